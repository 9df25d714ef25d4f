"""The servo law has the requested poles and does not oscillate, even with low limits."""

from __future__ import annotations

import itertools
from itertools import product

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bt_dualarm.control.kernel_rows import OBSERVED, Gains, PlaneLimits
from bt_dualarm.control.servo_kernels import (
    braking_speed,
    closing_velocity,
    fading_acceleration,
    following_gains,
    jerk_bandwidth,
    pole_gains,
    spare_limits,
)
from bt_dualarm.core.pose import Matrix, Vector
from bt_dualarm.trajectory.set_points import stopping_distance
from tests.families import some

PERIOD = 0.002  # s
SLACK = 1.5e-4  # m
LITTLE_TO_MUCH = [
    # From a UR5 at a tenth of its limits to a Panda at its full limits.
    PlaneLimits(acceleration, jerk)
    for acceleration, jerk in itertools.product((0.2, 1.0, 8.0), (4.0, 50.0, 600.0, 5000.0))
]


def sampled(gains: Gains, period: float) -> Matrix:
    """Transition matrix of error, its derivative and the sent acceleration over one period."""
    c, b, f = gains
    sent = np.array((-f * b * c, -f * b, 1.0 - f))
    return np.array(
        ((1.0, period, 0.0) + 0.5 * period**2 * sent, (0.0, 1.0, 0.0) + period * sent, sent)
    )


@given(
    w=st.floats(0.5, 400.0), p=st.floats(0.5, 2000.0), period=st.sampled_from((0.001, 0.002, 0.008))
)
def test_sampled_system_has_the_requested_poles(w: float, p: float, period: float) -> None:
    """Compared by polynomials, as multiple roots are accurate to half of the digits only."""
    gains = pole_gains((w, w, p), period)
    expected = np.poly(np.exp(-np.array((w, w, p)) * period))
    assert np.poly(sampled(gains, period)) == pytest.approx(expected, abs=1e-9)
    assert min(gains) > 0.0


@given(distance=st.floats(1e-6, 3.0), a=st.floats(0.01, 20.0), j=st.floats(0.1, 10_000.0))
def test_braking_speed_leads_to_rest_at_the_target(distance: float, a: float, j: float) -> None:
    speed = np.array((braking_speed(distance, PlaneLimits(a, j)),))
    distances = stopping_distance(speed, np.zeros(1), np.array((a,)), np.array((j,)))
    assert distances[0] == pytest.approx(distance, rel=1e-6)


@given(w=st.floats(20.0, 300.0), jerk=st.floats(1.0, 10_000.0))
def test_error_of_the_slack_does_not_exceed_the_jerk_limit(w: float, jerk: float) -> None:
    """The first change of acceleration is the largest; the bandwidth is at most as requested."""
    c, b, f = following_gains(w, SLACK, jerk, PERIOD)
    assert f * b * c * SLACK <= 1.001 * jerk * PERIOD
    pole = np.exp(-min(w, jerk_bandwidth(jerk, SLACK)) * PERIOD)
    assert np.polyval(np.poly(sampled(Gains(c, b, f), PERIOD)), pole) == pytest.approx(0, abs=1e-9)


def followed(
    target: Vector, reach: PlaneLimits, bandwidth: float, noise: float, seconds: float
) -> Matrix:
    """Errors along three axes, of shape (n, 3), of a limited point that follows a noisy target."""
    rng = np.random.default_rng(0)
    gains = following_gains(bandwidth, SLACK, reach.jerk, PERIOD)
    p = np.zeros(3)
    v = np.zeros(3)
    a = np.zeros(3)
    errors = []
    for _ in range(round(seconds / PERIOD)):
        error = target + noise * rng.normal(size=3) - p
        goal = closing_velocity(error, gains, reach, 6.5 * SLACK)
        expected = fading_acceleration(goal - v, gains.b, reach.jerk)
        expected *= min(1.0, reach.acceleration / max(float(np.linalg.norm(expected)), 1e-12))
        step = gains.f * (expected - a)
        a = a + step * min(1.0, reach.jerk * PERIOD / max(float(np.linalg.norm(step)), 1e-12))
        p = p + v * PERIOD + 0.5 * a * PERIOD**2
        v = v + a * PERIOD
        errors.append(target - p)
    return np.array(errors)


@pytest.mark.parametrize(
    ("distance", "reach"), some(product([3e-4, 0.01, 0.2], LITTLE_TO_MUCH), 2), ids=str
)
def test_point_arrives_without_overshoot(reach: PlaneLimits, distance: float) -> None:
    """Near or far, with low or high jerk; a law without the jerk limit would oscillate here."""
    along = np.array((0.64, -0.48, 0.6))
    longest = 4.0 * (np.cbrt(distance / reach.jerk) + np.sqrt(distance / reach.acceleration)) + 1.0
    error = followed(distance * along, reach, 200.0, 0.0, longest) @ along
    assert abs(error[-1]) < 0.01 * distance
    assert error.min() > -0.01 * distance


@pytest.mark.parametrize("reach", LITTLE_TO_MUCH, ids=str)
def test_noise_is_not_amplified(reach: PlaneLimits) -> None:
    """For white noise of 0.05 mm of a resting target, the error is smaller than the noise."""
    error = followed(np.zeros(3), reach, 200.0, 5e-5, 8.0)
    late = error[len(error) // 2 :]
    assert np.sqrt(np.mean(late**2)) < 5e-5


def test_acceleration_of_the_target_reduces_the_spare_limits() -> None:
    """It counts at once, in any direction, and decays within seconds."""
    reach = PlaneLimits(2.0, 40.0)
    seen = np.zeros(OBSERVED)
    rest = np.zeros(3)
    assert spare_limits(reach, rest, PERIOD, seen) == reach
    assert spare_limits(reach, np.array((0.0, -1.5, 0.0)), PERIOD, seen) == pytest.approx((0.5, 10))
    assert spare_limits(reach, rest, 1.0, seen).acceleration == pytest.approx(2.0 - 1.5 / np.e)
    # For any acceleration of the target, the tool still closes in, and the decay is the same.
    least = spare_limits(reach, np.array((50.0, 0.0, 0.0)), PERIOD, seen)
    assert least == pytest.approx((0.2, 4.0))
    assert spare_limits(reach, rest, 1.0, seen).acceleration == pytest.approx(2.0 - 2.0 / np.e)
