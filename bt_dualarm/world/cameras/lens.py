"""A lens that bends what it shows: radial distortion that the calibration does not know."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cache
from typing import Final, NamedTuple

import cv2
import numpy as np
import numpy.typing as npt

from bt_dualarm.world.rendering.renderer import Exposure, Image, Region, enter_blocks

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
        y, x = np.indices((height, width)) + 0.5
        x, y = (x - width / 2) / focal_px, (y - height / 2) / focal_px
        seen_at = np.hypot(x, y)
        scale = _straight(k1, k2, seen_at) / seen_at.clip(1e-12)
        columns, rows = x * scale * focal_px + width / 2, y * scale * focal_px + height / 2
        self._columns: npt.NDArray[np.float32] = (columns - 0.5).astype(np.float32)
        self._rows: npt.NDArray[np.float32] = (rows - 0.5).astype(np.float32)
        is_seen = np.isfinite(columns)
        self._is_seen = None if is_seen.all() else is_seen
        self._known: tuple[Region, int, _Part] | None = None
        self._pixels: Image = np.zeros((height, width, 3), np.uint8)  # of the latest coarse blocks

    def widened(self, exposure: Exposure) -> Exposure:
        """What has to be drawn so that all of an exposure is there once it is bent."""
        if exposure.is_empty:
            return exposure
        needed, asked = self._part(exposure).needed, exposure
        return Exposure(
            asked.camera_id, asked.width, asked.height, needed, asked.stride, asked.groups,
            asked.alone,
        )  # fmt: skip

    def bent(self, image: Image, exposure: Exposure) -> Image:
        """The picture behind the lens, black outside of the exposure's region."""
        (left, top, right, bottom), step = self.widened(exposure).clipped, exposure.stride
        drawn = image if step > 1 else image[top:bottom, left:right]
        return exposure.paint(lambda _: self._behind(drawn, exposure))

    def seen(self, drawn: Image, exposure: Exposure) -> Image:
        """Colours behind the lens of the blocks of an exposure, of shape (rows, columns, 3).

        Args:
            drawn: Colours before it of the blocks of that exposure, widened.
            exposure: Exposure that is not empty, its corner on the grid of blocks.
        """
        if exposure.stride > 1:
            wide = self.widened(exposure)
            enter_blocks(self._pixels, wide.clipped, wide.stride, drawn, wide.corner)
            drawn = self._pixels
        return self._behind(drawn, exposure)

    def _behind(self, drawn: Image, exposure: Exposure) -> Image:
        """As `seen`, of the pixels that are needed; of a coarse exposure, of the whole image."""
        part = self._part(exposure)
        seen = cv2.remap(
            drawn, part.columns, part.rows, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
        )
        if part.is_seen is not None:
            seen[~part.is_seen] = 0
        return np.asarray(seen, dtype=np.uint8)

    def _part(self, exposure: Exposure) -> _Part:
        """Where the rays of an exposure come from: a target that rests is asked for again."""
        region, step = exposure.clipped, exposure.stride  # one ray a block: only its corner counts
        if self._known is None or self._known[:2] != (region, step):
            left, top, right, bottom = _needed()(self._columns, self._rows, region, step)
            # Corners are of blocks.
            needed = left - left % step, top - top % step, right, bottom
            part = slice(region[1], region[3], step), slice(region[0], region[2], step)
            is_seen = None if self._is_seen is None else self._is_seen[part]
            # Less by whole numbers, places are as exact as before.
            left, top = needed[:2] if step == 1 else (0, 0)
            columns, rows = (
                self._columns[part] - np.float32(left),
                self._rows[part] - np.float32(top),
            )
            self._known = region, step, _Part(columns, rows, is_seen, needed)
        return self._known[2]


class _Part(NamedTuple):
    """A part of a picture behind a lens.

    Attributes:
        columns: Places before it along x that its blocks show, of shape (rows, columns), in px
            from the corner of what is needed, of coarse blocks from that of the image.
        rows: Likewise along y.
        is_seen: Which of them show something, None where all do.
        needed: Part of the picture before it that they are made of.
    """

    columns: npt.NDArray[np.float32]
    rows: npt.NDArray[np.float32]
    is_seen: npt.NDArray[np.bool_] | None
    needed: Region


@cache
def _needed() -> Callable[..., Region]:
    """The kernel of the lens: an import statement costs as much as it does."""
    from bt_dualarm.world.cameras.lens_kernels import needed

    return needed


def _straight(k1: float, k2: float, seen_at: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """Radii at which it is without the lens; not a number where nothing is seen."""
    # Beyond twice the farthest of the picture there is nothing that a lens within the ranges of
    # k1 and k2 would show in it.
    radius = np.linspace(0.0, 2.0 * float(seen_at.max()), _RADII)
    bent = radius * (1.0 + k1 * radius**2 + k2 * radius**4)
    falls = np.flatnonzero(np.diff(bent) <= 0)
    end = int(falls[0]) + 1 if len(falls) else _RADII
    return np.interp(seen_at, bent[:end], radius[:end], right=math.nan)


def bend_something() -> None:
    """Have the kernel of the lens compiled."""
    Lens(0.1, 0.1, 2, 2, 1.0).widened(Exposure(0, 2, 2, (0, 0, 1, 1)))
