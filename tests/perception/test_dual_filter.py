"""Dual-filter estimate: a slow filter for targets at rest, a fast one for targets that turn."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from bt_dualarm.core.pose import Vector
from bt_dualarm.perception.target_filter import DualFilterEstimate, TargetEstimate

SIGMA = 1e-4  # m: declared standard deviation of a sighting
NOISE = 6e-5  # m: its true standard deviation
AHEAD = 0.034  # s: prediction horizon, two frames at 60 Hz


def prediction_errors(
    estimate: TargetEstimate,
    place: Callable[[float], Vector],
    fps: float,
    seconds: float,
    seed: int = 0,
    settled: float = 1.0,
) -> tuple[float, float]:
    """RMS errors of predicted position (m) and velocity (m/s) after ``settled`` seconds."""
    rng = np.random.default_rng(seed)
    errors: list[tuple[Vector, Vector]] = []
    step = 1e-4
    for stamp in np.arange(0.0, seconds, 1.0 / fps).tolist():
        estimate.update(stamp, place(stamp) + rng.normal(0, NOISE, 2), SIGMA)
        if stamp > settled:
            now = stamp + AHEAD
            motion = estimate.predict(now)
            velocity = (place(now + step) - place(now - step)) / (2 * step)
            errors.append((motion.position - place(now), motion.velocity - velocity))
    position, velocity = np.sqrt(np.mean(np.square(errors), axis=(0, 2))).tolist()
    return position, velocity


def resting(_: float) -> Vector:
    return np.array((0.3, -0.1))


def circling(radius: float, speed: float) -> Callable[[float], Vector]:
    w = speed / radius
    return lambda time: radius * np.array((np.cos(w * time), np.sin(w * time)))


def jerking(time: float) -> Vector:
    """Moves from side to side, with an unpredictable jerk of 50 m/s³ at each turn."""
    swing = np.arcsin(np.sin(2 * np.pi * time / 1.6)) * 2 / np.pi
    return np.array((0.1 * np.sin(swing * np.pi / 2), 0.0))


@pytest.mark.parametrize(("fps", "part"), [(10, 1 / 2), (30, 1 / 3), (60, 1 / 3), (120, 1 / 3)])
@pytest.mark.parametrize("seed", range(3))
def test_slow_filter_reduces_noise_of_a_target_at_rest(fps: float, part: float, seed: int) -> None:
    """The velocity, which an arm would follow, has only a part of the fast filter's noise."""
    fast = prediction_errors(TargetEstimate(), resting, fps, 6.0, seed)
    dual = prediction_errors(DualFilterEstimate(), resting, fps, 6.0, seed)
    assert dual[1] < part * fast[1]
    assert dual[0] < fast[0]


@pytest.mark.parametrize("fps", [10, 30, 60, 120])
@pytest.mark.parametrize("speed", [0.05, 0.1])
def test_slow_filter_reduces_errors_on_a_slow_circle(fps: float, speed: float) -> None:
    fast = prediction_errors(TargetEstimate(), circling(0.1, speed), fps, 12.0, settled=4.0)
    dual = prediction_errors(DualFilterEstimate(), circling(0.1, speed), fps, 12.0, settled=4.0)
    assert dual[0] < fast[0]
    assert dual[1] < fast[1]


@pytest.mark.parametrize("fps", [30, 60, 120])
@pytest.mark.parametrize("curve", [circling(0.06, 0.5), jerking])
def test_fast_filter_is_used_where_the_target_turns(
    fps: float, curve: Callable[[float], Vector]
) -> None:
    """With a low calmness, the slow filter costs no accuracy."""
    fast = prediction_errors(TargetEstimate(), curve, fps, 8.0)
    dual = prediction_errors(DualFilterEstimate(0.2), curve, fps, 8.0)
    assert dual[0] < 1.02 * fast[0] + 1e-6


@pytest.mark.parametrize(("calmness", "noise"), [(0.2, NOISE / 4), (1.0, NOISE)])
def test_slow_filter_is_dropped_at_a_start_and_resumed_at_rest(
    calmness: float, noise: float
) -> None:
    """It is dropped within 0.1 s of a start at 1 m/s², and used again after some time at rest."""

    def place(time: float) -> Vector:
        moved = min(max(time - 2.0, 0.0), 1.0)
        return np.array((0.1 * (1 - np.cos(np.pi * moved)), 0.0))

    rng = np.random.default_rng(1)
    estimate = DualFilterEstimate(calmness)
    shares = {}
    for k in range(480):
        estimate.update(k / 60, place(k / 60) + rng.normal(0, noise, 2), SIGMA)
        shares[k / 60] = estimate.slow_share
    assert all(share == 1.0 for time, share in shares.items() if 1.0 < time < 2.0)
    assert all(share == 0.0 for time, share in shares.items() if 2.1 < time < 3.0)
    assert all(share == 1.0 for time, share in shares.items() if time > 6.5)


def test_without_calmness_only_the_fast_filter_is_used() -> None:
    fast = TargetEstimate()
    dual = DualFilterEstimate(0.0)
    for k in range(30):
        for estimate in (fast, dual):
            estimate.update(k / 60, circling(0.1, 0.3)(k / 60), SIGMA)
    assert (dual.predict(0.6).position == fast.predict(0.6).position).all()


@pytest.mark.parametrize("estimate", [TargetEstimate(), DualFilterEstimate()])
def test_prediction_in_a_plane_is_the_projected_prediction(estimate: TargetEstimate) -> None:
    rng = np.random.default_rng(6)
    for k in range(30):
        place = np.array((0.01 * k, 0.0, 0.3)) + rng.normal(0, 0.01, 3)
        estimate.update(k / 60, place, SIGMA)
    axes = np.linalg.qr(rng.normal(size=(3, 3)))[0][:2].copy()
    origin = rng.normal(size=3)
    whole = estimate.predict(0.6)
    expected = (axes @ (whole.position - origin), axes @ whole.velocity, axes @ whole.acceleration)
    assert estimate.predict_in(axes, origin, 0.6) == pytest.approx(np.array(expected), rel=1e-12)


def test_a_fresh_estimate_has_not_seen_its_target() -> None:
    estimate = DualFilterEstimate(0.3)
    estimate.update(0.0, np.zeros(2), SIGMA)
    other = estimate.fresh()
    assert not other.seen
    with pytest.raises(ValueError, match="not been seen"):
        other.predict(0.0)
