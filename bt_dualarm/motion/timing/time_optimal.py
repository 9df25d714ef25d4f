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
    most = _largest(a, b, steps, (fastest[:-1] ** 2).min(axis=1))
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


def _largest(a: Matrix, b: Matrix, steps: Matrix, most: Vector) -> Vector:
    """The largest x up to ``most`` at each place for which there is any u, of shape (n - 1,).

    The least upper bound of u, ``(1 - b x) / a``, falls below the greatest lower one, ``(-1 - b x)
    / a`` or the one that leaves too little speed at the next place. Their distance is concave in x:
    from the right, the two lines that bound u at an x meet at the next x (Newton), and after a few
    times at the last for which the one is not below the other.
    """
    slowing = np.full_like(steps, 1.0 - _SLOWING)
    slowing[-1] = 1.0
    lower_a, lower_b = np.hstack((a, steps)), np.hstack((b, slowing))
    ones = np.hstack((np.ones_like(a), np.zeros_like(steps)))
    still = np.where(a == 0.0, np.abs(b), 0.0)
    x: Vector = np.minimum(most, _bounds(np.ones_like(still), still).min(axis=1))
    left = np.arange(len(x))
    while len(left):
        up = _lines(1.0 - b[left] * x[left, None], a[left], np.inf).argmin(axis=1)
        bounds = -ones[left] - lower_b[left] * x[left, None]
        low = _lines(bounds, lower_a[left], -np.inf).argmax(axis=1)
        slack = ones[left, low] * a[left, up] + lower_a[left, low]
        rise = b[left, up] * lower_a[left, low] - lower_b[left, low] * a[left, up]
        meeting = _bounds(slack, rise)
        lower = meeting < x[left]
        left = left[lower]
        x[left] = meeting[lower]
    return x


def _lines(over: Matrix, under: Matrix, missing: float) -> Matrix:
    """The quotients where what is under is positive, else what stands for a missing one."""
    quotients: Matrix = np.divide(over, under, out=np.full(over.shape, missing), where=under > 0.0)
    return quotients


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
