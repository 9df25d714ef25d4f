from __future__ import annotations

from typing import TYPE_CHECKING

import cv2
import numpy as np
import pytest

from bt_dualarm.core.pose import Pose
from bt_dualarm.perception.detection import ColorFilter, detect, detect_all, detect_blobs
from bt_dualarm.sim.frame import Frame, Window
from bt_dualarm.spec.colors import NAMED_COLORS
from bt_dualarm.spec.values import Color

if TYPE_CHECKING:
    from tests.perception.conftest import StudioMaker

TARGET_COLORS = ("yellow", "red", "green", "blue", "orange")
YELLOW = ColorFilter(Color.named("yellow"))


def painted(region: tuple[int, int, int, int] | None = None, stride: int = 1) -> Frame:
    """A gray image of 200 by 100 with one yellow rectangle of 20 by 10 px, center (150, 30)."""
    image = np.full((100, 200, 3), 90, np.uint8)
    image[25:35, 140:160] = (240, 215, 15)
    return Frame(1.5, image, Pose.identity(), 0.9, region or (0, 0, 200, 100), stride)


def test_centroid_is_zero_in_the_center_and_one_at_the_edges() -> None:
    found = detect(painted(), YELLOW)
    assert found is not None
    assert found.stamp == 1.5
    assert found.centroid_px == pytest.approx((150.0, 30.0), abs=1e-3)
    assert found.centroid == pytest.approx((0.5, -0.4), abs=1e-4)
    assert found.area_px == pytest.approx(200.0, rel=0.01)
    assert found.size == pytest.approx(np.sqrt(200.0) / 100.0, rel=0.01)
    assert found.bounds_px == (140, 25, 160, 35)
    assert found.confidence == 1.0
    assert not found.touches_border


def test_only_the_exposed_region_counts() -> None:
    assert detect(painted((0, 0, 100, 100)), YELLOW) is None
    inside = detect(painted((130, 15, 170, 45)), YELLOW)
    assert inside is not None
    assert inside.centroid_px == pytest.approx((150.0, 30.0), abs=1e-3)
    cut = detect(painted((100, 0, 150, 100)), YELLOW)
    assert cut is not None
    assert cut.touches_border


@pytest.mark.parametrize("stride", [1, 3])
@pytest.mark.parametrize(
    ("bounds", "spans"),
    [
        ((0, 0, 200, 100), True),
        ((0, 40, 200, 60), True),
        ((80, 0, 120, 100), True),
        ((0, 0, 120, 60), False),
        ((80, 40, 200, 100), False),
        ((6, 40, 192, 60), False),
    ],
)
def test_what_reaches_opposite_borders_of_the_image_spans_it(
    bounds: tuple[int, int, int, int], spans: bool, stride: int
) -> None:
    image = np.zeros((100, 200, 3), np.uint8)
    left, top, right, bottom = bounds
    image[top:bottom, left:right] = (255, 255, 0)
    frame = Frame(1.5, image, Pose.identity(), 0.9, (0, 0, 200, 100), stride)
    found = detect(frame, YELLOW)
    assert found is not None
    assert found.spans(frame) == spans


def test_a_window_that_a_target_spans_is_not_the_image() -> None:
    region = 140, 0, 160, 100
    frame = painted(region)
    found = detect(frame, YELLOW)
    assert found is not None
    assert found.touches_border
    assert not found.spans(frame)


def test_an_empty_region_has_no_detection() -> None:
    assert detect(painted((50, 50, 50, 60)), YELLOW) is None


def test_blocks_keep_the_centroid() -> None:
    """A frame sampled in blocks of 5 px, aligned with the rectangle, has the same centroid."""
    found = detect(painted(stride=5), YELLOW)
    assert found is not None
    assert found.centroid_px == pytest.approx((150.0, 30.0), abs=0.01)
    assert found.area_px == pytest.approx(200.0, rel=0.01)


def test_size_limits_are_kept() -> None:
    assert detect(painted(), YELLOW, min_area=250.0) is None
    assert detect(painted(), YELLOW, max_area=150.0) is None


def printed(rim: int, stride: int = 1) -> Frame:
    """A yellow square of 40 px, its center at (150, 60), with a print that leaves only a rim."""
    image = np.full((120, 300, 3), 90, np.uint8)
    image[40:80, 130:170] = (240, 215, 15)
    image[40 + rim : 80 - rim, 130 + rim : 170 - rim] = 235
    image[50:70:4, 140:160] = 20
    return Frame(0.0, image, Pose.identity(), 0.9, (0, 0, 300, 120), stride)


@pytest.mark.parametrize("rim", [1, 2, 3, 6])
def test_the_area_inside_a_rim_belongs_to_the_object(rim: int) -> None:
    frame = printed(rim)
    if rim > 1:
        frame.image[60, 130:132] = 90  # a gap
    found = detect_all(frame, YELLOW)
    assert len(found) == 1
    assert found[0].centroid_px == pytest.approx((150.0, 60.0), abs=0.05)
    assert found[0].area_px == pytest.approx(1600.0, rel=0.01)
    assert found[0].bounds_px == (130, 40, 170, 80)


def test_blocks_show_a_rim_with_gaps_as_one_object() -> None:
    """One sample per block misses a thinner rim in places."""
    frame = printed(rim=3, stride=3)
    for at in (45, 51, 69):
        frame.image[at : at + 6, 128:134] = 90
    found = detect_all(frame, YELLOW)
    assert len(found) == 1
    assert found[0].centroid_px == pytest.approx((150.0, 60.0), abs=3.0)
    assert found[0].area_px == pytest.approx(1600.0, rel=0.2)


def test_an_occlusion_from_outside_is_not_filled() -> None:
    frame = printed(rim=6)
    frame.image[55:65, 120:150] = 90  # a finger, for example
    found = detect_all(frame, YELLOW)
    assert len(found) == 1
    assert found[0].area_px < 1600.0 - 28.0**2


def test_separate_objects_stay_separate_in_blocks() -> None:
    """Three objects around an empty spot are not merged."""
    image = np.full((120, 300, 3), 90, np.uint8)
    for x, y in ((130, 40), (160, 40), (145, 66)):
        image[y : y + 18, x : x + 18] = (240, 215, 15)
    frame = Frame(0.0, image, Pose.identity(), 0.9, (0, 0, 300, 120), 3)
    assert len(detect_all(frame, YELLOW)) == 3


def test_specks_are_opened_away() -> None:
    frame = painted()
    frame.image[80, 20:40] = (240, 215, 15)
    assert len(detect_all(frame, YELLOW, min_area=5.0)) == 1


def test_pinholes_are_closed() -> None:
    frame = painted()
    frame.image[30, 150] = (90, 90, 90)
    found = detect(frame, YELLOW)
    assert found is not None
    assert found.centroid_px == pytest.approx((150.0, 30.0), abs=1e-3)
    assert found.confidence == pytest.approx(1.0 - 1.0 / 200.0)


def test_mixed_edge_pixels_count_by_their_share() -> None:
    """A column that is covered to 40 % moves the centroid as 40 % of a column would."""
    frame = painted()
    share = 0.4
    frame.image[25:35, 160] = np.round(
        share * np.array((240, 215, 15)) + (1.0 - share) * np.array((90, 90, 90))
    )
    found = detect(frame, YELLOW)
    assert found is not None
    expected = 140.0 + 0.5 * (20.0 + share) + 0.5 * share * (1.0 - share) / (20.0 + share)
    assert found.area_px == pytest.approx(10.0 * (20.0 + share), rel=0.01)
    assert found.centroid_px[0] == pytest.approx(expected, abs=0.02)


def test_the_largest_or_the_expected_object_is_chosen() -> None:
    frame = painted()
    frame.image[70:90, 20:60] = (240, 215, 15)
    largest = detect(frame, YELLOW)
    expected = detect(frame, YELLOW, expected_px=(140.0, 40.0))
    assert largest is not None
    assert largest.centroid_px == pytest.approx((40.0, 80.0), abs=1e-3)
    assert expected is not None
    assert expected.centroid_px == pytest.approx((150.0, 30.0), abs=1e-3)


def test_red_is_found_on_both_sides_of_the_wrap() -> None:
    red = ColorFilter(Color.named("red"))
    for rgb in ((220, 10, 30), (220, 30, 10)):
        frame = painted()
        frame.image[25:35, 140:160] = rgb
        assert detect(frame, red) is not None


@pytest.mark.parametrize("name", TARGET_COLORS)
def test_named_colors_are_found_and_distinguished(name: str, make_studio: StudioMaker) -> None:
    """A cube painted with the named color is seen by that filter and by no other."""
    studio = make_studio(NAMED_COLORS[name][:3])
    studio.place(0.03, 0.02)
    frame = studio.camera.capture(studio)
    for other in TARGET_COLORS:
        found = detect(frame, ColorFilter(Color.named(other)))
        assert (found is not None) == (other == name), other
        if found is not None:
            assert found.area_px == pytest.approx((frame.focal_px * 0.05 / 0.35) ** 2, rel=0.05)


def test_centroid_noise_is_a_tenth_of_a_pixel(
    make_studio: StudioMaker, rng: np.random.Generator
) -> None:
    """0.05 to 0.07 px were measured; the cube's front face is 0.35 m away."""
    studio = make_studio()
    studio.camera.aim = lambda *_: Window((110, 70, 210, 170))
    errors = []
    for x, z in rng.uniform(-0.02, 0.02, (40, 2)):
        studio.place(x, z)
        frame = studio.camera.capture(studio)
        found = detect(frame, YELLOW)
        assert found is not None
        scale = frame.focal_px / 0.35
        errors.append(np.subtract(found.centroid_px, (160.0 + scale * x, 120.0 - scale * z)))
    assert np.std(errors, axis=0) == pytest.approx(0.0, abs=0.1)
    assert np.mean(errors, axis=0) == pytest.approx(0.0, abs=0.03)


@pytest.mark.parametrize("seed", range(30))
def test_specks_and_pinholes_are_cleared_as_in_the_whole_image(seed: int) -> None:
    """Filtering only regions of the color has the same result as filtering the whole image."""
    rng = np.random.default_rng(seed)
    image = np.full((60, 80, 3), 90, np.uint8)
    for _ in range(3):
        x, y = (int(value) for value in rng.integers((-5, -5), (80, 60)))
        cv2.circle(image, (x, y), int(rng.integers(2, 20)), (240, 215, 15), cv2.FILLED)
    image[rng.random((60, 80)) < 0.05] = 90
    image[rng.random((60, 80)) < 0.01] = (240, 215, 15)
    square = cv2.getStructuringElement(cv2.MORPH_RECT, (3, 3))
    opened = cv2.morphologyEx(YELLOW.mask(image), cv2.MORPH_OPEN, square)
    cleared = cv2.morphologyEx(opened, cv2.MORPH_CLOSE, square)
    contours, _ = cv2.findContours(cleared, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_SIMPLE)
    boxes = [cv2.boundingRect(contour) for contour in contours]
    expected = {(x, y, x + w, y + h) for x, y, w, h in boxes if w * h >= 12}
    frame = Frame(0.0, image, Pose.identity(), 0.9, (0, 0, 80, 60))
    assert {found.bounds_px for found, _ in detect_blobs(frame, YELLOW, 0.0)} >= expected
    assert {blob.bounds for _, blob in detect_blobs(frame, YELLOW, 12.0)} <= expected
