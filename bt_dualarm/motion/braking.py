"""How far a joint still goes when it brakes as hard as its limits allow."""

from __future__ import annotations

import numpy as np

from bt_dualarm.pose import Vector


def stopping_distance(v: Vector, a: Vector, acceleration: Vector, jerk: Vector) -> Vector:
    """Farthest that joints go in the positive direction before they can turn, of shape (dof,).

    The jerk is at its negative limit until the acceleration is at its own, and at its positive
    limit at the end. Velocity is point-symmetric in such a profile, so that the way is half the
    velocity at its start times its duration.

    Args:
        v: Velocity of shape (dof,), rad/s.
        a: Acceleration of shape (dof,), rad/s², within the limit.
        acceleration: Its limit, of shape (dof,).
        jerk: Limit of shape (dof,), rad/s³.
    """
    # The profile begins where the acceleration is zero: ``lead`` seconds from now, or ago.
    lead = a / jerk
    top = np.maximum(v + 0.5 * a * lead, 0.0)
    lead_way = (v + a * lead / 3.0) * lead
    profile = 0.5 * top * _duration(top, acceleration, jerk)
    # Slower than the end of such a profile: it comes to rest while the acceleration fades.
    fading = np.maximum(-a, 0.0)
    root = np.sqrt(np.maximum(fading**2 - 2.0 * jerk * np.maximum(v, 0.0), 0.0))
    rest = (fading - root) / jerk
    short = (v + (0.5 * a + jerk * rest / 6.0) * rest) * rest
    ends_short = (a < 0.0) & (2.0 * jerk * v < a * a)
    way = np.where(ends_short, short, lead_way + profile)
    return np.where((v > 0.0) | (top > 0.0), np.maximum(way, 0.0), 0.0)


def _duration(v: Vector, acceleration: Vector, jerk: Vector) -> Vector:
    """Seconds from a velocity without acceleration to rest."""
    ramp = acceleration / jerk
    reaches_limit = v >= acceleration * ramp
    return np.where(reaches_limit, v / acceleration + ramp, 2.0 * np.sqrt(v / jerk))
