"""Record check: a repeated run is the same, or the first different step and number are reported."""

from __future__ import annotations

import dataclasses
import json
import time
from collections.abc import Iterator
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest

import bt_dualarm
from bt_dualarm import cli
from bt_dualarm.replay.record import Record
from bt_dualarm.replay.rerun import check_record
from bt_dualarm.skill.registry import Registry
from tests.replay.runs import recorded

REGISTRY = Registry.load()


@pytest.fixture(scope="module")
def short(tmp_path_factory: pytest.TempPathFactory) -> Record:
    return recorded(tmp_path_factory.mktemp("short"), seed=4, reality="lab")


def with_text(record: Record, old: str, new: str) -> Record:
    """A record whose tree is not the one that was run."""
    (name, text), *rest = record.start["texts"].items()
    assert old in text
    start = {**record.start, "texts": {name: text.replace(old, new), **dict(rest)}}
    return dataclasses.replace(record, start=start)


def test_the_same_run_agrees_to_the_last_step_and_hash(short: Record) -> None:
    found = check_record(short, REGISTRY)
    assert found.agrees
    assert (found.steps, found.hash_agrees) == (short.steps, True)
    assert found.changed == ()


PARAMETER = """\
bt_dualarm: 1
world: {scene: empty}
params: {far: {type: number, default: 0.05}}
arms: {arm1: {robot: ur5, tree: {reach_to_pose: {offset: {xyz: [0, 0, "{far}"]}}}}}
"""

WEAK = {"kind": "weak_joint", "arm": "arm1", "joint": "elbow_joint"}


@pytest.mark.parametrize(
    "options",
    [
        {"params": {"far": 0.0567890123456789}},
        {"params": {"far": np.float32(0.0567)}},
        {"duration": Fraction(1, 3)},
        {"duration": np.float32(0.3)},
        {"reality": {"set": "lab", "drive": {"delay": np.float32(0.0021)}}},
        {"faults": {"weak": {**WEAK, "strength": 0.1234567890123}}},
    ],
    ids=str,
)
def test_numbers_that_a_run_was_given_are_recorded_exactly(
    tmp_path: Path, options: dict[str, object]
) -> None:
    found = check_record(recorded(tmp_path, PARAMETER, **options), REGISTRY)
    assert found.agrees, found.difference


def test_another_goal_differs_where_the_leaf_begins(short: Record) -> None:
    """The goal is 0.1 µm away: the joints differ from the beginning of the motion."""
    [set_, go] = [
        event["time_s"] for event in short.events if event["path"] == "sequence/reach_to_pose"
    ]
    found = check_record(with_text(short, "[0, 0.06, 0]", "[0, 0.0600001, 0]"), REGISTRY)
    assert not found.agrees
    assert found.difference is not None
    assert set_ < found.difference.time_s < go
    assert found.difference.numbers[0].name.startswith(("position of arm1/", "velocity of arm1/"))
    assert abs(found.difference.numbers[0].now - found.difference.numbers[0].recorded) < 1e-3
    assert found.difference.doing == ("arm1:sequence", "arm1:sequence/reach_to_pose")


def test_another_event_is_reported(short: Record) -> None:
    found = check_record(with_text(short, "set: {key", "set: {name: other, key"), REGISTRY)
    assert found.difference is not None
    assert found.difference.event == (
        "arm1:sequence/set → SUCCESS at 0.000 s in the record; "
        "now arm1:sequence/other → SUCCESS at 0.000 s"
    )


def test_other_objects_differ_in_their_count(short: Record) -> None:
    old = "  ball: {"
    more = "  box: {shape: box, size: [0.1, 0.1, 0.1], mass: 1, pose: {xyz: [2, 2, 1]}}\n"
    found = check_record(with_text(short, old, more + old), REGISTRY)
    assert found.difference is not None
    assert found.difference.step == 1
    assert found.difference.numbers[0].name == "count of positions"


def test_a_run_that_was_closed_agrees_until_then(tmp_path: Path, short: Record) -> None:
    with bt_dualarm.open(next(iter(short.start["texts"])), record=tmp_path) as run:
        run.step(0.5)
    found = check_record(Record.read(tmp_path), REGISTRY)
    assert found.agrees
    assert (found.steps, found.hash_agrees) == (250, None)


REMOVING = """\
bt_dualarm: 1
name: removing
world: {scene: empty, time_limit: 20}
arms:
  arm1:
    robot: ur5
    tree:
      sequence: [{wait: 0.2}, {remove: {arm: arm2}}, {reach_to_pose: {offset: {xyz: [0, 0, 0.1]}}}]
  arm2: {robot: ur3, base: {xyz: [0, 2, 0]}, tree: {wait: 9}}
"""


@pytest.mark.parametrize("is_killed", [False, True])
def test_the_removal_of_an_arm_by_a_tree_is_no_intervention(
    tmp_path: Path, is_killed: bool
) -> None:
    """It is repeated, so the record is compared beyond it, up to where the run was closed."""
    with bt_dualarm.open(REMOVING, record=tmp_path) as run:
        run.step(0.5)
    if is_killed:
        (tmp_path / "summary.json").unlink()
        events = (tmp_path / "events.jsonl").read_text().splitlines(keepends=True)
        (tmp_path / "events.jsonl").write_text("".join(one for one in events if "0.5," not in one))
    found = check_record(Record.read(tmp_path), REGISTRY)
    assert found.agrees
    assert found.steps == 250


def test_an_include_that_has_changed_since_is_taken_from_the_record(tmp_path: Path) -> None:
    record = recorded(tmp_path)
    (tmp_path / "parts.yaml").write_text("bt_dualarm: 1\n")
    found = check_record(record, REGISTRY)
    assert found.agrees
    (changed,) = found.changed
    assert changed.endswith("parts.yaml, which the tree includes, has changed")


def test_the_command_reports_agreement(short: Record, capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.replay([str(short.folder), "--check"]) == 0
    out = capsys.readouterr().out
    until = f"{short.steps} steps, {short.steps * 0.002:.3f} s"
    assert out == f"the same: {until}, and the hash of all states\n"
    assert cli.replay([str(short.folder), "--check", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["agrees"] is True


def test_a_difference_exits_with_code_1(
    short: Record, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    other = recorded(tmp_path, seed=5, reality="lab")
    history = (other.folder / "run.history").read_bytes()
    assert history != (short.folder / "run.history").read_bytes()
    events = (other.folder / "events.jsonl").read_text().replace("SUCCESS", "FAILURE", 1)
    (other.folder / "events.jsonl").write_text(events)
    assert cli.replay([str(other.folder), "--check"]) == 1
    out = capsys.readouterr().out
    assert "differs at step 0, 0.000 s" in out
    assert "→ FAILURE at 0.000 s in the record; now arm1:sequence/set → SUCCESS at 0.000 s" in out


def test_a_missing_record_exits_with_code_2(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert cli.replay([str(tmp_path), "--check"]) == 2
    assert "contains no record" in capsys.readouterr().err
    assert cli.replay([str(tmp_path)]) == 2
    assert "contains no record" in capsys.readouterr().err
    with pytest.raises(SystemExit) as ended:
        cli.replay([str(tmp_path), "--json"])
    assert ended.value.code == 2


def test_a_run_that_the_watchdog_ended_agrees_until_then(tmp_path: Path) -> None:
    """The wall clock ended it; the repeated run does not wait for the tick that hung."""

    class Hang(bt_dualarm.Skill):
        """Hang within a tick until it is interrupted."""

        class Ports(bt_dualarm.PortModel):
            """None."""

        example = "hang"

        def run(self) -> Iterator[None]:
            for _ in range(10):
                yield
            time.sleep(5)

    text = "bt_dualarm: 1\nworld: {scene: empty}\narms: {arm1: {robot: ur3, tree: hang}}\n"
    result = bt_dualarm.run(text, record=tmp_path, skills=[Hang], watchdog=0.5)
    assert result.ending is bt_dualarm.Ending.OVERRUN
    found = check_record(Record.read(tmp_path), Registry.load((), [Hang]))
    assert found.agrees
    assert found.until_s == pytest.approx(0.2)
