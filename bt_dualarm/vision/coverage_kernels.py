"""Which share of each pixel a coloured target covers, and the moments of that.

Each step is one of OpenCV's, with the same roundings, on the few pixels of one target: there the
calls of OpenCV cost more than what they do.
"""

from __future__ import annotations

from typing import Final, TypeAlias

import numpy as np
import numpy.typing as npt

from bt_dualarm.kernels.kernel import kernel

_Mask: TypeAlias = npt.NDArray[np.uint8]
_Share: TypeAlias = npt.NDArray[np.float32]

_TILE: Final = 32
"""Pixels of a tile's edge: OpenCV sums up moments in tiles."""

_REACH: Final = 2
"""Pixels to either side in which the extremes about a pixel are looked for."""


@kernel
def cover(rgb: _Mask, filled: _Mask, share: _Share) -> None:
    """Enter the share of each pixel that is covered; see `coverage`.

    Args:
        rgb: Colours, of shape (h, w, 3).
        filled: Which pixels lie within the outline, of shape (h, w), 0 where they do not.
        share: The shares, of shape (h, w), to be filled.
    """
    height, width = filled.shape
    near, inside = np.empty((height, width), np.uint8), np.empty((height, width), np.uint8)
    _grown(filled, near, inside)
    along = _along(rgb, filled, near)
    lowest, highest = _extremes(along)
    for row in range(height):
        for column in range(width):
            if inside[row, column] != 0:
                share[row, column] = 1.0
            elif near[row, column] != 0:
                low, high = lowest[row, column], highest[row, column]
                for x in range(max(column - _REACH, 0), min(column + _REACH + 1, width)):
                    low, high = min(low, lowest[row, x]), max(high, highest[row, x])
                span = max(high - low, np.float32(1.0))
                share[row, column] = (along[row, column] - low) / span
            else:
                share[row, column] = 0.0


@kernel
def _grown(filled: _Mask, near: _Mask, inside: _Mask) -> None:
    """Enter which pixels have a filled one beside them, and which have no other beside them."""
    height, width = filled.shape
    wide = height + 2, width + 2
    some, every = np.zeros(wide, np.uint8), np.empty(wide, np.uint8)
    every[:] = 255  # beyond the border is nothing that is not filled
    some[1:-1, 1:-1], every[1:-1, 1:-1] = filled, filled
    for row in range(height):
        above, here, below = some[row], some[row + 1], some[row + 2]
        for column in range(width + 2):
            above[column] |= here[column] | below[column]
        for column in range(width):
            near[row, column] = above[column] | above[column + 1] | above[column + 2]
        above, here, below = every[row], every[row + 1], every[row + 2]
        for column in range(width + 2):
            above[column] &= here[column] & below[column]
        for column in range(width):
            inside[row, column] = above[column] & above[column + 1] & above[column + 2]


@kernel
def _along(rgb: _Mask, filled: _Mask, near: _Mask) -> _Share:
    """Colours along the line from the mean of the background to that of what is filled, (h, w)."""
    line = _line(rgb, filled, near)
    red, green, blue = np.float64(line[0]), line[1], np.float64(line[2])
    along = np.empty(filled.shape, np.float32)
    for row in range(rgb.shape[0]):
        for column in range(rgb.shape[1]):
            # Rounded after each sum, not before: OpenCV multiplies and adds at once where it can.
            part = green * np.float32(rgb[row, column, 1])
            part = np.float32(red * rgb[row, column, 0] + np.float64(part))
            along[row, column] = np.float32(blue * rgb[row, column, 2] + np.float64(part))
    return along


@kernel
def _line(rgb: _Mask, filled: _Mask, near: _Mask) -> _Share:
    """From the mean colour of the background to that of what is filled, of shape (3,)."""
    target, background = np.zeros(3), np.zeros(3)
    count, others = 0, 0
    for row in range(rgb.shape[0]):
        for column in range(rgb.shape[1]):
            if filled[row, column] != 0:
                count += 1
                for channel in range(3):
                    target[channel] += rgb[row, column, channel]
            if near[row, column] == 0:
                others += 1
                for channel in range(3):
                    background[channel] += rgb[row, column, channel]
    line = np.empty(3, np.float32)
    for channel in range(3):
        mean = target[channel] * (1.0 / count) if count else 0.0
        line[channel] = mean - (background[channel] * (1.0 / others) if others else 0.0)
    return line


@kernel
def _extremes(along: _Share) -> tuple[_Share, _Share]:
    """Least and largest of each pixel and those above and below it, of shape (h, w)."""
    height, width = along.shape
    lowest, highest = along.copy(), along.copy()
    for row in range(height):
        for other in range(max(row - _REACH, 0), min(row + _REACH + 1, height)):
            low, high, values = lowest[row], highest[row], along[other]
            for column in range(width):
                value = values[column]
                low[column] = value if value < low[column] else low[column]
                high[column] = value if value > high[column] else high[column]
    return lowest, highest


@kernel
def weigh(share: _Share) -> tuple[float, float, float]:
    """Sum of an image of shape (h, w), and its sums weighed by column and by row."""
    height, width = share.shape
    total, by_column, by_row = 0.0, 0.0, 0.0
    for top in range(0, height, _TILE):
        for left in range(0, width, _TILE):
            own, own_by_column, own_by_row = 0.0, 0.0, 0.0
            for y in range(min(_TILE, height - top)):
                line, line_by_column = 0.0, 0.0
                for x in range(min(_TILE, width - left)):
                    value = float(share[top + y, left + x])
                    line += value
                    line_by_column += x * value
                own += line
                own_by_column += line_by_column
                own_by_row += y * line
            total += own
            by_column += own_by_column + left * own
            by_row += own_by_row + top * own
    return total, by_column, by_row


@kernel
def measure(rgb: _Mask, raw: _Mask, filled: _Mask) -> tuple[float, float, float, int, int]:
    """What there is to know of one target.

    Args:
        rgb: Colours, of shape (h, w, 3).
        raw: Which pixels have the colour that is looked for, of shape (h, w).
        filled: Which lie within the outline, likewise.

    Returns:
        As `weigh` of the share that is covered; how many pixels lie within the outline, and how
        many of those have the colour.
    """
    share = np.empty(filled.shape, np.float32)
    cover(rgb, filled, share)
    total, by_column, by_row = weigh(share)
    count, colored = 0, 0
    for row in range(filled.shape[0]):
        for column in range(filled.shape[1]):
            if filled[row, column] != 0:
                count += 1
                colored += 1 if raw[row, column] != 0 else 0
    return total, by_column, by_row, count, colored
