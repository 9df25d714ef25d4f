"""Cubic splines agree with SciPy's."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from bt_dualarm.core.pose import Matrix, Vector
from bt_dualarm.trajectory.cubic_spline import cubic_spline
from bt_dualarm.trajectory.trajectory_kernels import solve_tridiagonal
from tests.plain_kernels import plain


def sampled(count: int, closed: bool, rng: np.random.Generator) -> tuple[Vector, Matrix]:
    """Random knots and points in three dimensions; steps span four orders of magnitude."""
    knots = np.concatenate(((0.0,), np.cumsum(10.0 ** rng.uniform(-3.0, 1.0, count - 1))))
    points = rng.normal(size=(count, 3))
    if closed:
        points[-1] = points[0]
    return knots, points


@pytest.mark.parametrize(
    ("closed", "count"),
    [(False, 2), (False, 3), *((closed, n) for closed in (False, True) for n in (4, 5, 20, 300))],
)
def test_spline_equals_that_of_scipy_bit_for_bit(closed: bool, count: int) -> None:
    """Including derivatives, between the knots and beyond them."""
    for seed in range(20):
        rng = np.random.default_rng(seed)
        knots, points = sampled(count, closed, rng)
        at = np.concatenate((knots, rng.uniform(-1.0, knots[-1] + 1.0, 30)))
        ours = cubic_spline(knots, points, closed=closed)
        theirs = CubicSpline(knots, points, bc_type="periodic" if closed else "not-a-knot")
        for order in range(4):
            assert ours(at, order).tobytes() == theirs(at, order).tobytes()


@pytest.mark.parametrize(
    ("knots", "points"),
    [
        ((0.0, 1.0, 1.0, 2.0), np.zeros((4, 1))),
        ((0.0, 1.0, np.nan, 2.0), np.zeros((4, 1))),
        ((0.0, 1.0, 2.0, np.inf), np.zeros((4, 1))),
        ((0.0, 1.0, 2.0, 3.0), np.full((4, 1), np.nan)),
    ],
)
def test_invalid_knots_and_points_are_rejected(knots: tuple[float, ...], points: Matrix) -> None:
    with pytest.raises(ValueError, match="must increase, and its points must be finite"):
        cubic_spline(np.array(knots), points)


def test_tridiagonal_system_is_solved_with_and_without_pivoting() -> None:
    """Plain Python and compiled code agree bit for bit, and with NumPy."""
    rng = np.random.default_rng(0)
    for scale in (0.1, 10.0):  # with and without a dominant diagonal
        lower, upper = scale * rng.normal(size=(2, 7))
        diagonal = rng.normal(size=8)
        right = rng.normal(size=(8, 2))
        system = np.diag(diagonal) + np.diag(lower, -1) + np.diag(upper, 1)
        found = []
        for solve in (solve_tridiagonal, plain(solve_tridiagonal)):
            solution = right.copy()
            solve(lower.copy(), diagonal.copy(), upper.copy(), solution)
            found.append(solution)
        assert found[0] == pytest.approx(np.linalg.solve(system, right), rel=1e-8)
        assert found[0].tobytes() == found[1].tobytes()
