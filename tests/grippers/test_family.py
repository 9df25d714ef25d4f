"""Every gripper on every robot, well maintained or not, has its commanded force and speed."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest

from bt_dualarm.core.pose import Pose
from bt_dualarm.robots.gripper import Gripper, gripper_names
from bt_dualarm.robots.mjspec import DRIVE
from bt_dualarm.sim.grippers import GripperCommand
from bt_dualarm.sim.world import World
from bt_dualarm.spec.document import ObjectSpec
from bt_dualarm.spec.values import PoseSpec
from tests.families import some
from tests.grippers.fingers import FINGERED
from tests.grippers.test_drive import REALITIES, let_run, pressed
from tests.sim.worlds import ROBOTS, arm, file_of, world_with

TRAVEL_M = 0.010
"""Travel of the fingers until they touch the plate, m."""

GAIN = {"ideal": 0.0, "lab": 0.02, "rough": 0.05}
"""Largest relative error of a drive's force; docs/reality.md."""

PUMP = f"arm1/{DRIVE}"
SOLVER = 0.03
"""Relative fluctuation of MuJoCo's contact forces around the drive's."""


def world_before(robot: str, gripper: str, reality: str) -> World:
    """A world with a fixed plate, narrower than the open fingers or flat before the cup."""
    nominal = world_with(robot, gripper=gripper)
    description = nominal.grippers["arm1"].gripper
    tool = nominal.arms["arm1"].tool_pose
    size = (
        (0.04, description.stroke - TRAVEL_M, 0.02) if description.fingers else (0.08, 0.08, 0.02)
    )
    at = tool if description.fingers else tool @ Pose.from_rpy((0.0, 0.0, 0.5 * size[2] - 5e-4))
    pose = PoseSpec(xyz=tuple(at.position.tolist()), quat=tuple(at.quaternion.tolist()))
    plate = ObjectSpec(shape="box", size=size, mass=1.0, pose=pose, fixed=True)
    return World(file_of({"arm1": arm(robot, gripper=gripper)}, {"plate": plate}, reality=reality))


def half(description: Gripper) -> float:
    """Force in the middle of the gripper's range, N."""
    return 0.5 * (description.force.least + description.force.most)


@pytest.mark.parametrize(
    ("robot", "gripper", "reality"), some(product(ROBOTS, gripper_names(), REALITIES), 11)
)
def test_force_is_the_commanded_one(robot: str, gripper: str, reality: str) -> None:
    """The sensed force is the commanded one; the true one deviates by the drive's gain."""
    world = world_before(robot, gripper, reality)
    hardware = world.grippers["arm1"]
    description = hardware.gripper
    commanded = half(hardware.gripper)
    hardware.command(GripperCommand(0.0, description.speed.most, commanded))
    let_run(world, 0.6)
    assert hardware.force == pytest.approx(commanded, rel=0.01)
    true = (
        pressed(world)
        if description.fingers
        else float(world.data.actuator("arm1/gripper/drive").force[0])
    )
    assert true == pytest.approx(commanded, rel=GAIN[reality] + SOLVER)


@pytest.mark.parametrize(
    ("robot", "gripper", "reality"), some(product(ROBOTS, FINGERED, REALITIES), 5)
)
def test_speed_is_the_commanded_one(robot: str, gripper: str, reality: str) -> None:
    """Afterwards the fingers are at their commanded opening."""
    world = World(file_of({"arm1": arm(robot, gripper=gripper)}, reality=reality))
    hardware = world.grippers["arm1"]
    description = hardware.gripper
    speed = 0.5 * description.speed.most
    travel = 0.3 * description.stroke
    hardware.command(GripperCommand(description.stroke - travel, speed, description.force.most))
    seen = np.array(let_run(world, travel / speed + 0.2))
    steady = (
        round(0.3 * travel / speed / world.timestep),
        round(0.7 * travel / speed / world.timestep),
    )
    assert -seen[slice(*steady), 1] == pytest.approx(speed, rel=0.02)
    assert np.abs(seen[:, 1]).max() <= 1.02 * speed
    assert seen[-1, 0] == pytest.approx(description.stroke - travel, abs=2e-4)
