"""Convex hulls with few vertices that stand for many points."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy

from bt_dualarm.pose import Matrix

LOSS_M = 0.002
"""Distance in metres by which a point may stand out of its hull; 1 mm takes 1.5 times the
vertices."""

_DIRECTIONS = 24
"""Number of directions whose extreme points a hull begins with."""


@dataclass(frozen=True, eq=False)
class Hull:
    """A convex polyhedron.

    Attributes:
        vertices: Corners, of shape (n, 3), m.
        triangles: Indices of the corners of its faces, anticlockwise seen from outside, (m, 3).
    """

    vertices: Matrix
    triangles: Matrix


def low_poly_hull(points: Matrix) -> Hull:
    """Convex hull of points, of shape (n, 3), m, with few vertices, all of them among the points.

    It begins with the extreme points in evenly spread directions and takes in the point that
    stands out farthest of each of its sides, until none stands out by more than `LOSS_M`.
    """
    corners = points[scipy.spatial.ConvexHull(points).vertices]
    chosen = np.unique(np.argmax(corners @ _fibonacci_sphere(_DIRECTIONS).T, axis=0))
    while True:
        hull = scipy.spatial.ConvexHull(corners[chosen])
        outside = corners @ hull.equations[:, :3].T + hull.equations[:, 3]
        farthest = np.argmax(outside, axis=0)[outside.max(axis=0) > LOSS_M]
        if len(farthest) == 0:
            return Hull(corners[chosen], _outward(corners[chosen], hull))
        chosen = np.union1d(chosen, farthest)


def _fibonacci_sphere(count: int) -> Matrix:
    """Evenly spread unit vectors, of shape (count, 3) (golden-angle spiral)."""
    k = np.arange(count) + 0.5
    z = 1 - 2 * k / count
    angle = np.pi * (1 + 5**0.5) * k
    radius = np.sqrt(1 - z**2)
    return np.column_stack((radius * np.cos(angle), radius * np.sin(angle), z))


def _outward(points: Matrix, hull: scipy.spatial.ConvexHull) -> Matrix:
    """Triangles of a hull, each with its corners anticlockwise seen from outside."""
    triangles: Matrix = hull.simplices.copy()
    corners = points[triangles]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    inward = np.einsum("ij,ij->i", normal, hull.equations[:, :3]) < 0
    triangles[inward] = triangles[inward][:, ::-1]
    return triangles
