"""A lens distorts images according to OpenCV's distortion model."""

from __future__ import annotations

import math
from typing import Any

import cv2
import numpy as np
import pytest

from bt_dualarm.core.pose import Vector
from bt_dualarm.sim.camera import Lens
from bt_dualarm.sim.frame import Exposure, Image, Region
from bt_dualarm.sim.ray_trace_kernels import source_region
from tests.plain_kernels import plain

WIDTH = 320
HEIGHT = 240
FOCAL_PX = 257.0
WHOLE = Exposure(0, WIDTH, HEIGHT)


def lens(k1: float, k2: float) -> Lens:
    return Lens(k1, k2, WIDTH, HEIGHT, FOCAL_PX)


def spot(at: tuple[float, float]) -> Image:
    """An image of a Gaussian spot with a deviation of 4 px, at a point in pixels."""
    y, x = np.indices((HEIGHT, WIDTH)) + 0.5
    level = 255 * np.exp(-((x - at[0]) ** 2 + (y - at[1]) ** 2) / (2 * 4.0**2))
    return np.repeat(np.rint(level).astype(np.uint8)[..., None], 3, axis=2)


def middle(image: Image) -> Vector:
    """Centroid in pixels."""
    level = image[..., 0].astype(float)
    y, x = np.indices((HEIGHT, WIDTH)) + 0.5
    return np.array([(level * x).sum() / level.sum(), (level * y).sum() / level.sum()])


@pytest.mark.parametrize("seed", range(8))
def test_point_is_seen_where_opencv_projects_it(seed: int) -> None:
    rng = np.random.default_rng(seed)
    k1, k2 = rng.uniform(-0.1, 0.1, 2)
    at = (float(rng.uniform(60, 260)), float(rng.uniform(50, 190)))
    ray = np.array([[(at[0] - WIDTH / 2) / FOCAL_PX, (at[1] - HEIGHT / 2) / FOCAL_PX, 1.0]])
    camera = np.array([[FOCAL_PX, 0, WIDTH / 2], [0, FOCAL_PX, HEIGHT / 2], [0, 0, 1.0]])
    coefficients = np.array([k1, k2, 0.0, 0.0])
    projected, _ = cv2.projectPoints(ray, np.zeros(3), np.zeros(3), camera, coefficients)
    seen = middle(lens(k1, k2).distorted(spot(at), WHOLE))
    np.testing.assert_allclose(seen, projected.ravel(), atol=0.15)


@pytest.mark.parametrize("stride", [1, 4])
@pytest.mark.parametrize("region", [(0, 0, 40, 40), (100, 80, 180, 160), (280, 200, 320, 240)])
def test_region_is_distorted_as_in_the_whole_image(region: Region, stride: int) -> None:
    """The widened region suffices for it, and its corner lies on the grid of blocks."""
    glass = lens(0.05, -0.05)
    image = spot((140.0, 120.0))
    image[::7] = 200
    part = Exposure(0, WIDTH, HEIGHT, region, stride)
    left, top, right, bottom = glass.widened(part).region or (1, 1, 1, 1)
    assert left % stride == top % stride == 0
    source = np.zeros_like(image)
    source[top:bottom, left:right] = image[top:bottom, left:right]
    expected = np.zeros_like(image)
    inside = slice(region[1], region[3]), slice(region[0], region[2])
    corners = glass.distorted(image, WHOLE)[inside][::stride, ::stride]
    height, width = expected[inside].shape[:2]
    expected[inside] = corners.repeat(stride, axis=0).repeat(stride, axis=1)[:height, :width]
    np.testing.assert_array_equal(glass.distorted(source, part), expected)


def test_image_is_black_where_the_distortion_is_not_invertible() -> None:
    """With k1 = -0.3 a wide lens has an edge: at r (1 - 0.3 r²) = 0.70 focal lengths."""
    white = np.full((HEIGHT, WIDTH, 3), 255, np.uint8)
    image = Lens(-0.3, 0.0, WIDTH, HEIGHT, 100.0).distorted(white, WHOLE)
    y, x = np.indices((HEIGHT, WIDTH)) + 0.5
    radius = np.hypot(x - WIDTH / 2, y - HEIGHT / 2) / 100.0
    assert (image[radius < 0.69] == 255).all()
    assert not image[radius > 0.71].any()


def test_empty_region_stays_black() -> None:
    nothing = Exposure(0, WIDTH, HEIGHT, (400, 300, 500, 400))
    assert not lens(0.1, 0.0).distorted(spot((160.0, 120.0)), nothing).any()


@pytest.mark.parametrize("kernel", [source_region, plain(source_region)])
@pytest.mark.parametrize("stride", [1, 3])
def test_source_region_contains_the_four_pixels_around_each_position(
    kernel: Any, stride: int
) -> None:
    """It is clipped to the image, and the first pixel if nothing is seen."""
    rng = np.random.default_rng(stride)
    columns, rows = rng.uniform(-2.0, 62.0, (2, 50, 60)).astype(np.float32)
    columns[::5] = math.nan
    left, top, right, bottom = kernel(columns, rows, (7, 9, 40, 30), stride)
    x = columns[9:30:stride, 7:40:stride]
    y = rows[9:30:stride, 7:40:stride]
    x, y = x[~np.isnan(x)], y[~np.isnan(x)]
    assert left == max(math.floor(x.min()), 0)
    assert top == max(math.floor(y.min()), 0)
    assert right == min(math.floor(x.max()) + 2, 60)
    assert bottom == min(math.floor(y.max()) + 2, 50)
    assert kernel(np.full_like(columns, math.nan), rows, (7, 9, 40, 30), stride) == (0, 0, 1, 1)
