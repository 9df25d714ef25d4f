"""Arrays that the kernels of swept collision checks and of RRT-Connect read and write.

Named tuples of arrays are the only structures that compiled code reads at full speed. `SweptArm` is
the model of one arm in its world, `Query` the problem of a search, `Trees` its result.
"""

from __future__ import annotations

from typing import NamedTuple, TypeAlias

import numpy as np
import numpy.typing as npt

from bt_dualarm.core.pose import Matrix, Vector

Numbers: TypeAlias = npt.NDArray[np.int64]

Draws: TypeAlias = npt.NDArray[np.uint64]
"""State of a random number generator, of shape (1,); not zero."""

Frames: TypeAlias = npt.NDArray[np.float64]
"""Transforms, of shape (n, 3, 4): rotation, and translation in the last column; or rotations only,
of shape (n, 3, 3)."""


class Joints(NamedTuple):
    """Revolute joints of one arm, base to tip, in its reference configuration.

    Attributes:
        reference: Reference configuration, of shape (dof,), rad.
        anchors: Points on the axes in the world, of shape (dof, 3), m.
        axes: Directions of the axes in the world, of shape (dof, 3).
    """

    reference: Vector
    anchors: Matrix
    axes: Matrix


class ConvexShapes(NamedTuple):
    """Convex shapes in the reference configuration: hulls of corners, inflated by a radius.

    A half space has no corners; its center is a point of its plane.

    Attributes:
        corners: Corners of all shapes in the world, of shape (c, 3), m.
        ranges: First corner of each shape, the first after its last, and the number of joints that
            move it, of shape (n, 3).
        radii: Radius of inflation of each shape, of shape (n,), m.
        centers: Centers of the bounding spheres and bounding boxes in the world, of shape (n, 3),
            m.
        bounds: Radii of the bounding spheres, of shape (n,), m; inf for a half space.
        rotations: Axes of the bounding boxes as columns, of shape (n, 3, 3).
        half_extents: Half of the edges of the bounding boxes, of shape (n, 3), m.
        normals: Outward normals of half spaces, of shape (n, 3); zero for other shapes.
        reaches: Largest motion of any point of each shape per radian of each joint, in any
            configuration, of shape (n, dof), m/rad.
    """

    corners: Matrix
    ranges: Numbers
    radii: Vector
    centers: Matrix
    bounds: Vector
    rotations: Frames
    half_extents: Matrix
    normals: Matrix
    reaches: Matrix


class Pairs(NamedTuple):
    """Pairs of shapes to check; the first is moved by more joints than the second.

    Attributes:
        first: Indices of shapes, of shape (p,).
        second: Indices of shapes, of shape (p,).
        least: Minimum allowed distances, of shape (p,), m; negative where penetration is allowed.
        directions: Initial separating directions from the second to the first, or directions of
            least penetration where that is allowed, of shape (p, 3).
    """

    first: Numbers
    second: Numbers
    least: Vector
    directions: Matrix


class SweptArm(NamedTuple):
    """An arm in its world.

    Attributes:
        joints: Joints of the arm.
        shapes: Shapes of the arm and of everything that it may collide with.
        pairs: Pairs of shapes to check.
        clearance: Distance to keep on top of the minimum distances except near the ends of a path,
            m.
    """

    joints: Joints
    shapes: ConvexShapes
    pairs: Pairs
    clearance: float


class Query(NamedTuple):
    """Sampling bounds and limits of a search.

    Attributes:
        lower: Lower bounds of samples, of shape (dof,), rad.
        upper: Upper bounds of samples, of shape (dof,), rad.
        radii: Largest motion of the arm per radian of each joint, of shape (dof,), m/rad.
        longest: Longest extension of a tree, as motion of the arm, m.
        checks: Number of configurations checked after which the search ends.
    """

    lower: Vector
    upper: Vector
    radii: Vector
    longest: float
    checks: int


class Trees(NamedTuple):
    """Two trees with a fixed capacity of nodes.

    Attributes:
        nodes: Configurations, of shape (2, capacity, dof), rad.
        parents: Indices of the parent nodes, of shape (2, capacity); -1 for a root.
        counts: Numbers of nodes, of shape (2,).
    """

    nodes: Frames
    parents: Numbers
    counts: Numbers
