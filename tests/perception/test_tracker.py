from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from itertools import product
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from bt_dualarm.core.pose import Pose, Vector
from bt_dualarm.perception.detection import Detection
from bt_dualarm.perception.localization import PlaneLocalizer, PlaneOfSizeLocalizer, Sighting
from bt_dualarm.perception.tracker import TargetTracker, TrackerSettings
from bt_dualarm.sim.frame import Frame
from bt_dualarm.spec.values import Color
from tests.families import WHOLE, some
from tests.perception.conftest import SIDE_M, Studio, StudioMaker

YELLOW = Color.named("yellow")
FACE = PlaneLocalizer(np.array([0.0, -SIDE_M / 2.0, 0.5]), np.array([0.0, 1.0, 0.0]))
NORMAL = np.array([0.0, 1.0, 0.0])
CENTER = np.array([0.0, -SIDE_M / 2.0, 0.5])
Path = Callable[[float], tuple[float, ...]]
"""Position at a time, across the image, upward, and optionally away from the camera, m."""


def by_rays(
    names: tuple[str, ...], *cases: tuple[Any, ...], one_in: int = 1
) -> pytest.MarkDecorator:
    """Parametrize a test, with the ray renderer; with OpenGL as well only in ``make matrix``.

    OpenGL takes twice as long; the tests without such cases always use both renderers.

    Args:
        names: Names of the test's arguments.
        cases: Values of these arguments.
        one_in: How many cases each case stands for that the ray renderer runs.
    """
    by_ray = [("ray", *case) for case in some(cases, one_in)]
    by_gl = [("gl", *case) for case in cases] if WHOLE else []
    return pytest.mark.parametrize(("renderer", *names), by_ray + by_gl, indirect=["renderer"])


def follow(
    studio: Studio, tracker: TargetTracker, path: Path, start: float, end: float
) -> list[Frame]:
    """Run camera and tracker on the cube's path, a step every 2 ms; the frames taken."""
    frames = []
    for time in np.arange(round(start / 0.002), round(end / 0.002)) * 0.002:
        x, z, *deeper = path(time)
        studio.place(x, z, y=sum(deeper))
        if studio.camera.due(time):
            frames.append(studio.camera.capture(studio.at(time)))
        studio.camera.deliver(time)
    assert tracker.frames >= 0
    return frames


def small_circle(time: float) -> tuple[float, float]:
    """4 cm about the axis in 2 s: within what shows only the front face, nearly."""
    return 0.02 * math.cos(math.pi * time), 0.02 * math.sin(math.pi * time)


def at_rest(_: float) -> tuple[float, float]:
    return 0.0, 0.0


def position(path: Path, time: float) -> Vector:
    x, z, *deeper = path(time)
    moved: Vector = CENTER + np.array([x, sum(deeper), z])
    return moved


def test_tracker_follows_a_circle(make_studio: StudioMaker) -> None:
    """At 60 Hz with one frame of latency, the predicted current position is within 0.6 mm."""
    studio = make_studio(fps=60.0, latency=1.0 / 60.0)
    tracker = TargetTracker(studio.camera, YELLOW, FACE)
    follow(studio, tracker, small_circle, 0.0, 0.5)
    errors = []
    for step in range(50):
        end = 0.5 + 0.01 * (step + 1)
        follow(studio, tracker, small_circle, end - 0.01, end)
        errors.append(tracker.predict(end).position - position(small_circle, end))
    assert tracker.locked
    assert tracker.lost_count == 0
    assert np.sqrt(np.mean(np.sum(np.square(errors), axis=1))) < 0.6e-3


def test_the_window_shrinks_to_the_target(make_studio: StudioMaker) -> None:
    """Before the lock, the whole image in blocks; then less than a tenth at full resolution."""
    studio = make_studio(fps=60.0)
    tracker = TargetTracker(studio.camera, YELLOW, FACE)
    frames = follow(studio, tracker, small_circle, 0.0, 0.6)
    assert frames[0].region == (0, 0, 320, 240)
    assert frames[0].stride == 3
    left, top, right, bottom = frames[-1].region
    assert frames[-1].stride == 1
    assert (right - left) * (bottom - top) < 0.1 * 320 * 240
    assert tracker.detection is not None
    assert not tracker.detection.touches_border


class UncertainLocalizer(PlaneLocalizer):
    """Locates a target exactly; after 0.5 s its uncertainty is that of a partly covered one."""

    def locate(self, detection: Detection, frame: Frame) -> Sighting:
        sighting = super().locate(detection, frame)
        return replace(sighting, sigma=np.full(3, 0.05)) if frame.stamp > 0.5 else sighting


@by_rays(("speed", "share"), (1.0, (0.0, 0.2)), (100.0, (0.3, 1.0)))
def test_the_window_of_a_visible_target_stays_small_despite_uncertainty(
    make_studio: StudioMaker, speed: float, share: tuple[float, float]
) -> None:
    """It is as large as the target's possible motion, so that the target stays in view."""
    studio = make_studio(fps=60.0)
    localizer = UncertainLocalizer(FACE.point, FACE.normal)
    settings = TrackerSettings(window_speed=speed)
    tracker = TargetTracker(studio.camera, YELLOW, localizer, settings=settings)
    frames = follow(studio, tracker, small_circle, 0.0, 1.2)
    left, top, right, bottom = frames[-1].region
    assert frames[-1].stride == 1
    assert share[0] < (right - left) * (bottom - top) / (320 * 240) < share[1]
    assert tracker.lost_count == 0
    assert tracker.detection is not None
    assert not tracker.detection.touches_border


def test_a_lost_target_is_reported_and_found_again(make_studio: StudioMaker) -> None:
    """Behind a screen for 0.3 s: still locked after 0.05 s, lost after 0.1 s, then regained."""
    studio = make_studio(fps=60.0)
    tracker = TargetTracker(studio.camera, YELLOW, FACE)
    follow(studio, tracker, small_circle, 0.0, 1.0)
    studio.place(0.0, 0.0, "screen", y=-0.2)
    follow(studio, tracker, small_circle, 1.0, 1.05)
    assert tracker.locked
    assert tracker.age(1.05) > 0.05
    frames = follow(studio, tracker, small_circle, 1.05, 1.3)
    assert not tracker.locked
    assert tracker.detection is None
    assert tracker.lost_count == 1
    assert tracker.lost_since == pytest.approx(tracker.last_stamp)
    assert frames[-1].region == (0, 0, 320, 240)
    studio.place(0.0, 1.0, "screen", y=-5.0)
    follow(studio, tracker, small_circle, 1.3, 1.8)
    assert tracker.locked
    assert tracker.lost_since is None
    assert tracker.lost_count == 1
    assert tracker.predict(1.8).position == pytest.approx(position(small_circle, 1.8), abs=1e-3)


def test_a_twin_that_crosses_does_not_steal_the_lock(make_studio: StudioMaker) -> None:
    """The twin passes above at 0.3 m/s and covers nothing."""
    studio = make_studio(fps=60.0)
    tracker = TargetTracker(studio.camera, YELLOW, FACE)
    follow(studio, tracker, at_rest, 0.0, 0.3)
    for step in range(150):
        time = 0.3 + 0.01 * step
        studio.place(-0.2 + 0.3 * (time - 0.3), 0.062, "other")
        follow(studio, tracker, at_rest, time, time + 0.01)
        assert tracker.predict(time).position == pytest.approx(CENTER, abs=2e-3)
    assert tracker.lost_count == 0


def cube() -> PlaneOfSizeLocalizer:
    return PlaneOfSizeLocalizer(NORMAL, SIDE_M, cube=True)


def test_a_half_hidden_target_is_located_by_its_free_edges(make_studio: StudioMaker) -> None:
    """A screen slides over the left half in 0.2 s and stays: it shifts the centroid by 12 mm."""
    studio = make_studio(fps=60.0)
    tracker = TargetTracker(studio.camera, YELLOW, cube())
    follow(studio, tracker, at_rest, 0.0, 1.0)
    for step in range(100):
        time = 1.0 + 0.02 * step
        studio.place(min(-0.53 + 0.15 * (time - 1.0), -0.5), 0.0, "screen", y=-0.03)
        follow(studio, tracker, at_rest, time, time + 0.02)
        assert tracker.predict(time).position == pytest.approx(CENTER, abs=3e-3)
    assert tracker.lost_count == 0


def test_a_target_half_out_of_the_image_is_located_by_its_free_edges(
    make_studio: StudioMaker,
) -> None:
    """It leaves to the right at 0.1 m/s until half of it is cut off, and stays."""
    studio = make_studio(fps=60.0)
    tracker = TargetTracker(studio.camera, YELLOW, cube())
    edge = 0.35 * math.tan(math.radians(25.0)) * 4.0 / 3.0

    def leaving(time: float) -> tuple[float, float]:
        return min(0.1 * time, edge), 0.0

    follow(studio, tracker, leaving, 0.0, 2.5)
    assert tracker.detection is not None
    assert tracker.detection.touches_border
    assert tracker.lost_count == 0
    assert tracker.predict(2.5).position[0] == pytest.approx(edge, abs=4e-3)


def test_an_object_of_the_same_color_beside_the_target_does_not_shift_it(
    make_studio: StudioMaker,
) -> None:
    """They form one outline for two seconds, its centroid 25 mm away; then the other leaves."""
    studio = make_studio(fps=60.0)
    tracker = TargetTracker(studio.camera, YELLOW, cube())
    follow(studio, tracker, at_rest, 0.0, 0.5)
    for step in range(400):
        time = 0.5 + 0.01 * step
        beside = 0.0501 + max(0.3 - 0.3 * (time - 0.5), 0.0) + max(0.3 * (time - 3.5), 0.0)
        studio.place(-beside, 0.0, "other")
        follow(studio, tracker, at_rest, time, time + 0.01)
        assert tracker.predict(time).position == pytest.approx(CENTER, abs=3e-3)
    assert tracker.lost_count == 0


@by_rays(("depth",), (-0.055,), (0.08,))
def test_a_passing_object_of_the_same_color_does_not_steal_the_lock(
    depth: float, make_studio: StudioMaker
) -> None:
    """It passes at 0.2 m/s; in front of the target, it hides it for a while."""
    studio = make_studio(fps=60.0)
    tracker = TargetTracker(studio.camera, YELLOW, cube())
    follow(studio, tracker, small_circle, 0.0, 1.0)
    for step in range(200):
        time = 1.0 + 0.01 * step
        studio.place(-0.2 + 0.2 * (time - 1.0), 0.01, "other", y=depth)
        follow(studio, tracker, small_circle, time, time + 0.01)
        if tracker.locked:
            away = tracker.predict(time).position - position(small_circle, time)
            assert float(np.abs(away).max()) < 15e-3
    assert tracker.locked
    assert tracker.predict(3.0).position == pytest.approx(position(small_circle, 3.0), abs=1e-3)


def test_a_lost_target_is_found_again_where_it_was(
    make_studio: StudioMaker,
) -> None:
    """A larger object of its color appears meanwhile and is not taken for the target."""
    studio = make_studio(fps=60.0)
    tracker = TargetTracker(studio.camera, YELLOW, FACE)
    follow(studio, tracker, at_rest, 0.0, 0.5)
    studio.place(0.1, 0.0, "other", y=-0.06)
    follow(studio, tracker, lambda _: (2.0, 0.0), 0.5, 1.2)
    assert tracker.lost_count == 1
    assert not tracker.locked
    follow(studio, tracker, at_rest, 1.2, 1.5)
    assert tracker.locked
    assert tracker.predict(1.5).position == pytest.approx(CENTER, abs=1e-3)


def swapped(studio: Studio, x: float, y: float = 0.0, seconds: float = 2.5) -> TargetTracker:
    """Track a target that rests for half a second, then vanishes just as another one appears."""
    tracker = TargetTracker(studio.camera, YELLOW, FACE)
    follow(studio, tracker, at_rest, 0.0, 0.5)
    studio.place(x, 0.0, "other", y=y)
    follow(studio, tracker, lambda _: (2.0, 0.0), 0.5, 0.5 + seconds)
    assert tracker.lost_count == 1
    return tracker


@by_rays(("x", "fps"), *product((-0.15, 0.12, 0.18), (20.0, 60.0)))
def test_an_object_that_appears_out_of_reach_is_not_the_target(
    x: float, fps: float, make_studio: StudioMaker
) -> None:
    """No target moves 12 cm from rest in a tenth of a second; the object stays rejected later."""
    studio = make_studio(fps=fps)
    tracker = swapped(studio, x)
    assert not tracker.locked
    assert tracker.distractors.count > 20
    studio.place(x, 0.0, "other")
    follow(studio, tracker, at_rest, 3.0, 3.5)  # both in view
    assert tracker.locked
    assert tracker.predict(3.5).position == pytest.approx(CENTER, abs=1e-3)


@by_rays(("y",), (-0.15,), (0.25,))
def test_an_object_of_another_size_is_never_the_target(y: float, make_studio: StudioMaker) -> None:
    """It is where the target was, 1.75 or 0.6 times as wide in the image, up to 3 s later."""
    studio = make_studio(fps=60.0)
    tracker = swapped(studio, 5.0, seconds=1.5)
    studio.place(0.0, 0.0, "other", y=y)
    follow(studio, tracker, lambda _: (2.0, 0.0), 2.0, 3.5)
    assert not tracker.locked
    assert "times as wide" in tracker.distractors.reason


def test_an_object_that_arrives_during_a_loss_is_not_the_target(
    make_studio: StudioMaker,
) -> None:
    """It comes from 0.17 m away at 0.1 m/s to where the target was, a known distractor by then."""
    studio = make_studio(fps=60.0)
    tracker = TargetTracker(studio.camera, YELLOW, FACE)
    follow(studio, tracker, at_rest, 0.0, 0.5)
    for step in range(200):
        time = 0.5 + 0.01 * step
        studio.place(-0.17 + 0.1 * (time - 0.5), 0.0, "other")
        follow(studio, tracker, lambda _: (2.0, 0.0), time, time + 0.01)
    assert tracker.lost_count == 1
    assert not tracker.locked


@by_rays(("hidden", "last"), (0.2, 2.0), (0.5, 2.0), (0.4, 0.85))
def test_a_target_that_moves_while_hidden_is_found_again(
    make_studio: StudioMaker, hidden: float, last: float
) -> None:
    """It goes on behind a screen at 0.15 m/s, or stops there."""
    studio = make_studio(fps=60.0)
    tracker = TargetTracker(studio.camera, YELLOW, FACE)

    def going(time: float) -> tuple[float, float]:
        return -0.1 + 0.15 * min(time, last), 0.0

    follow(studio, tracker, going, 0.0, 0.6)
    studio.place(0.0, 0.0, "screen", y=-0.03)
    follow(studio, tracker, going, 0.6, 0.6 + hidden)
    studio.place(0.0, 5.0, "screen", y=-0.03)
    follow(studio, tracker, going, 0.6 + hidden, 1.4)
    assert tracker.lost_count == 1
    assert tracker.locked, tracker.distractors.reason
    assert tracker.predict(1.4).position == pytest.approx(position(going, 1.4), abs=8e-3)


def test_a_target_that_looks_different_off_axis_is_not_lost(make_studio: StudioMaker) -> None:
    """100 mm off axis, a third more of a cube is visible, which a plane does not model."""
    studio = make_studio(fps=60.0)
    tracker = TargetTracker(studio.camera, YELLOW, FACE)

    def coming(time: float) -> tuple[float, float]:
        away = 1.0 - min(max((time - 0.4) / 0.3, 0.0), 1.0)
        return 0.1 * away, 0.07 * away

    follow(studio, tracker, coming, 0.0, 1.5)
    assert tracker.lost_count == 0
    assert tracker.predict(1.5).position == pytest.approx(CENTER, abs=1e-3)


@by_rays(
    ("axis", "away", "rate"),
    *product(((0.6, 0.8, 0.0), (0.0, 1.0, 0.0)), (-0.08, 0.2), (3.0, 1.5)),
    one_in=3,
)
def test_a_cube_of_known_size_that_moves_and_turns_is_not_lost(
    rate: float, away: float, axis: tuple[float, ...], make_studio: StudioMaker
) -> None:
    """At 40 Hz, it comes nearer or goes away; its outline fits no upright cube meanwhile."""
    studio = make_studio(fps=40.0)
    tracker = TargetTracker(studio.camera, YELLOW, cube())
    body = studio.model.body("cube").mocapid[0]

    def carried(time: float) -> tuple[float, float, float]:
        share = min(max(time - 0.5, 0.0), 1.0)
        half = 0.5 * rate * share
        studio.data.mocap_quat[body] = (math.cos(half), *(math.sin(half) * np.array(axis)))
        return 0.05 * share, 0.03 * share, away * share**2 * (3.0 - 2.0 * share)

    follow(studio, tracker, carried, 0.0, 2.5)
    assert tracker.locked
    assert tracker.lost_count == 0
    sideways = tracker.predict(2.5).position - position(carried, 2.5)
    assert np.abs(sideways[[0, 2]]).max() < 0.012


def test_a_cube_of_known_size_that_turns_about_the_line_of_sight_is_not_lost(
    make_studio: StudioMaker,
) -> None:
    """Its outline's box becomes a third wider and higher, its area stays: it shows all edges."""
    studio = make_studio(fps=60.0)
    tracker = TargetTracker(studio.camera, YELLOW, cube())

    def turning(time: float) -> tuple[float, float]:
        angle = 0.5 * math.sin(3.0 * max(time - 0.5, 0.0))
        body = studio.model.body("cube").mocapid[0]
        studio.data.mocap_quat[body] = (math.cos(0.5 * angle), 0.0, math.sin(0.5 * angle), 0.0)
        return small_circle(time)

    follow(studio, tracker, turning, 0.0, 2.5)
    assert tracker.lost_count == 0
    assert tracker.predict(2.5).position == pytest.approx(position(small_circle, 2.5), abs=1e-3)


def test_a_passing_speck_does_not_count_as_a_loss(make_studio: StudioMaker) -> None:
    studio = make_studio(fps=60.0)
    tracker = TargetTracker(studio.camera, YELLOW, FACE)
    follow(studio, tracker, at_rest, 0.0, 0.01)
    assert not tracker.locked
    follow(studio, tracker, lambda _: (2.0, 0.0), 0.01, 0.3)
    assert not tracker.locked
    assert tracker.lost_count == 0
    assert tracker.lost_since is None


def test_prediction_fails_without_a_sighting(make_studio: StudioMaker) -> None:
    studio = make_studio(fps=60.0)
    tracker = TargetTracker(studio.camera, Color.named("green"), FACE)
    follow(studio, tracker, at_rest, 0.0, 0.05)
    assert tracker.frames > 0
    assert tracker.age(0.05) == math.inf
    with pytest.raises(ValueError, match="not been seen"):
        tracker.predict(0.05)


def test_an_unknown_plane_is_found_by_the_size(make_studio: StudioMaker) -> None:
    studio = make_studio(fps=60.0)
    localizer = PlaneOfSizeLocalizer(np.array([0.0, 1.0, 0.0]), SIDE_M)
    tracker = TargetTracker(studio.camera, YELLOW, localizer)
    follow(studio, tracker, at_rest, 0.0, 0.6)
    assert tracker.predict(0.6).position == pytest.approx(CENTER, abs=3e-3)


def test_closing_releases_the_camera(make_studio: StudioMaker) -> None:
    studio = make_studio(fps=60.0)
    tracker = TargetTracker(studio.camera, YELLOW, FACE)
    tracker.close()
    tracker.close()
    assert studio.camera.aim is None
    assert not studio.camera.due(1000.0), "no subscriber is left"


@by_rays(("offset",), ((0.06, 0.05),), ((-0.07, 0.04),), ((0.0, 0.08),))
def test_a_target_first_seen_off_axis_is_located_exactly_on_the_axis(
    make_studio: StudioMaker, offset: tuple[float, float]
) -> None:
    """Dark flanks make its depth wrong by 2 cm until it is on the axis; there 0.1 mm remains.

    Taken for partly hidden and located by its edges, it would be 1 to 5 mm off.
    """
    studio = make_studio(fps=30.0, ambient=0.0)
    tracker = TargetTracker(studio.camera, YELLOW, cube())

    def coming(time: float) -> tuple[float, float]:
        away = 1.0 - min(max((time - 0.2) / 0.3, 0.0), 1.0)
        return offset[0] * away, offset[1] * away

    follow(studio, tracker, coming, 0.0, 1.5)
    late = [sighting for sighting in tracker.sightings.newest() if sighting.stamp > 0.6]
    errors = np.array([sighting.point - CENTER for sighting in late])
    assert len(late) > 20
    assert np.abs(errors[:, [0, 2]]).max() < 0.2e-3
    assert np.abs(errors[:, 1]).max() < 3e-3


@by_rays(("hidden",), (0.1,), (0.3,), (0.5,))
def test_a_target_first_seen_in_part_is_located_exactly_when_visible(
    make_studio: StudioMaker, hidden: float
) -> None:
    """Hidden for half a second; taken for a smaller cube it would stay 2.5 to 18 mm off.

    A target that seemed farther away by 70 mm or more is lost and found again meanwhile.
    """
    studio = make_studio(fps=30.0)
    tracker = TargetTracker(studio.camera, YELLOW, cube())
    for step in range(100):
        time = 0.02 * step
        edge = -0.025 + 0.05 * hidden - 0.5 * max(time - 0.5, 0.0)
        studio.place(-0.5 + edge, 0.0, "screen", y=-0.03)
        follow(studio, tracker, at_rest, time, time + 0.02)
    assert tracker.sightings.newest(1)[0].point[[0, 2]] == pytest.approx(CENTER[[0, 2]], abs=0.2e-3)
    assert tracker.sightings.newest(1)[0].point[1] == pytest.approx(CENTER[1], abs=3e-3)
    assert tracker.locked


@by_rays(("duration",), (1.0,), (2.0,))
def test_a_target_that_comes_into_view_is_locked_when_it_is_whole(
    make_studio: StudioMaker, duration: float
) -> None:
    """Cut off by the border, it would seem to be far away and to fly toward the camera."""
    studio = make_studio(fps=60.0)
    tracker = TargetTracker(studio.camera, YELLOW, cube())

    def coming(time: float) -> tuple[float, float]:
        share = min(time / duration, 1.0)
        return 0.4 * (share**3 * (10.0 - 15.0 * share + 6.0 * share**2) - 1.0), 0.0

    end = duration + 0.5
    follow(studio, tracker, coming, 0.0, end)
    seen = tracker.sightings.newest()
    assert tracker.lost_count == 0
    assert tracker.locked
    assert seen[0].point[1] == pytest.approx(CENTER[1], abs=0.02)
    assert tracker.predict(end).position == pytest.approx(CENTER, abs=3e-3)


def test_a_target_that_stays_at_the_image_border_is_locked_after_a_while(
    make_studio: StudioMaker,
) -> None:
    studio = make_studio(fps=60.0)
    tracker = TargetTracker(studio.camera, YELLOW, FACE)
    border = 0.35 * math.tan(math.radians(25.0)) * 320 / 240  # half of it is in view
    follow(studio, tracker, lambda _: (border, 0.0), 0.0, 0.4)
    assert not tracker.locked
    follow(studio, tracker, lambda _: (border, 0.0), 0.4, 0.7)
    assert tracker.locked


@by_rays(("turned", "depth"), *product((0.4, 0.0), (-0.05, 0.03, 0.06)), one_in=2)
def test_a_cube_of_known_size_that_changes_depth_is_located_there(
    make_studio: StudioMaker, depth: float, turned: float
) -> None:
    """It changes depth within half a second while it circles; the depth scales the circle."""
    studio = make_studio(fps=60.0)
    tracker = TargetTracker(studio.camera, YELLOW, cube())
    body = studio.model.body("cube").mocapid[0]
    studio.data.mocap_quat[body] = (math.cos(0.5 * turned), 0.0, math.sin(0.5 * turned), 0.0)

    def circling(time: float) -> tuple[float, ...]:
        return *small_circle(time), depth * min(max((time - 0.5) / 0.5, 0.0), 1.0)

    follow(studio, tracker, circling, 0.0, 4.0)
    assert tracker.locked
    assert tracker.predict(4.0).position == pytest.approx(position(circling, 4.0), abs=3e-3)
    late = [one for one in tracker.sightings.newest() if one.stamp > 2.0]
    assert len(late) >= 119  # every image


@by_rays(("turn", "duration"), *product((-1.0, 0.5), (0.6, 1.2)))
def test_a_cube_of_known_size_that_comes_nearer_and_tilts_is_not_lost(
    make_studio: StudioMaker, duration: float, turn: float
) -> None:
    """An arm that carries it turns it by 45° to and fro, or by 90°, on its way to the camera."""
    studio = make_studio(fps=60.0)
    tracker = TargetTracker(studio.camera, YELLOW, cube())
    body = studio.model.body("cube").mocapid[0]

    def coming(time: float) -> tuple[float, ...]:
        share = min(max((time - 0.5) / duration, 0.0), 1.0)
        angle = 0.5 * math.pi * (share if turn < 0.0 else turn * math.sin(math.pi * share))
        studio.data.mocap_quat[body] = (math.cos(0.5 * angle), math.sin(0.5 * angle), 0.0, 0.0)
        return 0.02 * share, 0.0, 0.2 * (1.0 - share) - 0.03

    follow(studio, tracker, coming, 0.0, 3.0)
    assert tracker.locked
    assert tracker.predict(3.0).position == pytest.approx(position(coming, 3.0), abs=3e-3)
    late = [one for one in tracker.sightings.newest() if one.stamp > 1.0 + duration]
    assert len(late) >= 60 * (2.0 - duration) - 2  # every image


@by_rays(
    ("tilt", "turned", "duration"),
    *product((0.3, 0.0), (0.785, 0.4, 0.0), (0.6, 1.2)),
    one_in=5,
)
def test_a_cube_of_known_size_that_goes_away_and_tilts_is_not_lost(
    make_studio: StudioMaker, turned: float, tilt: float, duration: float
) -> None:
    """An arm that brings the cube to where tracking begins carries it away from the camera."""
    studio = make_studio(fps=60.0)
    tracker = TargetTracker(studio.camera, YELLOW, cube())
    body = studio.model.body("cube").mocapid[0]

    def going(time: float) -> tuple[float, ...]:
        share = min(max((time - 0.5) / duration, 0.0), 1.0)
        rotation = Rotation.from_rotvec((tilt * (1.0 - share), 0.0, 0.0))
        rotation *= Rotation.from_rotvec((0.0, turned, 0.0))
        studio.data.mocap_quat[body] = rotation.as_quat(scalar_first=True)
        return 0.02 * share, 0.0, 0.12 * share - 0.08

    follow(studio, tracker, going, 0.0, 2.5)
    assert tracker.locked
    assert tracker.lost_count == 0
    assert tracker.predict(2.5).position == pytest.approx(position(going, 2.5), abs=3e-3)


@by_rays(("offset",), ((0.03, -0.02),), ((0.0, 0.0),), ((-0.05, 0.04),))
def test_a_depth_correction_does_not_count_as_motion(
    make_studio: StudioMaker, offset: tuple[float, float]
) -> None:
    """The first, coarse images misjudge the size, and so the depth, of a target at rest.

    Taken for motion of the target, this was 0.02 to 0.24 m/s along the normal here, and 2 m/s
    with noise: the next window missed the target, which was lost as soon as it was found.
    """
    studio = make_studio(fps=60.0)
    tracker = TargetTracker(studio.camera, YELLOW, cube())
    velocities = []
    for step in range(12):
        follow(studio, tracker, lambda _: offset, step / 60.0, (step + 1) / 60.0)
        if tracker.locked:
            velocities.append(NORMAL @ tracker.predict(tracker.last_stamp).velocity)
    assert len(velocities) >= 9
    assert np.abs(velocities).max() < 1e-6


def test_the_next_image_replaces_an_unconfirmed_partial_view() -> None:
    """A coarse image shows a corner of a thin rim, seemingly far away; the next shows all of it."""
    camera = SimpleNamespace(subscribe=lambda _: lambda: None, aim=None, findings=[])
    localizer = PlaneOfSizeLocalizer(np.array((0.0, 0.0, 1.0)), 0.05, cube=True)
    tracker = TargetTracker(cast("Any", camera), YELLOW, localizer)
    for number in range(4):
        image = np.full((240, 320, 3), 90, np.uint8)
        image[100:140, 140:180] = (240, 215, 15)
        image[103:137, 143:177] = 235
        if number == 0:
            image[:, :170] = 90
            image[115:] = 90
        frame = Frame(
            number / 60.0, image, Pose.identity(), 0.87, (0, 0, 320, 240), 3 if number == 0 else 1
        )
        tracker.on_frame(frame)
    assert tracker.locked
    assert tracker.predict(3.0 / 60.0).position[2] == pytest.approx(
        frame.focal_px * 0.05 / 40.0, rel=0.02
    )
