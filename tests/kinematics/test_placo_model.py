"""PlaCo models are reused, since PlaCo never releases their memory."""

from __future__ import annotations

import pytest

from bt_dualarm.core.pose import Pose
from bt_dualarm.kinematics.inverse_kinematics import Kinematics
from bt_dualarm.kinematics.solver import MOST_IDLE
from bt_dualarm.robots.robot_description import load_robot

HERE = Pose.from_rpy((0.0, 0.0, 0.0))
THERE = Pose.from_rpy((1.0, 2.0, 3.0), (0.0, 0.0, 1.0))


def test_unused_model_is_reused() -> None:
    robot = load_robot("ur5")
    first = Kinematics(robot, HERE)
    model = first.placo
    assert Kinematics(robot, HERE).placo is not model, "it is in use"
    del first
    taken = [Kinematics(robot, THERE) for _ in range(MOST_IDLE)]  # others may have been idle longer
    assert any(one.placo is model for one in taken)


def test_bare_mechanism_keeps_its_model() -> None:
    robot = load_robot("ur5")
    bare = Kinematics(robot, HERE).bare
    others = [Kinematics(robot, HERE) for _ in range(3)]
    assert all(other.placo is not bare.placo for other in others)


@pytest.mark.parametrize("name", ["ur5", "panda"])
def test_reused_model_has_no_state_of_its_previous_use(name: str) -> None:
    """Neither the previous base nor previous targets change a bit of the solution."""
    robot = load_robot(name)
    home = robot.postures["home"]
    goal = Kinematics(robot, HERE).forward(home + 0.1)
    expected = Kinematics(robot, HERE, 1).solve(goal, home)
    there = Kinematics(robot, THERE, 2)
    there.solve(there.forward(home - 0.2), home)
    del there
    assert (Kinematics(robot, HERE, 1).solve(goal, home) == expected).all()
