"""A point that follows a moving target within limits of velocity, acceleration and jerk.

Three loops, one inside the other, each of which asks no more of the next than it can still undo
(a cascade, Siciliano et al., Robotics, 8.3; the profiles are those of motion from rest to rest,
Biagiotti and Melchiorri, Trajectory Planning for Automatic Machines and Robots, 3.4):

- the velocity is that of the target and, along the error ``e``, ``c·e``, or less: as fast as the
  point can brake from before it arrives;
- the acceleration is that of the target and, along the lack ``s`` of velocity, ``b·s``, or less:
  what can fade before the velocity is there;
- the acceleration that is sent approaches it by the share ``f`` a period, or by the limit of jerk.

Near the target none of the limits binds, and the error is that of a linear system with three poles
that are chosen for the sampled system itself.
"""

from __future__ import annotations

import math

import numpy as np

from bt_dualarm.kernels.kernel import kernel
from bt_dualarm.motion.setpoints.kernel_rows import Gains, Reach
from bt_dualarm.pose import Vector

_BRAKE_ACCELERATION = 0.5  # share of the limit that is planned for slowing down before the target
_BRAKE_JERK = 0.35
_FADE_JERK = 0.5  # share of the limit by which an acceleration is planned to fade


@kernel
def jerk_bandwidth(jerk: float, error: float) -> float:
    """The bandwidth in rad/s at which an error in m takes all of the jerk in m/s³.

    A system with three poles at ``w`` answers a jump by ``e`` with a jerk of ``w³·e``.
    """
    bandwidth: float = np.cbrt(jerk / error)
    return bandwidth


@kernel
def pole_gains(poles: tuple[float, float, float], period: float) -> Gains:
    """Gains with which the sampled, unlimited system has its poles at ``exp(-pole · period)``.

    With the relative error, velocity and acceleration (e, e', e'') as the state, the last one as it
    was sent, one period leads to the characteristic polynomial
    ``z³ - (3 - f - m - k/2) z² + (3 - 2f - m + k/2) z - (1 - f)`` with ``k = f b c T²`` and
    ``m = f b T``; comparing coefficients gives the gains.

    Args:
        poles: Three real ones, in rad/s, positive.
        period: ``T`` in s.
    """
    x, y, z = (
        math.exp(-poles[0] * period),
        math.exp(-poles[1] * period),
        math.exp(-poles[2] * period),
    )
    f = 1.0 - x * y * z
    k = (1.0 - x) * (1.0 - y) * (1.0 - z)
    m = 3.0 - f - (x + y + z) - 0.5 * k
    return Gains(k / (m * period), m / (f * period), f)


@kernel
def following_gains(bandwidth: float, error: float, jerk: float, period: float) -> Gains:
    """The gains of a follower.

    Args:
        bandwidth: The most that is wanted, in rad/s; two poles are there, or lower.
        error: Jump of the target in m that may take all of the jerk.
        jerk: What there is of it, in m/s³.
        period: Seconds between set-points.
    """
    w = min(bandwidth, jerk_bandwidth(jerk, error))
    return pole_gains((w, w, max(w, jerk / (error * w * w))), period)


@kernel
def braking_speed(distance: float, reach: Reach) -> float:
    """The speed in m/s from which a point comes to rest within a distance in m.

    From no acceleration to none: without an even part of it up to ``a²/j``, by
    ``d = v·√(v/j)``; beyond by ``d = v/2·(v/a + a/j)``.
    """
    a, j = reach
    ramp = a / j
    if distance <= a * ramp * ramp:
        speed: float = np.cbrt(distance * distance * j)
        return speed
    return 0.5 * a * (math.sqrt(ramp * ramp + 8.0 * distance / a) - ramp)


@kernel
def closing_velocity(away: Vector, gains: Gains, reach: Reach) -> Vector:
    """Velocity towards a target that is ``away``, of shape (2,), in m/s."""
    distance = math.hypot(away[0], away[1])
    if distance == 0.0:
        return np.zeros(2)
    planned = Reach(_BRAKE_ACCELERATION * reach.acceleration, _BRAKE_JERK * reach.jerk)
    speed = min(gains.c * distance, braking_speed(distance, planned))
    closing: Vector = away * (speed / distance)
    return closing


@kernel
def fading_acceleration(lack: Vector, gain: float, jerk: float) -> Vector:
    """Acceleration in m/s² for a lack of velocity, of shape (2,), in m/s.

    ``gain`` times as much, or what fades to nothing, by a share of the jerk ``j``, as the lack
    does: ``s = a²/2j``.
    """
    size = math.hypot(lack[0], lack[1])
    if size == 0.0:
        return np.zeros(2)
    acceleration: Vector = lack * min(gain, math.sqrt(2.0 * _FADE_JERK * jerk / size))
    return acceleration
