"""Checks, plans and the guard's spheres use the fingers' positions from the encoder."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest

from bt_dualarm.collision.checker import CollisionChecker
from bt_dualarm.collision.distance import ArmDistance, BoundingSpheres
from bt_dualarm.core.pose import Pose, Vector
from bt_dualarm.kinematics.inverse_kinematics import Kinematics
from bt_dualarm.planning.problem import straight_motion
from bt_dualarm.robots.gripper import FINGERS
from bt_dualarm.sim.grippers import GripperCommand
from bt_dualarm.sim.world import World
from bt_dualarm.spec.document import ObjectSpec
from bt_dualarm.spec.values import PoseSpec
from tests.arm.test_arm import Bench
from tests.control.walls import problem_in
from tests.families import some
from tests.grippers.fingers import FINGERED, opened
from tests.sim.worlds import ROBOTS, arm, file_of, world_with

TURN_RAD = 0.5
THICK_M = 0.008
BESIDE_M = 0.010
"""Distance from the pad's face of an open finger outwards to the middle of the post, m.

It lies within the finger.
"""

ASIDE_M = 0.04
"""Distance sideways and forward from an open finger to the tool of another arm, m."""

NEARER_M = 0.005
"""Least reduction of the distance by open fingers, m: closed, another link is the nearest."""


def beside_a_post(robot: str, gripper: str) -> tuple[World, Vector]:
    """A world with a post, and a configuration in which only an open finger touches it."""
    bare = world_with(robot, gripper=gripper)
    body = bare.arms["arm1"]
    there = body.q.copy()
    there[0] += TURN_RAD * (1.0 if there[0] < 0.5 * body.robot.limits.upper[0] else -1.0)
    tool = Kinematics(body.robot, body.base).forward(there)
    aside = 0.5 * bare.grippers["arm1"].gripper.stroke + BESIDE_M
    at = tool.apply(np.array((0.0, aside, 0.0)))
    pose = PoseSpec(xyz=tuple(at.tolist()), quat=tuple(tool.quaternion.tolist()))
    post = ObjectSpec(shape="box", size=(THICK_M,) * 3, mass=1.0, pose=pose, fixed=True)
    world = World(file_of({"arm1": arm(robot, gripper=gripper)}, {"post": post}))
    return world, there


@pytest.mark.parametrize(("robot", "gripper"), some(product(ROBOTS, FINGERED), 3))
def test_configuration_free_with_closed_fingers_collides_with_open_ones(
    robot: str, gripper: str
) -> None:
    """The encoder's position counts, not the true one."""
    world, there = beside_a_post(robot, gripper)
    stroke = world.grippers["arm1"].gripper.stroke
    for true in (0.0, stroke):
        opened(world, true, sensed=0.0)
        assert CollisionChecker(world, "arm1").contact(there) is None
        opened(world, true, sensed=stroke)
        contact = CollisionChecker(world, "arm1").contact(there)
        assert contact is not None
        assert contact.first in {f"arm1/{finger}" for finger in FINGERS}
        assert contact.second == "post"


@pytest.mark.parametrize("gripper", FINGERED)
def test_motion_free_with_closed_fingers_is_refused_with_open_ones(gripper: str) -> None:
    world, there = beside_a_post("ur5", gripper)
    here = world.hardware["arm1"].q.copy()
    stroke = world.grippers["arm1"].gripper.stroke
    opened(world, 0.0)
    assert straight_motion(problem_in(world, here, there)) is not None
    opened(world, stroke)
    assert straight_motion(problem_in(world, here, there)) is None


@pytest.mark.parametrize("gripper", FINGERED)
def test_spheres_of_the_guard_move_with_the_fingers(gripper: str) -> None:
    """Spheres that were made once contain the pads at each opening and bound their motion."""
    world = world_with("ur5", gripper=gripper)
    stroke = world.grippers["arm1"].gripper.stroke
    opened(world, 0.0)
    hull = BoundingSpheres(world, "arm1")
    closed = hull.spheres()
    opened(world, stroke)
    away = np.linalg.norm(hull.spheres() - closed, axis=1)
    assert away.max() == pytest.approx(0.5 * stroke, abs=5e-4)
    assert np.count_nonzero(away > 1e-3) < len(away)
    last = world.model.joint(f"arm1/{world.robots['arm1'].joints[-1]}").id
    wrist = world.data.xanchor[last]
    spheres = hull.spheres()[away > 1e-3]
    far = np.linalg.norm(spheres[:, :3] - wrist, axis=1) + spheres[:, 3]
    assert far.max() <= hull.spans[-1] + 1e-9


@pytest.mark.parametrize("gripper", FINGERED)
def test_distance_of_arms_includes_their_fingers(gripper: str) -> None:
    """An open finger is nearest to another arm's tool that points diagonally at it."""
    arms = {"arm1": arm("ur5", gripper=gripper), "arm2": arm("ur5", (0.9, 0.4, 0.4), 180.0)}
    world = World(file_of(arms))
    here = world.arms["arm1"].tool_pose
    other = world.arms["arm2"]
    stroke = world.grippers["arm1"].gripper.stroke
    goal = here @ Pose.from_rpy((0.0, 0.5 * stroke + ASIDE_M, ASIDE_M), (0.75 * np.pi, 0, 0))
    kinematics = Kinematics(other.robot, other.base)
    world.data.qpos[other.qpos_ids] = kinematics.solve(goal, other.q)
    near = []
    for width in (0.0, stroke):
        opened(world, width)
        near.append(ArmDistance(world, "arm1").gap({}))
    assert 0.0 < near[1].meters < near[0].meters - NEARER_M
    assert near[1].first in {f"arm1/{finger}" for finger in FINGERS}


@pytest.mark.parametrize(
    ("robot", "gripper"), some(product(("ur5", "panda", "xarm7", "ur10e"), FINGERED), 3)
)
def test_plans_are_for_fingers_as_far_apart_as_they_are_opening_to(
    robot: str, gripper: str
) -> None:
    """A plan that was made while they opened led an open finger against a post."""
    world, there = beside_a_post(robot, gripper)
    bench = Bench(robot=robot, gripper=gripper, post=world.declared_objects["post"])
    opened(bench.world, 0.0)
    hardware = bench.world.grippers["arm1"]
    description = hardware.gripper
    speed, force = description.speed.most, description.force.least
    hardware.command(GripperCommand(0.0, speed, force))
    assert bench.first.checker().free(there)
    hardware.command(GripperCommand(description.stroke, speed, force))
    assert hardware.width < 0.5 * description.stroke
    assert not bench.first.checker().free(there)
