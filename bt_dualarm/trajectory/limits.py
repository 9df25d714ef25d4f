"""Set-points within joint limits.

- `SetPointLimiter` is the last stage before the control law: no set-point breaks a limit after it.
- `OnlineStep` computes one step of a time-optimal motion toward a moving reference.
- `feasible`, `stopping_distance` and `displacement_bound` tell what joints can still do.
"""

from __future__ import annotations

from typing import NamedTuple, Protocol, TypeAlias

import numpy as np
import numpy.typing as npt
import ruckig

from bt_dualarm.core.errors import DivergenceError, Failure
from bt_dualarm.core.pose import Matrix, Vector
from bt_dualarm.kinematics.chain_kernel_arrays import ROUNDING
from bt_dualarm.robots.robot import JointLimits
from bt_dualarm.trajectory.point_to_point import solve_ruckig
from bt_dualarm.trajectory.trajectory import Trajectory

_HEADROOM = 0.9
"""Share of the limits that a reference may use, so that the joint can catch up with it."""

Flags: TypeAlias = npt.NDArray[np.bool_]
"""Booleans, one per joint, of shape (dof,)."""


class SetPoint(NamedTuple):
    """Position, velocity and acceleration of the joints: rad, rad/s, rad/s², each (dof,)."""

    q: Vector
    v: Vector
    a: Vector


class SetPointSource(Protocol):
    """Source of set-points that a controller follows: a trajectory or a stream."""

    def next(self, time: float) -> SetPoint:
        """Set-point for the current simulated time in s."""

    @property
    def done(self) -> bool:
        """Whether its last set-point has been sent."""

    @property
    def braking(self) -> Trajectory | None:
        """Reserved braking trajectory from the last set-point on; None if there is none."""


class SetPointLimiter:
    """Passes set-points that keep the joint limits, limits those that do not, and counts them.

    The last stage before the control law. From one set-point to the next it checks velocity,
    acceleration (as given and as the change of velocity), jerk and position, and whether each joint
    could still stop before its position limit. Joints that break a limit approach the desired
    set-point as fast as the limits allow; the others are not affected.

    Args:
        limits: Joint limits of the arm.
        period: Seconds between set-points.
        start: Initial position at rest, of shape (dof,), rad.

    Attributes:
        sent: The last set-point.
        clipped: Number of set-points that were limited.
    """

    def __init__(self, limits: JointLimits, period: float, start: Vector) -> None:
        from bt_dualarm.trajectory.limit_kernels import keeps_limits

        self._keeps_limits = keeps_limits
        self.clipped = 0
        rest = np.zeros_like(start)
        self.sent = SetPoint(start.copy(), rest, rest)
        self._limits = limits
        self._period = period
        self._step = OnlineStep(limits, period)
        self._rows = limit_rows(limits)
        # Scratch arrays, written in every control cycle.
        self._last = np.empty((3, len(start)))
        self._desired = np.empty((3, len(start)))
        rates = np.array((limits.velocity, limits.acceleration, limits.acceleration, limits.jerk))
        steps = np.array((1.0, 1.0, period, period))[:, None]
        drift = limits.acceleration * period**2
        self._bounds = np.vstack((rates * steps * (1 + ROUNDING), drift))

    def send(self, desired: SetPoint) -> SetPoint:
        """Next set-point: ``desired``, or one step toward it within the limits."""
        self.sent = self.limited(desired)
        return self.sent

    def limited(self, desired: SetPoint) -> SetPoint:
        """Set-point that `send` would return; the caller assigns ``sent`` once it is commanded."""
        sent = self.sent
        last = self._last
        target = self._desired
        last[0] = sent.q
        last[1] = sent.v
        last[2] = sent.a
        target[0] = desired.q
        target[1] = desired.v
        target[2] = desired.a
        return (
            desired
            if self._keeps_limits(self._rows, self._period, last, target)
            else self.corrected(desired)
        )

    def corrected(self, desired: SetPoint) -> SetPoint:
        """Result of `limited` for a set-point that is known to break a limit; counts it.

        Joints that break a limit take a step toward it, or to rest.
        """
        self.clipped += 1
        limits = self._limits
        last = self.sent
        now = np.array((last.q, last.v, last.a))
        target = np.array((desired.q, desired.v, desired.a))
        # A joint without a finite target brakes.
        known = np.isfinite(target).all(axis=0)
        goal = np.where(known, target, now)
        good = known & self._within(desired).all(axis=0) & feasible(self._rows, *goal)
        # Toward the target where that is safe, else to rest. Joints that break no limit pass.
        step = self._step.toward(self._reachable(goal), now)
        safe = known & feasible(self._rows, *step)
        if not (safe | good).all():
            step = np.where(safe, step, self._step.to_rest(now))
        step = np.where(good, target, step)
        # Braking ends exactly on a position limit, except for rounding.
        return SetPoint(np.clip(step[0], limits.lower, limits.upper), step[1], step[2])

    def _within(self, desired: SetPoint) -> Flags:
        """Which limits are kept from the last set-point to this one, of shape (5, dof)."""
        # Rows: velocity, acceleration, change of velocity, jerk, position against velocity.
        last = self.sent
        found = (
            desired.v,
            desired.a,
            desired.v - last.v,
            desired.a - last.a,
            desired.q - last.q - (0.5 * self._period) * (desired.v + last.v),
        )
        kept: Flags = np.abs(found) <= self._bounds
        return kept

    def _reachable(self, target: Matrix) -> Matrix:
        """Desired states with positions beyond a limit replaced by rest on the limit."""
        inside = np.clip(target[0], self._limits.lower, self._limits.upper)
        return np.where(inside == target[0], target, np.array((inside, 0 * inside, 0 * inside)))


class OnlineStep:
    """Time-optimal steps toward a moving reference, each joint independently, by Ruckig.

    States have shape (3, dof): position, velocity and acceleration in rad, rad/s, rad/s².

    Args:
        limits: Joint limits; position limits are not considered.
        period: Duration of one step, s.
    """

    def __init__(self, limits: JointLimits, period: float) -> None:
        self._limits = limits
        self._period = period
        dof = len(limits.velocity)
        self._solver = ruckig.Ruckig(dof)

    def toward(self, reference: Matrix, now: Matrix) -> Matrix:
        """State one period after ``now`` toward ``reference``, the state desired at that time.

        The reference is assumed to continue with constant acceleration. The motion is planned
        relative to it, where the goal is rest: a fixed goal would be a position that the reference
        has left by the time the joint arrives.
        """
        limits = self._limits
        dt = self._period
        goal = reference.copy()
        goal[1] = np.clip(goal[1], -_HEADROOM * limits.velocity, _HEADROOM * limits.velocity)
        goal[2] = np.clip(
            goal[2], -_HEADROOM * limits.acceleration, _HEADROOM * limits.acceleration
        )
        # The reference one period earlier, so that both states are of the same time.
        before = goal.copy()
        before[0] -= (goal[1] - 0.5 * goal[2] * dt) * dt
        before[1] -= goal[2] * dt
        request = self._request(now - before)
        request.target_position = request.target_velocity
        # Limits of the relative motion: absolute ones less what the reference itself uses.
        request.max_velocity = (limits.velocity - goal[1]).tolist()
        request.min_velocity = (-limits.velocity - goal[1]).tolist()
        request.max_acceleration = (limits.acceleration - goal[2]).tolist()
        request.min_acceleration = (-limits.acceleration - goal[2]).tolist()
        return goal + self._step(request)

    def to_rest(self, now: Matrix) -> Matrix:
        """State one period after ``now``, braking as hard as the limits allow."""
        request = self._request(now)
        request.control_interface = ruckig.ControlInterface.Velocity
        return self._step(request)

    def _request(self, now: Matrix) -> ruckig.InputParameter:
        limits = self._limits
        rest = [0.0] * len(limits.jerk)
        request = ruckig.InputParameter(len(rest))
        request.synchronization = ruckig.Synchronization.No
        request.current_position, request.current_velocity, request.current_acceleration = (
            now.tolist()
        )
        request.target_velocity = request.target_acceleration = rest
        request.max_velocity = limits.velocity.tolist()
        request.max_acceleration = limits.acceleration.tolist()
        return request

    def _step(self, request: ruckig.InputParameter) -> Matrix:
        """State one period later.

        Raises:
            DivergenceError: Ruckig finds no solution.
        """
        try:
            motion = solve_ruckig(request, self._limits.jerk, self._solver)
        except Failure as refusal:
            raise DivergenceError(f"a motion cannot be continued: {refusal.reason}") from refusal
        return np.array(motion.at_time(self._period))


def feasible(limits: Matrix, q: Vector, v: Vector, a: Vector) -> Flags:
    """Whether each joint can keep its limits, of shape (5, dof), from a state (q, v, a) on."""
    from bt_dualarm.trajectory.limit_kernels import can_stop

    states = zip(q.tolist(), v.tolist(), a.tolist(), strict=True)
    return np.array([can_stop(limits, i, *state) for i, state in enumerate(states)])


def stopping_distance(v: Vector, a: Vector, acceleration: Vector, jerk: Vector) -> Vector:
    """Largest displacement in the positive direction until joints can rest, of shape (dof,), rad.

    Args:
        v: Velocity of shape (dof,), rad/s.
        a: Acceleration of shape (dof,), rad/s², within the limit.
        acceleration: Limit of the acceleration, of shape (dof,), rad/s².
        jerk: Limit of the jerk, of shape (dof,), rad/s³.
    """
    from bt_dualarm.trajectory.limit_kernels import max_displacement_before_rest

    joints = zip(v.tolist(), a.tolist(), acceleration.tolist(), jerk.tolist(), strict=True)
    return np.array([max_displacement_before_rest(*joint) for joint in joints])


def displacement_bound(v: Vector, a: Vector, limits: Matrix, seconds: float) -> Vector:
    """Upper bound of the displacement of joints that move freely, then brake, (dof,), rad.

    Args:
        v: Velocity of shape (dof,), rad/s.
        a: Acceleration of shape (dof,), rad/s², within the limit.
        limits: Joint limits, of shape (5, dof), see `limit_rows`.
        seconds: Time after which they brake, s.
    """
    from bt_dualarm.trajectory.limit_kernels import max_displacement

    joints = zip(v.tolist(), a.tolist(), strict=True)
    return np.array(
        [max_displacement(limits, i, *joint, seconds) for i, joint in enumerate(joints)]
    )


def limit_rows(limits: JointLimits) -> Matrix:
    """Joint limits as an array of shape (5, dof), see `chain_kernel_arrays.LOWER` and following."""
    rows = limits.lower, limits.upper, limits.velocity, limits.acceleration, limits.jerk
    return np.array(rows)


def every(flags: Flags) -> bool:
    """``flags.all()`` at a third of its cost, for use at the control rate."""
    return b"\0" not in flags.tobytes()
