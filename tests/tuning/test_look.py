"""Blobs of a color in an image, and the picture of them."""

from __future__ import annotations

import cv2
import numpy as np

from bt_dualarm.sim.frame import Image
from bt_dualarm.spec.values import Color
from bt_dualarm.tuning import ColorView, png, still


def two_squares() -> Image:
    """Yellow squares on gray, 80x60: 20x20 around (30, 30), 10x10 around (65, 15)."""
    image = np.full((60, 80, 3), 128, np.uint8)
    image[20:40, 20:40] = image[10:20, 60:70] = (242, 217, 13)
    return image


def test_largest_blob_comes_first() -> None:
    view = ColorView(still(two_squares()), Color.named("yellow"))
    assert [one["centroid_px"] for one in view.table] == [[30.0, 30.0], [65.0, 15.0]]
    assert [one["area_px"] for one in view.table] == [400.0, 100.0]
    assert int((view.mask > 0).sum()) == 500


def test_picture_has_three_panels_of_equal_width() -> None:
    """The image, the mask in white, and the image with everything outside the mask darkened."""
    picture = ColorView(still(two_squares()), Color.named("yellow")).picture("two")
    zoom = 6
    bar = 26
    gap = 4
    assert picture.shape == (60 * zoom + bar, 3 * 80 * zoom + 2 * gap, 3)
    panels = [picture[bar:, start : start + 480] for start in (0, 484, 968)]
    inside = (25 * zoom, 25 * zoom)
    outside = (50 * zoom, 50 * zoom)
    assert panels[0][inside].tolist() == panels[2][inside].tolist() == [242, 217, 13]
    assert panels[0][outside].tolist() == [128, 128, 128]
    assert panels[1][inside].tolist() == [255, 255, 255]
    assert panels[1][outside].tolist() == [0, 0, 0]
    assert panels[2][outside].max() < 64
    boxed = np.argwhere((panels[2] == (0, 230, 90)).all(axis=2))
    assert boxed.min(axis=0).tolist() <= [20 * zoom, 20 * zoom]


def test_picture_without_blobs_is_made() -> None:
    view = ColorView(still(two_squares()), Color.named("blue"))
    assert view.found == ()
    assert view.picture("none").shape[2] == 3


def test_png_preserves_the_order_of_colors() -> None:
    image = two_squares()
    read = cv2.imdecode(np.frombuffer(png(image), np.uint8), cv2.IMREAD_COLOR)
    assert read is not None
    assert (cv2.cvtColor(read, cv2.COLOR_BGR2RGB) == image).all()
