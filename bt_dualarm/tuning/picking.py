"""From pixels to a range: what a person points at is what the camera shall look for."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final, TypeAlias

import cv2
import numpy as np

from bt_dualarm.errors import DualArmError
from bt_dualarm.pose import Matrix, Vector
from bt_dualarm.spec.color import HsvRange
from bt_dualarm.world.rendering.renderer import Image

Pixel: TypeAlias = tuple[int, int]
"""Column and row, from the top left corner."""

_AROUND: Final = 1
"""Pixels on each side that are taken up with the one that was pointed at."""

_HUE_MARGIN_DEG: Final = 6.0
_SHARE_MARGIN: Final = 0.15
_COLORLESS: Final = 0.08
"""Below this product of saturation and value 8 bits hold no hue (black, white, grey)."""


class PixelError(DualArmError):
    """A pixel is not in the image."""


def range_of(image: Image, pixels: Sequence[Pixel], begin: HsvRange | None = None) -> HsvRange:
    """The smallest range around pixels and those next to them, with a margin for other light.

    Args:
        image: Red, green, blue, of shape (height, width, 3).
        pixels: Columns and rows of what was pointed at, at least one.
        begin: Range that is widened to hold the pixels, too; None to begin anew.

    Raises:
        PixelError: One is outside of the image.
    """
    hsv = np.vstack([_patch(image, pixel) for pixel in pixels])
    colored = hsv[hsv[:, 1] * hsv[:, 2] >= _COLORLESS, 0]
    return HsvRange(
        hue=_arc(colored, begin.hue if begin else None),
        saturation=_span(hsv[:, 1], begin.saturation if begin else None),
        value=_span(hsv[:, 2], begin.value if begin else None),
    )


def _patch(image: Image, pixel: Pixel) -> Matrix:
    """Hue in degrees, saturation and value from 0 to 1 around a pixel, of shape (n, 3)."""
    x, y = pixel
    height, width = image.shape[:2]
    if not (0 <= x < width and 0 <= y < height):
        raise PixelError(f"pixel {x},{y} is outside of the image, which is {width}x{height}")
    part = image[max(y - _AROUND, 0) : y + _AROUND + 1, max(x - _AROUND, 0) : x + _AROUND + 1]
    hsv = cv2.cvtColor(np.ascontiguousarray(part), cv2.COLOR_RGB2HSV).reshape(-1, 3)
    return np.asarray(hsv * (2.0, 1 / 255, 1 / 255))


def _arc(hues: Vector, begin: tuple[float, float] | None) -> tuple[float, float]:
    """An arc of the colour circle around all hues, grown at whichever end is nearer; degrees."""
    if begin is None and not len(hues):
        return 0.0, 360.0
    low, high = begin or (float(hues[0]), float(hues[0]))
    length = high - low if high >= low else high - low + 360.0
    for hue in hues:
        from_low = (float(hue) - _HUE_MARGIN_DEG - low) % 360.0
        upwards, downwards = from_low + 2 * _HUE_MARGIN_DEG - length, 360.0 - from_low
        if 0.0 < downwards < upwards:
            low, length = low - downwards, length + downwards
        elif upwards > 0.0:
            length += upwards
    if length >= 360.0:
        return 0.0, 360.0
    return float(math.floor(low) % 360), float(math.ceil(low + length) % 360)


def _span(shares: Vector, begin: tuple[float, float] | None) -> tuple[float, float]:
    """A span of shares around all of them, within 0 to 1, in hundredths."""
    low, high = begin or (1.0, 0.0)
    low = min(low, max(0.0, float(shares.min()) - _SHARE_MARGIN))
    high = max(high, min(1.0, float(shares.max()) + _SHARE_MARGIN))
    return math.floor(100 * low) / 100, math.ceil(100 * high) / 100
