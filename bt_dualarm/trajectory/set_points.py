"""Set-points of a controller: their sources, and the limits that none of them breaks.

`TrajectorySource` and `StreamSource` provide set-points. Time scaling slows a motion down, stops
and resumes it without leaving its path. At a time scale r, the path parameter s (the time on the
motion as planned) advances by r seconds per second. Set-points are then ``q(s)``, ``r q'(s)`` and
``r² q''(s) + r' q'(s)``: the joints stay on their path, and all brake together.

- `SetPointLimiter` is the last stage before the control law: no set-point breaks a limit after it.
- `OnlineStep` computes one step of a time-optimal motion toward a moving reference.
- `feasible`, `stopping_distance` and `displacement_bound` determine what joints can still do.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple, Protocol, TypeAlias, runtime_checkable

import numpy as np
import numpy.typing as npt
import ruckig

from bt_dualarm.core.errors import DivergenceError, Failure
from bt_dualarm.core.pose import Matrix, Vector
from bt_dualarm.kinematics.chain_kernel_arrays import ROUNDING, Stack
from bt_dualarm.robots.robot import JointLimits
from bt_dualarm.trajectory.path_timing import solve_ruckig, stop
from bt_dualarm.trajectory.trajectory import LongTrajectory, Rows, SetPoints, Trajectory, joined

_HEADROOM = 0.9
"""Fraction of the limits that a reference may use, so that the joint can catch up with it."""

Flags: TypeAlias = npt.NDArray[np.bool_]
"""Booleans, one per joint, of shape (dof,)."""


class SetPoint(NamedTuple):
    """Position, velocity and acceleration of the joints: rad, rad/s, rad/s², each (dof,)."""

    q: Vector
    v: Vector
    a: Vector

    def copy(self) -> SetPoint:
        """The same one in arrays of its own."""
        return SetPoint(self.q.copy(), self.v.copy(), self.a.copy())


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
        from bt_dualarm.trajectory.trajectory_kernels import keeps_limits

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
        # Toward the target where that is safe, otherwise to rest. Joints that break no limit pass.
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
        # Limits of the relative motion: absolute limits minus what the reference itself uses.
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
        state = np.array(motion.at_time(self._period))
        # Rounding leaves a velocity after the end of a joint's motion: it would never be at rest.
        state[1:, np.array(motion.independent_min_durations) <= self._period] = 0.0
        return state


def feasible(limits: Matrix, q: Vector, v: Vector, a: Vector) -> Flags:
    """Whether each joint can keep its limits, of shape (5, dof), from a state (q, v, a) on."""
    from bt_dualarm.trajectory.trajectory_kernels import can_stop

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
    from bt_dualarm.trajectory.trajectory_kernels import max_displacement_before_rest

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
    from bt_dualarm.trajectory.trajectory_kernels import max_displacement

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


_LONGER = (1.0, 1.3, 1.7, 2.4, 4.0, 7.0)
"""Duration factors of a time scale change that are tried in turn, relative to what the joint speeds
alone would allow."""

_LOWER = (0.8, 0.5)
"""Shares of a higher time scale that are tried in turn where it is out of reach: where the motion
as planned needs all of an acceleration limit, nothing is left for the change."""

_MAX_RATE = 25.0
"""Upper bound of the time scale's rate of change, 1/s: at rest, the joints impose none."""

_MAX_RATE_CHANGE = 600.0
"""Upper bound of the change of that rate, 1/s²."""

_AHEAD_S = 0.4
"""Planned time ahead whose joint speeds bound a change of the time scale, s."""

_RUN_OUT_S = 0.8
"""Remaining time below which a motion that cannot be stopped may run to its end, s."""

_JERK_SHARE = 0.9
"""Fraction of the jerk limit for a change; rounding to the grid of set-points takes the rest."""

_BACK_S = 0.01
"""Planned time by which a motion may go back on its path: while its time scale falls to zero, a new
stop can take it slightly below, because the joints ahead have become faster, s."""

_SPARSE = 8.0
"""Spacing in set-points above which a long motion is evaluated one set-point at a time."""

_ROUNDING = 1.0 + 1e-6
"""Factor of the limits, as a tolerance for floating-point rounding."""

_PIECE = 25
"""Number of set-points at a constant time scale that are computed at a time."""

_LEAD_S = 0.01
"""Lead over its partner up to which a motion is not slowed down, s."""

_CATCH_UP = 4.0
"""Reduction of the time scale per second of lead, 1/s."""

_LEAST_SHARE = 0.1
"""Minimum share of its time scale to which a partner slows a motion down."""

_MAX_MEASURED = 8192
"""Largest number of measured tool positions that are stored until they are taken."""

STALE_S = 0.1
"""Time for which an arm coasts without a new set-point of its stream, s."""

Stream: TypeAlias = Callable[[float], SetPoint | None]
"""Returns the set-point for a simulated time in s; called once per control period.

None, or the same set-point again while the arm moves, means that there is no new one.
"""


class TrajectorySource:
    """Follows a trajectory at a time scale that may change; stores measured tool positions.

    Args:
        trajectory: Trajectory from rest to rest.
        along_path: Whether the tool's path matters, not only its end.
        most_scale: Largest time scale, above 0 to 1.

    Attributes:
        goal_scale: Time scale that it has, or is changing to.
        most_scale: Largest time scale that the guard may give it: less than 1 if another arm cannot
            keep up.
        tool_avoids_payloads: Whether the tool avoids what other arms hold.
        waits: Whether it stays at its first set-point until it may begin.
        seconds: Time that it takes together with that of its partner, s; 0 without one.
        partner: Motion of another arm that is to take the same time, if there is one.
        held_since: Simulated time since which the guard holds it, s; None while it moves.
        held_up: Reason for which it is held.
        leaves_path: Whether the reserved braking trajectory leaves the path.
    """

    def __init__(
        self, trajectory: Trajectory, along_path: bool = False, most_scale: float = 1.0
    ) -> None:
        self.trajectory = trajectory
        self.along_path = along_path
        self.goal_scale = most_scale
        self.most_scale = most_scale
        self.tool_avoids_payloads = False
        self.waits = False
        self.seconds = 0.0
        self.partner: TrajectorySource | None = None
        self._share = _Share()
        self._share_before = self._share
        self._left_before = _Left()
        self.held_since: float | None = None
        self.held_up = ""
        self.leaves_path = False
        self._measured: deque[tuple[Vector, float]] = deque(maxlen=_MAX_MEASURED)
        self._position: Vector | None = None
        self._next = 0
        self._count = len(trajectory)
        self._ahead: ScaledPiece | None = None
        self._row = 0
        self._reserved = False
        if most_scale < 1.0:
            self.cap(most_scale)

    @property
    def done(self) -> bool:
        """Whether the last set-point has been sent."""
        if self.waits:
            return False
        if self._ahead is not None:
            along: float = self._ahead.parameters.item(self._row, 0)
            return along >= self.trajectory.duration
        return self._next >= self._count

    @property
    def progress(self) -> float:
        """Fraction of the motion that was sent, in [0, 1]."""
        if self._ahead is not None:
            return min(self.parameter.s / max(self.trajectory.duration, 1e-9), 1.0)
        return self._next / len(self.trajectory)

    @property
    def parameter(self) -> PathParameter:
        """Path parameter of the last set-point."""
        if self._ahead is None:
            return PathParameter(max(self._next - 1, 0) * self.trajectory.dt)
        return PathParameter(*self._ahead.parameters[self._row].tolist())

    @property
    def changing(self) -> bool:
        """Whether its time scale is being changed."""
        return self.parameter.scale != self.goal_scale

    @property
    def braking(self) -> Trajectory | None:
        """Reserved braking trajectory from the last set-point on; None if there is none."""
        if self._ahead is None or not self._reserved:
            return None
        rows = self._ahead.motion
        i = self._row
        return Trajectory(rows.dt, rows.q[i:], rows.v[i:], rows.a[i:])

    def cap(self, most_scale: float) -> None:
        """Reduce the largest time scale; before the first set-point also the current one."""
        self.most_scale = most_scale
        if self._next == 0 and self._row == 0:
            # At rest, another time scale changes neither velocity nor acceleration.
            start = np.array(((0.0, most_scale, 0.0),))
            self._ahead = ScaledPiece(start, sampled_at(self.trajectory, start), most_scale)
            self.goal_scale = most_scale

    def paced(self, scale: float, time: float) -> float:
        """Time scale that the largest one and the partner of this motion allow.

        The partner's state is that before this control period, whichever controller is updated
        first. A partner that is held up does not stop this motion, which may be in its way.

        Args:
            scale: Time scale that the surroundings of this arm allow.
            time: Simulated time, s.
        """
        most = self.most_scale
        other = self.partner
        if other is None:
            return min(scale, most)
        self.note_share(scale / most, time)
        lead_s = other.left_before(time) - self.left_before(time)
        slower = 1.0 - _CATCH_UP * max(lead_s - _LEAD_S, 0.0)
        return min(scale, most * max(min(other.share_before(time), slower), _LEAST_SHARE))

    def note_share(self, share: float, time: float) -> None:
        """Note for the partner which share of its largest time scale this motion may have."""
        if time > self._share.time:
            self._share_before = self._share
        self._share = _Share(time, min(share, 1.0))

    def share_before(self, time: float) -> float:
        """Share that `note_share` noted last before a simulated time in s."""
        share = self._share if self._share.time < time else self._share_before
        return share.share

    def left_before(self, time: float) -> float:
        """What was left of `seconds` before the set-point for a simulated time in s."""
        before = self._left_before
        return before.seconds if before.time == time else (1.0 - self.progress) * self.seconds

    def measure(self, position: Vector) -> None:
        """Store the measured tool position, of shape (3,), m, at the time of the next set-point."""
        self._position = position

    def take_measured(self) -> list[tuple[Vector, float]]:
        """Measurements since the last call, at most `_MAX_MEASURED` (half a minute).

        Returns:
            Pairs of a tool position, of shape (3,), m, and the path parameter at that time, s.
        """
        taken = list(self._measured)
        self._measured.clear()
        return taken

    def next(self, time: float) -> SetPoint:
        """Next set-point, for a simulated time in s."""
        if self.waits:
            return SetPoint(*self.trajectory.set_point(0))
        if self.partner is not None:
            self._left_before = _Left(time, (1.0 - self.progress) * self.seconds)
        if self._ahead is not None:
            return self._next_ahead(self._ahead)
        i = min(self._next, self._count - 1)
        self._next += 1
        self._note(i * self.trajectory.dt)
        return SetPoint(*self.trajectory.set_point(i))

    def change_scale(self, scale: float, limits: JointLimits) -> bool:
        """Begin to change the time scale; return whether the limits allow it.

        Args:
            scale: Desired time scale; 0 stops on the path.
            limits: Limits that no set-point may exceed.
        """
        change = change_scale(self.trajectory, self.parameter, scale, limits)
        if change is None:
            return False
        # A reserved braking trajectory is dropped with the piece that it ended.
        self._ahead = change
        self._row = 0
        self._reserved = False
        self.goal_scale = change.goal
        self.leaves_path = False
        return True

    def to_rest_after(self, count: int, scale: float, limits: JointLimits) -> ScaledPiece | None:
        """The next ``count`` set-points, changing to a time scale, then to rest on the path.

        None if that is not possible within the limits.
        """
        return to_rest_after(self.trajectory, self.parameter, scale, count, limits)

    def to_brake_after(self, count: int, limits: JointLimits) -> ScaledPiece | None:
        """The next ``count`` set-points, then each joint to rest by itself, leaving the path.

        None while the time scale is changing.
        """
        now = self.parameter
        if now.change:
            return None
        return brake_after(self.trajectory, now, count, limits)

    def take(self, ahead: ScaledPiece, *, leaves_path: bool = False) -> None:
        """Follow a reserved piece, which ends at rest unless it is replaced before.

        Args:
            ahead: Piece from the last set-point on.
            leaves_path: Whether its end leaves the path.
        """
        self._ahead = ahead
        self._row = 0
        self._reserved = True
        self.goal_scale = ahead.goal
        self.leaves_path = leaves_path

    def halt(self, limits: JointLimits) -> Trajectory | None:
        """Stop on the path from the last set-point on; None if none was found."""
        change = change_scale(self.trajectory, self.parameter, 0.0, limits)
        return None if change is None else change.motion

    def configuration(self, s: float) -> Vector:
        """Joint positions, of shape (dof,), rad, at the set-point nearest to a path parameter."""
        row = min(round(s / self.trajectory.dt), len(self.trajectory) - 1)
        return self.trajectory.set_point(row)[0]

    def _note(self, parameter: float) -> None:
        if self._position is not None:
            self._measured.append((self._position, parameter))

    def _next_ahead(self, ahead: ScaledPiece) -> SetPoint:
        self._row += 1
        if self._row >= len(ahead.parameters):
            last = PathParameter(*ahead.parameters[-1].tolist())
            parameters = keep_scale(self.trajectory, last, _PIECE)
            rows = sampled_at(self.trajectory, parameters)
            ahead = ScaledPiece(parameters, rows, last.scale)
            self._ahead = ahead
            self._row = 1
        self._note(ahead.parameters.item(self._row, 0))
        return SetPoint(*ahead.motion.set_point(self._row))


@dataclass(frozen=True)
class _Share:
    """How fast the surroundings of a motion let it be, for its partner.

    Attributes:
        time: Simulated time, s.
        share: Fraction of its largest time scale that they allow.
    """

    time: float = -1.0
    share: float = 1.0


@dataclass(frozen=True)
class _Left:
    """What was left of a motion, for its partner.

    Attributes:
        time: Simulated time of a set-point, s.
        seconds: Time that the motion still took before that set-point, s.
    """

    time: float = -1.0
    seconds: float = 0.0


@runtime_checkable
class ScalableStream(Protocol):
    """Stream that can be slowed down."""

    time_scale: float
    """Fraction of its normal speed, in [0, 1]."""


class StreamSource:
    """Follows a stream of set-points; coasts through gaps, and fails when the stream is stale.

    Args:
        stream: Function that returns the set-points.
        sent: The last set-point that was sent.
        period: Seconds between set-points.
        jerk: Jerk limits, of shape (dof,), rad/s³.

    Attributes:
        braking: Reserved braking trajectory from the last set-point on; None if there is none.
    """

    done = False

    def __init__(self, stream: Stream, sent: SetPoint, period: float, jerk: Vector) -> None:
        self.braking: Trajectory | None = None
        self._stream = stream
        self._scalable = stream if isinstance(stream, ScalableStream) else None
        self._given: SetPoint | None = None
        self._next = sent
        self._period = period
        self._change = jerk * period
        self._old = 0

    def next(self, time: float) -> SetPoint:
        """Set-point for the current time; without a new one the arm coasts.

        Raises:
            Failure: ``STALE`` without a new set-point for `STALE_S`.
            TypeError: The stream returns something else, or arrays of another shape.
        """
        given = self._stream(time)
        if given is not None and not self._fits(given):
            raise TypeError(
                f"a stream returns a SetPoint, whose q, v and a are arrays of shape "
                f"{self._next.q.shape}, or None; this one returns {given!r:.120}"
            )
        # The same object again is an old set-point, unless it is one of rest.
        if given is not None and (given is not self._given or not given.v.any()):
            self._given = self._next = given
            self._old = 0
            return given
        self._old += 1
        if self._old * self._period > STALE_S:
            waited = self._old * self._period
            raise Failure("STALE", f"no new set-point for {waited:.2f} s", waited_s=waited)
        self._next = self._coasting()
        return self._next

    def _fits(self, given: object) -> bool:
        """Whether it is a set-point of this arm: streams are written by users."""
        if not isinstance(given, SetPoint):
            return False
        try:
            return given.q.shape == given.v.shape == given.a.shape == self._next.q.shape
        except AttributeError:  # lists
            return False

    def change_scale(self, scale: float) -> bool:
        """Set the stream's time scale, if it has one; return whether that is a change."""
        if self._scalable is None or self._scalable.time_scale == scale:
            return False
        self._scalable.time_scale = scale
        return True

    def _coasting(self) -> SetPoint:
        """Extrapolated set-point: the acceleration fades at the jerk limit."""
        last = self._next
        dt = self._period
        a = last.a - np.clip(last.a, -self._change, self._change)
        v = last.v + 0.5 * (last.a + a) * dt
        return SetPoint(last.q + 0.5 * (last.v + v) * dt, v, a)


@dataclass(frozen=True)
class PathParameter:
    """Position of a motion on its path, and its speed along it.

    Attributes:
        s: Time since the beginning of the motion as planned, s.
        scale: Time scale ds/dt.
        change: Rate of change of the time scale, 1/s.
    """

    s: float
    scale: float = 1.0
    change: float = 0.0


@dataclass(frozen=True, eq=False)
class ScaledPiece:
    """Piece of a motion at a changing time scale; its first row is the current set-point.

    Attributes:
        parameters: Path parameters, of shape (n, 3): s, time scale, its change.
        motion: Set-points at these parameters.
        goal: Time scale that it changes to, before it comes to rest if it does.
    """

    parameters: Matrix
    motion: Trajectory
    goal: float


def change_scale(
    motion: Trajectory, begin: PathParameter, scale: float, limits: JointLimits
) -> ScaledPiece | None:
    """Fastest change to another time scale that keeps the limits; None if none was found.

    Args:
        motion: Motion as planned.
        begin: Current path parameter.
        scale: Desired time scale in [0, 1].
        limits: Velocity, acceleration and jerk limits that no set-point may exceed.
    """
    rate, jerk = _bounds(motion, begin, limits)
    for longer in _LONGER:
        try:
            parameters = _profile(begin, scale, (rate / longer, jerk / longer**2), motion.dt)
        except Failure:  # Ruckig found no root; it may find one for a slower change
            continue
        if parameters[:, 0].min() < max(begin.s - _BACK_S, 0.0):
            # While the time scale falls, a slower change would let it fall far below zero first.
            continue
        rows = _sampled(motion, parameters)
        if keeps_rates(rows, motion.dt, limits):
            return ScaledPiece(parameters, Trajectory(motion.dt, *rows), scale)
    return None


def to_rest_after(
    motion: Trajectory, begin: PathParameter, scale: float, count: int, limits: JointLimits
) -> ScaledPiece | None:
    """The next ``count`` set-points, changing to a time scale, then to rest on the path.

    If the time scale cannot change, it is kept. Near its end, a motion rests soonest at its end.
    None if the time scale is changing and cannot change back, or if it takes too long to rest.
    """
    ahead = _advance(motion, begin, scale, count, limits)
    if ahead is None:
        return None
    parameters, goal = ahead
    last = PathParameter(*parameters[-1].tolist())
    change = change_scale(motion, last, 0.0, limits)
    if change is not None:
        tail = change.parameters
    else:
        # It cannot stop on the path before its end: let it run out if that is near.
        steps = (motion.duration - last.s) / max(last.scale * motion.dt, 1e-9)
        if last.change or steps > round(_RUN_OUT_S / motion.dt):
            return None
        tail = keep_scale(motion, last, int(np.ceil(steps)))
    whole = np.vstack((parameters, tail[1:]))
    return ScaledPiece(whole, sampled_at(motion, whole), goal)


def _advance(
    motion: Trajectory, begin: PathParameter, scale: float, count: int, limits: JointLimits
) -> tuple[Matrix, float] | None:
    """Path parameters of the next set-points, changing to a time scale; and the one reached."""
    change = None
    if begin.scale != scale or begin.change:
        change = change_scale(motion, begin, scale, limits)
        # Otherwise a motion at rest would remain there: nothing changes until it moves on. Changes
        # of a falling time scale could each take the motion back a little.
        for share in _LOWER if scale > begin.scale and begin.change >= 0.0 else ():
            change = change or change_scale(motion, begin, share * scale, limits)
        if change is None and begin.change:
            return None
    if change is None:
        return keep_scale(motion, begin, count), begin.scale
    parameters = change.parameters[: count + 1]
    last = PathParameter(*parameters[-1].tolist())
    more = count + 1 - len(parameters)
    return np.vstack((parameters, keep_scale(motion, last, more)[1:])), change.goal


def brake_after(
    motion: Trajectory, begin: PathParameter, count: int, limits: JointLimits
) -> ScaledPiece:
    """The next ``count`` set-points at the same time scale, then each joint to rest by itself.

    Braking leaves the path; s stays constant meanwhile.
    """
    parameters = keep_scale(motion, begin, count)
    rows = sampled_at(motion, parameters)
    rows = rows.then(stop(rows.q[-1], rows.v[-1], rows.a[-1], limits, motion.dt))
    off = np.broadcast_to((parameters[-1, 0], 0.0, 0.0), (len(rows) - len(parameters), 3))
    return ScaledPiece(np.vstack((parameters, off)), rows, begin.scale)


def keep_scale(motion: Trajectory, begin: PathParameter, count: int) -> Matrix:
    """Path parameters at a constant time scale, of shape (count + 1, 3), from ``begin`` on."""
    parameters = np.tile((begin.s, begin.scale, 0.0), (count + 1, 1))
    parameters[:, 0] += np.arange(count + 1) * (begin.scale * motion.dt)
    return parameters


def at_scale(motion: Trajectory, scale: float) -> Trajectory:
    """The whole motion at a constant time scale in (0, 1]."""
    return joined(motion.dt, (_AtScale(motion, scale),))


@dataclass(frozen=True, eq=False)
class _AtScale:
    """Motion at a constant time scale, see `TrajectoryProtocol`."""

    motion: Trajectory
    scale: float

    def __len__(self) -> int:
        return int(np.ceil(self.motion.duration / (self.scale * self.motion.dt))) + 1

    def rows(self, index: Rows) -> SetPoints:
        """Positions, velocities and accelerations of some set-points, each of shape (n, dof)."""
        parameters = np.tile((0.0, self.scale, 0.0), (len(index), 1))
        parameters[:, 0] += index * (self.scale * self.motion.dt)
        slower = sampled_at(self.motion, parameters)
        return slower.q, slower.v, slower.a


def sampled_at(motion: Trajectory, parameters: Matrix) -> Trajectory:
    """Set-points of a motion at path parameters, of shape (n, 3): s, time scale, its change."""
    return Trajectory(motion.dt, *_sampled(motion, parameters))


def _sampled(motion: Trajectory, parameters: Matrix) -> Stack:
    """Positions, velocities and accelerations at path parameters, of shape (3, n, dof)."""
    from bt_dualarm.trajectory.trajectory_kernels import scale

    parameters = np.ascontiguousarray(parameters)
    far = _SPARSE * len(parameters) * motion.dt
    if isinstance(motion, LongTrajectory) and far < np.ptp(parameters[:, 0]):
        return _sampled_apart(motion, parameters)
    first, rows = motion.around(parameters[:, 0])
    count = len(motion)
    scaled = np.empty((3, len(parameters), rows[0].shape[1]))
    scale(*rows, first, count, motion.dt, parameters, scaled)
    return scaled


def _sampled_apart(motion: Trajectory, parameters: Matrix) -> Stack:
    """Result of `_sampled` for a long motion, evaluated only next to the parameters."""
    from bt_dualarm.trajectory.trajectory_kernels import scale

    count = len(motion)
    place = np.clip(parameters[:, 0] / motion.dt, 0.0, count - 1.0)
    first = np.minimum(place.astype(int), count - 2)
    pairs = np.array(motion.rows(np.column_stack((first, first + 1)).ravel()))
    pairs = pairs.reshape(3, len(first), 2, -1).swapaxes(0, 1).copy()
    scaled = np.empty_like(pairs[:, :, :1])
    for i, (q, v, a) in enumerate(pairs):
        scale(q, v, a, int(first[i]), count, motion.dt, parameters[i : i + 1], scaled[i])
    return np.ascontiguousarray(scaled[:, :, 0].swapaxes(0, 1))


def _bounds(motion: Trajectory, begin: PathParameter, limits: JointLimits) -> tuple[float, float]:
    """Bounds of r' and r'' in 1/s and 1/s², from ``r' q' <= acceleration``, ``r'' q' <= jerk``."""
    # The fastest joint speed ahead, in case the change takes that long.
    first = min(int(begin.s / motion.dt), len(motion) - 1)
    end = min(first + round(_AHEAD_S / motion.dt), len(motion))
    speed = np.abs(motion.piece(first, end).v).max(axis=0) + 1e-9
    rate = min(float((limits.acceleration / speed).min()), _MAX_RATE)
    jerk = min(float((_JERK_SHARE * limits.jerk / speed).min()), _MAX_RATE_CHANGE)
    return rate, jerk


def _profile(begin: PathParameter, scale: float, bounds: tuple[float, float], dt: float) -> Matrix:
    """Path parameters until a time scale is reached, of shape (n, 3).

    Args:
        begin: Path parameter of the first row.
        scale: Time scale of the last row.
        bounds: Bounds of the time scale's rate of change in 1/s, and of its change in 1/s².
        dt: Seconds between rows.
    """
    request = ruckig.InputParameter(1)
    request.control_interface = ruckig.ControlInterface.Velocity
    request.current_position = [begin.s]
    request.current_velocity = [begin.scale]
    request.current_acceleration = [begin.change]
    request.target_velocity = [scale]
    request.target_acceleration = [0.0]
    request.max_velocity = [2.0]  # never reached: time scales are at most 1
    # The current rate must be within the limits of the request.
    request.max_acceleration = [max(bounds[0], abs(begin.change))]
    motion = solve_ruckig(request, np.array(bounds[1:]))
    grid = np.arange(int(np.ceil(motion.duration / dt - 1e-9)) + 1) * dt
    states = map(motion.at_time, np.minimum(grid, motion.duration).tolist())
    rows = np.array([(s[0], rate[0], change[0]) for s, rate, change in states])
    # Ruckig holds the state at its end; the motion continues from there.
    rows[-1] = (rows[-1, 0] + max(grid[-1] - motion.duration, 0.0) * scale, scale, 0.0)
    return rows


def keeps_rates(rows: Stack, dt: float, limits: JointLimits) -> bool:
    """Whether a motion keeps the velocity, acceleration and jerk limits of all joints.

    Args:
        rows: Positions, velocities and accelerations, of shape (3, n, dof).
        dt: Seconds between set-points.
        limits: Joint limits.
    """
    from bt_dualarm.trajectory.trajectory_kernels import within

    most = np.array((limits.velocity, limits.acceleration, limits.jerk))
    return within(rows, dt, _ROUNDING, most)


def warm_up_limiter() -> None:
    """Compile the kernels of the limits, by calling them with arrays of the final types."""
    from bt_dualarm.trajectory import trajectory_kernels

    limits = np.ones((5, 1))
    state = np.ones((3, 1))
    trajectory_kernels.keeps_limits(limits, 1.0, state, state)
    trajectory_kernels.can_stop(limits, 0, 1.0, 1.0, 1.0)
    trajectory_kernels.max_displacement_before_rest(1.0, 1.0, 1.0, 1.0)
    trajectory_kernels.max_displacement(limits, 0, 1.0, 1.0, 1.0)
    trajectory_kernels.within(np.ones((3, 1, 1)), 1.0, 1.0, state)
