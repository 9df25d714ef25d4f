"""Timing of a path at a constant speed of the tool, with a smooth start and end.

The path parameter is the tool's path length s. Its rate rises from 0 to the speed along a quintic
and falls likewise, so that acceleration and its change are continuous. The ramps are as short as
the joint limits allow; in between, the rate does not change.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from bt_dualarm.core.errors import Failure, rounded_down
from bt_dualarm.core.pose import Matrix, Vector
from bt_dualarm.robots.robot import JointLimits
from bt_dualarm.trajectory.cubic_spline import cubic_spline
from bt_dualarm.trajectory.kernel_arrays import Spline
from bt_dualarm.trajectory.trajectory import Trajectory, use_of_limits

_FIRST_RAMP_S: Final = 0.04
_LONGER: Final = 1.3
"""Duration of the shortest ramp that is tried, s, and the ratio of one ramp to the next."""

_SLOWER: Final = 0.9
"""Ratio of one speed to the next that are tried to find a possible one."""

_LEAST_SHARE: Final = 0.05
"""Fraction of the first of these speeds at which the search ends: slower motions have ever more
samples."""

_SPACING_M: Final = 3e-4
"""Minimum distance of samples, m: the third derivative of a spline amplifies the rounding of
inverse kinematics with its inverse cube."""

_SHARE: Final = 0.98
"""Fraction of the joint limits that may be used: between set-points, derivatives vary a little."""


def at_constant_speed(
    samples: Matrix, lengths: Vector, speed: float, limits: JointLimits, dt: float
) -> tuple[Trajectory, float]:
    """Motion along a path from rest to rest, at a constant speed of the tool in between.

    Args:
        samples: Configurations along the path, of shape (n, dof), rad, dense enough that the
            spline through them is the path.
        lengths: Length of the tool's path up to each of them, of shape (n,), m; at least two of
            them apart.
        speed: Speed of the tool, m/s.
        limits: Joint limits.
        dt: Time between set-points, s.

    Returns:
        The motion, and the duration of each ramp in s.

    Raises:
        Failure: ``TOO_FAST`` with about the largest possible speed, ``fastest_m_s``: the joints
            cannot follow, or the path is too short to reach the speed.
    """
    kept = _apart(lengths)
    path = cubic_spline(lengths[kept], samples[kept])
    length = float(lengths[-1])
    lower = _fastest(path, length, limits)
    reason = "a joint would exceed its limits on the path"
    if speed <= lower:
        found = _with_ramps(path, length, speed, limits, dt)
        if found is not None:
            return found
        lower = _SLOWER * speed
        reason = "the path is too short to reach the speed smoothly"
    least = _LEAST_SHARE * lower
    while lower > least and _with_ramps(path, length, rounded_down(lower), limits, dt) is None:
        lower *= _SLOWER
    raise too_fast(speed, lower, reason)


def _with_ramps(
    path: Spline, length: float, speed: float, limits: JointLimits, dt: float
) -> tuple[Trajectory, float] | None:
    """Motion with the shortest possible ramps, and their duration; None if there are none."""
    ramp = _FIRST_RAMP_S
    while speed * ramp <= length:
        motion, used = _timed(path, length, speed, ramp, dt)
        if _keeps(motion, limits):
            return motion, used
        ramp *= _LONGER
    return None


def _apart(lengths: Vector) -> list[int]:
    """Indices of samples that are not nearer than `_SPACING_M` to each other, with both ends."""
    kept = [0]
    last = float(lengths[-1])
    for index, length in enumerate(lengths.tolist()):
        if length - lengths[kept[-1]] >= _SPACING_M and last - length >= _SPACING_M:
            kept.append(index)
    return [*kept, len(lengths) - 1]


def too_fast(speed: float, fastest: float, reason: str) -> Failure:
    """``TOO_FAST``, with a speed to try that is no higher than the largest possible one.

    Args:
        speed: Speed of the tool that was requested, m/s.
        fastest: Largest possible speed, m/s.
        reason: Why the requested one is not possible.
    """
    possible = rounded_down(fastest)
    return Failure(
        "TOO_FAST",
        f"the tool cannot move at {speed:g} m/s: {reason}; try {possible:g} m/s",
        asked_m_s=speed,
        fastest_m_s=possible,
    )


def _fastest(path: Spline, length: float, limits: JointLimits) -> float:
    """Largest constant speed within the joint limits, m/s."""
    # Second and third derivatives of a cubic spline are largest at its knots.
    s = np.union1d(np.linspace(0.0, length, max(64, math.ceil(length / 5e-4))), path.knots)
    rates = [np.abs(path(s, order)).max(axis=0) for order in (1, 2, 3)]
    bounds = (limits.velocity, limits.acceleration, limits.jerk)
    speeds = [
        (_SHARE * bound / np.maximum(rate, 1e-12)) ** (1.0 / order)
        for order, (rate, bound) in enumerate(zip(rates, bounds, strict=True), 1)
    ]
    return float(np.min(speeds))


def _timed(
    path: Spline, length: float, speed: float, ramp: float, dt: float
) -> tuple[Trajectory, float]:
    """Motion with ramps of at least a duration in s, and their exact duration."""
    # Each ramp covers half of what the speed would in its time, so both together cost one ramp.
    # The end falls on a set-point: the ramps become longer by what the last period has left.
    count = math.ceil((length / speed + ramp) / dt)
    ramp = count * dt - length / speed
    t = dt * np.arange(count + 1)
    steady = count * dt - ramp
    s, ds, dds = np.empty((3, count + 1))
    u = np.clip(np.minimum(t, count * dt - t) / ramp, 0.0, 1.0)
    ds[:] = speed * u**3 * (10.0 - 15.0 * u + 6.0 * u**2)
    dds[:] = speed / ramp * 30.0 * u**2 * (1.0 - u) ** 2
    # The integral of the quintic; the second half of the motion mirrors the first.
    covered = speed * ramp * u**4 * (2.5 - 3.0 * u + u**2)
    late = t > 0.5 * count * dt
    s[:] = covered + speed * np.clip(t - ramp, 0.0, None)
    s[late] = length - covered[late] - speed * np.clip(steady - t[late], 0.0, None)
    dds[late] *= -1.0
    s = np.clip(s, 0.0, length)
    first = path(s, 1)
    q = path(s)
    # Chain rule: q(s(t)) has the derivatives q' s' and q' s'' + q'' s'^2.
    v = first * ds[:, None]
    a = first * dds[:, None] + path(s, 2) * (ds**2)[:, None]
    v[[0, -1]] = 0.0
    a[[0, -1]] = 0.0
    return Trajectory(dt, q, v, a), ramp


def _keeps(motion: Trajectory, limits: JointLimits) -> bool:
    """Whether a motion keeps the limits of velocity, acceleration and jerk."""
    use = use_of_limits(motion, limits)
    return max(use.velocity, use.acceleration, use.jerk) <= 1.0
