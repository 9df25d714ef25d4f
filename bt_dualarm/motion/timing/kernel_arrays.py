"""What the kernels of timing read: paths, and motions along them."""

from __future__ import annotations

from typing import NamedTuple, TypeAlias

import numpy as np
import numpy.typing as npt

from bt_dualarm.pose import Matrix, Vector

Pieces: TypeAlias = npt.NDArray[np.float64]
"""Coefficients of cubics, of shape (m, 4, dof)."""


class PathOnGrid(NamedTuple):
    """A path at n places.

    Attributes:
        grid: The places, of shape (n,), rising.
        slope: Derivatives of the joints' angles by the place, of shape (n, dof).
        curvature: Second derivatives, of shape (n, dof).
        most: Squares of the largest rates that the joints' velocities allow, of shape (n,).
    """

    grid: Vector
    slope: Matrix
    curvature: Matrix
    most: Vector


class Spline(NamedTuple):
    """A cubic spline.

    Attributes:
        knots: Places at which its pieces meet, of shape (m + 1,).
        pieces: Coefficients of each piece over the distance from its first knot, that of the cube
            first, of shape (m, 4, dof).
        period: Length after which it comes again, zero for one that does not.
    """

    knots: Vector
    pieces: Pieces
    period: float


class Parabolas(NamedTuple):
    """How far along a path, over time, of constant acceleration between knots.

    Attributes:
        time: Knots, of shape (n,), s, rising from zero.
        place: Place at the knots, of shape (n,).
        rate: Its derivative at the knots, of shape (n,).
        bends: Its second derivative after each knot, of shape (n - 1,).
        areas: Integral of the place until each knot, of shape (n,).
    """

    time: Vector
    place: Vector
    rate: Vector
    bends: Vector
    areas: Vector
