"""A path of straight pieces made smooth: its corners cut as far as obstacles allow."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from bt_dualarm.motion.collision.sweep import interpolated
from bt_dualarm.motion.paths.bezier import corner_curve
from bt_dualarm.pose import Matrix, Vector

_CUTS = (0.5, 0.3, 0.18, 0.1, 0.05)
"""Shares of the shorter piece at a corner that are tried for its cut, longest first."""

_SPACING = 0.02
"""Most that a point of the arm moves between two samples, in metres."""


def rounded(corners: Matrix, radii: Vector, is_free: Callable[[Matrix], bool]) -> list[Matrix]:
    """Smooth pieces, each of shape (m, dof), that lead through corners, of shape (n, dof).

    At a corner that cannot be cut without touching something, one piece ends and the next begins:
    the arm stops there.

    Args:
        corners: The corners.
        radii: Metres that the arm moves at most per radian of each joint, of shape (dof,).
        is_free: Whether a path of straight pieces, given by its corners, touches nothing.
    """
    pieces: list[list[Matrix]] = [[]]
    begin = corners[0]
    for i in range(1, len(corners) - 1):
        cut = _cut(corners[i - 1], corners[i], corners[i + 1], radii, is_free)
        enter = corners[i] if cut is None else cut[0]
        pieces[-1].append(interpolated(begin, enter, radii, _SPACING))
        if cut is None:
            pieces.append([])
            begin = corners[i]
        else:
            pieces[-1].append(cut)
            begin = cut[-1]
    pieces[-1].append(interpolated(begin, corners[-1], radii, _SPACING))
    return [np.vstack(piece) for piece in pieces]


def _cut(
    before: Vector,
    corner: Vector,
    after: Vector,
    radii: Vector,
    is_free: Callable[[Matrix], bool],
) -> Matrix | None:
    """The longest free curve from the piece before a corner to the piece after it."""
    arriving, leaving = before - corner, after - corner
    length = min(np.abs(arriving) @ radii, np.abs(leaving) @ radii)
    for share in _CUTS:
        start = corner + arriving * (share * length / (np.abs(arriving) @ radii))
        end = corner + leaving * (share * length / (np.abs(leaving) @ radii))
        curve = corner_curve(start, corner, end)
        if is_free(curve):
            return curve
    return None
