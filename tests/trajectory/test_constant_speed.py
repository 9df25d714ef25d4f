"""Motions at a constant tool speed are within the limits, and smooth at both ends."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from bt_dualarm.core.errors import Failure
from bt_dualarm.core.pose import Matrix, Pose, Vector
from bt_dualarm.kinematics.inverse_kinematics import Kinematics
from bt_dualarm.planning.problem import joint_path
from bt_dualarm.robots.robot_description import load_robot
from bt_dualarm.trajectory.constant_speed import at_constant_speed
from bt_dualarm.trajectory.paths import blended

ROBOT = load_robot("ur5", Path(), None)
ARM = Kinematics(ROBOT, Pose.from_rpy((0, 0, 0.4), (0, 0, 0)))
DT = 0.004


def samples(blend: float, side: float = 0.08) -> tuple[Matrix, Vector]:
    """Configurations along two lines with a blended corner, and their path lengths."""
    q = ROBOT.postures["present"]
    tool = ARM.forward(q)
    corners = [
        Pose(tool.position + np.array(step), tool.quaternion)
        for step in ((0, 0, 0), (0, side, 0), (0, side, side))
    ]
    path = blended(corners, blend)
    return joint_path(ARM, path, q), path.lengths


@pytest.mark.parametrize("speed", [0.01, 0.03, 0.06])
def test_tool_has_the_given_speed_between_the_ramps(speed: float) -> None:
    rows, lengths = samples(0.015)
    motion, ramp = at_constant_speed(rows, lengths, speed, ROBOT.limits, DT)
    assert motion.duration == pytest.approx(lengths[-1] / speed + ramp, abs=1e-9)
    positions = np.array([ARM.forward(q).position for q in motion.q])
    speeds = np.linalg.norm(np.diff(positions, axis=0), axis=1) / DT
    inner = slice(round(ramp / DT) + 1, -round(ramp / DT) - 1)
    assert np.abs(speeds[inner] / speed - 1.0).max() < 2e-3
    assert speeds.max() < speed * 1.002
    np.testing.assert_allclose(motion.q[[0, -1]], rows[[0, -1]], atol=1e-12)


def test_motion_is_smooth_and_within_the_limits() -> None:
    rows, lengths = samples(0.015)
    motion, _ = at_constant_speed(rows, lengths, 0.06, ROBOT.limits, DT)
    limits = ROBOT.limits
    assert (np.abs(motion.v) <= limits.velocity).all()
    assert (np.abs(motion.a) <= limits.acceleration).all()
    assert (np.abs(np.diff(motion.a, axis=0)) <= DT * limits.jerk).all()
    # Velocity and acceleration are the derivatives of position and velocity.
    np.testing.assert_allclose(np.diff(motion.q, axis=0) / DT, _means(motion.v), atol=1e-3)
    np.testing.assert_allclose(np.diff(motion.v, axis=0) / DT, _means(motion.a), atol=0.1)
    assert not motion.v[[0, -1]].any()


def test_changes_of_velocity_keep_the_acceleration_limit_too() -> None:
    """An FR3 reaches its full acceleration within a period: between two set-points it had more."""
    robot = load_robot("fr3", Path(), None)
    arm = Kinematics(robot, Pose.identity())
    q = robot.postures["home"]
    tool = arm.forward(q)
    corners = [
        Pose(tool.position + np.array(step), tool.quaternion)
        for step in ((0, 0, 0), (0.04, 0, 0), (0.04, 0.08, 0.05))
    ]
    path = blended(corners, 0.003)
    rows = joint_path(arm, path, q)
    with pytest.raises(Failure) as too_fast:
        at_constant_speed(rows, path.lengths, 50.0, robot.limits, DT)
    fastest = float(too_fast.value.numbers["fastest_m_s"])
    motion, _ = at_constant_speed(rows, path.lengths, fastest, robot.limits, DT)
    assert (np.abs(np.diff(motion.v, axis=0)) <= DT * robot.limits.acceleration).all()


def _means(rows: Matrix) -> Matrix:
    return 0.5 * (rows[1:] + rows[:-1])


def test_too_high_speed_is_refused_with_the_possible_one() -> None:
    rows, lengths = samples(0.015)
    with pytest.raises(Failure, match="a joint would exceed its limits") as refused:
        at_constant_speed(rows, lengths, 1.0, ROBOT.limits, DT)
    fastest = float(refused.value.numbers["fastest_m_s"])
    at_constant_speed(rows, lengths, 0.99 * fastest, ROBOT.limits, DT)
    with pytest.raises(Failure, match="a joint would exceed its limits"):
        at_constant_speed(rows, lengths, 1.01 * fastest, ROBOT.limits, DT)


@pytest.mark.parametrize("asked", [3.0, 0.7])
@pytest.mark.parametrize("side", np.linspace(0.02, 0.1, 9).tolist())
def test_speed_to_try_is_possible(asked: float, side: float) -> None:
    """As the message gives it: rounded up it would be refused, with itself as the one to try."""
    rows, lengths = samples(0.015, side=side)
    with pytest.raises(Failure) as refused:
        at_constant_speed(rows, lengths, asked, ROBOT.limits, DT)
    advice = re.fullmatch(r".*; try (\S+) m/s", refused.value.reason)
    assert advice is not None
    speed = float(advice[1])
    assert speed == refused.value.numbers["fastest_m_s"]
    at_constant_speed(rows, lengths, speed, ROBOT.limits, DT)


def test_sharper_corners_are_slower() -> None:
    fastest = []
    for blend in (0.002, 0.01, 0.03):
        with pytest.raises(Failure) as refused:
            at_constant_speed(*samples(blend), 5.0, ROBOT.limits, DT)
        fastest.append(float(refused.value.numbers["fastest_m_s"]))
    assert fastest == sorted(fastest)


def test_path_too_short_for_the_speed_is_refused() -> None:
    rows, lengths = samples(0.001, side=0.004)
    straight = lengths < 0.003
    with pytest.raises(Failure, match="too short") as refused:
        at_constant_speed(rows[straight], lengths[straight], 0.3, ROBOT.limits, DT)
    assert refused.value.code == "TOO_FAST"
