"""Cubic splines through points, twice continuously differentiable (de Boor 1978).

They equal SciPy's `CubicSpline` to the last bit, except for three knots at distances of exactly 1,
for which SciPy's solver takes another path. Importing ``scipy.interpolate`` takes a quarter of
the time until a run begins, and 38 MB, because it imports most of SciPy.
"""

from __future__ import annotations

import numpy as np

from bt_dualarm.core.pose import Matrix, Vector
from bt_dualarm.trajectory.kernel_arrays import Spline


def cubic_spline(knots: Vector, points: Matrix, *, closed: bool = False) -> Spline:
    """Cubic spline through points.

    Args:
        knots: Path parameters of the points, of shape (n,), increasing.
        points: Points, of shape (n, dof), at least two.
        closed: Whether it is periodic, with the last point, of at least four, equal to the first.
            Otherwise its end conditions are not-a-knot: the first two pieces are one polynomial,
            and so are the last two.

    Raises:
        ValueError: The knots do not increase, or a number is not finite.
    """
    step = np.diff(knots)
    if not (step > 0.0).all() or not np.isfinite(knots[-1]) or not np.isfinite(points).all():
        raise ValueError("the knots of a spline must increase, and its points must be finite")
    slope = np.diff(points, axis=0) / step[:, None]
    derivative = _periodic(step, slope) if closed else _not_a_knot(knots, step, slope)
    # Cubic Hermite interpolation between the knots.
    pieces = np.empty((len(step), 4, points.shape[1]))
    bend = (derivative[:-1] + derivative[1:] - 2.0 * slope) / step[:, None]
    pieces[:, 0] = bend / step[:, None]
    pieces[:, 1] = (slope - derivative[:-1]) / step[:, None] - bend
    pieces[:, 2] = derivative[:-1]
    pieces[:, 3] = points[:-1]
    return Spline(knots, pieces, float(knots[-1] - knots[0]) if closed else 0.0)


def _not_a_knot(knots: Vector, step: Vector, slope: Matrix) -> Matrix:
    """Derivatives at the knots, of shape (n, dof), from the slopes between them."""
    if len(step) == 1:  # a straight line
        return np.vstack((slope, slope))
    wide = step[:, None]
    if len(step) == 2:  # a parabola: both end conditions are the same
        system = np.array(
            ((1.0, 1.0, 0.0), (step[1], 2.0 * (step[0] + step[1]), step[0]), (0.0, 1.0, 1.0))
        )
        middle = 3.0 * (wide[0] * slope[1] + wide[1] * slope[0])
        return np.linalg.solve(system, np.array((2.0 * slope[0], middle, 2.0 * slope[1])))
    first = knots[2] - knots[0]
    last = knots[-1] - knots[-3]
    lower = np.append(step[1:], last)
    diagonal = np.concatenate((step[1:2], 2.0 * (step[:-1] + step[1:]), step[-2:-1]))
    upper = np.insert(step[:-1], 0, first)
    right = np.empty((len(knots), slope.shape[1]))
    right[0] = ((wide[0] + 2.0 * first) * wide[1] * slope[0] + wide[0] ** 2 * slope[1]) / first
    right[1:-1] = 3.0 * (wide[1:] * slope[:-1] + wide[:-1] * slope[1:])
    right[-1] = (wide[-1] ** 2 * slope[-2] + (2.0 * last + wide[-1]) * wide[-2] * slope[-1]) / last

    from bt_dualarm.trajectory.trajectory_kernels import solve_tridiagonal

    solve_tridiagonal(lower, diagonal, upper, right)
    return right


def _periodic(step: Vector, slope: Matrix) -> Matrix:
    """Result of `_not_a_knot` for a periodic spline.

    The system is tridiagonal but for two corners: it is solved without its last row and column,
    once for the right-hand sides and once for that column.
    """
    from bt_dualarm.trajectory.trajectory_kernels import solve_tridiagonal

    before = np.roll(step, 1)
    wide = step[:, None]
    right = 3.0 * (wide * np.roll(slope, 1, axis=0) + before[:, None] * slope)
    diagonal = 2.0 * (before + step)
    count = len(step) - 1
    column = np.zeros((count, 1))
    column[0] = -step[0]
    column[-1] = -step[-3]
    solved = np.hstack((right[:-1], column))
    solve_tridiagonal(step[1:-1].copy(), diagonal[:-1].copy(), before[: count - 1].copy(), solved)
    without, share = solved[:, :-1], solved[:, -1:]
    last = (right[-1] - step[-2] * without[0] - step[-1] * without[-1]) / (
        diagonal[-1] + step[-2] * share[0] + step[-1] * share[-1]
    )
    derivative = without + last * share
    return np.vstack((derivative, last, derivative[:1]))
