"""Compiled kernels of the camera: speeds across the image, and the input region of the lens."""

from __future__ import annotations

import math
from typing import NamedTuple, TypeAlias

import numpy as np
import numpy.typing as npt

from bt_dualarm.core.kernel import kernel
from bt_dualarm.core.pose import Matrix, Vector

# Motion blur

_NEAREST_M = 1e-3  # depth in front of the camera below which nothing is visible


class Bodies(NamedTuple):
    """Positions and velocities of all bodies of a model, in MuJoCo's arrays.

    Attributes:
        positions: Positions in the world (``xpos``), of shape (nbody, 3), m.
        velocities: Angular, then linear velocity (``cvel``) along the world's axes, the latter at
            the center of mass of the body's tree, of shape (nbody, 6), rad/s and m/s.
        centers: Centers of mass of the subtrees (``subtree_com``), of shape (nbody, 3), m.
        roots: Ids of the roots of the bodies' trees (``body_rootid``), of shape (nbody,).
    """

    positions: Matrix
    velocities: Matrix
    centers: Matrix
    roots: npt.NDArray[np.int32]


@kernel
def fastest(
    ids: npt.NDArray[np.int64], radii: Vector, holder: int, bodies: Bodies,
    eye: Vector, axes: Matrix, focal_px: float,
    size: tuple[int, int], region: tuple[int, int, int, int],
) -> float:  # fmt: skip
    """Highest image speed of the bodies that may be visible in a region, in pixels per second.

    Args:
        ids: Ids of the bodies to consider, of shape (n,).
        radii: Bounding radii about their positions, of shape (n,), m.
        holder: Id of the body that carries the camera.
        bodies: Positions and velocities of all bodies.
        eye: Position of the camera, of shape (3,), m.
        axes: Camera's x (right), y (up) and z (backward) as columns, of shape (3, 3).
        focal_px: Focal length in pixels.
        size: Width and height of the whole image in pixels.
        region: Region of the image: left, top, right, bottom.
    """
    most = 0.0
    relative = np.empty(3)
    of_camera = np.empty(3)
    for number in range(len(ids)):
        position = bodies.positions[ids[number]]
        relative[:] = position - eye
        x, y, z = _in_camera(axes, relative)
        if not _is_shown(x, y, z, radii[number], focal_px, size, region):
            continue
        # The image shows the body's velocity relative to a point that moves with the camera.
        _velocity(bodies, ids[number], position, relative)
        _velocity(bodies, holder, position, of_camera)
        relative -= of_camera
        u, v, w = _in_camera(axes, relative)
        # Derivative of the projection (x / z, y / z), with z < 0 in front of the camera.
        across = math.sqrt((u - x * w / z) ** 2 + (v - y * w / z) ** 2)
        most = max(most, focal_px * across / -z)
    return most


@kernel
def _velocity(bodies: Bodies, body: int, point: Vector, velocity: Vector) -> None:
    """Enter the velocity of the point of a body at a position, of shape (3,), m/s."""
    motion = bodies.velocities[body]
    center = bodies.centers[bodies.roots[body]]
    for axis in range(3):
        after = (axis + 1) % 3
        last = (axis + 2) % 3
        velocity[axis] = motion[3 + axis] + motion[after] * (point[last] - center[last])
        velocity[axis] -= motion[last] * (point[after] - center[after])


@kernel
def _in_camera(axes: Matrix, direction: Vector) -> tuple[float, float, float]:
    """Rotate a direction of the world into the camera, whose axes are the columns of a matrix."""
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
    """Whether a sphere at a position in the camera can be visible in a region."""
    if z > -_NEAREST_M:
        return False
    left, top, right, bottom = region
    scale = focal_px / -z
    column = size[0] / 2 + x * scale
    row = size[1] / 2 - y * scale
    room = radius * scale
    return left - room < column < right + room and top - room < row < bottom + room


# Lens

LensMap: TypeAlias = npt.NDArray[np.float32]
"""Source coordinate of each pixel along one axis, in pixels, of shape (height, width)."""


@kernel
def source_region(
    columns: LensMap, rows: LensMap, region: tuple[int, int, int, int], stride: int
) -> tuple[int, int, int, int]:
    """Region of the undistorted image that a region of the distorted image is computed from.

    Args:
        columns: Source coordinates along x; NaN where the lens shows nothing.
        rows: Source coordinates along y.
        region: Region of the distorted image: left, top, right, bottom.
        stride: Edge in pixels of the blocks, of which only the corners are computed.

    Returns:
        Left, top, right, bottom, inside the image, with the four pixels that bilinear interpolation
        needs around each source; the first pixel if the lens shows nothing.
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
    # Sources beyond the border take the color of the border.
    return (
        min(max(int(left), 0), width - 1), min(max(int(top), 0), height - 1),
        min(int(right) + 2, width), min(int(bottom) + 2, height),
    )  # fmt: skip
