"""Compiled kernels for images: coverage of pixels by a target, and residuals of outlines."""

from __future__ import annotations

import math
from typing import Final, TypeAlias

import numpy as np
import numpy.typing as npt

from bt_dualarm.core.kernel import kernel
from bt_dualarm.core.pose import Matrix, Vector

# Pixel coverage
#
# Each step replaces a function of OpenCV, with the same rounding: for the few pixels of one target
# the call overhead would dominate.


_Mask: TypeAlias = npt.NDArray[np.uint8]
_Share: TypeAlias = npt.NDArray[np.float32]

_TILE: Final = 32
"""Edge of a tile in pixels: OpenCV sums up moments in tiles, which determines the rounding."""

_REACH: Final = 2
"""Pixels to either side over which the extremes of a neighborhood are taken."""


@kernel
def cover(rgb: _Mask, filled: _Mask, share: _Share) -> None:
    """Compute the share of each pixel that the target covers; see `detection.coverage`.

    Args:
        rgb: Colors, of shape (h, w, 3).
        filled: Mask of the pixels within the outline, of shape (h, w).
        share: Takes the shares, of shape (h, w).
    """
    height, width = filled.shape
    near = np.empty((height, width), np.uint8)
    inside = np.empty((height, width), np.uint8)
    _dilate_and_erode(filled, near, inside)
    along = _along(rgb, filled, near)
    lowest, highest = _extremes(along)
    for row in range(height):
        for column in range(width):
            if inside[row, column] != 0:
                share[row, column] = 1.0
            elif near[row, column] != 0:
                low = lowest[row, column]
                high = highest[row, column]
                for x in range(max(column - _REACH, 0), min(column + _REACH + 1, width)):
                    low = min(low, lowest[row, x])
                    high = max(high, highest[row, x])
                span = max(high - low, np.float32(1.0))
                share[row, column] = (along[row, column] - low) / span
            else:
                share[row, column] = 0.0


@kernel
def _dilate_and_erode(filled: _Mask, near: _Mask, inside: _Mask) -> None:
    """Dilate a mask into ``near`` and erode it into ``inside``, by 3 by 3 pixels."""
    height, width = filled.shape
    wide = height + 2, width + 2
    some = np.zeros(wide, np.uint8)
    every = np.empty(wide, np.uint8)
    every[:] = 255  # erosion treats pixels beyond the border as filled
    some[1:-1, 1:-1] = filled
    every[1:-1, 1:-1] = filled
    for row in range(height):
        above = some[row]
        here = some[row + 1]
        below = some[row + 2]
        for column in range(width + 2):
            above[column] |= here[column] | below[column]
        for column in range(width):
            near[row, column] = above[column] | above[column + 1] | above[column + 2]
        above = every[row]
        here = every[row + 1]
        below = every[row + 2]
        for column in range(width + 2):
            above[column] &= here[column] & below[column]
        for column in range(width):
            inside[row, column] = above[column] & above[column + 1] & above[column + 2]


@kernel
def _along(rgb: _Mask, filled: _Mask, near: _Mask) -> _Share:
    """Project colors to the line from the background's mean color to the target's, (h, w)."""
    line = _line(rgb, filled, near)
    red = np.float64(line[0])
    green = line[1]
    blue = np.float64(line[2])
    along = np.empty(filled.shape, np.float32)
    for row in range(rgb.shape[0]):
        for column in range(rgb.shape[1]):
            # Rounded after each sum, not before: OpenCV uses fused multiply-add where it can.
            part = green * np.float32(rgb[row, column, 1])
            part = np.float32(red * rgb[row, column, 0] + np.float64(part))
            along[row, column] = np.float32(blue * rgb[row, column, 2] + np.float64(part))
    return along


@kernel
def _line(rgb: _Mask, filled: _Mask, near: _Mask) -> _Share:
    """Difference of the mean colors of target and background, of shape (3,)."""
    target = np.zeros(3)
    background = np.zeros(3)
    count = 0
    others = 0
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
    """Minimum and maximum over the vertical neighborhood of each pixel, of shape (h, w)."""
    height, width = along.shape
    lowest = along.copy()
    highest = along.copy()
    for row in range(height):
        for other in range(max(row - _REACH, 0), min(row + _REACH + 1, height)):
            low = lowest[row]
            high = highest[row]
            values = along[other]
            for column in range(width):
                value = values[column]
                low[column] = value if value < low[column] else low[column]
                high[column] = value if value > high[column] else high[column]
    return lowest, highest


@kernel
def weigh(share: _Share) -> tuple[float, float, float]:
    """Moments m00, m10 and m01 of an image of shape (h, w)."""
    height, width = share.shape
    total = 0.0
    by_column = 0.0
    by_row = 0.0
    for top in range(0, height, _TILE):
        for left in range(0, width, _TILE):
            own = 0.0
            own_by_column = 0.0
            own_by_row = 0.0
            for y in range(min(_TILE, height - top)):
                line = 0.0
                line_by_column = 0.0
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
def measure_coverage(rgb: _Mask, raw: _Mask, filled: _Mask) -> tuple[float, float, float, int, int]:
    """Measure one target.

    Args:
        rgb: Colors, of shape (h, w, 3).
        raw: Mask of the pixels with the target's color, of shape (h, w).
        filled: Mask of the pixels within the outline, likewise.

    Returns:
        Moments of the coverage (see `weigh`), number of pixels within the outline, and number of
        those with the color.
    """
    share = np.empty(filled.shape, np.float32)
    cover(rgb, filled, share)
    total, by_column, by_row = weigh(share)
    count = 0
    colored = 0
    for row in range(filled.shape[0]):
        for column in range(filled.shape[1]):
            if filled[row, column] != 0:
                count += 1
                colored += 1 if raw[row, column] != 0 else 0
    return total, by_column, by_row, count, colored


# Outline residuals

# Unknowns: position, rotation, rotation and shift of the mount (three each), focal length, rim.
_TURN: Final = 3
_MOUNT_TURN: Final = 6
_MOUNT_SHIFT: Final = 9
_FOCAL: Final = 12
_RIM: Final = 13


@kernel
def see(
    about: Matrix, offset: Vector, inward: Matrix, mount: Matrix, focals: tuple[float, float],
    pixels: Matrix, change: npt.NDArray[np.float64],
) -> float:  # fmt: skip
    """Project points into an image, with derivatives; returns their least depth, m.

    If the least depth is not positive, nothing is entered.

    Args:
        about: Points relative to the object's center, in the world's axes, of shape (n, 3), m.
        offset: Center relative to the camera, of shape (3,), m.
        inward: Camera's axes as columns in the world, of shape (3, 3).
        mount: Camera's axes as columns in the nominal camera frame, of shape (3, 3).
        focals: Estimated and nominal focal length, px.
        pixels: Takes positions relative to the image center, of shape (n, 2), px.
        change: Takes their derivatives with respect to the unknowns, of shape (n, 2, 14).
    """
    places = _from_camera(about, offset, inward)
    least: float = places[:, 2].min()
    if least <= 0.0:
        return least
    by_point = np.zeros(3)
    by_place = np.empty(3)
    for number in range(len(about)):
        local = places[number]
        for side in range(2):
            flat = local[side] / local[2]
            pixels[number, side] = focals[0] * flat
            by_point[0] = by_point[1] = 0.0
            by_point[side] = focals[0] / local[2]
            by_point[2] = -pixels[number, side] / local[2]
            entry = change[number, side]
            for axis in range(3):
                by_place[axis] = 0.0
                shift = 0.0
                for own in range(3):
                    by_place[axis] += by_point[own] * inward[axis, own]
                    shift += by_point[own] * mount[axis, own]
                entry[axis] = by_place[axis]
                entry[_MOUNT_SHIFT + axis] = -shift
            for axis in range(3):
                after = (axis + 1) % 3
                last = (axis + 2) % 3
                entry[_TURN + axis] = about[number, after] * by_place[last]
                entry[_TURN + axis] -= about[number, last] * by_place[after]
                entry[_MOUNT_TURN + axis] = local[last] * by_point[after]
                entry[_MOUNT_TURN + axis] -= local[after] * by_point[last]
            entry[_FOCAL] = focals[1] * flat
            entry[_RIM] = 0.0
    return least


@kernel
def _from_camera(about: Matrix, offset: Vector, inward: Matrix) -> Matrix:
    """Transform points to the camera, of shape (n, 3), m; arguments as of `see`."""
    places = np.zeros((len(about), 3))
    for number in range(len(about)):
        for own in range(3):
            for axis in range(3):
                places[number, own] += (offset[axis] + about[number, axis]) * inward[axis, own]
    return places


@kernel
def measure_outline(
    corners: Matrix, ends: npt.NDArray[np.float64], edge: Matrix, beyond: float,
    error: Vector, jacobian: Matrix,
) -> None:  # fmt: skip
    """Signed distances of points from a convex outline, positive outside, with derivatives.

    Args:
        corners: Corners of the outline, in order, of shape (m, 2), px.
        ends: Their derivatives with respect to the unknowns, of shape (m, 2, 14).
        edge: Points, of shape (n, 2), px.
        beyond: Offset that is added to each distance, px.
        error: Takes the distances, of shape (n,), px.
        jacobian: Takes their derivatives, of shape (n, 14).
    """
    sides = _sides(corners)
    for number in range(len(edge)):
        error[number] = -math.inf
        best = 0
        for side in range(len(sides)):
            apart = edge[number, 0] * sides[side, 0] + edge[number, 1] * sides[side, 1]
            if apart - sides[side, 2] > error[number]:
                error[number] = apart - sides[side, 2]
                best = side
        error[number] += beyond
        u = sides[best, 0]
        v = sides[best, 1]
        after = (best + 1) % len(sides)
        share = (edge[number, 0] - corners[best, 0]) * sides[best, 3]
        share = (share + (edge[number, 1] - corners[best, 1]) * sides[best, 4]) / sides[best, 5]
        share = min(max(share, 0.0), 1.0)
        for unknown in range(ends.shape[2]):
            across = (1.0 - share) * ends[best, 0, unknown] + share * ends[after, 0, unknown]
            down = (1.0 - share) * ends[best, 1, unknown] + share * ends[after, 1, unknown]
            jacobian[number, unknown] = -(u * across + v * down)
        jacobian[number, _RIM] = -1.0


@kernel
def _sides(corners: Matrix) -> Matrix:
    """Sides of a polygon: outward normal (2), offset, direction (2), squared length; (m, 6)."""
    count = len(corners)
    middle = np.zeros(2)
    sides = np.empty((count, 6))
    for number in range(count):
        after = (number + 1) % count
        x = corners[after, 0] - corners[number, 0]
        y = corners[after, 1] - corners[number, 1]
        length = max(math.sqrt(x * x + y * y), 1e-9)
        sides[number, 0] = y / length
        sides[number, 1] = -x / length
        sides[number, 3] = x
        sides[number, 4] = y
        sides[number, 5] = length**2
        middle += corners[number] / count
    inside = sides[0, 0] * (middle[0] - corners[0, 0]) + sides[0, 1] * (middle[1] - corners[0, 1])
    for number in range(count):
        if inside > 0.0:
            sides[number, 0], sides[number, 1] = -sides[number, 0], -sides[number, 1]
        sides[number, 2] = (
            corners[number, 0] * sides[number, 0] + corners[number, 1] * sides[number, 1]
        )
    return sides
