"""The last gate before an arm: no set-point leaves it that breaks the arm's limits."""

from __future__ import annotations

import numpy as np

from bt_dualarm.motion.chains.kernel_rows import ROUNDING
from bt_dualarm.motion.setpoints.online_step import OnlineStep
from bt_dualarm.motion.setpoints.set_point import SetPoint
from bt_dualarm.motion.setpoints.stopping_distance import Flags, feasible, limit_rows
from bt_dualarm.pose import Matrix, Vector
from bt_dualarm.world.robots.robot import JointLimits


class SetPointLimiter:
    """Passes set-points that keep to the limits, bends those that do not, and counts them.

    Velocity, acceleration (as given and as the change of velocity), jerk and position are looked
    at from one set-point to the next, and whether the joint could still stop before its position
    limit. Joints that break a limit follow what was wanted as soon as the limits allow; the others
    are not disturbed.

    Args:
        limits: Limits of the arm.
        period: Seconds between set-points.
        start: Position at rest from which the first set-point is judged, of shape (dof,), rad.

    Attributes:
        sent: The last set-point.
        clipped: Number of set-points that were bent.
    """

    def __init__(self, limits: JointLimits, period: float, start: Vector) -> None:
        from bt_dualarm.motion.chains.limit_kernels import keep

        self._keep = keep
        self.clipped = 0
        rest = np.zeros_like(start)
        self.sent = SetPoint(start.copy(), rest, rest)
        self._limits = limits
        self._period = period
        self._step = OnlineStep(limits, period)
        self._rows = limit_rows(limits)
        self._last, self._wanted = np.empty((2, 3, len(start)))
        rates = np.array((limits.velocity, limits.acceleration, limits.acceleration, limits.jerk))
        steps = np.array((1.0, 1.0, period, period))[:, None]
        drift = limits.acceleration * period**2
        self._bounds = np.vstack((rates * steps * (1 + ROUNDING), drift))

    def send(self, wanted: SetPoint) -> SetPoint:
        """The set-point to follow now: ``wanted``, or the nearest that the limits allow."""
        self.sent = self.bend(wanted)
        return self.sent

    def bend(self, wanted: SetPoint) -> SetPoint:
        """As ``send``, but it has not been sent yet: that is for the caller to say."""
        sent, last, asked = self.sent, self._last, self._wanted
        last[0], last[1], last[2] = sent.q, sent.v, sent.a
        asked[0], asked[1], asked[2] = wanted.q, wanted.v, wanted.a
        return wanted if self._keep(self._rows, self._period, last, asked) else self.bent(wanted)

    def bent(self, wanted: SetPoint) -> SetPoint:
        """As ``bend``, of one that is known not to keep the limits."""
        self.clipped += 1
        return self._bent(wanted)

    def _within(self, wanted: SetPoint) -> Flags:
        """Which limits are kept from the last set-point to this one, of shape (5, dof)."""
        last = self.sent
        found = (
            wanted.v,
            wanted.a,
            wanted.v - last.v,
            wanted.a - last.a,
            wanted.q - last.q - (0.5 * self._period) * (wanted.v + last.v),
        )
        kept: Flags = np.abs(found) <= self._bounds
        return kept

    def _bent(self, wanted: SetPoint) -> SetPoint:
        """Joints that keep the limits as wanted, the others one step towards it or to rest."""
        limits, last = self._limits, self.sent
        now = np.array((last.q, last.v, last.a))
        ask = np.array((wanted.q, wanted.v, wanted.a))
        known = np.isfinite(ask).all(axis=0)
        goal = np.where(known, ask, now)
        good = known & self._within(wanted).all(axis=0) & feasible(self._rows, *goal)
        step = self._step.towards(self._reachable(goal), now)
        safe = known & feasible(self._rows, *step)
        if not (safe | good).all():
            step = np.where(safe, step, self._step.to_rest(now))
        step = np.where(good, ask, step)
        # Braking ends on a position limit but for rounding.
        return SetPoint(np.clip(step[0], limits.lower, limits.upper), step[1], step[2])

    def _reachable(self, ask: Matrix) -> Matrix:
        """What lies beyond a position limit is wanted at rest on it."""
        inside = np.clip(ask[0], self._limits.lower, self._limits.upper)
        return np.where(inside == ask[0], ask, np.array((inside, 0 * inside, 0 * inside)))
