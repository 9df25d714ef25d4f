"""Arms that wait for each other: in records, web pages, explanations, replay and resume."""

from __future__ import annotations

from pathlib import Path

import pytest

import bt_dualarm as bt
from bt_dualarm.behaviors.report import NodeView
from bt_dualarm.diagnosis.story import stories
from bt_dualarm.replay.record import Record
from bt_dualarm.replay.timeline import Timeline
from bt_dualarm.runtime.arm_runtime import RunView
from bt_dualarm.runtime.display import draw_tree
from bt_dualarm.runtime.report import UNICODE
from bt_dualarm.viewer.events import rows_at, rows_of
from tests.matrix.recordings import output_of
from tests.no_plots import no_plots

TREE = """
bt_dualarm: 1
name: waiting
world: {scene: empty, time_limit: 2}
cell:
  signals: {done: {type: integer, written_by: [arm1], initial: 0}}
  zones: {bin: {size: [0.2, 0.2, 0.2]}}
  rendezvous: {handover: [arm1, arm2]}
arms:
  arm1:
    robot: ur5
    gripper: robotiq_2f85
    tree:
      sequence:
        - claim: {zone: bin, child: {wait: 0.5}}
        - signal: {signal: done, value: 1}
        - compare: {value: 1, to: 2}
        - meet: handover
  arm2:
    robot: panda
    base: {xyz: [1.5, 0, 0]}
    tree: {selector: [meet: handover, {claim: {zone: bin, child: {wait: 10}}}]}
  arm3:
    robot: ur3
    base: {xyz: [-1.5, 0, 0]}
    tree:
      sequence:
        - await: {signal: done, relation: greater, to: 0, value: "{count}"}
        - log: "{count} done"
        - wait: 0.3
        - claim: {zone: bin, child: {wait: 10}}
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The record of a run that ends at its time limit, with two arms at the bin."""
    parent = tmp_path_factory.mktemp("waiting")
    (parent / "waiting.yaml").write_text(TREE)
    with no_plots():
        bt.run(parent / "waiting.yaml", record=parent / "record")
    return parent / "record"


def waiting_at(record: Record, time: float) -> dict[str, str]:
    """What each node waits for at a time, by arm and path, as the web page of a record shows it."""
    timeline = Timeline(record)
    return {
        f"{arm}:{row['path']}": str(row["waiting"])
        for arm, root in timeline.roots.items()
        for row in rows_at(root, time, record.notes)
        if row["waiting"]
    }


def test_a_page_of_the_record_shows_who_waits_for_whom(folder: Path) -> None:
    record = Record.read(folder)
    assert waiting_at(record, 0.3) == {
        "arm2:selector/meet": "waits at 'handover' for arm1 since 0.00 s",
        "arm3:sequence/await": "waits for signal 'done' of arm1 since 0.00 s",
    }
    assert waiting_at(record, 1.5) == {
        "arm3:sequence/claim": "waits for zone bin, claimed by arm2, since 0.84 s"
    }


class Waits:
    """Observer that stores after each tick the time, and what nodes wait for on a live page."""

    def __init__(self) -> None:
        self.seen: list[tuple[float, dict[str, str]]] = []

    def on_event(self, change: object) -> None:
        """Do nothing."""

    def after_ticks(self, run: RunView) -> None:
        """Store the sentences."""
        rows = {
            f"{view.name}:{row['path']}": str(row["waiting"])
            for view in run.views()
            for row in rows_of(view.tree)
            if row["waiting"]
        }
        self.seen.append((run.time, rows))

    def after_step(self, time: float) -> None:
        """Do nothing."""


@pytest.mark.parametrize(("tree", "seconds"), [("carry_together", 6.0), ("handover", 9.0)])
def test_a_page_of_the_record_agrees_with_the_live_one(
    tree: str, seconds: float, tmp_path: Path
) -> None:
    """Also after the wait of a leaf that goes on, as that of the arm that came first."""
    live = Waits()
    with no_plots(), bt.open(f"trees/{tree}.yaml", duration=seconds, record=tmp_path / "r") as run:
        run.watch(live)
        run.finish()
    record = Record.read(tmp_path / "r")
    for time, rows in live.seen[:-1]:  # at the end the trees are halted
        assert waiting_at(record, time) == rows, time
    assert any(rows for _, rows in live.seen)
    assert any(not rows for _, rows in live.seen)


class Views:
    """Observer that stores the trees at one time of a run."""

    def __init__(self, at: float) -> None:
        self.at = at
        self.trees: dict[str, NodeView] = {}

    def on_event(self, change: object) -> None:
        """Do nothing."""

    def after_ticks(self, run: RunView) -> None:
        """Store the trees."""
        if not self.trees and run.time >= self.at:
            self.trees = {view.name: view.tree for view in run.views() if view.tree is not None}

    def after_step(self, time: float) -> None:
        """Do nothing."""


def test_a_live_page_and_the_terminal_show_who_waits_for_whom(folder: Path) -> None:
    views = Views(0.3)
    with bt.open(folder.parent / "waiting.yaml", duration=0.4) as run:
        run.watch(views)
        run.finish()
    sentence = "waits at 'handover' for arm1 since 0.00 s"
    (row,) = [row for row in rows_of(views.trees["arm2"]) if row["waiting"]]
    assert (row["path"], row["waiting"]) == ("selector/meet", sentence)
    for width in (120, 44):  # beside its node, and in lines below it
        lines = draw_tree(views.trees["arm2"], 0.3, width, 30, UNICODE)
        output = " ".join(line.plain.strip(" │") for line in lines)
        assert sentence in " ".join(output.split())


def test_the_explanation_names_what_the_other_arm_did(folder: Path) -> None:
    reported = {story.arm: story for story in stories(Record.read(folder))}
    assert reported["arm1"].leaf == "sequence/compare"
    assert reported["arm3"].leaf == "sequence/claim"
    assert reported["arm3"].status == "HALTED"
    cause = reported["arm3"].causes[0]
    assert cause.kind == "OTHER_ARM"
    assert cause.leaf == "selector/claim/wait"
    (meeting,) = stories(Record.read(folder), "selector/meet")
    assert meeting.code == "PARTNER_GONE"
    assert meeting.causes[0].leaf == "sequence/compare"
    assert "arm1 had failed at 0.52 s" in meeting.causes[0].sentence


def test_a_wait_that_the_reason_states_is_not_stated_twice(tmp_path: Path) -> None:
    writer = {"robot": "ur3", "tree": {"sequence": [{"wait": 0.1}, "fail"]}}
    reader = {"robot": "ur3", "base": {"xyz": [2, 0, 0]}, "tree": {"await": "done"}}
    signals = {"done": {"type": "boolean", "written_by": ["arm1"], "initial": False}}
    file = {"bt_dualarm": 1, "world": {"scene": "empty"}, "cell": {"signals": signals}}
    with no_plots():
        bt.run(file | {"arms": {"arm1": writer, "arm2": reader}}, record=tmp_path / "record")
    (waiting,) = stories(Record.read(tmp_path / "record"), "await")
    assert waiting.code == "PARTNER_GONE"
    sentence = waiting.causes[0].sentence
    assert sentence.startswith("arm2 waits for signal 'done' of arm1 since 0.00 s: arm1 had failed")


def test_the_run_is_repeated_and_resumed_bit_for_bit(folder: Path, tmp_path: Path) -> None:
    assert output_of("bt-replay", folder, "--check").code == 0
    digest = (Record.read(folder).summary or {})["state_sha256"]
    with no_plots():
        output = output_of("bt-run", "--resume", f"{folder}@0.7", "--record", tmp_path / "again")
    assert output.code == 1, "one tree fails"
    assert (Record.read(tmp_path / "again").summary or {})["state_sha256"] == digest
