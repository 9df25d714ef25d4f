"""Compiled checks of joint limits: between set-points, and of the ability to stop afterwards."""

from __future__ import annotations

import math

from bt_dualarm.core.kernel import kernel
from bt_dualarm.core.pose import Matrix
from bt_dualarm.kinematics.chain_kernel_arrays import (
    LOWER,
    MAX_ACCELERATION,
    MAX_JERK,
    MAX_VELOCITY,
    ROUNDING,
    UPPER,
    Stack,
)


@kernel
def keeps_limits(limits: Matrix, period: float, last: Matrix, desired: Matrix) -> bool:
    """Whether all joints keep their limits from one set-point to the next.

    Checks velocity, acceleration (as given and as the change of velocity), jerk, consistency of
    position with velocity, and whether each joint could still stop before its position limits.

    Args:
        limits: Joint limits, of shape (LIMITS, dof).
        period: Seconds between set-points.
        last: Position, velocity and acceleration of the previous set-point, of shape (3, dof).
        desired: The same of the next set-point.
    """
    factor = 1.0 + ROUNDING
    for i in range(limits.shape[1]):
        q = desired[0, i]
        v = desired[1, i]
        a = desired[2, i]
        max_v = limits[MAX_VELOCITY, i]
        max_a = limits[MAX_ACCELERATION, i]
        # Position minus the trapezoidal integral of velocity: a jump of the position alone.
        drift = q - last[0, i] - 0.5 * period * (v + last[1, i])
        kept = (
            abs(v) <= max_v * factor
            and abs(a) <= max_a * factor
            and abs(v - last[1, i]) <= max_a * period * factor
            and abs(a - last[2, i]) <= limits[MAX_JERK, i] * period * factor
            and abs(drift) <= max_a * period**2
        )
        if not (kept and can_stop(limits, i, q, v, a)):
            return False
    return True


@kernel
def can_stop(limits: Matrix, i: int, q: float, v: float, a: float) -> bool:
    """Whether a joint can keep its limits from a state on; false for a state that is not finite."""
    max_a = limits[MAX_ACCELERATION, i]
    jerk = limits[MAX_JERK, i]
    ahead = q + max_displacement_before_rest(v, a, max_a, jerk)
    # Mirrored for the lower limit.
    behind = q - max_displacement_before_rest(-v, -a, max_a, jerk)
    # Velocity once the acceleration has faded at the jerk limit.
    max_v = abs(v + a * abs(a) / (2.0 * jerk))
    kept: bool = (
        behind >= limits[LOWER, i] - ROUNDING
        and ahead <= limits[UPPER, i] + ROUNDING
        and max_v <= limits[MAX_VELOCITY, i] * (1.0 + ROUNDING)
    )
    return kept


@kernel
def max_displacement_before_rest(v: float, a: float, acceleration: float, jerk: float) -> float:
    """Largest displacement in the positive direction before a joint can come to rest, rad.

    Braking profile: negative jerk limit until the negative acceleration limit, and positive jerk
    limit at the end. From zero acceleration, the velocity of such a profile is point-symmetric, so
    that the distance is half the initial velocity times the duration.

    Args:
        v: Velocity, rad/s.
        a: Acceleration within its limit, rad/s².
        acceleration: Limit of the acceleration, rad/s².
        jerk: Limit of the jerk, rad/s³.
    """
    # The profile begins where the acceleration is zero: ``lead`` seconds from now, or ago.
    lead = a / jerk
    top = max(v + 0.5 * a * lead, 0.0)  # velocity at that time
    if not (v > 0.0 or top > 0.0):
        return 0.0
    if a < 0.0 and 2.0 * jerk * v < a * a:
        # Slower than the end of such a profile: it comes to rest while the acceleration fades.
        root = math.sqrt(max(a * a - 2.0 * jerk * max(v, 0.0), 0.0))
        rest = (-a - root) / jerk
        return max((v + (0.5 * a + jerk * rest / 6.0) * rest) * rest, 0.0)
    ramp = acceleration / jerk
    # With a phase of constant acceleration, or a triangle of two jerk phases.
    long = top >= acceleration * ramp
    duration = top / acceleration + ramp if long else 2.0 * math.sqrt(top / jerk)
    return max((v + a * lead / 3.0) * lead + 0.5 * top * duration, 0.0)


@kernel
def max_displacement(limits: Matrix, i: int, v: float, a: float, seconds: float) -> float:
    """Upper bound in rad of a joint's displacement: any motion for a time, then braking.

    Braking begins with the acceleration fading within ``a/j``. From a speed v it then takes at
    most ``v/a + a/j`` at an average speed of v/2.

    Args:
        limits: Joint limits, of shape (LIMITS, dof).
        i: Index of the joint.
        v: Velocity, rad/s.
        a: Acceleration within its limit, rad/s².
        seconds: Time after which it brakes, s.
    """
    max_v = limits[MAX_VELOCITY, i]
    max_a = limits[MAX_ACCELERATION, i]
    jerk = limits[MAX_JERK, i]
    # Fastest growth of the acceleration, then of the velocity; both within their limits.
    most = min(abs(a) + jerk * seconds, max_a)
    fade = most / jerk
    speed = min(abs(v) + most * seconds, max_v) + 0.5 * most * fade
    turn: float = speed * (seconds + fade + 0.5 * speed / max_a + 0.5 * max_a / jerk)
    return turn


@kernel
def within(scaled: Stack, dt: float, factor: float, limits: Matrix) -> bool:
    """Whether set-points keep the rate limits, each one by itself and from one to the next.

    Args:
        scaled: Positions, velocities, accelerations of a motion, of shape (3, n, dof).
        dt: Seconds between set-points.
        factor: Multiplies the limits, as a tolerance for rounding.
        limits: Velocity, acceleration and jerk limits, of shape (3, dof), rad/s, rad/s², rad/s³.
    """
    v = scaled[1]
    a = scaled[2]
    for i in range(len(v)):
        for j in range(v.shape[1]):
            max_a = limits[1, j]
            if not (abs(v[i, j]) <= limits[0, j] * factor and abs(a[i, j]) <= max_a * factor):
                return False
            # What a controller can observe: differences of consecutive set-points.
            if i and not (
                abs(v[i, j] - v[i - 1, j]) <= max_a * dt * factor
                and abs(a[i, j] - a[i - 1, j]) <= limits[2, j] * dt * factor
            ):
                return False
    return True
