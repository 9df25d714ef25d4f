"""Points of a shape in a picture, how far an outline is from them, and by what both change."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
import numpy.typing as npt

from bt_dualarm.kernels.kernel import kernel
from bt_dualarm.pose import Matrix, Vector

# Unknowns: place, turn, the mount's turn and shift (three each), focal length, rim.
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
    """Enter where points are seen, and how that changes; the least of their depths, m.

    Where it is not above 0, nothing more is entered.

    Args:
        about: Points from the thing's centre, in the world's axes, of shape (n, 3), m.
        offset: The centre from the camera, of shape (3,), m.
        inward: The camera's axes as columns in the world, of shape (3, 3).
        mount: Its axes as columns in those where it is believed to be, of shape (3, 3).
        focals: True and believed focal length, px.
        pixels: Places from the image's middle, of shape (n, 2), px, to be filled.
        change: Their change with the unknowns, of shape (n, 2, 14), to be filled.
    """
    places = _from_camera(about, offset, inward)
    least: float = places[:, 2].min()
    if least <= 0.0:
        return least
    by_point, by_place = np.zeros(3), np.empty(3)
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
                by_place[axis], shift = 0.0, 0.0
                for own in range(3):
                    by_place[axis] += by_point[own] * inward[axis, own]
                    shift += by_point[own] * mount[axis, own]
                entry[axis], entry[_MOUNT_SHIFT + axis] = by_place[axis], -shift
            for axis in range(3):
                after, last = (axis + 1) % 3, (axis + 2) % 3
                entry[_TURN + axis] = about[number, after] * by_place[last]
                entry[_TURN + axis] -= about[number, last] * by_place[after]
                entry[_MOUNT_TURN + axis] = local[last] * by_point[after]
                entry[_MOUNT_TURN + axis] -= local[after] * by_point[last]
            entry[_FOCAL], entry[_RIM] = focals[1] * flat, 0.0
    return least


@kernel
def _from_camera(about: Matrix, offset: Vector, inward: Matrix) -> Matrix:
    """Points in the camera's axes, of shape (n, 3), m; arguments as of `see`."""
    places = np.zeros((len(about), 3))
    for number in range(len(about)):
        for own in range(3):
            for axis in range(3):
                places[number, own] += (offset[axis] + about[number, axis]) * inward[axis, own]
    return places


@kernel
def measure(
    corners: Matrix, ends: npt.NDArray[np.float64], edge: Matrix, beyond: float,
    error: Vector, jacobian: Matrix,
) -> None:  # fmt: skip
    """Enter how far points are from an outline, outside positive, and how that changes.

    Args:
        corners: Corners of the outline, in its order, of shape (m, 2), px.
        ends: Their change with the unknowns, of shape (m, 2, 14).
        edge: Points of shape (n, 2), px.
        beyond: Pixels that are added to each distance.
        error: Distances, of shape (n,), px, to be filled.
        jacobian: Their change, of shape (n, 14), to be filled.
    """
    sides = _sides(corners)
    for number in range(len(edge)):
        error[number], best = -math.inf, 0
        for side in range(len(sides)):
            apart = edge[number, 0] * sides[side, 0] + edge[number, 1] * sides[side, 1]
            if apart - sides[side, 2] > error[number]:
                error[number], best = apart - sides[side, 2], side
        error[number] += beyond
        u, v, after = sides[best, 0], sides[best, 1], (best + 1) % len(sides)
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
    """Of each side its outward normal (2), distance from the origin, way (2), length squared."""
    count, middle = len(corners), np.zeros(2)
    sides = np.empty((count, 6))
    for number in range(count):
        after = (number + 1) % count
        x, y = corners[after, 0] - corners[number, 0], corners[after, 1] - corners[number, 1]
        length = max(math.sqrt(x * x + y * y), 1e-9)
        sides[number, 0], sides[number, 1] = y / length, -x / length
        sides[number, 3], sides[number, 4], sides[number, 5] = x, y, length**2
        middle += corners[number] / count
    inside = sides[0, 0] * (middle[0] - corners[0, 0]) + sides[0, 1] * (middle[1] - corners[0, 1])
    for number in range(count):
        if inside > 0.0:
            sides[number, 0], sides[number, 1] = -sides[number, 0], -sides[number, 1]
        sides[number, 2] = (
            corners[number, 0] * sides[number, 0] + corners[number, 1] * sides[number, 1]
        )
    return sides
