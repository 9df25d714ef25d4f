"""Motion across an image, and the part of an image that a lens needs: compiled."""

from __future__ import annotations

import math
from typing import NamedTuple, TypeAlias

import numpy as np
import numpy.typing as npt

from bt_dualarm.core.kernel import kernel
from bt_dualarm.core.pose import Matrix, Vector

# How fast things move across a picture.


_NEAREST_M = 1e-3  # what is not so far ahead is not in a picture


class Bodies(NamedTuple):
    """All bodies of a model, as MuJoCo has them.

    Attributes:
        places: Places in the world, of shape (nbody, 3), m.
        motions: Turn and velocity along the world's axes, of shape (nbody, 6), rad/s and m/s: of
            what moves with a body at the center of its tree.
        centers: Centers of mass of all that hangs on a body, of shape (nbody, 3), m.
        roots: Numbers of the bodies that their trees begin with, of shape (nbody,).
    """

    places: Matrix
    motions: Matrix
    centers: Matrix
    roots: npt.NDArray[np.int32]


@kernel
def fastest(
    things: npt.NDArray[np.int64], radii: Vector, holder: int, bodies: Bodies,
    eye: Vector, axes: Matrix, focal_px: float,
    size: tuple[int, int], region: tuple[int, int, int, int],
) -> float:  # fmt: skip
    """Highest speed of a thing that can be in a part of a picture across it, in pixels a second.

    Args:
        things: Numbers of the bodies that are asked, of shape (n,).
        radii: How far they extend from their places, of shape (n,), m.
        holder: Number of the body that the camera is part of.
        bodies: Places and motion of all bodies.
        eye: Place of the camera, of shape (3,), m.
        axes: The camera's x (right), y (up) and z (backward) as columns, of shape (3, 3).
        focal_px: Focal length in pixels.
        size: Width and height of the whole picture in pixels.
        region: Part of it: left, top, right, bottom.
    """
    most = 0.0
    its = np.empty(3)
    ours = np.empty(3)
    for number in range(len(things)):
        place = bodies.places[things[number]]
        its[:] = place - eye
        x, y, z = _inward(axes, its)
        if not _is_shown(x, y, z, radii[number], focal_px, size, region):
            continue
        _velocity(bodies, things[number], place, its)
        _velocity(bodies, holder, place, ours)  # as if it moved with the camera
        its -= ours
        u, v, w = _inward(axes, its)
        across = math.sqrt((u - x * w / z) ** 2 + (v - y * w / z) ** 2)
        most = max(most, focal_px * across / -z)
    return most


@kernel
def _velocity(bodies: Bodies, body: int, place: Vector, velocity: Vector) -> None:
    """Enter the velocity of what moves with a body, at a place: of shape (3,), m/s."""
    motion = bodies.motions[body]
    center = bodies.centers[bodies.roots[body]]
    for axis in range(3):
        after = (axis + 1) % 3
        last = (axis + 2) % 3
        velocity[axis] = motion[3 + axis] + motion[after] * (place[last] - center[last])
        velocity[axis] -= motion[last] * (place[after] - center[after])


@kernel
def _inward(axes: Matrix, direction: Vector) -> tuple[float, float, float]:
    """A direction of the world in the axes that are these columns."""
    x = direction[0]
    y = direction[1]
    z = direction[2]
    return (
        axes[0, 0] * x + axes[1, 0] * y + axes[2, 0] * z,
        axes[0, 1] * x + axes[1, 1] * y + axes[2, 1] * z,
        axes[0, 2] * x + axes[1, 2] * y + axes[2, 2] * z,
    )


@kernel
def _is_shown(
    x: float, y: float, z: float, radius: float, focal_px: float,
    size: tuple[int, int], region: tuple[int, int, int, int],
) -> bool:  # fmt: skip
    """Whether a thing at a place in the camera's axes can be in a part of the picture."""
    if z > -_NEAREST_M:
        return False
    left, top, right, bottom = region
    scale = focal_px / -z
    column = size[0] / 2 + x * scale
    row = size[1] / 2 - y * scale
    room = radius * scale
    return left - room < column < right + room and top - room < row < bottom + room


# Which part of a picture before a lens a part of the picture behind it comes from.


Places: TypeAlias = npt.NDArray[np.float32]
"""Where the rays of all pixels come from, along one axis, in pixels, of shape (height, width)."""


@kernel
def needed(
    columns: Places, rows: Places, region: tuple[int, int, int, int], stride: int
) -> tuple[int, int, int, int]:
    """The pixels before the lens that a part of the picture behind it is made of.

    Args:
        columns: Places along x; not a number where nothing is seen.
        rows: Places along y.
        region: Part of the picture: left, top, right, bottom.
        stride: Edge in pixels of the blocks of which the corner alone is looked at.

    Returns:
        Left, top, right, bottom, inside the image: four pixels about each place; the first pixel
        where nothing is seen.
    """
    height, width = columns.shape
    left = np.inf
    right = -np.inf
    top = np.inf
    bottom = -np.inf
    for row in range(region[1], region[3], stride):
        for column in range(region[0], region[2], stride):
            x = columns[row, column]
            y = rows[row, column]
            if not np.isnan(x):
                left = min(left, x)
                right = max(right, x)
                top = min(top, y)
                bottom = max(bottom, y)
    if right < left:
        return 0, 0, 1, 1
    # What lies beyond the border has its color.
    return (
        min(max(int(left), 0), width - 1), min(max(int(top), 0), height - 1),
        min(int(right) + 2, width), min(int(bottom) + 2, height),
    )  # fmt: skip
