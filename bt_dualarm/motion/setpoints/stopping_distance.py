"""Stopping feasibility: how far a joint goes when it brakes as hard as its limits allow."""

from __future__ import annotations

from typing import TypeAlias

import numpy as np
import numpy.typing as npt

from bt_dualarm.pose import Matrix, Vector
from bt_dualarm.world.robots.robot import JointLimits

Flags: TypeAlias = npt.NDArray[np.bool_]
"""One answer for each joint, of shape (dof,)."""

ROUNDING = 1e-6
"""In rad, and as a share of a rate's limit: floating point, not motion."""


class StoppingFeasibility:
    """Tells states from which a joint can go on within its limits from those where it is too late.

    Args:
        limits: Limits of the arm.
    """

    def __init__(self, limits: JointLimits) -> None:
        self._limits = limits
        # With less speed than this no acceleration within its limit can lead past the limit.
        self._calm = limits.velocity - limits.acceleration**2 / (2 * limits.jerk)
        # Far from its position limits a joint can stop from whatever speed it may have.
        still = np.zeros_like(limits.velocity)
        rates = limits.acceleration, limits.jerk
        longest = 1.01 * stopping_distance(limits.velocity, still, *rates)
        self._low, self._high = limits.lower + longest, limits.upper - longest

    def feasible(self, q: Vector, v: Vector, a: Vector) -> Flags:
        """Whether each joint can keep its limits from here, all three of shape (dof,)."""
        easy = self._far_from_limits(q, v)
        return easy if every(easy) else easy | self._can_stop(q, v, a)

    def all_feasible(self, q: Vector, v: Vector, a: Vector) -> bool:
        """Whether all of them can."""
        easy = self._far_from_limits(q, v)
        return every(easy) or every(easy | self._can_stop(q, v, a))

    def _far_from_limits(self, q: Vector, v: Vector) -> Flags:
        far: Flags = (np.abs(v) < self._calm) & (q > self._low) & (q < self._high)
        return far

    def _can_stop(self, q: Vector, v: Vector, a: Vector) -> Flags:
        limits = self._limits
        rates = limits.acceleration, limits.jerk
        fast = np.abs(v + a * np.abs(a) / (2 * limits.jerk))
        ahead = q + stopping_distance(v, a, *rates)
        behind = q - stopping_distance(-v, -a, *rates)
        in_reach = (behind >= limits.lower - ROUNDING) & (ahead <= limits.upper + ROUNDING)
        kept: Flags = in_reach & (fast <= limits.velocity * (1 + ROUNDING))
        return kept


def every(flags: Flags) -> bool:
    """As ``flags.all()``, at a third of what that costs: it is asked at the control rate."""
    return b"\0" not in flags.tobytes()


def stopping_distance(v: Vector, a: Vector, acceleration: Vector, jerk: Vector) -> Vector:
    """Farthest that joints go in the positive direction before they can turn, of shape (dof,).

    The jerk is at its negative limit until the acceleration is at its own, and at its positive
    limit at the end. Velocity is point-symmetric in such a profile, so that the distance is half
    the velocity at its start times its duration.

    Args:
        v: Velocity of shape (dof,), rad/s.
        a: Acceleration of shape (dof,), rad/s², within the limit.
        acceleration: Limit of the acceleration, of shape (dof,), rad/s².
        jerk: Limit of the jerk, of shape (dof,), rad/s³.
    """
    # The profile begins where the acceleration is zero: ``lead`` seconds from now, or ago.
    lead = a / jerk
    top = np.maximum(v + 0.5 * a * lead, 0.0)
    lead_distance = (v + a * lead / 3.0) * lead
    profile = 0.5 * top * _duration(top, acceleration, jerk)
    # Slower than the end of such a profile: it comes to rest while the acceleration fades.
    fading = np.maximum(-a, 0.0)
    root = np.sqrt(np.maximum(fading**2 - 2.0 * jerk * np.maximum(v, 0.0), 0.0))
    rest = (fading - root) / jerk
    short = (v + (0.5 * a + jerk * rest / 6.0) * rest) * rest
    ends_short = (a < 0.0) & (2.0 * jerk * v < a * a)
    distance = np.where(ends_short, short, lead_distance + profile)
    return np.where((v > 0.0) | (top > 0.0), np.maximum(distance, 0.0), 0.0)


def displacement_bound(v: Vector, a: Vector, limits: JointLimits, seconds: Matrix) -> Matrix:
    """How far joints get at most that do as they like and brake then, of shape (n, dof), rad.

    To brake, the acceleration fades first; after that it takes no longer than at an even
    acceleration and two ramps, at half of the speed on average.

    Args:
        v: Velocity of shape (dof,), rad/s.
        a: Acceleration of shape (dof,), rad/s², within the limit.
        limits: Limits that they keep meanwhile.
        seconds: Times after which they brake, of shape (n, 1), s.
    """
    most = np.minimum(np.abs(a) + limits.jerk * seconds, limits.acceleration)
    fade = most / limits.jerk
    fast = np.minimum(np.abs(v) + most * seconds, limits.velocity) + 0.5 * most * fade
    half_ramp = 0.5 * limits.acceleration / limits.jerk
    distances: Matrix = fast * (seconds + fade + 0.5 * fast / limits.acceleration + half_ramp)
    return distances


def _duration(v: Vector, acceleration: Vector, jerk: Vector) -> Vector:
    """Seconds from a velocity without acceleration to rest."""
    ramp = acceleration / jerk
    reaches_limit = v >= acceleration * ramp
    return np.where(reaches_limit, v / acceleration + ramp, 2.0 * np.sqrt(v / jerk))
