"""Hot reload: a tree file that is saved during its run is applied if valid, else reported."""

from __future__ import annotations

import logging
import os
from pathlib import Path

import pytest

import bt_dualarm
from bt_dualarm.behaviors.report import NodeView
from bt_dualarm.replay.record import Record
from bt_dualarm.replay.rerun import check_record
from bt_dualarm.replay.timeline import Timeline
from bt_dualarm.runtime.api import registry_of
from bt_dualarm.runtime.run import FileWatch, Run
from bt_dualarm.viewer.past import PastView
from tests.replay.runs import PARTS, SHORT, write_short

REGISTRY = registry_of()

pytestmark = pytest.mark.usefixtures("without_plots")
LATER = SHORT.replace('reach_to_pose: {offset: "{goal}"}', "wait: {seconds: 0.2}")


class Edited:
    """A run whose file is watched, and saved by the test."""

    def __init__(self, folder: Path) -> None:
        self.path = write_short(folder / "trees")
        self.record = folder / "out"
        self.run = bt_dualarm.open(self.path, record=self.record)
        self.watch = FileWatch(self.run, self.path, REGISTRY, {})
        self.run.watch(self.watch)
        self._saved = 0

    def save(self, text: str, part: str = "short.yaml") -> None:
        """Save the file with a modification time of its own, and check it as the thread does."""
        path = self.path.with_name(part)
        path.write_text(text)
        self._saved += 1
        os.utime(path, (self._saved, self._saved))
        self.watch.look()


def running(run: Run) -> list[NodeView]:
    """Running leaves."""
    return [leaf for view in run.views() for leaf in _leaves(view.tree) if leaf.status == "RUNNING"]


def _leaves(node: NodeView | None) -> list[NodeView]:
    if node is None:
        return []
    return [leaf for child in node.children for leaf in _leaves(child)] or [node]


@pytest.fixture
def edited(tmp_path: Path) -> Edited:
    return Edited(tmp_path)


def test_a_leaf_that_is_unchanged_goes_on(edited: Edited) -> None:
    """Only a later leaf has changed: the motion goes on undisturbed."""
    with edited.run as run:
        run.step(0.3)
        [before] = [change.since for change in running(run)]
        edited.save(LATER)
        run.step(0.1)
        assert [change.since for change in running(run)] == [before]
        assert run.finish().outcome == "SUCCESS"
        kinds = [leaf.skill for leaf in run.result.arms["arm1"].runs]
        assert kinds == ["set", "reach_to_pose", "wait"]


def test_a_leaf_that_changed_is_halted_and_restarted(edited: Edited) -> None:
    with edited.run as run:
        run.step(0.3)
        edited.save(PARTS.replace("-0.06", "-0.03"), "parts.yaml")
        assert run.finish().outcome == "SUCCESS"
        runs = [(leaf.skill, leaf.code) for leaf in run.result.arms["arm1"].runs]
        assert runs == [
            ("set", ""),
            ("reach_to_pose", "HALTED"),
            ("reach_to_pose", ""),
            ("reach_to_pose", ""),
        ]


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        (SHORT.replace("reach_to_pose", "reach_to_pos"), "did you mean 'reach_to_pose'?"),
        (SHORT.replace("sequence:", "sequence"), "short.yaml:"),
        (SHORT.replace("mass: 1", "mass: 2"), "objects: during a run, only trees"),
        (SHORT.replace("[0, 0, 0.4]", "[0, 0, 0.5]"), "arms.arm1: during a run"),
        (SHORT.replace("time_limit: 20", "time_limit: 21"), "world: during a run"),
        (SHORT + "goal: {there: {tool: arm1, height: [0, 1]}}\n", "goal: during a run"),
        (SHORT + "never: {high: {tool: arm1, height: [2, 3]}}\n", "never: during a run"),
        (SHORT + "faults: {jam: {arm: arm1, leaf: set}}\n", "faults: during a run"),
    ],
)
def test_an_edit_that_cannot_be_applied_is_reported_and_the_run_goes_on(
    edited: Edited, text: str, expected: str, caplog: pytest.LogCaptureFixture
) -> None:
    plain = bt_dualarm.run(edited.path).state_sha256
    with edited.run as run, caplog.at_level(logging.INFO, "bt_dualarm"):
        run.step(0.3)
        edited.save(text)
        assert run.finish().state_sha256 == plain
    assert expected in caplog.text


def test_an_equivalent_file_changes_nothing(edited: Edited) -> None:
    plain = bt_dualarm.run(edited.path).state_sha256
    with edited.run as run:
        run.step(0.3)
        edited.save("# a remark\n" + SHORT)
        run.step(0.1)
        edited.watch.look()
        assert run.finish().state_sha256 == plain


def test_a_tree_that_has_ended_stays_unchanged(
    edited: Edited, caplog: pytest.LogCaptureFixture
) -> None:
    with edited.run as run, caplog.at_level(logging.INFO, "bt_dualarm"):
        run.step(0.3)
        run.finish()
        edited.save(LATER)
        edited.watch.take()
        assert run.result.outcome == "SUCCESS"
    assert "its tree has ended" in caplog.text


def test_the_record_contains_the_edit(edited: Edited) -> None:
    """Its trees are those of each time; the check compares it up to the edit."""
    with edited.run as run:
        run.step(0.3)
        edited.save(LATER)
        run.finish()
    record = Record.read(edited.record)
    kinds = [[node.kind for node in Timeline(record, at).leaves()] for at in (0.2, None)]
    assert [each[-1] for each in kinds] == ["reach_to_pose", "wait"]
    past = PastView(edited.record)
    shown = [past.moment(at)["arms"][0]["nodes"][-1]["kind"] for at in (0.2, record.until)]
    assert shown == ["reach_to_pose", "wait"]
    assert past.moment(record.until)["arms"][0]["nodes"][-1]["status"] == "SUCCESS"
    agreement = check_record(record, REGISTRY)
    assert agreement.agrees
    assert agreement.until_s == pytest.approx(0.3, abs=0.01)


@pytest.mark.parametrize("saved", ["other.csv", "line.csv"])
def test_a_path_file_is_read_with_the_edit(edited: Edited, saved: str) -> None:
    """A name that is new and a file that has changed; the record contains both as edits."""
    leaf = "follow_path: {file: FILE, scale: 0.001, tool_speed: 0.05}"
    text = SHORT.replace('reach_to_pose: {offset: "{goal}"}', leaf)
    edited.path.with_name("line.csv").write_text("0, 0\n20, 0\n")
    edited.path.with_name("other.csv").write_text("0, 0\n30, 0\n")
    edited.save(text.replace("FILE", "./line.csv"))
    with edited.run as run:
        run.step(0.1)
        if saved == "line.csv":
            edited.save("0, 0\n30, 0\n", saved)
        else:
            edited.save(text.replace("FILE", saved))
        run.step(0.1)
        assert run.finish().outcome == "SUCCESS"
        leaf_run = run.result.arms["arm1"].runs[-1]
        assert leaf_run.metrics["path_length_m"] == pytest.approx(0.03)
    notes = [note for note in Record.read(edited.record).notes if note["kind"] == "edited"]
    assert len(notes) == 2


def test_the_file_must_be_valid_at_first(tmp_path: Path) -> None:
    edited = Edited(tmp_path)
    with edited.run as run:
        edited.path.write_text("nonsense")
        with pytest.raises(bt_dualarm.SpecError):
            FileWatch(run, edited.path, REGISTRY, {})


SKILL = '''"""Waits two ticks."""
from bt_dualarm import Skill
class Dawdle(Skill):
    """Wait two ticks."""
    example = "dawdle"
    def run(self):
        """Wait."""
        yield
        yield
'''


def test_a_skill_that_is_saved_is_reported_once(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    """Of two skills in the folder, only the one in the tree; the run goes on with the old code."""
    skills = tmp_path / "own"
    skills.mkdir()
    for name in ("Dawdle", "Idle"):
        (skills / f"{name.lower()}.py").write_text(SKILL.replace("Dawdle", name))
    registry = registry_of([skills])
    path = write_short(tmp_path / "trees", LATER.replace("wait: {seconds: 0.2}", "dawdle"))
    with bt_dualarm.open(path, skills=[skills]) as run, caplog.at_level(logging.INFO, "bt_dualarm"):
        watch = FileWatch(run, path, registry, {})
        run.watch(watch)
        for name in ("dawdle.py", "idle.py"):
            (skills / name).write_text("nonsense(")
            os.utime(skills / name, (1, 1))
        for _ in range(3):
            watch.look()
            run.step(0.1)
        assert run.finish().outcome == "SUCCESS"
    messages = [record.message for record in caplog.records if "was saved" in record.message]
    assert messages == [
        f"{skills / 'dawdle.py'} was saved: skill code takes effect in the next run"
    ]
