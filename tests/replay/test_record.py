"""Records: they hold all that is needed to replay a run, however it ended."""

from __future__ import annotations

import hashlib
import logging
import os
import signal
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest

import bt_dualarm
from bt_dualarm.replay.record import Record, ReplayError
from bt_dualarm.replay.rerun import check_record
from bt_dualarm.runtime.history_file import HistoryError
from bt_dualarm.skill.registry import Registry
from tests.families import some
from tests.faults.test_kill import ENDLESS, PROGRAM
from tests.replay.runs import PARTS, SHORT, recorded


@pytest.fixture(scope="module")
def short(tmp_path_factory: pytest.TempPathFactory) -> Record:
    return recorded(tmp_path_factory.mktemp("short"), seed=4)


def test_a_record_has_the_sources_of_its_run(short: Record) -> None:
    start = short.start
    assert list(start["texts"].values()) == [SHORT, PARTS]
    assert (short.name, start["seed"], start["timestep"]) == ("short", 4, 0.002)
    assert set(start["skills"]) == {"reach_to_pose"}
    skill = Path(start["skills"]["reach_to_pose"]["file"])
    digest = hashlib.sha256(skill.read_bytes()).hexdigest()
    assert start["skills"]["reach_to_pose"]["sha256"] == digest
    assert start["versions"]["mujoco"] == mujoco.__version__
    assert start["processor"]["arithmetic"]
    tree = short.arms["arm1"]["tree"]
    assert [child["place"] for child in tree["children"]] == [
        "short.yaml:14",
        "short.yaml:15",
        "short.yaml:16",
    ]


def test_its_states_are_those_that_were_hashed(short: Record) -> None:
    """The run's hash can be computed from the record: every state is stored exactly."""
    digest = hashlib.sha256()
    for number in range(len(short.times)):
        moment = short.moment(number)
        for part in (np.float64(moment.time), moment.qpos, moment.qvel):
            digest.update(part.tobytes())
    assert short.summary is not None
    assert short.end is not None
    assert digest.hexdigest() == short.summary["state_sha256"] == short.end["state_sha256"]


def test_every_step_has_its_checksum(short: Record) -> None:
    assert short.summary is not None
    assert short.steps == round(short.summary["sim_time_s"] / 0.002)
    assert len(short.checksums()) == short.steps


def test_the_run_can_be_stepped_on_from_a_whole_state(short: Record) -> None:
    """The whole state at the end of a block is the last one kept in it, in MuJoCo's own order."""
    block = short.seconds[0]
    model = short.model(0)
    data = mujoco.MjData(model)
    key = block.arrays["key"].astype(float)
    mujoco.mj_setState(model, data, key, mujoco.mjtState.mjSTATE_INTEGRATION)
    last = block.arrays["states"][-1]
    assert data.time == last[0] == pytest.approx(1.0, abs=0.003)
    np.testing.assert_array_equal(data.qpos, last[1 : 1 + model.nq])
    mujoco.mj_step(model, data)
    assert data.time > last[0]


def test_ports_and_keys_are_recorded_with_leaf_and_time(short: Record) -> None:
    ports = {note["leaf"]: note for note in short.notes if note["kind"] == "ports"}
    back = ports["sequence/reach_to_pose"]
    assert back["ports"]["offset"]["xyz"] == [0, 0.06, 0], "the key is looked up"
    assert back["time_s"] > 0.5
    [written] = [note for note in short.notes if note["kind"] == "wrote"]
    assert (written["leaf"], written["key"]) == ("sequence/set", "goal")
    assert written["value"] == {"xyz": [0, 0.06, 0]}


def test_set_points_and_torques_are_recorded(short: Record) -> None:
    row = short.arm_row("arm1", short.index_at(0.5))
    assert row is not None
    q, v, _, torque = row
    assert [len(part) for part in row] == [6] * 4
    np.testing.assert_allclose(q, short.moment(short.index_at(0.5)).qpos[-6:], atol=0.01)
    assert np.abs(v).max() < 3.2
    assert np.abs(torque).max() > 1.0
    assert short.arm_row("arm2", 0) is None


def test_a_time_outside_the_record_is_refused(short: Record) -> None:
    with pytest.raises(ReplayError, match=r"99 s is outside the record, which goes from 0 to"):
        short.index_at(99)
    with pytest.raises(ReplayError, match="-1 s is outside"):
        short.index_at(-1)


def test_a_run_that_was_killed_in_its_first_second_has_no_state(short: Record) -> None:
    with pytest.raises(ReplayError, match="contains no state: the first second of the run was"):
        replace(short, seconds=()).index_at(0.0)


def test_a_run_is_the_same_whether_it_is_recorded_or_not(short: Record) -> None:
    [main, *_] = short.start["texts"]
    plain = bt_dualarm.run(Path(main), seed=4)
    assert short.summary is not None
    assert plain.state_sha256 == short.summary["state_sha256"]


def test_camera_frames_and_detections_are_recorded(tmp_path: Path) -> None:
    bt_dualarm.run("visual_tracking", record=tmp_path, duration=3.0)
    record = Record.read(tmp_path)
    frames = [note for note in record.notes if note["kind"] == "frame"]
    looks = [note for note in record.notes if note["kind"] == "look"]
    assert 80 <= len(frames) <= 91, "30 Hz for three seconds"
    assert all(note["arm"] == "arm2" and note["crc"] for note in frames)
    assert looks[-1]["locked"]
    then = record.moment(record.index_at(looks[-1]["stamp"]))
    model = record.model(then.generation)
    address = model.joint(int(model.body("cube").jntadr[0])).qposadr[0]
    cube = then.qpos[address : address + 3]
    np.testing.assert_allclose(looks[-1]["point"], cube, atol=0.01)
    size = (tmp_path / "run.history").stat().st_size
    assert set(record.models) == {0, 1, 2}, "the cube was attached, the stand taken away"
    per_minute = 20 * sum(len(block.encoded()) for block in record.seconds)
    assert per_minute < 2e6
    assert size < 8e5, "the later models share parts with the first: alone each has 0.38 MB"


def test_a_folder_without_a_record_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ReplayError, match="there is no folder"):
        Record.read(tmp_path / "none")
    with pytest.raises(ReplayError, match=r"contains no record: there is no run\.history in it"):
        Record.read(tmp_path)
    (tmp_path / "run.history").write_bytes(b"bt_dualarm history 1\n")
    with pytest.raises(HistoryError, match="the run had barely begun"):
        Record.read(tmp_path)


def test_a_copy_without_its_events_is_refused(short: Record, tmp_path: Path) -> None:
    """Without them, nothing would seem to have failed."""
    for name in ("run.history", "summary.json"):
        (tmp_path / name).write_bytes((short.folder / name).read_bytes())
    with pytest.raises(HistoryError, match=r"not complete: there is no events\.jsonl in it"):
        Record.read(tmp_path)


def test_a_full_disk_keeps_what_was_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    """If half of a block fits, the run goes on, earlier blocks are readable, the end reports it."""
    write = os.write
    blocks = []

    def full(file: int, content: bytes) -> int:
        if b"BLCK" in content[:40]:
            blocks.append(content)
        if len(blocks) > 3 and file_of(file).endswith("run.history"):
            if content is blocks[-1]:
                return write(file, content[: len(content) // 2])
            raise OSError(28, "No space left on device")
        return write(file, content)

    monkeypatch.setattr("bt_dualarm.runtime.history_file.os.write", full)
    with pytest.raises(bt_dualarm.DualArmError, match="No space left on device"):
        recorded(tmp_path)
    record = Record.read(tmp_path / "out")
    assert record.until == pytest.approx(0.98, abs=0.03)
    assert "part of a block" in record.torn
    assert "the history is no longer written" in caplog.text


def file_of(descriptor: int) -> str:
    return str(Path(f"/proc/self/fd/{descriptor}").readlink())


@pytest.mark.slow
@pytest.mark.parametrize("lines", some([6, 11, 17], 2))
def test_a_run_that_is_killed_leaves_all_but_its_last_second(tmp_path: Path, lines: int) -> None:
    (tmp_path / "endless.yaml").write_text(ENDLESS)
    command = [sys.executable, "-c", PROGRAM, str(tmp_path / "endless.yaml"), "--display", "log"]
    options = {"stdout": subprocess.PIPE, "stderr": subprocess.DEVNULL, "text": True}
    folder = tmp_path / "out"
    with subprocess.Popen([*command, "--record", str(folder)], **options) as process:  # type: ignore[call-overload]
        for _ in range(lines):
            assert "arm1" in process.stdout.readline()
        process.send_signal(signal.SIGKILL)
    record = Record.read(folder)
    assert record.summary is None
    assert record.end is None
    last = record.events[-1]["time_s"]
    assert last - 1.0 <= record.until <= last + 1.0


def test_a_file_is_not_taken_for_a_missing_folder(tmp_path: Path) -> None:
    tree = tmp_path / "tree.yaml"
    tree.write_text("bt_dualarm: 1\n")
    with pytest.raises(ReplayError, match="is a file; a record is the folder of bt-run --record"):
        Record.read(tree)


class Odd(bt_dualarm.Skill):
    """Measures, writes, logs and fails with whatever Python allows."""

    class Outputs(bt_dualarm.PortModel):
        count: int = bt_dualarm.port(..., "a count")

    failures = {"ODD" * 50: "always"}  # noqa: RUF012 - as `Skill` declares it
    example = "odd"

    def run(self) -> bt_dualarm.Ticks:
        """Fail at the second tick."""
        yield
        logging.getLogger("bt_dualarm.odd").warning("read %s", os.fsdecode(b"caf\xe9.png"))
        self.output("count", 2**70)
        self.metrics |= {f"name {number}": number for number in range(1200)}
        self.metrics["tab\t, no-break space\u00a0, " + "long" * 100] = 2**64
        self.metrics[os.fsdecode(b"caf\xe9")] = os.fsdecode(b"caf\xe9.png")
        raise bt_dualarm.Failure("ODD" * 50, "reason " * 100_000)


def test_any_output_of_a_skill_can_be_read_back(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Otherwise the record would be lost."""
    # pytest-xdist cannot send the message that the skill logs.
    monkeypatch.setattr(logging.getLogger("bt_dualarm"), "propagate", False)
    tree = {
        "bt_dualarm": 1,
        "arms": {"arm1": {"robot": "ur5", "tree": {"odd": {"count": "{n}"}}}},
    }
    result = bt_dualarm.run(tree, skills=[Odd], record=tmp_path)
    assert result.arms["arm1"].leaves["odd"].code == "ODD" * 50
    data = bt_dualarm.load(tmp_path)
    (failed,) = (event for event in data.events if event["new"] == "FAILURE")
    assert failed["metrics"]["caf\\udce9"] == "caf\\udce9.png"
    assert failed["metrics"]["name 1199"] == 1199
    assert 2.0**64 in failed["metrics"].values()
    assert failed["reason"].startswith("reason reason")
    assert [value for _, value in data.blackboard("arm1")["n"]] == [2.0**70]
    assert "read caf\\udce9.png" in (tmp_path / "run.log").read_text()
    assert data.summary is not None
    assert data.summary["arms"]["arm1"]["outcome"] == "FAILURE"


@pytest.mark.parametrize(
    "name", ["no-break\u00a0space", "line\nbreak", os.fsdecode(b"caf\xe9"), "right to left \u202e"]
)
def test_the_path_of_the_tree_may_have_any_characters(name: str, tmp_path: Path) -> None:
    record = recorded(tmp_path / name, duration=0.2)
    assert check_record(record, Registry.load()).agrees
