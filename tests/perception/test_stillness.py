"""When a target counts as moved, and for how long it has been still since."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from bt_dualarm.core.pose import Vector
from bt_dualarm.perception.target_filter import RestDetector, RestSample

FPS = 60
GOOD_M = 1e-4
SHAKY_M = 2.7e-3
"""Standard deviation of a sighting 0.35 m away: of pixels alone, and with 2 px of shake."""


DEPTH_M = 0.35
DOUBT = 3.0
"""Believed depth, and the factor by which it may be wrong."""


def seen(stamp: float, place: Vector, sigma: float, eye: Vector | None = None) -> RestSample:
    """A sighting from a camera that by default hangs before the origin of the plane."""
    eye = np.zeros(2) if eye is None else eye
    return RestSample(stamp, eye, (place - eye) / DEPTH_M, DEPTH_M, sigma)


def watched(
    place: Callable[[float], float],
    seconds: float,
    noise: float,
    *,
    expected: float | None = None,
    fps: int = FPS,
    seed: int = 0,
) -> tuple[RestDetector, Vector]:
    """Where the target is along one axis by time; also for how long it was still at each frame.

    The camera follows with a lag of a tenth of a second.
    """
    rng = np.random.default_rng(seed)
    stillness = RestDetector(DOUBT)
    still = []
    for stamp in np.arange(0.0, seconds, 1.0 / fps).tolist():
        at = np.array((place(stamp), 0.0)) + rng.normal(0.0, noise, 2)
        eye = np.array((place(max(0.0, stamp - 0.1)), 0.0))
        stillness.take(seen(stamp, at, noise if expected is None else expected, eye))
        still.append(stillness.still_for)
    return stillness, np.array(still)


def approached(
    start: Vector, depth: float, noise: float, place: Callable[[float], float], *, seed: int
) -> RestDetector:
    """A target off the middle of the image, which the camera comes to, believed at ``DEPTH_M``.

    The camera's way is that of a critically damped loop of 8 rad/s at 30 Hz.
    """
    rng = np.random.default_rng(seed)
    stillness = RestDetector(DOUBT)
    eye = np.zeros(2)
    speed = rng.normal(0.0, 0.05, 2)
    for stamp in np.arange(0.0, 8.0, 1.0 / 30).tolist():
        target = start + np.array((place(stamp), 0.0))
        slope = (target - eye) / depth + rng.normal(0.0, noise / DEPTH_M, 2)
        stillness.take(RestSample(stamp, eye.copy(), slope, DEPTH_M, noise))
        seen_at = eye + DEPTH_M * slope
        speed = speed + (64.0 * (seen_at - eye) - 16.0 * speed) / 30
        eye = eye + speed / 30
    return stillness


def step(size: float, begin: float, length: float = 0.2) -> Callable[[float], float]:
    """Smoothly by ``size``."""

    def place(time: float) -> float:
        share = min(max((time - begin) / length, 0.0), 1.0)
        return size * share**3 * (10 - 15 * share + 6 * share**2)

    return place


def resting(_: float) -> float:
    return 0.3


@pytest.mark.parametrize("seed", range(2))
@pytest.mark.parametrize("noise", [GOOD_M, SHAKY_M, 10 * SHAKY_M])
def test_a_shake_is_no_movement(noise: float, seed: int) -> None:
    """A minute at rest, with up to 20 px of shake."""
    assert not watched(resting, 60.0, noise, seed=seed)[1].any()


def test_nor_is_a_shake_that_nobody_expects() -> None:
    """Its scatter tells."""
    assert not watched(resting, 60.0, SHAKY_M, expected=GOOD_M)[1].any()


def test_nor_are_two_sightings_far_off() -> None:
    """Of a target that is half covered for a moment, say."""
    stillness = RestDetector(DOUBT)
    rng = np.random.default_rng(0)
    for frame in range(300):
        off = 0.05 if frame % 50 in (20, 21) else 0.0
        stillness.take(seen(frame / FPS, rng.normal(off, GOOD_M, 2), GOOD_M))
    assert stillness.still_for == 0.0


@pytest.mark.parametrize("fps", [15, 30, 60, 200])
def test_a_movement_is_seen_to_end(fps: int) -> None:
    """At 2.2 s, as is known some frames later."""
    stillness, still = watched(step(0.011, 2.0), 4.0, GOOD_M, fps=fps)
    assert not still[: 2 * fps].any()
    assert stillness.still_for == pytest.approx(1.8, abs=0.1 + 12 / fps)


@pytest.mark.parametrize("fps", [15, 60])
def test_three_millimeters_end_a_rest(fps: int) -> None:
    """But are no first movement."""
    first = step(0.02, 1.0)
    then = step(0.003, 3.0)
    stillness, _ = watched(lambda time: first(time) + then(time), 5.0, GOOD_M, fps=fps)
    assert stillness.still_for == pytest.approx(1.8, abs=0.1 + 12 / fps)
    assert not watched(then, 5.0, GOOD_M, fps=fps)[1].any()


def test_time_out_of_view_is_no_rest() -> None:
    stillness, still = watched(step(0.02, 1.0), 2.0, GOOD_M)
    assert still[-1] > 0.7
    stillness.interrupt()
    assert stillness.still_for == 0.0
    for stamp in np.arange(4.0, 4.5, 1 / FPS).tolist():
        stillness.take(seen(stamp, np.array((0.1, 0.0)), GOOD_M))
        assert stillness.still_for <= stamp - 4.0
    assert stillness.still_for > 0.4


def test_a_movement_out_of_view_counts() -> None:
    stillness, still = watched(resting, 1.0, GOOD_M)
    stillness.interrupt()
    for stamp in np.arange(2.0, 3.0, 1 / FPS).tolist():
        stillness.take(seen(stamp, np.array((0.4, 0.0)), GOOD_M, np.array((0.3, 0.0))))
    assert not still.any()
    assert stillness.still_for == pytest.approx(1.0, abs=0.1)


def test_a_shaky_one_sees_two_centimeters() -> None:
    """Seven times the deviation of a single sighting; the end is found to 0.2 s."""
    stillness, still = watched(step(0.02, 2.0), 4.0, SHAKY_M)
    assert not still[: 2 * FPS].any()
    assert stillness.still_for == pytest.approx(1.8, abs=0.2)


@pytest.mark.parametrize(
    ("speed", "noise", "fps"),
    [(0.005, GOOD_M, 60), (0.5, GOOD_M, 60), (0.015, GOOD_M, 5), (0.025, SHAKY_M, 60)],
)
def test_what_goes_on_is_not_still(speed: float, noise: float, fps: int) -> None:
    """Not for a second, however slow; 25 mm/s are a curve at a twentieth of full speed."""
    stillness, still = watched(lambda time: speed * min(time, 15.0), 17.0, noise, fps=fps)
    assert still[: 15 * fps].max() < 1.0
    assert 1.9 - 4 / fps < stillness.still_for < 3.0


def test_a_moment_is_not_enough_to_be_called_still() -> None:
    """Between two sightings at 0.5 m/s it does not stand."""
    _, still = watched(lambda time: 0.5 * time, 2.0, GOOD_M)
    assert not still.any()


CASES = [
    (np.array(start), depth, noise, seed)
    for seed, (start, depth, noise) in enumerate(
        zip(
            np.random.default_rng(3).uniform(-0.12, 0.12, (40, 2)).tolist(),
            np.random.default_rng(4).uniform(0.2, 1.0, 40).tolist(),
            np.random.default_rng(5).choice([GOOD_M, 0.5 * SHAKY_M, SHAKY_M], 40).tolist(),
            strict=True,
        )
    )
]
"""Off the middle by up to 12 cm, 0.2 to 1 m away where 0.35 m are believed, with up to 2 px."""


def test_a_depth_that_is_not_the_believed_one_is_no_movement() -> None:
    for start, depth, noise, seed in CASES:
        stillness = approached(start, depth, noise, resting, seed=seed)
        assert stillness.still_for == 0.0, (start, depth, noise)


def test_fifteen_millimeters_are_a_movement_whatever_the_depth() -> None:
    """It ends at 3.2 s, and somewhat later where a wrong depth makes the camera slow to follow."""
    for start, depth, noise, seed in CASES:
        if noise < SHAKY_M:
            way = step(0.015, 3.0)
            stillness = approached(start, depth, noise, way, seed=seed)
            assert 2.8 < stillness.still_for < 5.2, (start, depth, noise)
