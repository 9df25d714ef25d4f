"""A lens that bends what it shows: radial distortion that the calibration does not know."""

from __future__ import annotations

import math
from typing import Final

import cv2
import numpy as np
import numpy.typing as npt

from bt_dualarm.world.rendering.renderer import Exposure, Image, Region, clip_region, enter_blocks

_RADII: Final = 4096
"""Radii at which the formula is worked out; between two of them it is a line."""


class Lens:
    """Radial distortion, the first two terms of OpenCV's model.

    A point at ``r`` from the middle, in focal lengths, is seen at ``r (1 + k1 r² + k2 r⁴)``
    (Brown, Decentering distortion of lenses, 1966). Where the formula folds the picture over,
    nothing is seen. A picture that was rectified by a calibration has what that did not know.

    Args:
        k1: Factor of the third power.
        k2: Factor of the fifth power.
        width: Width of the whole image in pixels.
        height: Height of the whole image in pixels.
        focal_px: True focal length in pixels.
    """

    def __init__(self, k1: float, k2: float, width: int, height: int, focal_px: float) -> None:
        self._size = width, height
        y, x = np.indices((height, width)) + 0.5
        x, y = (x - width / 2) / focal_px, (y - height / 2) / focal_px
        seen_at = np.hypot(x, y)
        scale = _straight(k1, k2, seen_at) / seen_at.clip(1e-12)
        columns, rows = x * scale * focal_px + width / 2, y * scale * focal_px + height / 2
        self._columns: npt.NDArray[np.float32] = (columns - 0.5).astype(np.float32)
        self._rows: npt.NDArray[np.float32] = (rows - 0.5).astype(np.float32)
        # Where the rays of the latest part that was asked for come from.
        self._asked: tuple[Region, int] | None = None
        self._maps: tuple[npt.NDArray[np.float32], ...] = ()
        is_seen = np.isfinite(columns)
        self._is_seen = None if is_seen.all() else is_seen
        moved = np.hypot(columns - x * focal_px - width / 2, rows - y * focal_px - height / 2)
        self._margin = math.ceil(float(np.nanmax(moved))) + 1

    def widened(self, exposure: Exposure) -> Exposure:
        """What has to be drawn so that all of an exposure is there once it is bent."""
        if exposure.region is None:
            return exposure
        margin = -(-self._margin // exposure.stride) * exposure.stride  # corners are of blocks
        left, top, right, bottom = exposure.region
        wide = (left - margin, top - margin, right + margin, bottom + margin)
        asked = exposure
        return Exposure(
            asked.camera_id, asked.width, asked.height, clip_region(wide, *self._size),
            asked.stride, asked.groups,
        )  # fmt: skip

    def bent(self, image: Image, exposure: Exposure) -> Image:
        """The picture behind the lens, black outside of the exposure's region."""
        arrived: Image = np.zeros_like(image)
        if not exposure.is_empty:
            enter_blocks(arrived, exposure.clipped, exposure.stride, self.seen(image, exposure))
        return arrived

    def seen(self, image: Image, exposure: Exposure) -> Image:
        """Colours behind the lens of the blocks of an exposure, of shape (rows, columns, 3).

        Args:
            image: The picture before it.
            exposure: Exposure that is not empty.
        """
        left, top, right, bottom = exposure.clipped
        step = exposure.stride  # one ray a block: nobody looks at more of it than its corner
        part = slice(top, bottom, step), slice(left, right, step)
        if self._asked != (exposure.clipped, step):
            self._asked = exposure.clipped, step
            self._maps = tuple(
                np.ascontiguousarray(one[part]) for one in (self._columns, self._rows)
            )
        columns, rows = self._maps
        seen = cv2.remap(image, columns, rows, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        if self._is_seen is not None:
            seen[~self._is_seen[part]] = 0
        return np.asarray(seen, dtype=np.uint8)


def _straight(k1: float, k2: float, seen_at: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """Radii at which it is without the lens; not a number where nothing is seen."""
    # Beyond twice the farthest of the picture there is nothing that a lens within the ranges of
    # k1 and k2 would show in it.
    radius = np.linspace(0.0, 2.0 * float(seen_at.max()), _RADII)
    bent = radius * (1.0 + k1 * radius**2 + k2 * radius**4)
    falls = np.flatnonzero(np.diff(bent) <= 0)
    end = int(falls[0]) + 1 if len(falls) else _RADII
    return np.interp(seen_at, bent[:end], radius[:end], right=math.nan)
