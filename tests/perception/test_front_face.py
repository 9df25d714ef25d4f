from __future__ import annotations

import numpy as np
import pytest

from bt_dualarm.core.pose import Vector
from bt_dualarm.perception.detection import ColorFilter, detect
from bt_dualarm.perception.localization import (
    Localizer,
    PlaneLocalizer,
    PlaneOfSizeLocalizer,
    front_face,
)
from bt_dualarm.spec.values import Color
from tests.perception.conftest import SIDE_M, Studio, StudioMaker

YELLOW = ColorFilter(Color.named("yellow"))
NORMAL = np.array([0.0, 1.0, 0.0])
FACE = np.array([0.0, -SIDE_M / 2.0, 0.5])


def error_mm(studio: Studio, localizer: Localizer, x: float, z: float) -> Vector:
    """Where the localizer places the front face, from where it is."""
    studio.place(x, z)
    frame = studio.camera.capture(studio)
    found = detect(frame, YELLOW)
    assert found is not None
    localizer.learn(found, frame)
    error: Vector = 1e3 * (localizer.locate(found, frame).point - FACE - np.array([x, 0.0, z]))
    return error


def seen_ahead(studio: Studio) -> PlaneOfSizeLocalizer:
    """A localizer that knows the depth from half a second of the cube on the camera's axis."""
    localizer = PlaneOfSizeLocalizer(NORMAL, SIDE_M, cube=True)
    for _ in range(30):
        error_mm(studio, localizer, 0.0, 0.0)
    return localizer


@pytest.mark.parametrize("offset", [0.05, 0.07, 0.1])
def test_flanks_pull_and_the_correction_lets_go(make_studio: StudioMaker, offset: float) -> None:
    """Without it 1 to 5 mm toward the axis, with it a third of that; 0.1 to 0.7 mm measured."""
    studio = make_studio()
    bias = error_mm(studio, PlaneLocalizer(FACE, NORMAL), offset, 0.0)[0]
    left = error_mm(studio, seen_ahead(studio), offset, 0.0)[0]
    assert bias < -0.8
    assert abs(left) < 0.4 * abs(bias)


def test_the_depth_does_not_suffer_off_axis(make_studio: StudioMaker) -> None:
    """A flank makes the outline larger and the target seem nearer by 2 cm."""
    studio = make_studio()
    naive = error_mm(studio, PlaneOfSizeLocalizer(NORMAL, SIDE_M), 0.1, 0.05)[1]
    aware = error_mm(studio, PlaneOfSizeLocalizer(NORMAL, SIDE_M, cube=True), 0.1, 0.05)[1]
    assert abs(naive) > 10.0
    assert abs(aware) < 4.0


def test_flanks_in_the_dark_do_not_pull(make_studio: StudioMaker) -> None:
    """Seen from the axis first, the depth is known; then the area shows that none has color."""
    studio = make_studio(ambient=0.0)
    error = error_mm(studio, seen_ahead(studio), 0.08, 0.0)
    assert np.abs(error[[0, 2]]).max() < 0.7


def test_on_the_axis_nothing_changes(make_studio: StudioMaker) -> None:
    studio = make_studio()
    studio.place(0.01, -0.01)
    frame = studio.camera.capture(studio)
    found = detect(frame, YELLOW)
    assert found is not None
    corrected = front_face(found, frame, FACE + np.array([0.01, 0.0, -0.01]), NORMAL, SIDE_M)
    assert corrected.centroid_px == pytest.approx(found.centroid_px, abs=1e-3)
    assert corrected.area_px == pytest.approx(found.area_px, rel=1e-4)


def test_a_cube_about_the_camera_is_left_as_it_is(make_studio: StudioMaker) -> None:
    studio = make_studio()
    frame = studio.camera.capture(studio)
    found = detect(frame, YELLOW)
    assert found is not None
    assert front_face(found, frame, frame.pose.position, NORMAL, SIDE_M) is found
