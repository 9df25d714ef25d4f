"""Whether joints keep their limits from one set-point to the next, and can still stop then."""

from __future__ import annotations

import math

from bt_dualarm.kernels.kernel import kernel
from bt_dualarm.motion.chains.kernel_rows import (
    LOWER,
    MOST_ACCELERATION,
    MOST_JERK,
    MOST_VELOCITY,
    ROUNDING,
    UPPER,
    Stack,
)
from bt_dualarm.pose import Matrix


@kernel
def keep(limits: Matrix, period: float, last: Matrix, wanted: Matrix) -> bool:
    """Whether all joints keep their limits.

    Velocity, acceleration (as given and as the change of velocity), jerk, and whether positions
    belong to velocities; and whether each could still stop before its position limits.

    Args:
        limits: Limits of the joints, see `kernel_rows`.
        period: Seconds between two set-points.
        last: Positions, velocities and accelerations that were sent last, of shape (3, dof).
        wanted: Those to come, likewise.
    """
    more = 1.0 + ROUNDING
    for i in range(limits.shape[1]):
        q, v, a = wanted[0, i], wanted[1, i], wanted[2, i]
        fast, brisk = limits[MOST_VELOCITY, i], limits[MOST_ACCELERATION, i]
        drift = q - last[0, i] - 0.5 * period * (v + last[1, i])
        kept = (
            abs(v) <= fast * more
            and abs(a) <= brisk * more
            and abs(v - last[1, i]) <= brisk * period * more
            and abs(a - last[2, i]) <= limits[MOST_JERK, i] * period * more
            and abs(drift) <= brisk * period**2
        )
        if not (kept and can_stop(limits, i, q, v, a)):
            return False
    return True


@kernel
def can_stop(limits: Matrix, i: int, q: float, v: float, a: float) -> bool:
    """Whether a joint can keep its limits from a state on; a state of no numbers cannot."""
    brisk, jerk = limits[MOST_ACCELERATION, i], limits[MOST_JERK, i]
    ahead = q + stopping_way(v, a, brisk, jerk)
    behind = q - stopping_way(-v, -a, brisk, jerk)
    fast = abs(v + a * abs(a) / (2.0 * jerk))
    kept: bool = (
        behind >= limits[LOWER, i] - ROUNDING
        and ahead <= limits[UPPER, i] + ROUNDING
        and fast <= limits[MOST_VELOCITY, i] * (1.0 + ROUNDING)
    )
    return kept


@kernel
def stopping_way(v: float, a: float, acceleration: float, jerk: float) -> float:
    """Farthest that a joint goes in the positive direction before it can turn.

    The jerk is at its negative limit until the acceleration is at its own, and at its positive
    limit at the end. Velocity is point-symmetric in such a profile, so that the distance is half
    the velocity at its start times its duration.

    Args:
        v: Velocity, rad/s.
        a: Acceleration within its limit, rad/s².
        acceleration: Limit of the acceleration, rad/s².
        jerk: Limit of the jerk, rad/s³.
    """
    # The profile begins where the acceleration is zero: ``lead`` seconds from now, or ago.
    lead = a / jerk
    top = max(v + 0.5 * a * lead, 0.0)
    if not (v > 0.0 or top > 0.0):
        return 0.0
    if a < 0.0 and 2.0 * jerk * v < a * a:
        # Slower than the end of such a profile: it comes to rest while the acceleration fades.
        root = math.sqrt(max(a * a - 2.0 * jerk * max(v, 0.0), 0.0))
        rest = (-a - root) / jerk
        return max((v + (0.5 * a + jerk * rest / 6.0) * rest) * rest, 0.0)
    ramp = acceleration / jerk
    long = top >= acceleration * ramp
    duration = top / acceleration + ramp if long else 2.0 * math.sqrt(top / jerk)
    return max((v + a * lead / 3.0) * lead + 0.5 * top * duration, 0.0)


@kernel
def turn_and_stop(limits: Matrix, i: int, v: float, a: float, seconds: float) -> float:
    """How far a joint gets at most, in rad, that does as it likes for a time and brakes then.

    To brake, the acceleration fades first; after that it takes no longer than at an even
    acceleration and two ramps, at half of the speed on average.

    Args:
        limits: Limits of the joints, see `kernel_rows`.
        i: Which joint it is.
        v: Velocity, rad/s.
        a: Acceleration within its limit, rad/s².
        seconds: Time after which it brakes, s.
    """
    fast, brisk, jerk = limits[MOST_VELOCITY, i], limits[MOST_ACCELERATION, i], limits[MOST_JERK, i]
    most = min(abs(a) + jerk * seconds, brisk)
    fade = most / jerk
    speed = min(abs(v) + most * seconds, fast) + 0.5 * most * fade
    turn: float = speed * (seconds + fade + 0.5 * speed / brisk + 0.5 * brisk / jerk)
    return turn


@kernel
def within(scaled: Stack, dt: float, more: float, limits: Matrix) -> bool:
    """Whether set-points keep the limits, one by one and from each to the next.

    Args:
        scaled: Positions, velocities, accelerations, of shape (3, n, dof), of a motion.
        dt: Seconds from one to the next.
        more: What the limits are multiplied by, for rounding.
        limits: Limits of velocity, acceleration, jerk, of shape (3, dof), rad/s, rad/s², rad/s³.
    """
    v, a = scaled[1], scaled[2]
    for i in range(len(v)):
        for j in range(v.shape[1]):
            brisk = limits[1, j]
            if not (abs(v[i, j]) <= limits[0, j] * more and abs(a[i, j]) <= brisk * more):
                return False
            if i and not (
                abs(v[i, j] - v[i - 1, j]) <= brisk * dt * more
                and abs(a[i, j] - a[i - 1, j]) <= limits[2, j] * dt * more
            ):
                return False
    return True
