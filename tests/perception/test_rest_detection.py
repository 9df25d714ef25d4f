"""Rest detection: when a target counts as moved, and how long it has been at rest since."""

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
    """A sighting from a camera that by default is in front of the plane's origin."""
    eye = np.zeros(2) if eye is None else eye
    return RestSample(stamp, eye, (place - eye) / DEPTH_M, DEPTH_M, sigma)


def run_detector(
    place: Callable[[float], float],
    seconds: float,
    noise: float,
    *,
    expected: float | None = None,
    fps: int = FPS,
    seed: int = 0,
) -> tuple[RestDetector, Vector]:
    """Run a detector on a target that moves along one axis; also return ``still_for`` by frame.

    The camera follows with a lag of a tenth of a second.
    """
    rng = np.random.default_rng(seed)
    detector = RestDetector(DOUBT)
    still = []
    for stamp in np.arange(0.0, seconds, 1.0 / fps).tolist():
        at = np.array((place(stamp), 0.0)) + rng.normal(0.0, noise, 2)
        eye = np.array((place(max(0.0, stamp - 0.1)), 0.0))
        detector.take(seen(stamp, at, noise if expected is None else expected, eye))
        still.append(detector.still_for)
    return detector, np.array(still)


def run_approach(
    start: Vector, depth: float, noise: float, place: Callable[[float], float], *, seed: int
) -> RestDetector:
    """Run a detector while the camera approaches a target that is believed at ``DEPTH_M``.

    The target starts off the middle of the image. The camera follows it in a critically damped
    loop of 8 rad/s at 30 Hz.
    """
    rng = np.random.default_rng(seed)
    detector = RestDetector(DOUBT)
    eye = np.zeros(2)
    speed = rng.normal(0.0, 0.05, 2)
    for stamp in np.arange(0.0, 8.0, 1.0 / 30).tolist():
        target = start + np.array((place(stamp), 0.0))
        slope = (target - eye) / depth + rng.normal(0.0, noise / DEPTH_M, 2)
        detector.take(RestSample(stamp, eye.copy(), slope, DEPTH_M, noise))
        seen_at = eye + DEPTH_M * slope
        speed = speed + (64.0 * (seen_at - eye) - 16.0 * speed) / 30
        eye = eye + speed / 30
    return detector


def step(size: float, begin: float, length: float = 0.2) -> Callable[[float], float]:
    """A smooth step of ``size``."""

    def place(time: float) -> float:
        share = min(max((time - begin) / length, 0.0), 1.0)
        return size * share**3 * (10 - 15 * share + 6 * share**2)

    return place


def resting(_: float) -> float:
    return 0.3


@pytest.mark.parametrize("seed", range(2))
@pytest.mark.parametrize("noise", [GOOD_M, SHAKY_M, 10 * SHAKY_M])
def test_shake_is_not_movement(noise: float, seed: int) -> None:
    """A minute at rest, with up to 20 px of shake."""
    assert not run_detector(resting, 60.0, noise, seed=seed)[1].any()


def test_unexpected_shake_is_not_movement() -> None:
    """It is recognized by its scatter."""
    assert not run_detector(resting, 60.0, SHAKY_M, expected=GOOD_M)[1].any()


def test_two_outliers_are_not_movement() -> None:
    """They occur when a target is half covered for a moment, for example."""
    detector = RestDetector(DOUBT)
    rng = np.random.default_rng(0)
    for frame in range(300):
        off = 0.05 if frame % 50 in (20, 21) else 0.0
        detector.take(seen(frame / FPS, rng.normal(off, GOOD_M, 2), GOOD_M))
    assert detector.still_for == 0.0


@pytest.mark.parametrize("fps", [15, 30, 60, 200])
def test_the_end_of_a_movement_is_detected(fps: int) -> None:
    """It ends at 2.2 s, which is known some frames later."""
    detector, still = run_detector(step(0.011, 2.0), 4.0, GOOD_M, fps=fps)
    assert not still[: 2 * fps].any()
    assert detector.still_for == pytest.approx(1.8, abs=0.1 + 12 / fps)


@pytest.mark.parametrize("fps", [15, 60])
def test_three_millimeters_end_a_rest(fps: int) -> None:
    """They do not count as a first movement, however."""
    first = step(0.02, 1.0)
    then = step(0.003, 3.0)
    detector, _ = run_detector(lambda time: first(time) + then(time), 5.0, GOOD_M, fps=fps)
    assert detector.still_for == pytest.approx(1.8, abs=0.1 + 12 / fps)
    assert not run_detector(then, 5.0, GOOD_M, fps=fps)[1].any()


def test_time_out_of_view_is_not_rest() -> None:
    detector, still = run_detector(step(0.02, 1.0), 2.0, GOOD_M)
    assert still[-1] > 0.7
    detector.interrupt()
    assert detector.still_for == 0.0
    for stamp in np.arange(4.0, 4.5, 1 / FPS).tolist():
        detector.take(seen(stamp, np.array((0.1, 0.0)), GOOD_M))
        assert detector.still_for <= stamp - 4.0
    assert detector.still_for > 0.4


def test_a_movement_out_of_view_counts() -> None:
    detector, still = run_detector(resting, 1.0, GOOD_M)
    detector.interrupt()
    for stamp in np.arange(2.0, 3.0, 1 / FPS).tolist():
        detector.take(seen(stamp, np.array((0.4, 0.0)), GOOD_M, np.array((0.3, 0.0))))
    assert not still.any()
    assert detector.still_for == pytest.approx(1.0, abs=0.1)


def test_a_shaky_camera_detects_two_centimeters() -> None:
    """Seven times the deviation of a single sighting; the end is found to 0.2 s."""
    detector, still = run_detector(step(0.02, 2.0), 4.0, SHAKY_M)
    assert not still[: 2 * FPS].any()
    assert detector.still_for == pytest.approx(1.8, abs=0.2)


@pytest.mark.parametrize(
    ("speed", "noise", "fps"),
    [(0.005, GOOD_M, 60), (0.5, GOOD_M, 60), (0.015, GOOD_M, 5), (0.025, SHAKY_M, 60)],
)
def test_continued_motion_is_not_rest(speed: float, noise: float, fps: int) -> None:
    """Never for a second, however slow; 25 mm/s is a curve at a twentieth of full speed."""
    detector, still = run_detector(lambda time: speed * min(time, 15.0), 17.0, noise, fps=fps)
    assert still[: 15 * fps].max() < 1.0
    assert 1.9 - 4 / fps < detector.still_for < 3.0


def test_rest_takes_more_than_a_moment() -> None:
    """At 0.5 m/s, a target is not at rest between two sightings."""
    _, still = run_detector(lambda time: 0.5 * time, 2.0, GOOD_M)
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
"""Up to 12 cm off the middle, 0.2 to 1 m away (0.35 m is believed), up to 2 px of noise."""


def test_a_wrong_depth_is_not_movement() -> None:
    for start, depth, noise, seed in CASES:
        detector = run_approach(start, depth, noise, resting, seed=seed)
        assert detector.still_for == 0.0, (start, depth, noise)


def test_fifteen_millimeters_are_a_movement_whatever_the_depth() -> None:
    """It ends at 3.2 s, and somewhat later where a wrong depth makes the camera slow to follow."""
    for start, depth, noise, seed in CASES:
        if noise < SHAKY_M:
            path = step(0.015, 3.0)
            detector = run_approach(start, depth, noise, path, seed=seed)
            assert 2.8 < detector.still_for < 5.2, (start, depth, noise)
