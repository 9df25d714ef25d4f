"""Timing a path of configurations: as fast as the limits allow, without leaving the path.

TOPP-RA (Pham and Pham 2018) gives the fastest motion under velocity and acceleration limits. Its
acceleration jumps; a moving average of the path parameter over time bounds the jerk and keeps every
point on the path. What the average does to velocity and acceleration is then paid for by stretching
time, and of all widths the one with the shortest result is taken.
"""

from __future__ import annotations

import logging
from typing import Any

import numpy as np
from scipy.interpolate import CubicSpline

from bt_dualarm.motion.profile import Profile
from bt_dualarm.motion.trajectory import Trajectory, use_of_limits
from bt_dualarm.pose import Matrix, Vector
from bt_dualarm.world.catalogue import JointLimits

_NOWHERE = 1e-9
"""Joint distance in rad below which two configurations are one."""

_WIDTHS = (14, 7)
"""Numbers of widths of the average that are tried: first of all, then around the best."""

_NODES = 1000
"""Most set-points at which a width is judged."""

_MARGIN = 1.0 + 1e-4
"""Stretched a little more than the excess asks for, as the grid falls on other points then."""


def time_path(
    q_samples: Matrix, limits: JointLimits, dt: float, closed: bool = False
) -> Trajectory:
    """The motion along a path from rest to rest, no set-point beyond the limits.

    Set-points lie on the cubic spline through the samples. A path of no length gives one set-point.

    Args:
        q_samples: Configurations along the path, of shape (n, dof), dense enough that the spline
            through them is the path; repeated ones do not matter.
        limits: Velocity, acceleration and jerk to keep.
        dt: Time between set-points in seconds.
        closed: The path ends where it starts and is smooth there.

    Raises:
        ValueError: The samples are not finite or leave the position limits.
    """
    samples = _distinct(_checked(q_samples, limits))
    if len(samples) < 2:
        return Trajectory.rest(samples[0], dt)
    path = _spline(samples, limits, closed)
    profile = fastest_profile(path, limits)
    width, stretch = _best_width(path, profile, limits, dt)
    while True:
        motion = _sampled(path, profile, width, stretch, dt)
        excess = _excess(motion, limits)
        if excess <= 1.0:
            return motion
        stretch *= excess * _MARGIN


def fastest_profile(path: CubicSpline, limits: JointLimits) -> Profile:
    """The fastest motion under velocity and acceleration limits alone: a bound for any other."""
    grid = np.linspace(0.0, path.x[-1], int(np.clip(2 * len(path.x), 200, 1500)) + 1)
    rates = _toppra_rates(path, limits, grid)
    if rates is None or not np.all(rates[1:-1] > 0.0):
        rates = _slow_rates(grid)
    return Profile.from_rates(grid, rates)


def _toppra_rates(path: CubicSpline, limits: JointLimits, grid: Vector) -> Vector | None:
    """ds/dt over the grid, of shape (n,), or None where TOPP-RA finds nothing."""
    from toppra import constraint  # slow to import, and only paths need it
    from toppra.algorithm import TOPPRA
    from toppra.interpolator import AbstractGeometricPath

    logging.getLogger("toppra").setLevel(logging.CRITICAL)

    class Path(AbstractGeometricPath):  # type: ignore[misc]
        """The spline as TOPP-RA wants it."""

        dof = len(limits.velocity)
        path_interval = path.x[[0, -1]]

        def __call__(self, path_positions: Any, order: int = 0) -> Any:
            return path(path_positions, order)

    def both_ways(limit: Vector) -> Matrix:
        return np.column_stack((-limit, limit))

    problem = TOPPRA(
        [
            constraint.JointVelocityConstraint(both_ways(limits.velocity)),
            constraint.JointAccelerationConstraint(
                both_ways(limits.acceleration),
                constraint.DiscretizationType.Interpolation,
            ),
        ],
        Path(),
        gridpoints=grid,
        solver_wrapper="seidel",
    )
    rates: Vector | None = problem.compute_parameterization(0.0, 0.0)[1]
    return rates


def _slow_rates(grid: Vector) -> Vector:
    """Speeding up over a tenth of the path, slowing down over the last: any path allows it."""
    length = grid[-1]
    rates: Vector = np.sqrt(np.minimum(np.minimum(grid, length - grid), 0.1 * length) * length)
    return rates


def _best_width(
    path: CubicSpline, profile: Profile, limits: JointLimits, dt: float
) -> tuple[float, float]:
    """The width whose motion is the shortest, and the stretch of time that it needs."""
    shortest = profile.duration
    low, high = min(dt, 0.1 * shortest), 2.0 * shortest
    tried: dict[float, float] = {}
    for count in _WIDTHS:
        for width in np.geomspace(low, high, count).tolist():
            tried[width] = _stretch_needed(path, profile, width, limits, dt)
        best = min(tried, key=lambda w: (shortest + w) * tried[w])
        reach = (high / low) ** (1.0 / (count - 1))
        low, high = best / reach, best * reach
    return best, tried[best]


def _stretch_needed(
    path: CubicSpline, profile: Profile, width: float, limits: JointLimits, dt: float
) -> float:
    """By how much time must be stretched for a width's motion to keep the limits."""
    step = max(dt, (profile.duration + width) / _NODES)
    return _excess(_sampled(path, profile, width, 1.0, min(step, width)), limits)


def _excess(motion: Trajectory, limits: JointLimits) -> float:
    """The stretch of time after which a motion just keeps the limits; at most one if it does."""
    use = use_of_limits(motion, limits)
    return float(max(use.velocity, use.acceleration**0.5, use.jerk ** (1.0 / 3.0)))


def _sampled(
    path: CubicSpline, profile: Profile, width: float, stretch: float, dt: float
) -> Trajectory:
    """The averaged profile along the path, slower by ``stretch``, on the grid ``dt``."""
    duration = (profile.duration + width) * stretch
    count = max(int(np.ceil(duration / dt - 1e-9)), 1)
    times = np.minimum(np.arange(count + 1) * dt / stretch, profile.duration + width)
    s, rate, bend = profile.smoothed(times, width)
    rate, bend = rate[:, None] / stretch, bend[:, None] / stretch**2
    rate[[0, -1]] = bend[[0, -1]] = 0.0  # rounding of the average
    q1, q2 = path(s, 1), path(s, 2)
    return Trajectory(dt, path(s), q1 * rate, q1 * bend + q2 * rate**2)


def _checked(q_samples: Matrix, limits: JointLimits) -> Matrix:
    samples = np.atleast_2d(np.asarray(q_samples, dtype=float))
    if not np.isfinite(samples).all():
        raise ValueError("a configuration of the path is not finite")
    if np.any(samples < limits.lower - _NOWHERE) or np.any(samples > limits.upper + _NOWHERE):
        raise ValueError("a configuration of the path is outside the position limits")
    return samples


def _distinct(samples: Matrix) -> Matrix:
    """The samples without those that repeat the one before."""
    kept = [0]
    for i in range(1, len(samples)):
        if np.abs(samples[i] - samples[kept[-1]]).max() > _NOWHERE:
            kept.append(i)
    kept[-1] = len(samples) - 1 if len(kept) > 1 else 0
    return samples[kept]


def _spline(samples: Matrix, limits: JointLimits, closed: bool) -> CubicSpline:
    """The path over its length in joint space, each joint measured by its velocity limit.

    A length that is smooth along the path: one that jumps from joint to joint would give the
    spline kinks, which cost jerk.
    """
    steps = np.linalg.norm(np.diff(samples, axis=0) / limits.velocity, axis=1)
    s = np.concatenate(((0.0,), np.cumsum(steps)))
    if closed and len(samples) > 3:
        samples = samples.copy()
        samples[-1] = samples[0]
        return CubicSpline(s, samples, bc_type="periodic")
    return CubicSpline(s, samples)
