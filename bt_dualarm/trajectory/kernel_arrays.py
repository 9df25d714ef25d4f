"""Arrays of the timing kernels: paths, and profiles of the path parameter over time."""

from __future__ import annotations

import math
from typing import NamedTuple, TypeAlias

import numpy as np
import numpy.typing as npt

from bt_dualarm.core.pose import Matrix, Vector

Pieces: TypeAlias = npt.NDArray[np.float64]
"""Coefficients of cubic polynomials, of shape (m, 4, dof)."""


class PathOnGrid(NamedTuple):
    """A path sampled at n grid points.

    Attributes:
        grid: Path parameters s of the grid points, of shape (n,), increasing.
        slope: dq/ds, of shape (n, dof).
        curvature: d²q/ds², of shape (n, dof).
        most: Squares of the largest ds/dt that the joint velocity limits allow, of shape (n,).
    """

    grid: Vector
    slope: Matrix
    curvature: Matrix
    most: Vector


class Spline(NamedTuple):
    """A cubic spline.

    Attributes:
        knots: Path parameters at which its pieces meet, of shape (m + 1,).
        pieces: Coefficients of each piece in the distance from its first knot, highest degree
            first, of shape (m, 4, dof).
        period: Length of a periodic spline; zero for one that is not periodic.
    """

    knots: Vector
    pieces: Pieces
    period: float

    def __call__(self, at: Vector, order: int = 0) -> Matrix:
        """Values or derivatives, of shape (n, dof); beyond its ends the outer pieces continue.

        Args:
            at: Path parameters, of shape (n,).
            order: Order of the derivative, 0 to 3.
        """
        if self.period:
            at = self.knots[0] + (at - self.knots[0]) % self.period
        piece = np.searchsorted(self.knots[1:-1], at, side="right")
        coefficients = self.pieces[piece]
        step = power = (at - self.knots[piece])[:, None]
        # Lowest degree first, as in SciPy; the zero makes a sum of no negative zeros.
        values: Matrix = 0.0 + coefficients[:, 3 - order] * math.factorial(order)
        for degree in range(order + 1, 4):
            values += coefficients[:, 3 - degree] * power * math.perm(degree, order)
            power = power * step
        return values


class Parabolas(NamedTuple):
    """Path parameter s over time, with constant d²s/dt² between knots.

    Attributes:
        time: Knots, of shape (n,), s, increasing from zero.
        place: s at the knots, of shape (n,).
        rate: ds/dt at the knots, of shape (n,).
        bends: d²s/dt² after each knot, of shape (n - 1,).
        areas: Integral of s over time up to each knot, of shape (n,).
    """

    time: Vector
    place: Vector
    rate: Vector
    bends: Vector
    areas: Vector
