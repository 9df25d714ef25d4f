"""Every gripper on every robot is displayed, live and from a record."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest

import bt_dualarm
from bt_dualarm.core.errors import DivergenceError
from bt_dualarm.replay.record import Record
from bt_dualarm.robots.gripper import FINGERS, PALM
from bt_dualarm.robots.mjspec import CUP, joint_motors
from bt_dualarm.viewer.live_view import Snapshot
from bt_dualarm.viewer.past import RecordView
from tests.families import some
from tests.grippers.test_mounting import GRIPPERS
from tests.sim.worlds import ROBOTS, WIDE, WORLD, world_with

MOUNTED = [(robot, gripper) for robot in ROBOTS for gripper in (None, *GRIPPERS)]
SHOWN = [pair for pair in MOUNTED if pair[0] in WIDE or pair[1] == "panda_hand"]

TREE = """\
bt_dualarm: 1
name: gripper
world: {scene: empty, time_limit: 20}
arms:
  first:
    robot: ROBOT
    gripper: GRIPPER
    base: {xyz: [0, 0, 0.2]}
    tree:
      sequence: [{wait: {seconds: 0.06}}, {spawn: {arm: late}}, {wait: {seconds: 0.1}}]
  late:
    robot: ROBOT
    gripper: GRIPPER
    base: {xyz: [0, 3, 0.2]}
    spawned: false
    tree: {sequence: [{wait: {seconds: 0.04}}, {remove: {arm: late}}]}
"""


@pytest.mark.parametrize(("robot", "gripper"), some(MOUNTED, 3))
def test_joint_motors_of_an_arm_exclude_its_gripper(robot: str, gripper: str | None) -> None:
    """Found from the model alone, they are those that the robot description names."""
    world = world_with(robot, gripper=gripper)
    body = world.arms["arm1"]
    assert joint_motors(world.model, "arm1").tolist() == body.actuator_ids.tolist()
    assert joint_motors(world.model, "arm2").size == 0


@pytest.mark.parametrize(("robot", "gripper"), some(SHOWN, 7))
def test_gripper_is_displayed_live_and_from_its_record(
    robot: str, gripper: str | None, tmp_path: Path
) -> None:
    """Including arms spawned later; both views agree on the tool, and draw fingers or cups."""
    text = TREE.replace("ROBOT", robot).replace("GRIPPER", gripper or "none")
    tree = tmp_path / "gripper.yaml"
    tree.write_text(text)
    shutil.copytree(WORLD / "robots", tmp_path / "robots")  # descriptions beside the file
    shown = {}
    with bt_dualarm.open(tree, record=tmp_path / "out") as run:
        snapshot = Snapshot(run.world, run.assembly.arms, run.views)
        while not run.done:
            run.step(run.world.timestep)
            snapshot.take()
            shown[snapshot.now["time"]] = snapshot.now
        visuals = snapshot.looks
        bodies = {run.world.model.body(int(shape["body"])).name for shape in visuals.shapes}
    parts = () if gripper is None else (PALM, CUP if "suction" in gripper else FINGERS[0])
    assert {f"first/{part}" for part in parts} <= bodies
    record = Record.read(tmp_path / "out")
    view = RecordView(tmp_path / "out")
    seen = []
    for time in record.times.tolist():
        now = shown[round(time, 4)]
        then = view.past.moment(time)
        assert now["generation"] == then["generation"]
        for live, past in zip(now["arms"], then["arms"], strict=True):
            assert ("tool" in live) == ("tool" in past)
            if "tool" in live:
                seen.append((live["arm"], now["generation"]))
                assert np.allclose(live["tool"], past["tool"], atol=2e-4)
                assert live["error_deg"] == pytest.approx(past["error_deg"], abs=1e-3)
    assert {arm for arm, _ in seen} == {"first", "late"}
    for generation in {generation for _, generation in seen}:
        drawn = view.past.looks(generation).shapes
        model = record.model(generation)
        assert {f"first/{part}" for part in parts} <= {
            model.body(int(shape["body"])).name for shape in drawn
        }


@pytest.mark.parametrize("gripper", GRIPPERS)
def test_diverged_gripper_drive_is_not_reported_as_a_joint(gripper: str) -> None:
    """A cup's drive acts on a body, the fingers' drive on a tendon: their ids are not joint ids."""
    world = world_with("ur5", gripper=gripper)
    drive = world.model.actuator("arm1/gripper/drive").id

    def gone_wrong() -> bool:
        world.data.ctrl[drive] = np.nan
        return False

    world.devices.drive = gone_wrong  # type: ignore[method-assign]  # that is the fault
    with pytest.raises(DivergenceError, match="drive 'arm1/gripper/drive'"):
        world.step()
