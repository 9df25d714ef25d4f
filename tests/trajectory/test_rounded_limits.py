"""Paths along position limits, and with rounding errors of inverse kinematics."""

from __future__ import annotations

import numpy as np
import pytest

from bt_dualarm.robots.robot_description import load_robot
from bt_dualarm.trajectory.path_timing import time_path


@pytest.mark.parametrize("robot", ["fr3", "panda", "xarm7"])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_rounding_beyond_a_limit_is_clipped_and_more_is_refused(robot: str, sign: float) -> None:
    limits = load_robot(robot).limits
    middle = 0.5 * (limits.lower + limits.upper)
    end = middle.copy()
    end[-1] = limits.upper[-1] if sign > 0 else limits.lower[-1]
    rows = np.linspace(middle, end, 17)
    rows[-1, -1] += sign * 2e-9
    motion = time_path(rows, limits, 0.004)
    assert (motion.q >= limits.lower - 1e-9).all()
    assert (motion.q <= limits.upper + 1e-9).all()
    rows[-1, -1] += sign * 1e-5
    with pytest.raises(ValueError, match="outside the position limits"):
        time_path(rows, limits, 0.004)


@pytest.mark.parametrize("robot", ["fr3", "tiago"])
@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("stays", [3, 12])
def test_spline_does_not_swing_beyond_a_limit_at_which_a_joint_turns_off(
    robot: str, sign: float, stays: int
) -> None:
    """A TIAGo that retreated after a handover was 1.8 mrad beyond two limits for a second.

    Its controller then clipped 182 set-points. The samples give way by a few times the swing.
    """
    limits = load_robot(robot).limits
    rows = np.tile(0.5 * (limits.lower + limits.upper), (20, 1))
    rows[:, 0] += np.linspace(0.0, 0.4, 20)
    bound = limits.upper[-1] if sign > 0 else limits.lower[-1]
    rows[:, -1] = bound - sign * 0.02 * np.maximum(np.arange(20.0)[::-1] - stays, 0.0)
    motion = time_path(rows, limits, 0.004)
    assert (motion.q >= limits.lower - 1e-9).all()
    assert (motion.q <= limits.upper + 1e-9).all()
    assert motion.q[0] == pytest.approx(rows[0], abs=1e-12)
    assert motion.q[-1] == pytest.approx(rows[-1], abs=1e-12)
    swing = 0.02 * 0.13  # of a spline through a corner, less than an eighth of a step
    where = np.interp(motion.q[:, 0], rows[:, 0], rows[:, -1])
    assert np.abs(motion.q[:, -1] - where).max() < 3.0 * swing
