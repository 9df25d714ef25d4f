"""Timing a path of configurations: as fast as the limits allow, without leaving the path.

TOPP-RA gives the fastest motion under velocity and acceleration limits. Its acceleration jumps; a
moving average of the path parameter over time bounds the jerk and keeps every point on the path.
What the average does to velocity and acceleration is then paid for by stretching time, and of all
widths the one with the shortest result is taken.
"""

from __future__ import annotations

import itertools
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
import scipy

from bt_dualarm.motion.timing.jerk_limited import StretchedMotion, shortest_motion, stretch_of
from bt_dualarm.motion.timing.law import Law
from bt_dualarm.motion.timing.time_optimal import TimeOptimal
from bt_dualarm.motion.timing.trajectory import LONG, Trajectory, joined
from bt_dualarm.pose import Matrix
from bt_dualarm.world.robots.robot import JointLimits

_NOWHERE = 1e-9
"""Joint distance in rad below which two configurations are one."""

_MARGIN = 1.0 + 1e-4
"""Stretched a little more than is needed, as the grid falls on other points then."""

_LONG_MARGIN = 1.0 + 1e-3
"""Stretch of a long motion, of which not every set-point is judged."""


class TimedPath(NamedTuple):
    """A motion along a path.

    Attributes:
        motion: Set-points from rest to rest.
        shortest_s: Seconds that no motion along the path can go below, by TOPP-RA: jerk aside.
    """

    motion: Trajectory
    shortest_s: float


def time_path(
    q_samples: Matrix, limits: JointLimits, dt: float, closed: bool = False
) -> Trajectory:
    """The motion of `timed_path` alone."""
    return timed_path(q_samples, limits, dt, closed).motion


def timed_path(
    q_samples: Matrix, limits: JointLimits, dt: float, closed: bool = False
) -> TimedPath:
    """The motion along a path from rest to rest, no set-point beyond the limits.

    Set-points lie on the cubic spline through the samples. Where the path turns back, or by more
    than a right angle from one sample to the next, the arm stops. A path of no length gives one
    set-point.

    Args:
        q_samples: Configurations along the path, of shape (n, dof), dense enough that the spline
            through them is the path; repeated ones do not matter.
        limits: Velocity, acceleration and jerk to keep.
        dt: Time between set-points in seconds.
        closed: Whether the path ends where it starts and is smooth there.

    Raises:
        ValueError: The samples are not finite or leave the position limits.
    """
    samples = _distinct(_checked(q_samples, limits))
    optimal = [TimeOptimal(path, limits) for path in _pieces(samples, limits, closed)]
    pieces = [_timed(one, limits, dt) for one in optimal]
    motion = joined(dt, (Trajectory.rest(samples[0], dt), *pieces))
    return TimedPath(motion, sum(one.fastest.duration for one in optimal))


def _pieces(
    samples: Matrix, limits: JointLimits, closed: bool
) -> list[scipy.interpolate.CubicSpline]:
    """The path from stop to stop; none where it has no length."""
    ends = [0, *_reversals(samples, limits), len(samples) - 1]
    closed = closed and len(ends) == 2
    return [
        spline_through(samples[first : last + 1], limits, closed)
        for first, last in itertools.pairwise(ends)
        if last > first
    ]


def _timed(optimal: TimeOptimal, limits: JointLimits, dt: float) -> Law:
    average, stretch = shortest_motion(optimal, limits, dt)
    motion = StretchedMotion(average, dt, stretch)
    if len(motion) > LONG:
        motion = StretchedMotion(average, dt, stretch * _LONG_MARGIN)
    while True:
        excess = stretch_of(motion, limits)
        if excess <= 1.0:
            return motion
        motion = StretchedMotion(average, dt, motion.stretch * (excess * _MARGIN))


def _reversals(samples: Matrix, limits: JointLimits) -> list[int]:
    """Samples at which the direction in joint space changes by more than a right angle."""
    steps = np.diff(samples, axis=0) / limits.velocity
    back = (steps[1:] * steps[:-1]).sum(axis=1) < 0.0
    return [int(i) + 1 for i in np.flatnonzero(back)]


def _checked(q_samples: Matrix, limits: JointLimits) -> Matrix:
    samples = np.atleast_2d(np.asarray(q_samples, dtype=float))
    if not np.isfinite(samples).all():
        raise ValueError("a configuration of the path is not finite")
    if np.any(samples < limits.lower - _NOWHERE) or np.any(samples > limits.upper + _NOWHERE):
        raise ValueError("a configuration of the path is outside the position limits")
    return samples


def _distinct(samples: Matrix) -> Matrix:
    """The samples without those that repeat the one before."""
    moves: npt.NDArray[np.bool_] = np.any(np.abs(np.diff(samples, axis=0)) > _NOWHERE, axis=1)
    if not moves[-1:].all() or not (moves[1:] | moves[:-1]).all():
        return _one_by_one(samples)
    distinct: Matrix = samples[np.insert(moves, 0, True)]
    return distinct


def _one_by_one(samples: Matrix) -> Matrix:
    """As `_distinct`, where several follow that are hardly apart, or where they do at the end."""
    kept = [0]
    for i in range(1, len(samples)):
        if np.abs(samples[i] - samples[kept[-1]]).max() > _NOWHERE:
            kept.append(i)
    kept[-1] = len(samples) - 1 if len(kept) > 1 else 0
    return samples[kept]


def spline_through(
    samples: Matrix, limits: JointLimits, closed: bool
) -> scipy.interpolate.CubicSpline:
    """The path over its length in joint space, each joint measured by its velocity limit.

    A length that is smooth along the path: one that jumps from joint to joint would give the
    spline kinks, which cost jerk.
    """
    steps = np.linalg.norm(np.diff(samples, axis=0) / limits.velocity, axis=1)
    s = np.concatenate(((0.0,), np.cumsum(steps)))
    if closed and len(samples) > 3:
        samples = samples.copy()
        samples[-1] = samples[0]
        return scipy.interpolate.CubicSpline(s, samples, bc_type="periodic")
    return scipy.interpolate.CubicSpline(s, samples)


def time_something() -> None:
    """Have all kernels of timing compiled."""
    far = np.full(2, np.inf)
    limits = JointLimits(-far, far, *np.ones((4, 2)))
    time_path(np.array(((0.0, 0.0), (0.5, 0.2), (1.0, 1.0))), limits, dt=0.1)
