"""Cutting a mesh into parts that are nearly convex.

A link that is bent, or thick where its joints are and thin in between, is far smaller than its
convex hull. Planes across the axes of its mesh, along which links are drawn, cut it where its
parts' hulls are smallest together. The mesh need not be closed: a part's hull needs no cap.
"""

from __future__ import annotations

import itertools
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
    whole = _best_cut(triangles)
    parts = [whole]
    while len(parts) < _MOST:
        part = max(parts, key=lambda one: one.saved)
        if part.saved < _WORTH * whole.volume:
            break
        parts.remove(part)
        parts += map(_best_cut, _halves(part.triangles, part.axis, part.offset))
    joined = _joined([part.triangles for part in parts], _WORTH * whole.volume)
    return tuple(one.reshape(-1, 3) for one in joined)


def _joined(parts: list[Matrix], worth: float) -> list[Matrix]:
    """The parts with those together again whose hull adds less than a volume in m³.

    A first cut goes through the middle of a thin piece between two thick ends.
    """
    while len(parts) > 1:
        pairs = itertools.combinations(range(len(parts)), 2)
        added, i, j = min((_added(parts[i], parts[j]), i, j) for i, j in pairs)
        if added >= worth:
            break
        parts = [
            *(one for k, one in enumerate(parts) if k not in (i, j)),
            _both(parts[i], parts[j]),
        ]
    return parts


def _added(first: Matrix, second: Matrix) -> float:
    """Volume in m³ by which the hull of two parts is larger than their own."""
    return _hull_volume(_both(first, second)) - _hull_volume(first) - _hull_volume(second)


def _both(first: Matrix, second: Matrix) -> Matrix:
    return np.concatenate((first, second))


def _best_cut(triangles: Matrix) -> _Part:
    volume = _hull_volume(triangles)
    best = _Part(triangles, volume, 0.0, 0, 0.0)
    low, high = triangles.min(axis=(0, 1)), triangles.max(axis=(0, 1))
    for axis, step in itertools.product(range(3), range(1, _STEPS)):
        offset = float(low[axis] + (high[axis] - low[axis]) * step / _STEPS)
        volumes = [_hull_volume(half) for half in _halves(triangles, axis, offset)]
        saved = volume - sum(volumes)
        if saved > best.saved and min(volumes) > 0.0:  # of a mesh with holes a half may be flat
            best = _Part(triangles, volume, saved, axis, offset)
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


def _hull_volume(triangles: Matrix) -> float:
    """Volume of the convex hull in m³; 0 of what is flat."""
    try:
        return float(scipy.spatial.ConvexHull(triangles.reshape(-1, 3)).volume)
    except (scipy.spatial.QhullError, ValueError):
        return 0.0
