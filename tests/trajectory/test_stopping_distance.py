"""Stopping distances agree with Ruckig for any state."""

from __future__ import annotations

import numpy as np
import pytest
import ruckig
from hypothesis import example, given
from hypothesis import strategies as st

from bt_dualarm.trajectory.set_points import every, stopping_distance

A = 5.0
J = 100.0


def farthest_of_ruckig(v: float, a: float) -> float:
    """Largest position of a joint that brakes to zero velocity."""
    request = ruckig.InputParameter(1)
    request.control_interface = ruckig.ControlInterface.Velocity
    request.current_velocity = [v]
    request.current_acceleration = [a]
    request.max_acceleration = [A]
    request.max_jerk = [J]
    answer = ruckig.Trajectory(1)
    ruckig.Ruckig(1).calculate(request, answer)
    return float(answer.position_extrema[0].max)


@given(st.floats(-3.2, 3.2), st.floats(-A, A))
@example(0.0, 0.0)
@example(1.0, 0.0)
@example(A * A / (2 * J), -A)  # at the end of braking
@example(-0.1, A)  # reverses, then brakes
def test_stopping_distance_agrees_with_ruckig(v: float, a: float) -> None:
    found = stopping_distance(np.array([v]), np.array([a]), np.array([A]), np.array([J]))
    assert found[0] == pytest.approx(farthest_of_ruckig(v, a), abs=1e-9)


def test_every_checks_all_flags() -> None:
    """For arrays of any shape and layout; a comparison with NaN is false."""
    flags = np.ones((5, 6), dtype=bool)
    assert every(flags)
    flags[4, 5] = False
    assert not every(flags)
    assert not every(flags.T[1::2])
    assert every(flags[:4])
    assert not every(np.array((0.0, np.nan)) < 1.0)
