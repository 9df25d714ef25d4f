"""Coverage kernels: bit for bit what a sequence of OpenCV calls computes."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
import pytest

from bt_dualarm.perception.perception_kernels import cover, measure_coverage, weigh
from tests.plain_kernels import plain

_SQUARE_3, _SQUARE_5 = (cv2.getStructuringElement(cv2.MORPH_RECT, (n, n)) for n in (3, 5))


def target(seed: int, most: int) -> tuple[Any, Any, Any]:
    """An image, a mask of the target's color, and a filled outline that may reach the border."""
    rng = np.random.default_rng(seed)
    height, width = rng.integers(1, most, 2)
    rgb = rng.integers(0, 256, (height, width, 3), dtype=np.uint8)
    raw = np.where(rng.random((height, width)) < 0.8, 255, 0).astype(np.uint8)
    corners = rng.integers((0, 0), (width, height), (5, 2)).astype(np.int32)
    filled = np.zeros_like(raw)
    cv2.drawContours(filled, [cv2.convexHull(corners)], -1, 255, cv2.FILLED)
    return rgb, raw, filled


def covered(rgb: Any, filled: Any) -> Any:
    """Share of each pixel that the target covers, computed by OpenCV."""
    inside = cv2.erode(filled, _SQUARE_3)
    near = cv2.dilate(filled, _SQUARE_3)
    target, background = (cv2.mean(rgb, mask)[:3] for mask in (filled, cv2.bitwise_not(near)))
    line = np.subtract(target, background)
    along = line_sums(rgb, line.astype(np.float32))
    lowest = cv2.erode(along, _SQUARE_5)
    highest = cv2.dilate(along, _SQUARE_5)
    share = (along - lowest) / np.maximum(highest - lowest, 1.0)
    share[near == 0] = 0.0
    share[inside > 0] = 1.0
    return share


def line_sums(rgb: Any, line: Any) -> Any:
    """Like ``cv2.transform``, with or without fused multiply-add in this processor."""
    red, green, blue = np.moveaxis(rgb.astype(np.float32), 2, 0)
    part = (float(line[0]) * red.astype(float) + line[1] * green).astype(np.float32)
    return (float(line[2]) * blue.astype(float) + part).astype(np.float32)


@pytest.mark.parametrize("seed", range(40))
def test_shares_and_moments_equal_those_of_opencv(seed: int) -> None:
    rgb, raw, filled = target(seed, 90)
    expected = covered(rgb, filled)
    share = np.empty(filled.shape, np.float32)
    cover(rgb, filled, share)
    assert (share == expected).all()
    moments = cv2.moments(expected)
    sums = moments["m00"], moments["m10"], moments["m01"]
    assert weigh(share) == sums
    count = cv2.countNonZero(filled)
    colored = cv2.countNonZero(cv2.bitwise_and(filled, raw))
    assert measure_coverage(rgb, raw, filled) == (*sums, count, colored)


@pytest.mark.parametrize("seed", range(4))
def test_line_sums_equal_those_of_opencv_except_for_rounding(seed: int) -> None:
    rgb, _, _ = target(seed, 60)
    line = np.random.default_rng(seed).normal(0.0, 80.0, 3).astype(np.float32)
    expected = cv2.transform(rgb.astype(np.float32), line[None]).reshape(rgb.shape[:2])
    assert line_sums(rgb, line) == pytest.approx(expected, rel=1e-6, abs=0.01)


@pytest.mark.parametrize("seed", range(6))
def test_compiled_measures_equal_plain_python(seed: int) -> None:
    by_python = plain(measure_coverage)(*target(seed, 24))
    assert measure_coverage(*target(seed, 24)) == by_python
    assert [type(number) for number in by_python] == [float, float, float, int, int]
