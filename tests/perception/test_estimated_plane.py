"""Guessed depth of a plane: corrected by oscillation of the camera, and by nothing else."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from bt_dualarm.core.pose import Pose, Vector
from bt_dualarm.perception.detection import Detection
from bt_dualarm.perception.localization import EstimatedPlaneLocalizer, Sighting
from bt_dualarm.sim.frame import Frame

GUESS_M = 0.35
FPS = 30
Path = Callable[[float], tuple[float, float]]


def estimated_depth(
    eye: Path, target: Path, depth: float, *, shake_px: float = 0.5, seconds: float = 6
) -> float:
    """Depth estimated in the end, for a camera and a target that move on given paths."""
    rng = np.random.default_rng(3)
    ahead = np.array((0.0, 0.0, GUESS_M))
    normal = np.array((0.0, 0.0, 1.0))
    localizer = EstimatedPlaneLocalizer(np.zeros(3), ahead, normal)
    for stamp in np.arange(0.0, seconds, 1.0 / FPS).tolist():
        pose = Pose.from_rpy((*eye(stamp), 0.0))
        image = np.zeros((240, 320, 3), np.uint8)
        frame = Frame(stamp, image, pose, np.radians(50.0), (0, 0, 320, 240), noise_px=shake_px)
        line: Vector = np.array((*target(stamp), depth)) - pose.position
        pixel = line[:2] / depth * frame.focal_px + (160, 120) + rng.normal(0.0, shake_px, 2)
        detection = Detection(
            stamp, (pixel[0] / 160 - 1, pixel[1] / 120 - 1), (pixel[0], pixel[1]), 1e3, 0.1,
            (0, 0, 0, 0), 1.0, False,
        )  # fmt: skip
        localizer.learn(detection, frame)
    assert localizer.ahead[2] == pytest.approx(localizer.locate(detection, frame).point[2])
    return float(localizer.ahead[2])


def swing(size: float, hertz: float) -> Path:
    return lambda time: (size * np.sin(2 * np.pi * hertz * time), 0.0)


def rest(_: float) -> tuple[float, float]:
    return (0.01, -0.02)


@pytest.mark.parametrize("depth", [0.14, 0.2, 0.25, 0.3])
@pytest.mark.parametrize("hertz", [1.2, 2.4, 4.0])
@pytest.mark.parametrize("size", [0.02, 0.06])
def test_oscillation_corrects_a_guess_that_was_too_large(
    depth: float, hertz: float, size: float
) -> None:
    """It is accurate to the tenth by which the slope has to be below zero."""
    assert depth * 0.97 < estimated_depth(swing(size, hertz), rest, depth) < 1.13 * depth


def test_no_depth_below_a_third_of_the_guess_is_accepted() -> None:
    assert estimated_depth(swing(0.05, 2.0), rest, 0.08) == pytest.approx(GUESS_M / 3)


@pytest.mark.parametrize("depth", [0.35, 0.5, 1.0])
@pytest.mark.parametrize("hertz", [1.2, 4.0])
def test_a_guess_that_is_right_or_too_small_stays(depth: float, hertz: float) -> None:
    assert estimated_depth(swing(0.06, hertz), rest, depth) == pytest.approx(GUESS_M)


@pytest.mark.parametrize("depth", [0.2, 0.35, 0.5])
@pytest.mark.parametrize("lag", [0.0, 0.05])
@pytest.mark.parametrize("hertz", [0.2, 0.7])
def test_following_a_target_does_not_change_the_depth(
    depth: float, lag: float, hertz: float
) -> None:
    """On a circle, the target moves with the camera, not against it."""

    def circle(time: float) -> tuple[float, float]:
        angle = 2 * np.pi * hertz * time
        return (0.1 * np.cos(angle), 0.1 * np.sin(angle))

    assert estimated_depth(lambda time: circle(time - lag), circle, depth) == pytest.approx(GUESS_M)


def test_meeting_a_target_does_not_change_the_depth() -> None:
    """They meet in the middle and stay there."""

    def eye(time: float) -> tuple[float, float]:
        return (min(0.1, 0.2 * time), 0.0)

    def target(time: float) -> tuple[float, float]:
        return (max(0.1, 0.2 - 0.2 * time), 0.0)

    assert estimated_depth(eye, target, GUESS_M) == pytest.approx(GUESS_M)


@pytest.mark.parametrize("past", [0.0, 0.03, 0.1])
@pytest.mark.parametrize("seconds", [0.1, 0.3])
def test_camera_overshoot_does_not_change_the_depth(past: float, seconds: float) -> None:
    """The target moves in the opposite direction throughout."""

    def eye(time: float) -> tuple[float, float]:
        return (float(np.interp(time, (0, 0.5, 0.5 + seconds), (0, 0.2 + past, 0.2))), 0.0)

    def target(time: float) -> tuple[float, float]:
        return (0.4 - 0.4 * time, 0.0)

    assert estimated_depth(eye, target, GUESS_M, seconds=1.0) == pytest.approx(GUESS_M)


@pytest.mark.parametrize("far", [0.03, 0.07, 0.15])
@pytest.mark.parametrize("legs", [(0.0, 0.013, -0.021, -0.012), (0.0, 0.01, -0.05, -0.04)])
def test_oscillation_while_a_target_moves_once_does_not_change_the_depth(
    far: float, legs: tuple[float, ...]
) -> None:
    """It moved the wrong way first: 0.35 m of depth was taken for 0.14 m, and 15 mm were lost."""

    def eye(time: float) -> tuple[float, float]:
        return (float(np.interp(time, (0.0, 0.2, 0.6, 0.9), legs)), 0.0)

    def target(time: float) -> tuple[float, float]:
        return (float(np.interp(time, (0.0, 0.6), (0.0, far))), 0.0)

    assert estimated_depth(eye, target, GUESS_M, seconds=2.0) == pytest.approx(GUESS_M)


def test_earlier_sightings_are_relocated_on_the_corrected_plane() -> None:
    """They keep their position in the image."""
    ahead = np.array((0.1, 0.0, GUESS_M))
    normal = np.array((0.0, 0.0, 1.0))
    localizer = EstimatedPlaneLocalizer(np.zeros(3), ahead, normal)
    seen: list[Sighting] = []
    for stamp in np.arange(0.0, 2.0, 1.0 / FPS).tolist():
        frame = Frame(
            stamp, np.zeros((240, 320, 3), np.uint8),
            Pose.from_rpy((*swing(0.05, 2.0)(stamp), 0.0)), np.radians(50.0), (0, 0, 320, 240),
        )  # fmt: skip
        line = (np.array((0.02, 0.01, 0.2)) - frame.pose.position) / 0.2
        pixel = line[:2] * frame.focal_px + (160, 120)
        detection = Detection(
            stamp, (0.0, 0.0), (pixel[0], pixel[1]), 1e3, 0.1, (0, 0, 0, 0), 1.0, False
        )
        seen.append(localizer.locate(detection, frame))
        if localizer.learn(detection, frame):
            break
    again = localizer.relocate(seen[0])
    assert again.point == pytest.approx((0.02, 0.01, 0.2), abs=1e-6)
    assert again.side / seen[0].side == pytest.approx(0.2 / GUESS_M)
    assert localizer.ahead == pytest.approx(ahead * 0.2 / GUESS_M)
