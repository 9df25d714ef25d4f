"""The summary of a robot is correct."""

from __future__ import annotations

import numpy as np
import pytest

from bt_dualarm.cli.bt_skills import direction, robot_summary
from bt_dualarm.core.pose import Pose
from bt_dualarm.kinematics.inverse_kinematics import Workspace
from bt_dualarm.robots.robot_description import load_robot
from tests.families import some
from tests.sim.worlds import ROBOTS, WORLD


@pytest.mark.parametrize("name", some(ROBOTS, 2))
def test_no_configuration_is_beyond_the_reach(name: str) -> None:
    """Sampled configurations within the joint limits are; the reach is within the bounding ball."""
    arm = Workspace(load_robot(name, WORLD), Pose.identity())
    farthest = arm.farthest()
    center, radius = arm.bounding_ball
    shares = np.random.default_rng(1).random((500, arm.dof))
    tools = [arm.forward(arm.lower + share * (arm.upper - arm.lower)) for share in shares]
    distances = [np.linalg.norm(tool.position - center) for tool in tools]
    assert max(distances) <= farthest + 1e-3
    assert farthest <= radius + 1e-6


def test_reach_of_a_ur5_is_that_of_its_links() -> None:
    """Upper arm, forearm and wrist are in line, with the lateral offsets of shoulder and flange.

    The data sheet's 850 mm end at the wrist.
    """
    arm = Workspace(load_robot("ur5"), Pose.identity())
    assert 0.85 < arm.farthest() < 0.85 + 0.0823 + 0.0947


@pytest.mark.parametrize("name", ROBOTS)
def test_tool_pose_of_a_posture_is_correct(name: str) -> None:
    robot = load_robot(name, WORLD)
    arm = Workspace(robot, Pose.identity())
    for posture in robot_summary(robot).postures:
        there = arm.forward(np.deg2rad(posture.angles_deg))
        assert there.position == pytest.approx(posture.tool_m, abs=1e-3)
        assert there.rotation_matrix[:, 2] == pytest.approx(posture.points, abs=0.01)


def test_limits_are_in_degrees() -> None:
    first = robot_summary(load_robot("ur5")).joints[0]
    assert (first.lower_deg, first.upper_deg) == (-360.0, 360.0)
    assert (first.name, first.velocity_deg_s) == ("shoulder_pan_joint", 180.0)


@pytest.mark.parametrize(
    ("axis", "name"),
    [((0, 0, -1), "-z"), ((1, 0, 0), "+x"), ((0.6, 0, 0.8), "0.6, 0, 0.8")],
)
def test_axis_has_a_short_name(axis: tuple[float, float, float], name: str) -> None:
    assert direction(axis) == name
