"""Cutting a mesh into parts that are nearly convex.

A link that is bent, or thick where its joints are and thin in between, is far smaller than its
convex hull. Planes across the axes of its mesh, along which links are drawn, cut it where its
parts' hulls are smallest together. The mesh need not be closed: a part's hull needs no cap.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy

from bt_dualarm.pose import Matrix

_STEPS = 12
"""Number of equal slices along each axis, between which a part may be cut."""

_WORTH = 0.03
"""Share of the whole hull's volume that a cut must save: with less, the hollow inside of a shell
would be cut free."""

_MOST = 8
"""Number of parts at most."""

_ROUNDING = 1e-6
"""Share by which sums of volumes may be off."""


@dataclass(frozen=True, eq=False)
class _Part:
    """A part of a mesh, and the best that one more cut could do.

    Attributes:
        triangles: Corners of its triangles, of shape (n, 3, 3), m.
        volume: Volume of its convex hull in m³.
        saved: Volume in m³ that is saved by the best cut.
        axis: Axis across which that cut goes: 0, 1 or 2.
        offset: Place of that cut along the axis, m.
    """

    triangles: Matrix
    volume: float
    saved: float
    axis: int
    offset: float


def convex_parts(triangles: Matrix) -> tuple[Matrix, ...]:
    """Points of the parts, each of shape (m, 3), m, whose convex hulls hold the whole mesh.

    Args:
        triangles: Corners of the mesh's triangles, of shape (n, 3, 3), m.
    """
    whole = _best_cut(triangles, 0.0)
    parts, worth = [whole], _WORTH * whole.volume
    while len(parts) < _MOST:
        part = max(parts, key=lambda one: one.saved)
        if part.saved < worth:
            break
        parts.remove(part)
        halves = _halves(part.triangles, part.axis, part.offset)
        parts += [_best_cut(half, worth) for half in halves]
    joined = _joined([_Piece.of(part.triangles) for part in parts], worth)
    return tuple(one.triangles.reshape(-1, 3) for one in joined)


@dataclass(frozen=True, eq=False)
class _Piece:
    """One part or several together.

    Attributes:
        triangles: Corners of its triangles, of shape (n, 3, 3), m.
        corners: Points that have the same convex hull, of shape (m, 3), m.
        volume: Volume of that in m³.
    """

    triangles: Matrix
    corners: Matrix
    volume: float

    @classmethod
    def of(cls, triangles: Matrix) -> _Piece:
        """The piece of these triangles."""
        return cls(triangles, *_hull(triangles))

    def added_by(self, other: _Piece) -> float:
        """Volume in m³ by which the hull of both is larger than their own."""
        both = np.concatenate((self.corners, other.corners))
        return _hull(both)[1] - self.volume - other.volume


def _joined(pieces: list[_Piece], worth: float) -> list[_Piece]:
    """The pieces with those together again whose hull adds less than a volume in m³.

    A first cut goes through the middle of a thin piece between two thick ends.
    """
    while len(pieces) > 1:
        pairs = itertools.combinations(range(len(pieces)), 2)
        added, i, j = min((pieces[i].added_by(pieces[j]), i, j) for i, j in pairs)
        if added >= worth:
            break
        both = _Piece.of(np.concatenate((pieces[i].triangles, pieces[j].triangles)))
        pieces = [*(one for k, one in enumerate(pieces) if k not in (i, j)), both]
    return pieces


def _best_cut(triangles: Matrix, worth: float) -> _Part:
    """A part, and its best cut if that saves as much as a volume in m³."""
    volume = _hull(triangles)[1]
    best = _Part(triangles, volume, 0.0, 0, 0.0)
    low, high = triangles.min(axis=(0, 1)), triangles.max(axis=(0, 1))
    for axis in range(3):
        offsets = [
            float(low[axis] + (high[axis] - low[axis]) * step / _STEPS) for step in range(1, _STEPS)
        ]
        slices = _slices(triangles, axis, offsets)
        saved, number = _most_saved(slices, volume, max(best.saved, worth))
        if saved > best.saved:
            best = _Part(triangles, volume, saved, axis, offsets[number])
    return best


def _slices(triangles: Matrix, axis: int, offsets: Sequence[float]) -> list[tuple[Matrix, float]]:
    """What lies between planes across an axis, at rising offsets: as `_hull` has it.

    The corners of a slice's own hull do: all else is inside whatever hull holds the slice.
    """
    slices, rest = [], triangles
    for offset in offsets:
        below, rest = _halves(rest, axis, offset)
        slices.append(_hull(below))
    return [*slices, _hull(rest)]


def _most_saved(
    slices: Sequence[tuple[Matrix, float]], volume: float, least: float
) -> tuple[float, int]:
    """What the best cut between two slices saves, in m³, and its number; 0 if it is too little.

    The hull of several slices is no smaller than theirs together: most cuts are known by that to
    save too little before their hulls are made.

    Args:
        slices: Corners and volume of each slice.
        volume: Volume of the hull of all of them, m³.
        least: Volume in m³ that it must save.
    """
    least *= 1.0 - _ROUNDING
    above = np.cumsum([size for _, size in slices[::-1]])[::-1]
    if volume - above[0] < least:
        return 0.0, 0
    corners, lower = slices[0][0], [slices[0][1]]
    for one, _ in slices[1:-1]:
        corners, size = _hull(np.concatenate((corners, one)))
        lower.append(size)
    best = 0.0, 0
    for number in np.argsort(np.add(lower, above[1:]), kind="stable").tolist():
        if volume - lower[number] - above[number + 1] < max(least, best[0] * (1.0 - _ROUNDING)):
            break
        upper = _hull(np.concatenate([one for one, _ in slices[number + 1 :]]))[1]
        saved = volume - lower[number] - upper
        if min(lower[number], upper) > 0.0:  # of a mesh with holes a half may be flat
            best = max(best, (saved, number), key=lambda one: (one[0], -one[1]))
    return best


def _halves(triangles: Matrix, axis: int, offset: float) -> tuple[Matrix, Matrix]:
    """The triangles below a plane across an axis, and those above it, of shape (m, 3, 3) each."""
    below = triangles[:, :, axis] <= offset
    count = below.sum(axis=1)
    crossing = (count == 1) | (count == 2)
    # Of a triangle that crosses the plane one corner is alone on its side: it comes first.
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
    """Where lines from points to points, of shape (n, 3) each, meet a plane across an axis."""
    share = (offset - start[:, axis]) / (end[:, axis] - start[:, axis])
    points: Matrix = start + share[:, None] * (end - start)
    return points


def _hull(points: Matrix) -> tuple[Matrix, float]:
    """Corners, of shape (m, 3), of the hull of points, of shape (…, 3), and its volume in m³.

    Of what is flat all points, and a volume of 0.
    """
    points = points.reshape(-1, 3)
    try:
        hull = scipy.spatial.ConvexHull(points)
    except (scipy.spatial.QhullError, ValueError):
        return np.unique(points, axis=0), 0.0
    return points[hull.vertices], float(hull.volume)
