"""Spheres around an arm: where they are, how far they turn, how near they are to others."""

from __future__ import annotations

import math
from typing import Final, TypeAlias

import numpy as np
import numpy.typing as npt

from bt_dualarm.core.kernel import kernel
from bt_dualarm.core.pose import Matrix, Vector

Numbers: TypeAlias = npt.NDArray[np.int64]

_TOGETHER: Final = 8  # spheres in a ball
_ROUNDING: Final = 1e-9  # m; a ball is not too small by it


@kernel
def place(own: Matrix, geoms: Numbers, places: Matrix, frames: Matrix, spheres: Matrix) -> None:
    """Enter where spheres are.

    Args:
        own: Centers in their shapes' frames, and radii, of shape (n, 4), m.
        geoms: Number of each one's shape, of shape (n,).
        places: Places of all shapes, of shape (ngeom, 3), m.
        frames: Axes of all shapes, row by row, of shape (ngeom, 9).
        spheres: Takes centers and radii in the world, of shape (n, 4), m.
    """
    for i in range(len(own)):
        geom = geoms[i]
        for row in range(3):
            total = places[geom, row]
            for column in range(3):
                total += frames[geom, 3 * row + column] * own[i, column]
            spheres[i, row] = total
        spheres[i, 3] = own[i, 3]


@kernel
def lever(
    spheres: Matrix, joints: Numbers, anchors: Matrix, axes: Matrix, moved: Matrix, levers: Matrix
) -> None:
    """Enter the farthest distance of a sphere's points from each joint's axis.

    Args:
        spheres: Centers and radii, of shape (n, 4), m.
        joints: Number of each joint, of shape (dof,).
        anchors: Places of all joints, of shape (njnt, 3), m.
        axes: Axes of all joints, likewise.
        moved: Whether a joint moves a sphere, 1 or 0, of shape (n, dof).
        levers: Takes the distances, of shape (n, dof), m; zero where the joint does not move it.
    """
    for i in range(len(spheres)):
        for j in range(len(joints)):
            square = 0.0
            along = 0.0
            for k in range(3):
                arm = spheres[i, k] - anchors[joints[j], k]
                square += arm * arm
                along += arm * axes[joints[j], k]
            away = math.sqrt(max(square - along * along, 0.0)) + spheres[i, 3]
            levers[i, j] = away * moved[i, j]


@kernel
def farthest(levers: Matrix, way: Vector) -> float:
    """The most that joints that turn by ``way``, of shape (dof,), rad, move one of the spheres."""
    most = 0.0
    for i in range(len(levers)):
        total = 0.0
        for j in range(len(way)):
            total += levers[i, j] * way[j]
        most = max(most, total)
    return most


@kernel
def reach(levers: Matrix, way: Vector, span: float) -> float:
    """How far any point gets, m, when the joints turn by no more than ``way``, (dof,), rad.

    A point is moved by each joint as far as its distance from the axis, which grows by no more
    than the result itself, ``R <= way · levers + R Σ way``, and is at most the span.
    """
    total = 0.0
    for i in range(len(way)):
        total += way[i]
    most: float = span * total
    if total >= 1.0:
        return most
    return min(farthest(levers, way) / (1.0 - total), most)


@kernel
def nearest(first: Matrix, second: Matrix) -> float:
    """The least distance in m of two sets of spheres, of shape (n, 4) and (m, 4).

    Spheres that follow each other lie near each other: what a ball around some of them is too far
    from for, they are.
    """
    count = len(second)
    least = math.inf
    balls = np.empty(((count + _TOGETHER - 1) // _TOGETHER, 4))
    for k in range(len(balls)):
        _wrap(second, k * _TOGETHER, min((k + 1) * _TOGETHER, count), balls[k])
    for i in range(len(first)):
        for k in range(len(balls)):
            if _between(first, i, balls, k) < least:
                for j in range(k * _TOGETHER, min((k + 1) * _TOGETHER, count)):
                    least = min(least, _between(first, i, second, j))
    return least


@kernel
def _between(first: Matrix, i: int, second: Matrix, j: int) -> float:
    """Distance of two spheres in m."""
    square = 0.0
    for k in range(3):
        square += (first[i, k] - second[j, k]) ** 2
    distance: float = math.sqrt(square) - first[i, 3] - second[j, 3]
    return distance


@kernel
def _wrap(spheres: Matrix, begin: int, end: int, ball: Vector) -> None:
    """Enter center and radius of a ball around spheres from ``begin`` to before ``end``."""
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
    """How far any point of some shapes has moved at most on a short way, m.

    Args:
        first: Centers of the shapes before it, of shape (n, 3), m.
        second: Centers after it, likewise.
        bounds: Radii of the shapes, of shape (n,), m.
        turned: Whether a joint turns a shape, 1 or 0, of shape (n, dof).
        turn: Turn of each joint, of shape (dof,), rad.
    """
    most = 0.0
    for i in range(len(bounds)):
        square = 0.0
        angle = 0.0
        for k in range(3):
            square += (second[i, k] - first[i, k]) ** 2
        for j in range(len(turn)):
            angle += turned[i, j] * abs(turn[j])
        most = max(most, math.sqrt(square) + bounds[i] * angle)
    return most
