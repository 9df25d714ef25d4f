"""What the kernels of the search read: an arm's joints, shapes, and which of them may meet."""

from __future__ import annotations

from typing import NamedTuple, TypeAlias

import numpy as np
import numpy.typing as npt

from bt_dualarm.core.pose import Matrix, Vector

Numbers: TypeAlias = npt.NDArray[np.int64]

Draws: TypeAlias = npt.NDArray[np.uint64]
"""State of a sequence of random numbers, of shape (1,); not zero."""

Frames: TypeAlias = npt.NDArray[np.float64]
"""Transforms, of shape (n, 3, 4): a rotation, and a place in the last column; or without it."""


class Joints(NamedTuple):
    """The turning joints of one arm, base to tip, as they stand in its reference configuration.

    Attributes:
        reference: The configuration, of shape (dof,), rad.
        anchors: Points on the axes in the world, of shape (dof, 3), m.
        axes: Directions of the axes, of shape (dof, 3).
    """

    reference: Vector
    anchors: Matrix
    axes: Matrix


class ConvexShapes(NamedTuple):
    """Convex shapes, where they are in the reference configuration: corners, rounded by a radius.

    A half space has no corners; its center is a point of its plane.

    Attributes:
        corners: Corners of all shapes in the world, of shape (c, 3), m.
        heaps: First corner of each shape, the first after its last, and the number of joints that
            move it, of shape (n, 3).
        radii: Meters by which each is rounded, of shape (n,).
        centers: Centers of spheres and of boxes around them, of shape (n, 3), m.
        bounds: Radii of the spheres; inf for a half space, of shape (n,), m.
        turns: Axes of the boxes as columns, of shape (n, 3, 3).
        halves: Half of the edges of the boxes, of shape (n, 3), m.
        normals: Outward normals of half spaces, zero of the others, of shape (n, 3).
        reaches: Meters that any point of each is moved at most by a radian of each joint, (n, dof).
    """

    corners: Matrix
    heaps: Numbers
    radii: Vector
    centers: Matrix
    bounds: Vector
    turns: Frames
    halves: Matrix
    normals: Matrix
    reaches: Matrix


class Pairs(NamedTuple):
    """Pairs of shapes that are to keep apart; the first is moved by more joints than the second.

    Attributes:
        first: Numbers of shapes, of shape (p,).
        second: Numbers of shapes, of shape (p,).
        least: Distances that they keep, of shape (p,), m; negative where they may touch.
        apart: Directions from the second to the first in which they are apart, or least in one
            another where they may touch, of shape (p, 3): where to look first.
    """

    first: Numbers
    second: Numbers
    least: Vector
    apart: Matrix


class SweptArm(NamedTuple):
    """An arm in its world.

    Attributes:
        joints: Joints of the arm.
        shapes: Shapes that it has, and that it may meet.
        pairs: Which of them are to keep apart.
        spare: Meters that they keep between them besides, but near the ends of a way.
    """

    joints: Joints
    shapes: ConvexShapes
    pairs: Pairs
    spare: float


class Query(NamedTuple):
    """Where a search looks, and for how long.

    Attributes:
        lower: Least angles that are drawn, of shape (dof,), rad.
        upper: Largest angles that are drawn, of shape (dof,), rad.
        radii: Meters that the arm moves at most per radian of each joint, of shape (dof,).
        longest: Longest branch of the trees, in meters that the arm moves.
        checks: Number of configurations at which it ends.
    """

    lower: Vector
    upper: Vector
    radii: Vector
    longest: float
    checks: int


class Trees(NamedTuple):
    """Two trees, each with room for so many nodes.

    Attributes:
        nodes: Configurations, of shape (2, most, dof), rad.
        parents: Numbers of the nodes that they hang on, of shape (2, most); -1 of a root.
        counts: Numbers of nodes, of shape (2,).
    """

    nodes: Frames
    parents: Numbers
    counts: Numbers
