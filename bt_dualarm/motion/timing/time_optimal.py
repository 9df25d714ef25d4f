"""The fastest motion along a path under velocity and acceleration limits.

TOPP-RA (Pham and Pham, A new approach to time-optimal path parameterization based on reachability
analysis, T-RO 2018): a backward pass finds at each place the largest speed from which the end can
still be reached at rest, a forward pass takes the largest acceleration that keeps below it. Where
the limits are of joint velocities and accelerations alone, each step of a pass is a linear program
in two variables whose answer is the least of a few numbers; no solver is needed.
"""

from __future__ import annotations

import numpy as np
import scipy

from bt_dualarm.motion.timing.profile import Profile
from bt_dualarm.pose import Matrix, Vector
from bt_dualarm.world.robots.robot import JointLimits


def grid_of(path: scipy.interpolate.CubicSpline) -> Vector:
    """Places along a path at which its motion is decided, of shape (n,)."""
    return np.linspace(0.0, path.x[-1], int(np.clip(2 * len(path.x), 200, 1500)) + 1)


def fastest_profile(
    path: scipy.interpolate.CubicSpline, limits: JointLimits, share: Vector | None = None
) -> Profile:
    """The fastest motion from rest to rest: a bound for any other.

    Args:
        path: Joint angles in rad over a path parameter that starts at zero.
        limits: Velocity and acceleration to keep; jerk is not looked at.
        share: Share of the acceleration limits that may be used at each place of
            ``grid_of(path)``, of shape (n,), in (0, 1]; all of it if not given.
    """
    grid = grid_of(path)
    slope, curvature = path(grid, 1), path(grid, 2)
    limit = limits.acceleration * (np.ones_like(grid) if share is None else share)[:, None]
    fastest = limits.velocity / np.maximum(np.abs(slope), _STILL)
    steps = 2.0 * np.diff(grid)[:, None]
    a, b = _rows(slope / limit, curvature / limit, steps)
    most = np.minimum((fastest[:-1] ** 2).min(axis=1), _largest(a, b, steps))
    squares = _forward(_backward(a, b, steps, most), a, b, steps)
    return Profile.from_rates(grid, np.sqrt(squares))


_STILL = 1e-12
"""Slope in rad below which a joint does not move: it bounds no speed."""

_SLOWING = 0.1
"""Least share of the square of a speed that is left at the next place, but for the last one: on a
sharp bend the largest speed of a place could else be one from which the next place is reached at
rest, and the arm would stop there."""


def _rows(slope: Matrix, curvature: Matrix, steps: Matrix) -> tuple[Matrix, Matrix]:
    """Coefficients of ``|a u + b x| <= 1``, each of shape (n - 1, 2 dof), with ``a >= 0``.

    x is the square of the speed at a place and u the acceleration from there to the next: between
    the two the limits hold at both ends.

    Args:
        slope: Derivative of the joints by the path parameter, over their limits, of shape (n, dof).
        curvature: Second derivative, likewise.
        steps: Twice the distance to the next place, of shape (n - 1, 1).
    """
    ahead = slope[1:] + steps * curvature[1:]
    a = np.hstack((slope[:-1], ahead))
    b = np.hstack((curvature[:-1], curvature[1:]))
    return np.abs(a), np.where(a < 0.0, -b, b)


def _largest(a: Matrix, b: Matrix, steps: Matrix) -> Vector:
    """The largest x at each place for which there is any u, of shape (n - 1,).

    Every lower bound of u must be below every upper one: ``(-1 - b x) / a`` of each row, and the
    one that leaves too little speed at the next place, below ``(1 - b x) / a`` of each.
    """
    slowing = np.full_like(steps, 1.0 - _SLOWING)
    slowing[-1] = 1.0
    lower_a = np.hstack((a, steps))[:, :, None]
    lower_b = np.hstack((b, slowing))[:, :, None]
    lower_one = np.hstack((np.ones_like(a), np.zeros_like(steps)))[:, :, None]
    slack = lower_one * a[:, None] + lower_a
    rise = b[:, None] * lower_a - lower_b * a[:, None]
    largest: Vector = _bounds(slack, rise).min(axis=(1, 2))
    return largest


def _bounds(slack: Matrix, rise: Matrix) -> Matrix:
    """The largest x with ``rise x <= slack``, infinite where nothing bounds it."""
    bounding = rise > 0.0
    bounds: Matrix = np.divide(slack, rise, out=np.full(slack.shape, np.inf), where=bounding)
    return bounds


def _backward(a: Matrix, b: Matrix, steps: Matrix, most: Vector) -> Vector:
    """The largest x from which the end can be reached at rest, of shape (n,).

    At each place a u must be left that leads to no more than the largest x at the next one: its
    lower bounds are below ``(next - x) / steps``. These are the least of straight lines over the
    next x.
    """
    rise = a - steps * b
    offset = _bounds(np.broadcast_to(steps, rise.shape), rise)
    factor = np.divide(a, rise, out=np.zeros_like(a), where=rise > 0.0)
    reachable = np.zeros(len(most) + 1)
    ahead = 0.0
    last = len(most) - 1
    for i in range(last, -1, -1):
        steepest = ahead / _SLOWING if i < last else np.inf
        ahead = min(float((factor[i] * ahead + offset[i]).min()), most[i], steepest)
        reachable[i] = ahead
    return reachable


def _forward(reachable: Vector, a: Matrix, b: Matrix, steps: Matrix) -> Vector:
    """The x of the fastest motion from rest, of shape (n,): always the largest u."""
    offset = _bounds(np.broadcast_to(steps, a.shape), a)
    factor = 1.0 - np.divide(steps * b, a, out=np.zeros_like(a), where=a > 0.0)
    squares = np.zeros_like(reachable)
    here = 0.0
    for i in range(len(a)):
        here = min(float((factor[i] * here + offset[i]).min()), reachable[i + 1])
        squares[i + 1] = here
    return squares
