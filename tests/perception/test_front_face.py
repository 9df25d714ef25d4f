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
    """Error of the located position of the front face, of shape (3,), mm."""
    studio.place(x, z)
    frame = studio.camera.capture(studio)
    found = detect(frame, YELLOW)
    assert found is not None
    localizer.learn(found, frame)
    error: Vector = 1e3 * (localizer.locate(found, frame).point - FACE - np.array([x, 0.0, z]))
    return error


def localizer_after_axial_view(studio: Studio) -> PlaneOfSizeLocalizer:
    """A localizer that knows the depth from half a second of the cube on the camera's axis."""
    localizer = PlaneOfSizeLocalizer(NORMAL, SIDE_M, cube=True)
    for _ in range(30):
        error_mm(studio, localizer, 0.0, 0.0)
    return localizer


@pytest.mark.parametrize("offset", [0.05, 0.07, 0.1])
def test_correction_reduces_the_bias_from_visible_flanks(
    make_studio: StudioMaker, offset: float
) -> None:
    """The bias is 1 to 5 mm toward the axis, a third of that corrected; 0.1 to 0.7 mm measured."""
    studio = make_studio()
    bias = error_mm(studio, PlaneLocalizer(FACE, NORMAL), offset, 0.0)[0]
    residual = error_mm(studio, localizer_after_axial_view(studio), offset, 0.0)[0]
    assert bias < -0.8
    assert abs(residual) < 0.4 * abs(bias)


def test_the_depth_is_accurate_off_axis(make_studio: StudioMaker) -> None:
    """Uncorrected, a flank makes the outline larger and the target seem nearer by 2 cm."""
    studio = make_studio()
    naive = error_mm(studio, PlaneOfSizeLocalizer(NORMAL, SIDE_M), 0.1, 0.05)[1]
    aware = error_mm(studio, PlaneOfSizeLocalizer(NORMAL, SIDE_M, cube=True), 0.1, 0.05)[1]
    assert abs(naive) > 10.0
    assert abs(aware) < 4.0


def test_dark_flanks_cause_no_bias(make_studio: StudioMaker) -> None:
    """The depth is known from a view on the axis; the area then shows that no flank has color."""
    studio = make_studio(ambient=0.0)
    error = error_mm(studio, localizer_after_axial_view(studio), 0.08, 0.0)
    assert np.abs(error[[0, 2]]).max() < 0.7


def test_nothing_is_corrected_on_the_axis(make_studio: StudioMaker) -> None:
    studio = make_studio()
    studio.place(0.01, -0.01)
    frame = studio.camera.capture(studio)
    found = detect(frame, YELLOW)
    assert found is not None
    corrected = front_face(found, frame, FACE + np.array([0.01, 0.0, -0.01]), NORMAL, SIDE_M)
    assert corrected.centroid_px == pytest.approx(found.centroid_px, abs=1e-3)
    assert corrected.area_px == pytest.approx(found.area_px, rel=1e-4)


def test_a_cube_around_the_camera_is_not_corrected(make_studio: StudioMaker) -> None:
    studio = make_studio()
    frame = studio.camera.capture(studio)
    found = detect(frame, YELLOW)
    assert found is not None
    assert front_face(found, frame, frame.pose.position, NORMAL, SIDE_M) is found
