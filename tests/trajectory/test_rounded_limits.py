"""Paths that end at a position limit, with rounding errors of inverse kinematics."""

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
