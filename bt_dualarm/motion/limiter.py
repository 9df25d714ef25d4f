"""The last gate before an arm: no set-point leaves it that breaks the arm's limits."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bt_dualarm.pose import Vector
from bt_dualarm.world.catalogue import JointLimits

_ROUNDING = 1e-6  # relative: floating point, not motion
_BANDWIDTH = 25.0  # rad/s, with which a clipped stream is followed
_BRAKE_SHARE = 0.5  # of the acceleration is planned for braking before a position limit


@dataclass(frozen=True, eq=False)
class SetPoint:
    """What a joint controller is to follow: rad, rad/s, rad/s², each of shape (dof,)."""

    q: Vector
    v: Vector
    a: Vector


class SetPointLimiter:
    """Passes set-points that keep to the limits, bends those that do not, and counts them.

    Velocity, acceleration (as given and as the change of velocity), jerk and position are looked
    at from one set-point to the next.

    Args:
        limits: The arm's limits.
        period: Seconds between set-points.
        start: Position at rest from which the first set-point is judged.
    """

    def __init__(self, limits: JointLimits, period: float, start: Vector) -> None:
        self.clipped = 0
        rest = np.zeros_like(start)
        self.sent = SetPoint(start.copy(), rest, rest)
        self._limits = limits
        self._period = period
        rates = (limits.velocity, limits.acceleration, limits.acceleration, limits.jerk)
        self._bounds = np.concatenate(rates) * (1 + _ROUNDING)
        self._lower, self._upper = limits.lower - _ROUNDING, limits.upper + _ROUNDING

    def send(self, wanted: SetPoint) -> SetPoint:
        """The set-point to follow now: ``wanted``, or the nearest that the limits allow."""
        if not self._allowed(wanted):
            self.clipped += 1
            wanted = self._bent(wanted)
        self.sent = wanted
        return wanted

    def _allowed(self, wanted: SetPoint) -> bool:
        last, dt = self.sent, self._period
        rates = np.concatenate(
            (wanted.v, wanted.a, (wanted.v - last.v) / dt, (wanted.a - last.a) / dt)
        )
        if not (np.abs(rates) <= self._bounds).all():
            return False
        if not ((wanted.q >= self._lower) & (wanted.q <= self._upper)).all():
            return False
        drift = np.abs(wanted.q - last.q - 0.5 * (wanted.v + last.v) * dt)
        return bool((drift <= self._limits.acceleration * dt * dt).all())

    def _bent(self, wanted: SetPoint) -> SetPoint:
        """A critically damped pursuit of ``wanted`` with bounded jerk."""
        last, dt, limits = self.sent, self._period, self._limits
        pursuit = np.nan_to_num(
            wanted.a + 2 * _BANDWIDTH * (wanted.v - last.v) + _BANDWIDTH**2 * (wanted.q - last.q)
        )
        low, high = self._velocity_bounds(last.q)
        fall = -np.sqrt(2 * limits.jerk * np.maximum(last.v - low, 0.0))
        rise = np.sqrt(2 * limits.jerk * np.maximum(high - last.v, 0.0))
        goal = np.clip(
            pursuit, np.maximum(fall, -limits.acceleration), np.minimum(rise, limits.acceleration)
        )
        a = last.a + np.clip(goal - last.a, -limits.jerk * dt, limits.jerk * dt)
        v = np.clip(last.v + 0.5 * (last.a + a) * dt, -limits.velocity, limits.velocity)
        q = np.clip(last.q + 0.5 * (last.v + v) * dt, limits.lower, limits.upper)
        return SetPoint(q, v, a)

    def _velocity_bounds(self, q: Vector) -> tuple[Vector, Vector]:
        """Velocities from which the arm can still brake before its position limits."""
        limits = self._limits
        braking = 2 * _BRAKE_SHARE * limits.acceleration
        down = np.sqrt(braking * np.maximum(q - limits.lower, 0.0))
        up = np.sqrt(braking * np.maximum(limits.upper - q, 0.0))
        return -np.minimum(down, limits.velocity), np.minimum(up, limits.velocity)
