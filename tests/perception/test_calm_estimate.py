"""Two filters: calm before a target at rest, lively before one that turns."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from bt_dualarm.core.pose import Vector
from bt_dualarm.perception.target_filter import DualFilterEstimate, TargetEstimate

SIGMA = 1e-4  # m: what a sighting is believed to be off
NOISE = 6e-5  # m: what it is off
AHEAD = 0.034  # s: two frames at 60 Hz


def fed(
    estimate: TargetEstimate,
    place: Callable[[float], Vector],
    fps: float,
    seconds: float,
    seed: int = 0,
    settled: float = 1.0,
) -> tuple[float, float]:
    """Root mean square errors of predicted position in m and velocity in m/s, after a while."""
    rng = np.random.default_rng(seed)
    off: list[tuple[Vector, Vector]] = []
    step = 1e-4
    for stamp in np.arange(0.0, seconds, 1.0 / fps).tolist():
        estimate.update(stamp, place(stamp) + rng.normal(0, NOISE, 2), SIGMA)
        if stamp > settled:
            now = stamp + AHEAD
            motion = estimate.predict(now)
            velocity = (place(now + step) - place(now - step)) / (2 * step)
            off.append((motion.position - place(now), motion.velocity - velocity))
    position, velocity = np.sqrt(np.mean(np.square(off), axis=(0, 2))).tolist()
    return position, velocity


def resting(_: float) -> Vector:
    return np.array((0.3, -0.1))


def circling(radius: float, speed: float) -> Callable[[float], Vector]:
    w = speed / radius
    return lambda time: radius * np.array((np.cos(w * time), np.sin(w * time)))


def jerking(time: float) -> Vector:
    """From side to side, 50 m/s³ at each turn: nobody foresees them."""
    swing = np.arcsin(np.sin(2 * np.pi * time / 1.6)) * 2 / np.pi
    return np.array((0.1 * np.sin(swing * np.pi / 2), 0.0))


@pytest.mark.parametrize(("fps", "part"), [(10, 1 / 2), (30, 1 / 3), (60, 1 / 3), (120, 1 / 3)])
@pytest.mark.parametrize("seed", range(3))
def test_a_target_at_rest_is_known_to_rest(fps: float, part: float, seed: int) -> None:
    """Velocity, which an arm would follow, has a part of the noise that the lively filter has."""
    lively = fed(TargetEstimate(), resting, fps, 6.0, seed)
    calm = fed(DualFilterEstimate(), resting, fps, 6.0, seed)
    assert calm[1] < part * lively[1]
    assert calm[0] < lively[0]


@pytest.mark.parametrize("fps", [10, 30, 60, 120])
@pytest.mark.parametrize("speed", [0.05, 0.1])
def test_a_slow_circle_is_calm_too(fps: float, speed: float) -> None:
    lively = fed(TargetEstimate(), circling(0.1, speed), fps, 12.0, settled=4.0)
    calm = fed(DualFilterEstimate(), circling(0.1, speed), fps, 12.0, settled=4.0)
    assert calm[0] < lively[0]
    assert calm[1] < lively[1]


@pytest.mark.parametrize("fps", [30, 60, 120])
@pytest.mark.parametrize("curve", [circling(0.06, 0.5), jerking])
def test_where_it_turns_the_lively_filter_leads(
    fps: float, curve: Callable[[float], Vector]
) -> None:
    """With little calmness nothing is lost by the calm one."""
    lively = fed(TargetEstimate(), curve, fps, 8.0)
    mixed = fed(DualFilterEstimate(0.2), curve, fps, 8.0)
    assert mixed[0] < 1.02 * lively[0] + 1e-6


@pytest.mark.parametrize(("calmness", "noise"), [(0.2, NOISE / 4), (1.0, NOISE)])
def test_a_start_is_noticed_and_a_rest_believed_again(calmness: float, noise: float) -> None:
    """At rest, off at 1 m/s², at rest again: calm, not calm within 0.1 s, calm after some time."""

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


def test_without_calmness_it_is_the_lively_filter() -> None:
    lively = TargetEstimate()
    mixed = DualFilterEstimate(0.0)
    for k in range(30):
        for estimate in (lively, mixed):
            estimate.update(k / 60, circling(0.1, 0.3)(k / 60), SIGMA)
    assert (mixed.predict(0.6).position == lively.predict(0.6).position).all()


@pytest.mark.parametrize("estimate", [TargetEstimate(), DualFilterEstimate()])
def test_in_a_plane_it_is_what_it_is_in_the_world(estimate: TargetEstimate) -> None:
    rng = np.random.default_rng(6)
    for k in range(30):
        place = np.array((0.01 * k, 0.0, 0.3)) + rng.normal(0, 0.01, 3)
        estimate.update(k / 60, place, SIGMA)
    axes = np.linalg.qr(rng.normal(size=(3, 3)))[0][:2].copy()
    origin = rng.normal(size=3)
    whole = estimate.predict(0.6)
    wanted = (axes @ (whole.position - origin), axes @ whole.velocity, axes @ whole.acceleration)
    assert estimate.predict_in(axes, origin, 0.6) == pytest.approx(np.array(wanted), rel=1e-12)


def test_another_target_begins_anew_with_the_same_calmness() -> None:
    estimate = DualFilterEstimate(0.3)
    estimate.update(0.0, np.zeros(2), SIGMA)
    other = estimate.fresh()
    assert not other.seen
    with pytest.raises(ValueError, match="not been seen"):
        other.predict(0.0)
