"""The two passes of TOPP-RA over a path: how fast it can be gone through at each place.

x is the square of the speed at a place, u the acceleration from there to the next. Both are bound
by rows ``|a u + b x| <= 1`` with ``a >= 0``, two for each joint: between two places the limits hold
at both ends. Each step of a pass is a linear program in u and x whose answer is the least of a few
numbers.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from bt_dualarm.kernels.kernel import kernel
from bt_dualarm.motion.timing.kernel_arrays import PathOnGrid
from bt_dualarm.pose import Vector

SLOWING: Final = 0.1
"""Least share of the square of a speed that is left at the next place, but for the last one: on a
sharp bend the largest speed of a place could else be one from which the next place is reached at
rest, and the arm would stop there."""

_BELOW: Final = 1.0 - 1e-6
"""Share of the square of the largest speed of a place that is taken at most: at that speed itself a
single acceleration is left, and where a joint all but turns back it may be a low one."""


@kernel
def squares_of_rates(path: PathOnGrid, acceleration: Vector, share: Vector) -> Vector:
    """Squares of the rates of the fastest motion from rest to rest, of shape (n,).

    Args:
        path: The path.
        acceleration: Limits of the joints' accelerations, of shape (dof,).
        share: Share of them that may be used at each place, of shape (n,).
    """
    count, dof = path.slope.shape
    a, b = np.empty((count - 1, 2 * dof)), np.empty((count - 1, 2 * dof))
    reachable = np.zeros(count)
    for i in range(count - 2, -1, -1):
        step = 2.0 * (path.grid[i + 1] - path.grid[i])
        last = i == count - 2
        _enter_rows(path, acceleration, share, i, a[i], b[i])
        most = _largest(a[i], b[i], step, 1.0 if last else 1.0 - SLOWING, path.most[i]) * _BELOW
        steepest = math.inf if last else reachable[i + 1] / SLOWING
        reachable[i] = min(_before(a[i], b[i], step, reachable[i + 1]), most, steepest)
    squares = np.zeros(count)
    for i in range(count - 1):
        step = 2.0 * (path.grid[i + 1] - path.grid[i])
        squares[i + 1] = min(_after(a[i], b[i], step, squares[i]), reachable[i + 1])
    return squares


@kernel
def _enter_rows(
    path: PathOnGrid, acceleration: Vector, share: Vector, i: int, a: Vector, b: Vector
) -> None:
    """Enter the coefficients of the rows of a place, of shape (2 dof,) each."""
    dof = len(acceleration)
    step = 2.0 * (path.grid[i + 1] - path.grid[i])
    for j in range(dof):
        here, there = acceleration[j] * share[i], acceleration[j] * share[i + 1]
        curvature = path.curvature[i + 1, j] / there
        _enter(a, b, j, path.slope[i, j] / here, path.curvature[i, j] / here)
        _enter(a, b, dof + j, path.slope[i + 1, j] / there + step * curvature, curvature)


@kernel
def _enter(a: Vector, b: Vector, row: int, along: float, across: float) -> None:
    """Enter the coefficients of a row; that of u is made positive."""
    a[row] = abs(along)
    b[row] = -across if along < 0.0 else across


@kernel
def _largest(a: Vector, b: Vector, step: float, slowing: float, most: float) -> float:
    """The largest x up to ``most`` for which there is any u.

    The least upper bound of u, ``(1 - b x) / a``, falls below the greatest lower one, ``(-1 - b x)
    / a`` or the one that leaves too little speed at the next place. Their distance is concave in x:
    from the right, the two lines that bound u at an x meet at the next x (Newton), and after a few
    times at the last for which the one is not below the other.
    """
    x = most
    for k in range(len(a)):
        if a[k] == 0.0 and b[k] != 0.0:
            x = min(x, 1.0 / abs(b[k]))
    while True:
        up, low = -1, -1
        least, greatest = math.inf, -slowing * x / step
        for k in range(len(a)):
            if a[k] > 0.0:
                tilt, width = b[k] * x, 1.0 / a[k]
                if (1.0 - tilt) * width < least:
                    up, least = k, (1.0 - tilt) * width
                if (-1.0 - tilt) * width > greatest:
                    low, greatest = k, (-1.0 - tilt) * width
        if up < 0:
            return x
        if low < 0:
            slack, rise = step, b[up] * step - slowing * a[up]
        else:
            slack, rise = a[up] + a[low], b[up] * a[low] - b[low] * a[up]
        if rise <= 0.0 or slack / rise >= x:
            return x
        x = slack / rise


@kernel
def _before(a: Vector, b: Vector, step: float, ahead: float) -> float:
    """The largest x from which some u leads to no more than what is reachable at the next place.

    The lower bounds of u are below ``(ahead - x) / step``.
    """
    x = math.inf
    for k in range(len(a)):
        rise = a[k] - step * b[k]
        if rise > 0.0:
            x = min(x, (a[k] * ahead + step) / rise)
    return x


@kernel
def _after(a: Vector, b: Vector, step: float, here: float) -> float:
    """The largest x of the next place: by the least upper bound of u."""
    x = math.inf
    for k in range(len(a)):
        if a[k] > 0.0:
            x = min(x, here + step * (1.0 - b[k] * here) / a[k])
    return x
