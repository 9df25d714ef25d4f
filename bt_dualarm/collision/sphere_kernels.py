"""Bounding spheres of an arm: positions, bounds of their motion, distances to other spheres."""

from __future__ import annotations

import math
from typing import Final, TypeAlias

import numpy as np
import numpy.typing as npt

from bt_dualarm.core.kernel import kernel
from bt_dualarm.core.pose import Matrix, Vector

Numbers: TypeAlias = npt.NDArray[np.int64]

_GROUP: Final = 8
"""Number of consecutive spheres with a common bounding ball in `nearest`."""

_ROUNDING: Final = 1e-9
"""Added to the radius of a bounding ball, m: rounding errors never make it too small."""


@kernel
def place(
    local: Matrix, geoms: Numbers, positions: Matrix, frames: Matrix, spheres: Matrix
) -> None:
    """Write the spheres in world coordinates.

    Args:
        local: Centers in the frames of their geoms, and radii, of shape (n, 4), m.
        geoms: Index of each sphere's geom, of shape (n,).
        positions: Positions of all geoms, of shape (ngeom, 3), m.
        frames: Rotation matrices of all geoms, row by row, of shape (ngeom, 9).
        spheres: Output: centers and radii in the world, of shape (n, 4), m.
    """
    for i in range(len(local)):
        geom = geoms[i]
        for row in range(3):
            total = positions[geom, row]
            for column in range(3):
                total += frames[geom, 3 * row + column] * local[i, column]
            spheres[i, row] = total
        spheres[i, 3] = local[i, 3]


@kernel
def lever(
    spheres: Matrix, joints: Numbers, anchors: Matrix, axes: Matrix, moved: Matrix, levers: Matrix
) -> None:
    """Write the largest distance of any point of each sphere from each joint's axis.

    Args:
        spheres: Centers and radii, of shape (n, 4), m.
        joints: Index of each joint, of shape (dof,).
        anchors: Points on the axes of all joints, of shape (njnt, 3), m.
        axes: Directions of the axes of all joints, of shape (njnt, 3).
        moved: Whether a joint moves a sphere, 1 or 0, of shape (n, dof).
        levers: Output: the distances, of shape (n, dof), m; zero if the joint does not move it.
    """
    for i in range(len(spheres)):
        for j in range(len(joints)):
            square = 0.0
            along = 0.0
            for k in range(3):
                arm = spheres[i, k] - anchors[joints[j], k]
                square += arm * arm
                along += arm * axes[joints[j], k]
            # Pythagoras; rounding may make the difference negative for a center on the axis.
            away = math.sqrt(max(square - along * along, 0.0)) + spheres[i, 3]
            levers[i, j] = away * moved[i, j]


@kernel
def reach(levers: Matrix, turns: Vector, span: float) -> float:
    """Upper bound of any point's displacement while each joint turns by no more than ``turns``, m.

    Args:
        levers: Current distances from the joints' axes, of shape (n, dof), m.
        turns: Largest turn of each joint, of shape (dof,), rad.
        span: Largest distance of any point from the first joint in any configuration, m.
    """
    # Turn the joints in the order tip to base. Before joint j turns, a point has moved by at most
    # the bound R, and the axis not at all: their distance is at most lever_j + R. Hence
    # R <= sum(lever_j turn_j) + R sum(turn_j), which is solved for R below.
    total = 0.0
    for i in range(len(turns)):
        total += turns[i]
    most: float = span * total
    if total >= 1.0:
        return most
    return min(farthest(levers, turns) / (1.0 - total), most)


@kernel
def farthest(levers: Matrix, turns: Vector) -> float:
    """Largest sum of a sphere's levers times the turns of the joints, of shape (dof,), rad."""
    most = 0.0
    for i in range(len(levers)):
        total = 0.0
        for j in range(len(turns)):
            total += levers[i, j] * turns[j]
        most = max(most, total)
    return most


@kernel
def nearest(first: Matrix, second: Matrix) -> float:
    """Smallest distance between two sets of spheres, of shape (n, 4) and (m, 4), m."""
    # Consecutive spheres belong to the same link: a ball around them rules out most pairs at once.
    count = len(second)
    least = math.inf
    balls = np.empty(((count + _GROUP - 1) // _GROUP, 4))
    for k in range(len(balls)):
        _wrap(second, k * _GROUP, min((k + 1) * _GROUP, count), balls[k])
    for i in range(len(first)):
        for k in range(len(balls)):
            if _between(first, i, balls, k) < least:
                for j in range(k * _GROUP, min((k + 1) * _GROUP, count)):
                    least = min(least, _between(first, i, second, j))
    return least


@kernel
def _between(first: Matrix, i: int, second: Matrix, j: int) -> float:
    """Distance between two spheres, m; negative if they overlap."""
    square = 0.0
    for k in range(3):
        square += (first[i, k] - second[j, k]) ** 2
    distance: float = math.sqrt(square) - first[i, 3] - second[j, 3]
    return distance


@kernel
def _wrap(spheres: Matrix, begin: int, end: int, ball: Vector) -> None:
    """Write center and radius of a ball around the spheres ``begin`` to ``end - 1``."""
    for k in range(3):
        ball[k] = 0.0
        for i in range(begin, end):
            ball[k] += spheres[i, k] / (end - begin)
    ball[3] = 0.0
    for i in range(begin, end):
        square = 0.0
        for k in range(3):
            square += (spheres[i, k] - ball[k]) ** 2
        ball[3] = max(ball[3], math.sqrt(square) + spheres[i, 3] + _ROUNDING)


@kernel
def moved(first: Matrix, second: Matrix, bounds: Vector, turned: Matrix, turn: Vector) -> float:
    """Upper bound of the displacement of any point of some shapes between two states, m.

    Args:
        first: Centers of the shapes in the first state, of shape (n, 3), m.
        second: Centers in the second state, of shape (n, 3), m.
        bounds: Radii of the shapes' bounding spheres, of shape (n,), m.
        turned: Whether a joint moves a shape, 1 or 0, of shape (n, dof).
        turn: Turn of each joint, of shape (dof,), rad.
    """
    most = 0.0
    for i in range(len(bounds)):
        square = 0.0
        angle = 0.0
        for k in range(3):
            square += (second[i, k] - first[i, k]) ** 2
        # A shape rotates about its center by no more than all its joints turn together.
        for j in range(len(turn)):
            angle += turned[i, j] * abs(turn[j])
        most = max(most, math.sqrt(square) + bounds[i] * angle)
    return most
