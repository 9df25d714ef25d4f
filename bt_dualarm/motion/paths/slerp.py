"""Turning evenly from one orientation to the next (Shoemake, SIGGRAPH 1985).

As SciPy's, to the last bit, without its import. Sines are those of the standard library: they are
the same on every processor, and NumPy's are not.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Final

import numpy as np

from bt_dualarm.pose import Matrix, Vector

_SMALL: Final = 1e-3
"""Angle in rad up to which series take the place of quotients of sines: they are exact there."""

_BACK: Final = np.array((1.0, -1.0, -1.0, -1.0))


def evenly_turned(knots: Vector, quaternions: Matrix, places: Vector) -> Matrix:
    """Orientations between others: the shorter way round, at an even speed.

    Args:
        knots: Places of the given ones, of shape (n,), rising, two at least.
        quaternions: The given ones, wxyz, of shape (n, 4) and any length but 0.
        places: Places from the first knot to the last, of shape (m,).

    Returns:
        Unit quaternions, wxyz, of shape (m, 4).
    """
    given = _unit(quaternions)
    ways = _turns(_unit(_products(given[:-1] * _BACK, given[1:])))
    before = np.maximum(np.searchsorted(knots, places) - 1, 0)
    share = (places - knots[before]) / np.diff(knots)[before]
    return _unit(_products(given[before], _quaternions(ways[before] * share[:, None])))


def _length(rows: Matrix) -> Vector:
    """Length of each row, of shape (n,); summed up in their order."""
    squares = (rows**2).T
    total: Vector = squares[0]
    for more in squares[1:]:
        total = total + more
    return np.sqrt(total)


def _unit(quaternions: Matrix) -> Matrix:
    unit: Matrix = quaternions / _length(np.roll(quaternions, -1, axis=1))[:, None]
    return unit


def _products(p: Matrix, q: Matrix) -> Matrix:
    """Of quaternions, row by row, each of shape (n, 4)."""
    (a, b, c, d), (w, x, y, z) = p.T, q.T
    return np.stack(
        (
            a * w - b * x - c * y - d * z,
            a * x + w * b + (c * z - d * y),
            a * y + w * c + (d * x - b * z),
            a * z + w * d + (b * y - c * x),
        ),
        axis=1,
    )


def _turns(quaternions: Matrix) -> Matrix:
    """Axis times angle of unit quaternions, no more than half a turn, of shape (n, 3), rad."""
    ahead = np.where(quaternions[:, :1] < 0.0, -quaternions, quaternions)
    angles = 2.0 * _each(math.atan2, _length(ahead[:, 1:]), ahead[:, 0])
    scale = np.where(
        angles <= _SMALL,
        2.0 + angles**2 / 12.0 + 7.0 * angles**4 / 2880.0,
        angles / _each(math.sin, np.maximum(angles, _SMALL) / 2.0),
    )
    turns: Matrix = scale[:, None] * ahead[:, 1:]
    return turns


def _quaternions(turns: Matrix) -> Matrix:
    """Unit quaternions of turns, of shape (n, 4)."""
    angles = _length(turns)
    large = np.maximum(angles, _SMALL)
    scale = np.where(
        angles <= _SMALL,
        0.5 - angles**2 / 48.0 + angles**4 / 3840.0,
        _each(math.sin, large / 2.0) / large,
    )
    return np.column_stack((_each(math.cos, angles / 2.0), scale[:, None] * turns))


def _each(function: Callable[..., float], *numbers: Vector) -> Vector:
    """A function of the standard library, number by number."""
    return np.array([function(*one) for one in zip(*(of.tolist() for of in numbers), strict=True)])
