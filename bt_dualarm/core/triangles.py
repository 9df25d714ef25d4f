"""Surfaces of triangles."""

from __future__ import annotations

import numpy as np

from bt_dualarm.core.pose import Matrix


def cut_at(triangles: Matrix, axis: int, offset: float) -> tuple[Matrix, Matrix]:
    """Cut triangles by a plane normal to an axis.

    Args:
        triangles: Corners, of shape (n, 3, 3): triangle, corner, coordinate, m.
        axis: Index of the axis.
        offset: Coordinate of the plane along it, m.

    Returns:
        Triangles below and above the plane, each of shape (m, 3, 3).
    """
    below = triangles[:, :, axis] <= offset
    count = below.sum(axis=1)
    crossing = (count == 1) | (count == 2)
    # A crossing triangle has one corner alone on its side. Rotate that corner to the front, then
    # split the triangle into a tip on its side and a quadrilateral (two triangles) on the other.
    lower = count[crossing] == 1
    alone = np.argmax(below[crossing] == lower[:, None], axis=1)
    order = (alone[:, None] + np.arange(3)) % 3
    first, second, third = np.take_along_axis(
        triangles[crossing], order[:, :, None], axis=1
    ).transpose(1, 0, 2)
    ends = [_meeting(first, other, axis, offset) for other in (second, third)]
    tips = np.stack((first, *ends), axis=1)
    stumps = np.stack((ends[0], second, third), axis=1), np.stack((*ends, third), axis=1)
    return (
        np.concatenate((triangles[count == 3], tips[lower], *(one[~lower] for one in stumps))),
        np.concatenate((triangles[count == 0], tips[~lower], *(one[lower] for one in stumps))),
    )


def _meeting(start: Matrix, end: Matrix, axis: int, offset: float) -> Matrix:
    """Intersect line segments, of shape (n, 3) each, with a plane normal to an axis."""
    share = (offset - start[:, axis]) / (end[:, axis] - start[:, axis])
    points: Matrix = start + share[:, None] * (end - start)
    return points
