"""The joint controller of one arm: computed torque behind a gate that enforces the limits."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from bt_dualarm.errors import RAISED_BY_SKILLS, Failure, Number
from bt_dualarm.motion.collision.checker import CollisionChecker
from bt_dualarm.motion.control.computed_torque import ComputedTorque
from bt_dualarm.motion.control.force_limit import ForceLimit
from bt_dualarm.motion.control.trouble import hit, left_behind, too_fast
from bt_dualarm.motion.control.way_back import CONTACTS, way_back
from bt_dualarm.motion.safety.guard import ArmGuard
from bt_dualarm.motion.safety.reservation import Reservations
from bt_dualarm.motion.setpoints.limiter import SetPointLimiter
from bt_dualarm.motion.setpoints.set_point import SetPoint, SetPointSource
from bt_dualarm.motion.setpoints.stream_source import Stream, StreamSource
from bt_dualarm.motion.setpoints.trajectory_source import TrajectorySource
from bt_dualarm.motion.timing.point_to_point import point_to_point, stop
from bt_dualarm.motion.timing.trajectory import Trajectory
from bt_dualarm.pose import Vector
from bt_dualarm.world.world import World

LEFT_BEHIND = 0.1
"""Joint error in rad at which a motion is given up: blocked, or beyond the arm's torque."""

OVERSPEED = 1.05
"""Measured speed of a joint, as a share of its limit, at which a motion has failed.

Set-points keep to the limit: an arm that is that fast was pushed, or could not brake.
"""

_STANDSTILL = 0.005  # rad/s: a tool 0.8 m away creeps by less than 4 mm/s


class JointController:
    """Keeps one arm on its set-points; without a motion it holds the last one.

    Args:
        world: World that the arm is in.
        name: Name of the arm.
        period: Seconds between set-points, a multiple of the world's time step.
        reservations: Reservations of all arms of the world; the one that an earlier controller of
            this arm has left there is withdrawn.

    Attributes:
        fault: Exception that ended the last motion; the skill that began it raises it.
        touch: What is known of torques from outside.
        compliance: Whether the arm gives way to what it meets.
    """

    def __init__(self, world: World, name: str, period: float, reservations: Reservations) -> None:
        reservations.withdraw(name)
        self.period = period
        self.fault: BaseException | None = None
        self._world, self._robot = world, world.robots[name]
        self._hardware, self._nominal = world.hardware[name], world.nominal[name]
        self._limiter = SetPointLimiter(self._robot.limits, period, world.hardware[name].q)
        self._name = name
        self._motion: SetPointSource | None = None
        self._followed: SetPointSource | None = None
        self._may_touch = False
        self._guard = ArmGuard(world, name, period, reservations)
        self._torque = ComputedTorque(world, name, period)
        self.touch, self.compliance = self._torque.touch, self._torque.compliance
        self._force = ForceLimit(world, name, self.touch)
        self._hold = self.setpoint

    @property
    def setpoint(self) -> SetPoint:
        """The last set-point that was sent: where the next motion has to begin."""
        return self._limiter.sent

    @property
    def clipped(self) -> int:
        """How many set-points broke a limit and were bent."""
        return self._limiter.clipped

    @property
    def saturated(self) -> int:
        """How often the joints' efforts did not suffice."""
        return self._torque.saturated

    @property
    def guard(self) -> Mapping[str, Number]:
        """What the guard has seen and done so far, as in `GuardReport`."""
        self._guard.report.saturated = self.saturated
        return self._guard.report.as_dict()

    @property
    def neighbours(self) -> tuple[str, ...]:
        """Names of the arms that this one can ever come near; the others do not matter to it."""
        return self._guard.neighbours

    @property
    def motion(self) -> SetPointSource | None:
        """What is being followed, None while holding."""
        return self._motion

    @property
    def at_rest(self) -> bool:
        """No motion is commanded and the arm stands still."""
        return self._motion is None and bool((np.abs(self._torque.drift) < _STANDSTILL).all())

    def follow(
        self,
        trajectory: Trajectory,
        *,
        along_path: bool = False,
        may_touch: bool = False,
        compliant: bool = False,
    ) -> TrajectorySource:
        """Begin a motion; it must start where the last set-point was.

        Args:
            trajectory: Trajectory from rest to rest.
            along_path: Whether the tool's path matters, not only its end.
            may_touch: Whether the arm is meant to touch something, so that it minds no hit.
            compliant: Whether it gives way to what it meets, then and afterwards.

        Raises:
            Failure: ``TRACKING_ERROR`` if it starts elsewhere.
        """
        away = float(np.abs(trajectory.start - self.setpoint.q).max())
        if away > 1e-6:
            raise Failure(
                "TRACKING_ERROR",
                f"the motion starts {np.degrees(away):.3g}° from where the arm is",
                start_error_rad=away,
            )
        motion = TrajectorySource(trajectory, along_path)
        self._motion, self.fault = motion, None
        self._followed, self._may_touch = motion, may_touch
        self.compliance.active = compliant
        return motion

    def stream(self, source: Stream, *, may_touch: bool = False) -> None:
        """Follow a stream of set-points until ``stop``; as to ``may_touch``, see ``follow``."""
        jerk = self._robot.limits.jerk
        self._motion = StreamSource(source, self.setpoint, self.period, jerk)
        self._followed, self.fault, self._may_touch = self._motion, None, may_touch
        self.compliance.active = False

    def stop(self) -> None:
        """Brake with bounded jerk and hold; harmless at rest, and where the arm brakes already."""
        self.compliance.hold_force()
        if self._motion is not None and self._motion is not self._followed:
            return
        sent = self.setpoint
        if not sent.v.any() and not sent.a.any():
            self._motion, self._hold = None, sent
            self._guard.rests(sent.q, self._world.time)
            return
        candidates = [stop(sent.q, sent.v, sent.a, self._robot.limits, self.period)]
        if isinstance(self._motion, TrajectorySource):
            on_path = self._motion.halt(self._robot.limits)
            if on_path is not None:
                candidates.insert(0, on_path)
        self._go_on(self._guard.stop(self._motion, candidates, self._world.time))

    def update(self, time: float) -> None:
        """Send the set-point for ``time`` and command the torques for the next step(s).

        Raises:
            DivergenceError: A torque is not a number.
        """
        guard, limiter = self._guard, self._limiter
        if self._motion is not None and self._motion is self._followed:
            self._heed(guard.look(self._motion, limiter.sent, time))
        wanted = self._wanted(time)
        if isinstance(self._motion, StreamSource) and not guard.is_free(time):
            sent = limiter.bend(wanted)
            refusal = guard.permits(self._motion, sent, time)
            if refusal is not None:
                self._heed(refusal)
                sent = limiter.bend(self._wanted(time))
            limiter.sent = self._torque.command(sent, time)
        else:
            limiter.sent = self._torque.send(wanted, limiter, time)
        self._watch(*self._torque.told.tolist())

    def _heed(self, refusal: Failure | None) -> None:
        """Give up the motion if the guard says so."""
        if refusal is None or self.fault is not None:
            return
        self.fault = refusal
        motion = self._motion
        if motion is None or not isinstance(refusal, CONTACTS):
            self.stop()
        else:
            here, v = self._hardware.q, self.setpoint.v
            self._give_in(way_back(motion, refusal, here, v, self._is_free))

    def _is_free(self, q: Vector) -> bool:
        """Whether the arm touches nothing in a configuration, by what is known of the world."""
        return CollisionChecker(self._world, self._name).contact(q) is None

    def _wanted(self, time: float) -> SetPoint:
        motion = self._motion
        if motion is None:
            return self._hold
        if isinstance(motion, TrajectorySource) and motion.along_path:
            motion.measure(self._nominal.tool_position_at(self._hardware.q))
        try:
            wanted = motion.next(time)
        except RAISED_BY_SKILLS as error:
            self.fault = error
            self.stop()
            return self._wanted(time)
        if motion.done:
            self._motion = None
            self._hold = SetPoint(wanted.q, np.zeros_like(wanted.q), np.zeros_like(wanted.q))
            self._guard.rests(wanted.q, time)
        return wanted

    def _watch_speed(self, share: float) -> None:
        """Note how fast the joints are; what is done while one is too fast has failed."""
        report = self._guard.report
        if share > report.fastest_share:
            report.fastest_share = share
        if share > OVERSPEED and self.fault is None:
            self.fault = too_fast(self._robot, np.abs(self._hardware.v) / self._torque.top_speed)
            self.stop()

    def _watch(self, fastest: float, behind: float, square: float) -> None:
        """Give up what presses, is too fast, that many rad behind, or was hit, see `told`."""
        pressed = self._force.look(square)
        if pressed is not None:  # by a link: no force is allowed
            self._heed(self._guard.touch() or pressed)
        self._watch_speed(fastest)
        if self._motion is None:
            return
        if behind > LEFT_BEHIND and self.fault is None:
            self.fault = left_behind(self._robot, self.setpoint.q - self._hardware.q)
            self._give_in(self._hardware.q)
        hits, minds = self._torque.hits, not self._may_touch
        if hits is not None and self._torque.was_hit and minds and self._motion is self._followed:
            jacobian = self._nominal.tool_jacobian_at(self._hardware.q)[:3]
            self._heed(hit(self._robot, hits, jacobian))

    def _give_in(self, q: Vector) -> None:
        """Brake, then let the set-point return to ``q``, where the arm does not push."""
        limits, sent = self._robot.limits, self.setpoint
        here = np.clip(q, limits.lower, limits.upper)
        braking = stop(sent.q, sent.v, sent.a, limits, self.period)
        back = braking.then(point_to_point(braking.q[-1], here, limits, self.period))
        self._go_on(self._guard.stop(self._motion, (back, braking), self._world.time))

    def _go_on(self, motion: Trajectory) -> None:
        """Follow a motion whose first set-point is the one that was sent last."""
        self._motion = TrajectorySource(motion)
        self._motion.next(self._world.time)
        if self._motion.done:
            self._motion, self._hold = None, self.setpoint
