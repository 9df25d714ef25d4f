"""Targets that leave axes of the tool free: arms of five, six and seven joints."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from bt_dualarm.core.errors import Failure
from bt_dualarm.core.free_axes import AXES, FreeAxes, angle_to, nearest_allowed, pointing
from bt_dualarm.core.pose import Pose
from bt_dualarm.kinematics.inverse_kinematics import Kinematics
from bt_dualarm.kinematics.solver import EXACT, TOOL, FrameTask
from bt_dualarm.planning.problem import joint_path
from bt_dualarm.robots.robot_description import load_robot
from bt_dualarm.trajectory.paths import circle

ROBOTS = ("so100", "so101", "ur5", "panda")
FREE: tuple[FreeAxes, ...] = (("rx",), ("ry",), ("rz",), AXES)


def drawn(rng: np.random.Generator, free: FreeAxes) -> Pose:
    """A rotation about the free axes alone."""
    turns = [rng.uniform(-3.0, 3.0) if axis in free else 0.0 for axis in AXES]
    return Pose.from_rpy((0.0, 0.0, 0.0), turns)


@pytest.mark.parametrize("robot", ROBOTS)
@pytest.mark.parametrize("free", FREE, ids=" ".join)
def test_pose_rotated_about_its_free_axes_is_reached(robot: str, free: FreeAxes) -> None:
    """A reachable pose remains reachable after any rotation about its free axes."""
    arm = Kinematics(load_robot(robot), Pose.identity())
    rng = np.random.default_rng(1)
    for _ in range(6):
        q = rng.uniform(np.maximum(arm.lower, -np.pi), np.minimum(arm.upper, np.pi))
        there = arm.forward(q)
        target = there @ drawn(rng, free)
        found = arm.solve(target, arm.robot.postures["home"], free=free)
        reached = arm.forward(found)
        assert reached.distance(target) <= EXACT.position
        assert angle_to(reached, target, free) <= EXACT.angle
        assert (found >= arm.lower).all()
        assert (found <= arm.upper).all()


@pytest.mark.parametrize("free", [(), *FREE], ids=lambda free: " ".join(free) or "none")
def test_nearest_allowed_pose_is_allowed_and_nearest(free: FreeAxes) -> None:
    rng = np.random.default_rng(2)
    for _ in range(50):
        here, target = (
            Pose.from_rpy(rng.uniform(-1, 1, 3).tolist(), rng.uniform(-3, 3, 3).tolist())
            for _ in range(2)
        )
        nearest = nearest_allowed(here, target, free)
        assert nearest.distance(target) == pytest.approx(0.0, abs=1e-12)
        assert angle_to(nearest, target, free) == pytest.approx(0.0, abs=1e-7)
        for _ in range(20):
            other = target @ drawn(rng, free)
            assert here.angle(nearest) <= here.angle(other) + 1e-9
        assert here.angle(nearest) == pytest.approx(angle_to(here, target, free), abs=1e-7)


@pytest.mark.parametrize("free", FREE[:3], ids=" ".join)
def test_opposite_directions_are_half_a_turn_apart(free: FreeAxes) -> None:
    axis = pointing(free)
    assert axis is not None
    here = Pose.identity()
    across = np.roll(axis, 1)
    target = Pose(np.zeros(3), np.array((0.0, *across)))
    assert angle_to(here, target, free) == pytest.approx(np.pi)
    nearest = nearest_allowed(here, target, free)
    assert angle_to(nearest, target, free) == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize("robot", ROBOTS[:2])
def test_full_pose_that_five_joints_cannot_reach_is_refused_with_a_remedy(robot: str) -> None:
    """The tool is tilted out of the vertical plane of such an arm."""
    arm = Kinematics(load_robot(robot), Pose.identity())
    home = arm.robot.postures["home"]
    tilted = arm.forward(home) @ Pose.from_rpy((0.0, 0.0, 0.0), (0.3, 0.2, 0.0))
    # Not every skill has this port: `approach_and_attach` was advised to use it, too.
    remedy = r"5 joints cannot take every orientation: skills with the port `free`.*free: \[rz\]"
    with pytest.raises(Failure, match=remedy):
        arm.solve(tilted, home)
    assert arm.residual(arm.solve(tilted, home, free=AXES), tilted, AXES)[0] <= EXACT.position


@pytest.mark.parametrize("robot", ROBOTS)
def test_closed_path_with_free_axes_closes_in_the_joints(robot: str) -> None:
    """Joints that the path does not need end where they began, so that it can be repeated."""
    arm = Kinematics(load_robot(robot), Pose.identity())
    home = arm.robot.postures["home"]
    plane = (np.eye(3)[0], np.eye(3)[2])
    for free in ((), AXES) if arm.dof > 5 else (AXES,):
        path = replace(circle(arm.forward(home), plane, 0.02), free=free)
        rows = arm.follow(path.poses, home, free=free)
        assert np.abs(rows[-1] - rows[0]).max() < 1e-4, free
        along = joint_path(arm, path, home)
        assert np.abs(np.diff(along, axis=0)).max() < 0.2
        assert along[-1] == pytest.approx(along[0])


def test_only_a_target_in_the_world_has_free_axes() -> None:
    with pytest.raises(ValueError, match="only a target in the world"):
        FrameTask(TOOL, seen_from="other", free=("rz",))
