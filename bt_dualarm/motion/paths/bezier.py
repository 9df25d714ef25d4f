"""The curve that cuts a corner between two straight pieces, smooth enough to be driven through."""

from __future__ import annotations

import numpy as np

from bt_dualarm.pose import Matrix, Vector

_SHARE = np.linspace(0.0, 1.0, 33)[:, None]


def corner_curve(start: Vector, corner: Vector, end: Vector) -> Matrix:
    """A Bézier curve of degree five, without curvature at its ends, where it meets the lines.

    Args:
        start: Point where it leaves the line to the corner, of shape (k,).
        corner: Corner of the two lines, of shape (k,).
        end: Point where it meets the line from the corner, of shape (k,).

    Returns:
        33 points from start to end, of shape (33, k).
    """
    t, u = _SHARE, 1.0 - _SHARE
    towards, away = (start + corner) / 2.0, (corner + end) / 2.0
    curve: Matrix = (
        u**5 * start
        + 5 * u**4 * t * towards
        + 10 * (u**3 * t**2 + u**2 * t**3) * corner
        + 5 * u * t**4 * away
        + t**5 * end
    )
    return curve
