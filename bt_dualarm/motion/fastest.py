"""The fastest motion along a path under velocity and acceleration limits (TOPP-RA)."""

from __future__ import annotations

import contextlib
import functools
import logging
import sys
from collections.abc import Iterator
from types import ModuleType
from typing import Any

import numpy as np
import scipy

from bt_dualarm.motion.profile import Profile
from bt_dualarm.pose import Matrix, Vector
from bt_dualarm.world.catalogue import JointLimits


def grid_of(path: scipy.interpolate.CubicSpline) -> Vector:
    """Places along a path at which its motion is decided, of shape (n,)."""
    return np.linspace(0.0, path.x[-1], int(np.clip(2 * len(path.x), 200, 1500)) + 1)


def fastest_profile(
    path: scipy.interpolate.CubicSpline, limits: JointLimits, share: Vector | None = None
) -> Profile:
    """The fastest motion from rest to rest (Pham and Pham 2018): a bound for any other.

    Args:
        path: Joint angles over a path parameter that starts at zero.
        limits: Velocity and acceleration to keep; jerk is not looked at.
        share: Of the acceleration limits that may be used at each place of ``grid_of(path)``, of
            shape (n,), in (0, 1]; all of it if not given.

    Returns:
        The motion; a slow one, to be stretched, where TOPP-RA finds none.
    """
    grid = grid_of(path)
    rates = _toppra_rates(path, limits, grid, np.ones_like(grid) if share is None else share)
    if rates is None or not np.all(rates[1:-1] > 0.0):
        rates = _slow_rates(grid)
    return Profile.from_rates(grid, rates)


def _toppra_rates(
    path: scipy.interpolate.CubicSpline, limits: JointLimits, grid: Vector, share: Vector
) -> Vector | None:
    """ds/dt over the grid, of shape (n,), or None where TOPP-RA finds nothing."""
    toppra, geometry, weighted = _toppra()

    class Path(geometry):  # type: ignore[misc, valid-type]
        """The spline as TOPP-RA wants it."""

        dof = len(limits.velocity)
        path_interval = path.x[[0, -1]]

        def __call__(self, path_positions: Any, order: int = 0) -> Any:
            return path(path_positions, order)

    constraints = [
        toppra.constraint.JointVelocityConstraint(_both_ways(limits.velocity)),
        weighted(_both_ways(limits.acceleration), share),
    ]
    problem = toppra.algorithm.TOPPRA(constraints, Path(), gridpoints=grid, solver_wrapper="seidel")
    rates: Vector | None = problem.compute_parameterization(0.0, 0.0)[1]
    return rates


def _both_ways(limit: Vector) -> Matrix:
    return np.column_stack((-limit, limit))


def _slow_rates(grid: Vector) -> Vector:
    """Speeding up over a tenth of the path, slowing down over the last: any path allows it."""
    length = grid[-1]
    rates: Vector = np.sqrt(np.minimum(np.minimum(grid, length - grid), 0.1 * length) * length)
    return rates


@functools.cache
def _toppra() -> tuple[Any, Any, Any]:
    """TOPP-RA, its base class of paths, and the acceleration constraint with a share.

    Imported when the first path is timed: not every run has one.
    """
    with _without_plots():
        import toppra
        import toppra.algorithm
        import toppra.constraint
        from toppra.interpolator import AbstractGeometricPath

    logging.getLogger("toppra").setLevel(logging.CRITICAL)

    class Weighted(toppra.constraint.JointAccelerationConstraint):  # type: ignore[misc]
        """|q' s'' + q'' s'²| <= share * limit, as a path whose derivatives are over the share."""

        def __init__(self, limit: Matrix, share: Vector) -> None:
            super().__init__(limit, toppra.constraint.DiscretizationType.Interpolation)
            # Each row holds the constraint at a grid point, then at the next one.
            ahead = np.append(share[1:], share[-1])
            self._over = 1.0 / np.repeat(np.column_stack((share, ahead)), len(limit), axis=1)

        def compute_constraint_params(self, path: Any, gridpoints: Vector, *_: Any) -> Any:
            a, b, *others = super().compute_constraint_params(path, gridpoints)
            return (a * self._over, b * self._over, *others)

    return toppra, AbstractGeometricPath, Weighted


@contextlib.contextmanager
def _without_plots() -> Iterator[None]:
    """Keep TOPP-RA from importing pyplot, which nobody asks it for: half a second of a start."""
    names = [name for name in ("matplotlib", "matplotlib.pyplot") if name not in sys.modules]
    sys.modules.update((name, ModuleType(name)) for name in names)
    try:
        yield
    finally:
        for name in names:
            del sys.modules[name]
