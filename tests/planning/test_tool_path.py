from __future__ import annotations

import numpy as np
import pytest

from bt_dualarm.core.errors import Failure
from bt_dualarm.core.pose import Pose
from bt_dualarm.kinematics.inverse_kinematics import Kinematics
from bt_dualarm.planning.problem import joint_path, trace
from bt_dualarm.robots.robot_description import load_robot, robot_names
from bt_dualarm.trajectory.paths import Axes, circle, line
from bt_dualarm.trajectory.trajectory import use_of_limits

YZ: Axes = (np.array((0.0, 1.0, 0.0)), np.array((0.0, 0.0, 1.0)))


FULL_POSES = [name for name in robot_names() if len(load_robot(name).limits.velocity) >= 6]
"""Robots that reach every pose nearby: with five joints the tool's axis cannot be kept."""


@pytest.mark.parametrize("name", FULL_POSES)
def test_the_tool_follows_the_requested_circle(name: str) -> None:
    """Every set-point puts the tool on the circle to a twentieth of a millimeter, within limits."""
    robot = load_robot(name)
    arm = Kinematics(robot, Pose.identity())
    tool = arm.forward(robot.postures["home"])
    motion, shortest = trace(
        arm, circle(tool, YZ, 0.05), robot.postures["home"], robot.limits.scaled(0.5), 0.002
    )
    assert shortest < motion.duration < 1.3 * shortest
    assert use_of_limits(motion, robot.limits.scaled(0.5)).within
    for q in motion.q[::20]:
        pose = arm.forward(q)
        assert np.linalg.norm(pose.position - tool.position) == pytest.approx(0.05, abs=5e-5)
        assert pose.angle(tool) < 1e-3


def test_every_turn_repeats_the_joint_positions_of_the_first() -> None:
    robot = load_robot("panda")
    arm = Kinematics(robot, Pose.identity())
    path = circle(arm.forward(robot.postures["home"]), YZ, 0.05, turns=2)
    rows = joint_path(arm, path, robot.postures["home"])
    once = len(path.positions) - 1
    np.testing.assert_array_equal(rows[: once + 1], rows[once:])


def test_a_path_that_leaves_the_reach_is_refused_as_a_whole() -> None:
    robot = load_robot("ur5")
    arm = Kinematics(robot, Pose.identity())
    tool = arm.forward(robot.postures["home"])
    away = Pose(tool.position + np.array((0.65, 0.0, 0.0)), tool.quaternion)
    with pytest.raises(Failure, match=r"PATH_BROKEN|SINGULAR") as caught:
        trace(arm, line(tool, away), robot.postures["home"], robot.limits, 0.002)
    assert 0.0 < float(caught.value.numbers["fraction"]) < 0.8
