"""Rays from one eye, and which of them can meet what lies within given corners."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from bt_dualarm.pose import Matrix, Vector

_NEAR_M = 1e-3


@dataclass(frozen=True, eq=False)
class Fan:
    """Rays from one eye, on a grid.

    Attributes:
        eye: Position of the eye in the world, of shape (3,), in m.
        axes: Camera's x (right), y (up) and z (backward) as columns in the world.
        rays: Unit vectors in these axes, of shape (3, rows, columns).
        spacing: Distance of neighbouring rays one metre ahead.
        centre: Column and row on the grid of the camera's axis.
    """

    eye: Vector
    axes: Matrix
    rays: npt.NDArray[np.float64]
    spacing: float
    centre: tuple[float, float]

    @property
    def whole(self) -> tuple[slice, slice]:
        """All rows and columns."""
        rows, columns = self.rays.shape[1:]
        return slice(0, rows), slice(0, columns)

    def part(self, points: Matrix) -> tuple[slice, slice] | None:
        """Rows and columns that can meet what is spanned by points of shape (n, 3) in ``axes``."""
        x, y = points[:, 0] / self.spacing, points[:, 1] / -self.spacing
        depth = -points[:, 2]
        rows, columns = self.rays.shape[1:]
        if depth.min() < _NEAR_M:
            hidden = depth.max() < _NEAR_M or _beside(x, depth, self.centre[0], columns)
            return None if hidden or _beside(y, depth, self.centre[1], rows) else self.whole
        across = _span(x / depth + self.centre[0], columns)
        along = _span(y / depth + self.centre[1], rows)
        return None if across is None or along is None else (along, across)


def _span(places: Vector, count: int) -> slice | None:
    """Rows or columns from the least to the greatest place, with one to spare."""
    start = max(math.floor(places.min()) - 1, 0)
    stop = min(math.ceil(places.max()) + 1, count)
    return slice(start, stop) if start < stop else None


def _beside(offsets: Vector, depth: Vector, centre: float, count: int) -> bool:
    """Whether all points, some of them behind the eye, lie on the outer side of one border.

    A row or column is ``offset / depth + centre``, which has to lie between -1 and ``count + 1``.
    """
    low, high = offsets + (centre + 1.0) * depth, offsets + (centre - count - 1.0) * depth
    return bool(low.max() < 0.0 or high.min() > 0.0)
