"""Every gripper on every robot, well kept or neglected: the force and the speed asked for."""

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

WAY_M = 0.010
"""That fingers go until they meet the plate."""

GAIN = {"ideal": 0.0, "lab": 0.02, "rough": 0.05}
"""Most that a drive's force is off; docs/reality.md."""

PUMP = f"arm1/{DRIVE}"
SOLVER = 0.03
"""Share by which MuJoCo's contact forces tremble around the drive's."""


def world_before(robot: str, gripper: str, reality: str) -> World:
    """A plate held in place: a little narrower than the open fingers, or flat before the cup."""
    nominal = world_with(robot, gripper=gripper)
    page = nominal.grippers["arm1"].gripper
    tool = nominal.arms["arm1"].tool_pose
    size = (0.04, page.stroke - WAY_M, 0.02) if page.fingers else (0.08, 0.08, 0.02)
    at = tool if page.fingers else tool @ Pose.from_rpy((0.0, 0.0, 0.5 * size[2] - 5e-4))
    pose = PoseSpec(xyz=tuple(at.position.tolist()), quat=tuple(at.quaternion.tolist()))
    plate = ObjectSpec(shape="box", size=size, mass=1.0, pose=pose, fixed=True)
    return World(file_of({"arm1": arm(robot, gripper=gripper)}, {"plate": plate}, reality=reality))


def half(page: Gripper) -> float:
    """Force in the middle of what it can do, N."""
    return 0.5 * (page.force.least + page.force.most)


@pytest.mark.parametrize(
    ("robot", "gripper", "reality"), some(product(ROBOTS, gripper_names(), REALITIES), 11)
)
def test_force(robot: str, gripper: str, reality: str) -> None:
    """What is sensed is what was asked for; what is pressed, but for the drive's gain."""
    world = world_before(robot, gripper, reality)
    hardware = world.grippers["arm1"]
    page = hardware.gripper
    asked = half(hardware.gripper)
    hardware.command(GripperCommand(0.0, page.speed.most, asked))
    let_run(world, 0.6)
    assert hardware.force == pytest.approx(asked, rel=0.01)
    true = (
        pressed(world)
        if page.fingers
        else float(world.data.actuator("arm1/gripper/drive").force[0])
    )
    assert true == pytest.approx(asked, rel=GAIN[reality] + SOLVER)


@pytest.mark.parametrize(
    ("robot", "gripper", "reality"), some(product(ROBOTS, FINGERED, REALITIES), 5)
)
def test_speed(robot: str, gripper: str, reality: str) -> None:
    """On the way; and then the fingers are where they were told to be."""
    world = World(file_of({"arm1": arm(robot, gripper=gripper)}, reality=reality))
    hardware = world.grippers["arm1"]
    page = hardware.gripper
    speed = 0.5 * page.speed.most
    way = 0.3 * page.stroke
    hardware.command(GripperCommand(page.stroke - way, speed, page.force.most))
    seen = np.array(let_run(world, way / speed + 0.2))
    under_way = round(0.3 * way / speed / world.timestep), round(0.7 * way / speed / world.timestep)
    assert -seen[slice(*under_way), 1] == pytest.approx(speed, rel=0.02)
    assert np.abs(seen[:, 1]).max() <= 1.02 * speed
    assert seen[-1, 0] == pytest.approx(page.stroke - way, abs=2e-4)
