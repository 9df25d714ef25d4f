"""Many rotations at once, as unit quaternions wxyz of shape (n, 4).

They equal those of SciPy's `Rotation` to the last bit: the C library's functions are used instead
of NumPy's, which round differently. Importing ``scipy.spatial`` takes a sixth of the time until a
run begins, and 24 MB.
"""

from __future__ import annotations

import math
from typing import TypeAlias

import numpy as np
import numpy.typing as npt

from bt_dualarm.core.pose import Matrix, Vector

Matrices: TypeAlias = npt.NDArray[np.float64]
"""Matrices along the first axis, of shape (n, 3, 3)."""

_SMALL = 1e-3
"""Angle in rad up to which series are used, whose error is then below the rounding of a float."""


def normalized(quaternions: Matrix) -> Matrix:
    """Quaternions divided by their lengths, whose squares are summed in the order xyzw."""
    return quaternions / _lengths(np.roll(quaternions, -1, axis=1))


def product(p: Matrix, q: Matrix) -> Matrix:
    """Hamilton products: first the rotations q, then p. One of them may be a single row."""
    a, b, c, d = p.T
    w, x, y, z = q.T
    return normalized(
        np.stack(
            (
                a * w - b * x - c * y - d * z,
                a * x + w * b + (c * z - d * y),
                a * y + w * c + (d * x - b * z),
                a * z + w * d + (b * y - c * x),
            ),
            axis=1,
        )
    )


def inverse(quaternions: Matrix) -> Matrix:
    """Inverse rotations."""
    return quaternions * (1.0, -1.0, -1.0, -1.0)


def from_rotation_vectors(vectors: Matrix) -> Matrix:
    """Rotations about the vectors, of shape (n, 3), by angles that are their lengths in rad."""
    quaternions = np.empty((len(vectors), 4))
    for i, angle in enumerate(_lengths(vectors)[:, 0].tolist()):
        square = angle * angle
        if angle <= _SMALL:
            scale = 0.5 - square / 48.0 + square * square / 3840.0
        else:
            scale = math.sin(angle / 2.0) / angle
        quaternions[i, 0] = math.cos(angle / 2.0)
        quaternions[i, 1:] = scale * vectors[i]
    return quaternions


def rotation_vectors(quaternions: Matrix) -> Matrix:
    """Inverse of `from_rotation_vectors`, of shape (n, 3), with angles of at most pi."""
    unit = np.where(quaternions[:, :1] < 0.0, -quaternions, quaternions)
    vectors = np.empty((len(unit), 3))
    for i, length in enumerate(_lengths(unit[:, 1:])[:, 0].tolist()):
        angle = 2.0 * math.atan2(length, unit[i, 0])
        square = angle * angle
        if angle <= _SMALL:
            scale = 2.0 + square / 12.0 + 7.0 * square * square / 2880.0
        else:
            scale = angle / math.sin(angle / 2.0)
        vectors[i] = scale * unit[i, 1:]
    return vectors


def matrices(quaternions: Matrix) -> Matrices:
    """Rotation matrices, of shape (n, 3, 3)."""
    w, x, y, z = quaternions.T
    found: Matrices = np.empty((len(quaternions), 3, 3))
    found[:, 0, 0] = x * x - y * y - z * z + w * w
    found[:, 1, 0] = 2.0 * (x * y + z * w)
    found[:, 2, 0] = 2.0 * (x * z - y * w)
    found[:, 0, 1] = 2.0 * (x * y - z * w)
    found[:, 1, 1] = -x * x + y * y - z * z + w * w
    found[:, 2, 1] = 2.0 * (y * z + x * w)
    found[:, 0, 2] = 2.0 * (x * z + y * w)
    found[:, 1, 2] = 2.0 * (y * z - x * w)
    found[:, 2, 2] = -x * x - y * y + z * z + w * w
    return found


def slerp(knots: Vector, quaternions: Matrix, at: Vector) -> Matrix:
    """Rotations at parameters, of shape (n,), at constant angular velocity between the knots.

    Args:
        knots: Parameters of the rotations, of shape (k,), increasing.
        quaternions: Rotations at the knots, of shape (k, 4).
        at: Parameters within the knots, of shape (n,).
    """
    turns = rotation_vectors(product(inverse(quaternions[:-1]), quaternions[1:]))
    piece = np.maximum(np.searchsorted(knots, at) - 1, 0)
    share = (at - knots[piece]) / np.diff(knots)[piece]
    steps = from_rotation_vectors(turns[piece] * share[:, None])
    return product(quaternions[piece], steps)


def _lengths(rows: Matrix) -> Matrix:
    """Lengths of rows, of shape (n, 1), summed from left to right."""
    first, *others = rows.T
    squares = first * first
    for column in others:
        squares = squares + column * column
    lengths: Matrix = np.sqrt(squares)[:, None]
    return lengths
