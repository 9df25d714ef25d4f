"""A cubic spline through points: SciPy's, without what its import takes: 0.12 s at every start."""

from __future__ import annotations

from typing import TypeAlias

import numpy as np
import numpy.typing as npt

from bt_dualarm.pose import Matrix, Vector

Pieces: TypeAlias = npt.NDArray[np.float64]
"""Coefficients of cubics over the distance from each one's first knot: of shape (m, 4, k)."""


class CubicSpline:
    """A cubic from each knot to the next, twice differentiable (de Boor, Guide to Splines, 1978).

    At its ends it goes on as the same cubic over two pieces ("not a knot"), or, of a closed curve,
    as smoothly as everywhere else. Through two points it is straight, through three a parabola.

    Args:
        knots: Places of the points, of shape (n,), rising, two at least.
        points: The points, of shape (n, k).
        periodic: Whether it closes; the last point is then the first again.

    Attributes:
        knots: As given.
        pieces: Its cubics, the coefficient of the cube first, of shape (n - 1, 4, k).
        period: Length after which it comes again, zero for one that does not.

    Raises:
        ValueError: The knots do not rise, or are not as many as the points; or it closes with
            points that differ.
    """

    def __init__(self, knots: Vector, points: Matrix, *, periodic: bool = False) -> None:
        steps = np.diff(knots)
        if not (len(knots) == len(points) > 1 and (steps > 0.0).all()):
            raise ValueError("a spline needs knots that rise, two or more, and as many points")
        if periodic and not np.allclose(points[0], points[-1], rtol=1e-15, atol=1e-15):
            raise ValueError("the last point of a closed spline is not the first")
        self.knots = np.ascontiguousarray(knots, dtype=float)
        self.period = float(knots[-1]) if periodic else 0.0
        h = steps[:, None]
        slopes = np.diff(points, axis=0) / h
        at = _closed(steps, slopes) if periodic else _open(self.knots, steps, slopes)
        bend = (at[:-1] + at[1:] - 2.0 * slopes) / h
        cubes, squares = bend / h, (slopes - at[:-1]) / h - bend
        self.pieces: Pieces = np.stack((cubes, squares, at[:-1], points[:-1]), axis=1)

    def __call__(self, places: Vector, order: int = 0) -> Matrix:
        """Points, or their first or second derivatives by the place.

        Beyond its ends the first and the last cubic go on.

        Args:
            places: Places, of shape (n,).
            order: Order of the derivative: 0 for the points, 1 or 2.

        Returns:
            An array of shape (n, k).
        """
        if self.period:
            first = self.knots[0]
            places = first + (places - first) % (self.knots[-1] - first)
        piece = np.searchsorted(self.knots[1:-1], places, side="right")
        x = (places - self.knots[piece])[:, None]
        cube, square, line, point = self.pieces[piece].swapaxes(0, 1)
        if order == 0:
            at: Matrix = point + line * x + square * (x * x) + cube * (x * x * x)
        elif order == 1:
            at = line + square * x * 2.0 + cube * (x * x) * 3.0
        else:
            at = square * 2.0 + cube * x * 6.0
        return at


def _open(knots: Vector, steps: Vector, slopes: Matrix) -> Matrix:
    """Derivatives at the knots, of shape (n, k), of a spline with two ends.

    Args:
        knots: Places of the points, of shape (n,).
        steps: Distances from knot to knot, of shape (n - 1,).
        slopes: Slopes of the straight lines between the points, of shape (n - 1, k).
    """
    if len(steps) == 1:
        return np.concatenate((slopes, slopes))
    if len(steps) == 2:
        a, b = steps
        through = np.array(((1.0, 1.0, 0.0), (b, 2.0 * (a + b), a), (0.0, 1.0, 1.0)))
        middle = 3.0 * (a * slopes[1] + b * slopes[0])
        return np.linalg.solve(through, np.array((2.0 * slopes[0], middle, 2.0 * slopes[1])))
    lower, diagonal, upper, right = _inner(steps, slopes)
    (a, b), (y, z) = steps[:2], steps[-2:]
    first, last = knots[2] - knots[0], knots[-1] - knots[-3]
    diagonal[0], upper[0] = b, first
    right[0] = ((a + 2.0 * first) * b * slopes[0] + a**2 * slopes[1]) / first
    diagonal[-1], lower[-1] = y, last
    right[-1] = (z**2 * slopes[-2] + (2.0 * last + z) * y * slopes[-1]) / last
    return _solved(lower, diagonal, upper, right)


def _inner(steps: Vector, slopes: Matrix) -> tuple[Vector, Vector, Vector, Matrix]:
    """Three diagonals and the right hand side: second derivatives meet at all inner knots."""
    count = len(steps) + 1
    lower, diagonal, upper = np.zeros(count - 1), np.zeros(count), np.zeros(count - 1)
    diagonal[1:-1] = 2.0 * (steps[:-1] + steps[1:])
    lower[:-1], upper[1:] = steps[1:], steps[:-1]
    right = np.zeros((count, slopes.shape[1]))
    h = steps[:, None]
    right[1:-1] = 3.0 * (h[1:] * slopes[:-1] + h[:-1] * slopes[1:])
    return lower, diagonal, upper, right


def _closed(steps: Vector, slopes: Matrix) -> Matrix:
    """Derivatives at the knots, of shape (n, k), of a closed spline.

    The system has two corners besides its three diagonals. The last unknown is taken out, and
    solved for with a second right hand side.
    """
    h = steps[:, None]
    if len(steps) < 3:
        mean = (slopes / h).sum(axis=0) / (1.0 / h).sum(axis=0)
        return np.tile(mean, (len(steps) + 1, 1))
    lower, diagonal, upper, right = _inner(steps, slopes)
    diagonal[0], upper[0] = 2.0 * (steps[-1] + steps[0]), steps[-1]
    right[0] = 3.0 * (h[0] * slopes[-1] + h[-1] * slopes[0])
    last = 3.0 * (h[-1] * slopes[-2] + h[-2] * slopes[-1])
    corners = np.zeros_like(right[:-2])
    corners[0], corners[-1] = -steps[0], -steps[-3]
    both = _solved(lower[:-2], diagonal[:-2], upper[:-2], np.hstack((right[:-2], corners)))
    one, two = np.hsplit(both, 2)
    found, (y, z) = np.empty_like(right), steps[-2:]
    own = 2.0 * (z + y) + y * two[0] + z * two[-1]
    found[-2] = (last - y * one[0] - z * one[-1]) / own
    found[:-2] = one + found[-2] * two
    found[-1] = found[0]
    return found


def _solved(lower: Vector, diagonal: Vector, upper: Vector, right: Matrix) -> Matrix:
    from bt_dualarm.motion.splines.spline_kernels import solve

    solve(lower, diagonal, upper, right)
    return right
