"""The fastest motion along a path agrees with closed forms and with the TOPP-RA package."""

from __future__ import annotations

import logging
from typing import TYPE_CHECKING

import numpy as np
import pytest
import scipy.ndimage
import toppra
import toppra.algorithm
import toppra.constraint

from bt_dualarm.core.pose import Matrix, Vector
from bt_dualarm.robots.robot import JointLimits
from bt_dualarm.robots.robot_description import load_robot
from bt_dualarm.trajectory.kernel_arrays import PathOnGrid, Spline
from bt_dualarm.trajectory.path_timing import (
    Profile,
    TimeOptimal,
    largest_within,
    spline_through,
)
from bt_dualarm.trajectory.trajectory_kernels import squares_of_rates
from tests.sim.worlds import WIDE

if TYPE_CHECKING:
    from collections.abc import Callable

LIMITS = {name: load_robot(name).limits for name in WIDE}


def corners(limits: JointLimits, rng: np.random.Generator) -> Matrix:
    """Distant configurations with sharp corners: the acceleration alternates all the time."""
    lower = np.maximum(limits.lower, -3.0)
    upper = np.minimum(limits.upper, 3.0)
    return rng.uniform(lower, upper, (12, len(lower)))


def wandering(limits: JointLimits, rng: np.random.Generator) -> Matrix:
    """Short steps in any direction."""
    return np.cumsum(rng.normal(0.0, 0.02, (60, len(limits.lower))), axis=0)


def waves(limits: JointLimits, rng: np.random.Generator) -> Matrix:
    """Smooth paths with joints that reverse, and one that does not move."""
    dof = len(limits.lower)
    t = np.linspace(0.0, 2.0 * np.pi, 40)[:, None]
    path: Matrix = 0.3 * np.sin(t * rng.integers(1, 4, dof) + rng.uniform(0.0, 6.0, dof))
    path[:, rng.integers(dof)] = 0.1
    return path


def squared_rates_of_toppra(path: Spline, limits: JointLimits, grid: Vector) -> Vector:
    """(ds/dt)² over the grid, from the TOPP-RA package, of shape (n,)."""
    logging.getLogger("toppra").setLevel(logging.CRITICAL)
    geometry = toppra.SplineInterpolator(path.knots, path(path.knots), bc_type="not-a-knot")
    constraints = [
        toppra.constraint.JointVelocityConstraint(np.stack((-limits.velocity, limits.velocity), 1)),
        toppra.constraint.JointAccelerationConstraint(
            np.stack((-limits.acceleration, limits.acceleration), 1)
        ),
    ]
    problem = toppra.algorithm.TOPPRA(
        constraints, geometry, gridpoints=grid, solver_wrapper="seidel"
    )
    rates: Vector = problem.compute_parameterization(0.0, 0.0)[1]
    return rates**2


@pytest.mark.parametrize("draw", [corners, wandering, waves])
@pytest.mark.parametrize("arm", sorted(LIMITS))
def test_duration_agrees_with_the_toppra_package(
    arm: str, draw: Callable[[JointLimits, np.random.Generator], Matrix]
) -> None:
    """The package solves its linear programs to about 1e-6, which adds up along a path."""
    limits = LIMITS[arm]
    for seed in range(4):
        path = spline_through(draw(limits, np.random.default_rng(seed)), limits, closed=False)
        profile = TimeOptimal(path, limits).fastest
        squares = squared_rates_of_toppra(path, limits, profile.place)
        theirs = Profile.from_rates(profile.place, np.sqrt(squares))
        assert abs(profile.duration / theirs.duration - 1.0) < 1e-5


def test_refined_grids_confirm_ours_where_toppra_almost_stops() -> None:
    """With few grid points in a bend, the package may choose a speed there that leads to rest."""
    limits = LIMITS["xarm7"]
    path = spline_through(wandering(limits, np.random.default_rng(1)), limits, closed=False)
    ours, theirs = durations(path, limits, 200)
    finer, theirs_finer = durations(path, limits, 400)
    finest, theirs_finest = durations(path, limits, 1600)
    assert 1.005 * ours < theirs
    assert finest < finer < ours
    assert (theirs_finer, theirs_finest) == pytest.approx((finer, finest), rel=1e-5)


def durations(path: Spline, limits: JointLimits, steps: int) -> tuple[float, float]:
    """Durations of the fastest motion on a grid with `steps` steps, ours and theirs, s."""
    grid = np.linspace(0.0, path.knots[-1], steps + 1)
    slope = path(grid, 1)
    most = (limits.velocity / np.abs(slope)).min(axis=1) ** 2
    on_grid = PathOnGrid(grid, slope, path(grid, 2), most)
    ours = squares_of_rates(on_grid, limits.acceleration, np.ones_like(grid))
    theirs = squared_rates_of_toppra(path, limits, grid)
    first, second = (Profile.from_rates(grid, np.sqrt(one)).duration for one in (ours, theirs))
    return first, second


@pytest.mark.parametrize("draw", [corners, wandering, waves])
@pytest.mark.parametrize("arm", sorted(LIMITS))
def test_limits_hold_everywhere_and_one_is_always_reached(
    arm: str, draw: Callable[[JointLimits, np.random.Generator], Matrix]
) -> None:
    """Even with reduced acceleration: the fastest motion is always at some limit.

    The acceleration is constant over a step: the limits hold at both of its ends.
    """
    limits = LIMITS[arm]
    rng = np.random.default_rng(7)
    path = spline_through(draw(limits, rng), limits, closed=False)
    fastest = TimeOptimal(path, limits)
    grid = fastest.grid
    scale = scipy.ndimage.gaussian_filter1d(rng.uniform(0.05, 1.0, len(grid)), 5.0)
    profile = fastest.profile(scale)
    slope = path(grid, 1)
    curvature = path(grid, 2)
    squares = profile.rate**2
    change = np.diff(squares)[:, None] / (2.0 * np.diff(grid)[:, None])
    allowed = limits.acceleration * scale[:, None]
    velocity = (np.abs(slope) * profile.rate[:, None] / limits.velocity).max(axis=1)
    use = [
        np.abs(slope[end] * change + curvature[end] * squares[end, None]) / allowed[end]
        for end in (slice(None, -1), slice(1, None))
    ]
    acceleration = np.maximum(*use).max(axis=1)
    assert velocity.max() <= 1.0 + 1e-9
    assert acceleration.max() <= 1.0 + 1e-6
    used = np.maximum(velocity[1:], acceleration)
    # Where a step ends at the largest allowed speed, the next one is at that limit.
    assert np.maximum(used[1:], used[:-1]).min() > 1.0 - 1e-6


@pytest.mark.parametrize("length", [0.01, 0.3, 2.0])
@pytest.mark.parametrize("arm", sorted(LIMITS))
def test_straight_line_takes_as_long_as_a_trapezoidal_profile(arm: str, length: float) -> None:
    """Acceleration, a phase at the velocity limit if that is reached, and deceleration."""
    limits = LIMITS[arm]
    span = length * np.linspace(0.2, 1.0, len(limits.lower))
    line = spline_through(np.linspace(0.0, 1.0, 30)[:, None] * span, limits, closed=False)
    velocity = (limits.velocity / span).min()
    acceleration = (limits.acceleration / span).min()
    shortest = 2.0 / np.sqrt(acceleration)
    if acceleration > velocity**2:
        shortest = 1.0 / velocity + velocity / acceleration
    assert TimeOptimal(line, limits).fastest.duration == pytest.approx(shortest, rel=1e-3)


@pytest.mark.parametrize("reach", [1, 2, 3, 4, 7, 40])
def test_largest_within_agrees_with_scipys_maximum_filter(reach: int) -> None:
    """Including windows that extend beyond one end or both."""
    for count in (1, 2, 9, 33):
        values = np.random.default_rng(count).normal(size=count)
        expected = scipy.ndimage.maximum_filter1d(values, 2 * reach + 1)
        assert np.array_equal(largest_within(values, reach), expected)
