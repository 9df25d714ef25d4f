"""Motions below a speed bound that varies along the path."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bt_dualarm.core.pose import Vector
from bt_dualarm.robots.robot import JointLimits
from bt_dualarm.trajectory.path_timing import SpeedBound, time_path, time_path_below
from bt_dualarm.trajectory.trajectory import use_of_limits

FAR = np.full(2, np.inf)
LIMITS = JointLimits(-FAR, FAR, np.full(2, 3.0), np.full(2, 5.0), np.full(2, 100.0), FAR)
LENGTH = 0.07
"""Length of the path, m; the two joints are its coordinates, in rad per 0.1 m."""

ROWS = np.linspace(0.0, 1.0, 21)[:, None] * np.array((6.0, 8.0)) * LENGTH
LENGTHS = np.linspace(0.0, LENGTH, 21)
DT = 0.002


def slowing(gentle_s: float, least: float) -> SpeedBound:
    """Bound that decreases from 50 to 55 mm of the path, as before a contact."""

    def most_m_s(lengths: Vector) -> Vector:
        near = np.clip(least + (0.055 - lengths) / gentle_s, least, 0.02)
        bound: Vector = np.where(lengths < 0.05, np.inf, near)
        return bound

    return most_m_s


@settings(max_examples=15, deadline=None)
@given(st.floats(0.04, 0.2), st.floats(0.001, 0.004))
def test_tool_speed_respects_the_bound(gentle_s: float, least: float) -> None:
    """The speed is below the bound 28 ms, half of the averaging time, after that has decreased."""
    most_m_s = slowing(gentle_s, least)
    motion = time_path_below(ROWS, LENGTHS, most_m_s, LIMITS, DT)
    covered = np.linalg.norm(motion.q, axis=1) / 10.0
    speed = np.linalg.norm(motion.v, axis=1) / 10.0
    within = covered > 0.051
    assert (speed[within] <= 1.3 * most_m_s(covered[within]) + 1e-6).all()
    assert (speed[covered > 0.0555] <= 1.02 * least).all()


def test_bounded_motion_respects_limits_and_path_from_rest_to_rest() -> None:
    """Like a motion without a bound."""
    motion = time_path_below(ROWS, LENGTHS, slowing(0.05, 0.002), LIMITS, DT)
    assert use_of_limits(motion, LIMITS).within
    assert np.abs(motion.q[:, 0] * 8.0 - motion.q[:, 1] * 6.0).max() < 1e-9
    assert np.allclose(motion.end, ROWS[-1], atol=1e-9)
    assert not motion.v[[0, -1]].any()


def test_inactive_bound_costs_little_time() -> None:
    """Only the averaging time is not optimized."""
    free = time_path(ROWS, LIMITS, DT)
    bound = time_path_below(ROWS, LENGTHS, lambda s: np.full_like(s, np.inf), LIMITS, DT)
    assert bound.duration == pytest.approx(free.duration, rel=0.05)
