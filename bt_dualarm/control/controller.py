"""Joint controller of one arm: follows motions through the guard and the set-point limiter."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Final

import numpy as np

from bt_dualarm.collision.checker import CollisionChecker
from bt_dualarm.control.collision_detection import CollisionDetector
from bt_dualarm.control.computed_torque import ComputedTorque, ForceLimit
from bt_dualarm.core.errors import (
    RAISED_BY_SKILLS,
    CollisionDetectedFailure,
    Failure,
    ForceLimitFailure,
    Number,
    TouchFailure,
)
from bt_dualarm.core.pose import Matrix, Vector
from bt_dualarm.robots.robot import Robot
from bt_dualarm.safety.failsafe import Reservations
from bt_dualarm.safety.guard import ArmGuard
from bt_dualarm.sim.world import World
from bt_dualarm.trajectory.coupled import CoupledSource
from bt_dualarm.trajectory.path_timing import point_to_point, stop
from bt_dualarm.trajectory.set_points import (
    SetPoint,
    SetPointLimiter,
    SetPointSource,
    Stream,
    StreamSource,
    TrajectorySource,
)
from bt_dualarm.trajectory.trajectory import Trajectory

_AFFECTED: Final = 0.5
"""Fraction of its threshold at which a joint counts as affected by a detected collision."""

CONTACTS = (TouchFailure, ForceLimitFailure, CollisionDetectedFailure)
"""Failures after which an arm retreats, instead of only stopping."""

BACK_OFF_S = 0.1
"""Planned time by which an arm retreats along its motion after a contact, s."""

RECOIL_RAD = 0.02
"""Minimum retreat of the joint that moves farthest after too much force, rad. With less, only the
set-point returns: the observer compensates the contact force, and the arm keeps pressing."""

MAX_POSITION_ERROR = 0.1
"""Joint position error at which a motion fails, rad: the arm is blocked, or lacks torque."""

OVERSPEED = 1.05
"""Measured joint speed, as a fraction of its limit, at which a motion fails. Set-points keep the
limit: an arm that is that fast was pushed, or could not brake."""

OVERSPEED_RAD_S = 0.05
"""Speed beyond the limit at which a motion fails at the earliest, rad/s: in `rough`, friction that
was not foreseen lets a joint be too fast by up to 0.04 rad/s, however low its limit is."""

OVERSPEED_S = 0.02
"""Time for which a joint must be that fast, s. One that breaks away from dry friction is too
fast for up to 15 ms (an FR3 in `rough`, by 0.06 rad/s); one that was pushed remains so."""

_CRAWL = 0.01
"""Fraction of the velocity limits below which a stop need not be on the path: it is the shortest,
and deviates by some micrometers."""

_STANDSTILL = 0.005
"""Joint speed that counts as rest, rad/s: a tool at 0.8 m moves by less than 4 mm/s."""

_STILL = 0.02
"""The same for a speed that is not averaged, and therefore has noise, rad/s."""


class JointController:
    """Joint controller of one arm: follows motions, and holds the last set-point without one.

    Each period passes through the guard (may the motion continue?), the motion source (the next
    set-point), the limiter (joint limits) and the control law (torques).

    Args:
        world: World that contains the arm.
        name: Name of the arm.
        period: Seconds between set-points, a multiple of the world's time step.
        reservations: Reservations of all arms of the world; a reservation left by a previous
            controller of this arm is withdrawn.

    Attributes:
        fault: Exception that ended the last motion; raised by the skill that started it.
        touch: Momentum observer, which estimates external torques.
        compliance: Compliance of the arm.
    """

    def __init__(self, world: World, name: str, period: float, reservations: Reservations) -> None:
        reservations.withdraw(name)
        self.period = period
        self.fault: BaseException | None = None
        self._world = world
        self._robot = world.robots[name]
        self._hardware = world.hardware[name]
        self._nominal = world.nominal[name]
        self._limiter = SetPointLimiter(self._robot.limits, period, world.hardware[name].q)
        self._name = name
        self._motion: SetPointSource | None = None
        self._followed: SetPointSource | None = None
        self._may_touch = False
        self._guard = ArmGuard(world, name, period, reservations)
        self._torque = ComputedTorque(world, name, period)
        self.touch = self._torque.touch
        self.compliance = self._torque.compliance
        self._force = ForceLimit(world, name, self.touch)
        self._too_fast_steps = 0
        self._hold = self.setpoint
        self._sent_s = world.time - period
        self._before = self.setpoint
        self._before_s = self._sent_s

    @property
    def setpoint(self) -> SetPoint:
        """The last set-point that was sent: where the next motion must begin."""
        return self._limiter.sent

    def commanded_at(self, time: float) -> SetPoint:
        """Set-point for a simulated time in s, extrapolated from the last one that is older.

        Another arm's controller that asks for it in its own update gets the same result before and
        after the update of this one.
        """
        sent = self.setpoint
        age = time - self._sent_s
        if age < 0.5 * self.period:
            sent = self._before
            age = time - self._before_s
        if not sent.v.any() and not sent.a.any():
            return sent
        v = sent.v + age * sent.a
        return SetPoint(sent.q + (0.5 * age) * (sent.v + v), v, sent.a)

    @property
    def clipped(self) -> int:
        """Number of set-points that broke a limit and were limited."""
        return self._limiter.clipped

    @property
    def saturated(self) -> int:
        """Number of periods in which torques were scaled down to the effort limits."""
        return self._torque.saturated

    def naming_efforts(self, failure: Failure) -> Failure:
        """Returns a failure to follow, with the joints that apply their whole effort."""
        return self._torque.naming_efforts(failure)

    @property
    def guard(self) -> Mapping[str, Number]:
        """Report of the guard so far, see `GuardReport`."""
        self._guard.report.saturated = self.saturated
        return self._guard.report.as_dict()

    @property
    def neighbors(self) -> tuple[str, ...]:
        """Names of the arms whose workspace this arm can approach."""
        return self._guard.neighbors

    def in_reach(self, within: float) -> frozenset[str]:
        """Names of those that are within a distance in m of where this arm can come now."""
        return self._guard.in_reach(within)

    @property
    def motion(self) -> SetPointSource | None:
        """Motion that is being followed, None while holding."""
        return self._motion

    @property
    def at_rest(self) -> bool:
        """Whether no motion is commanded and the arm is at rest.

        The gate of the set-points may still be some periods behind the end of a motion.
        """
        return (
            self._motion is None
            and not self.setpoint.v.any()
            and bool((np.abs(self._torque.mean_velocity) < _STANDSTILL).all())
        )

    @property
    def is_still(self) -> bool:
        """Whether the arm is at rest, and no joint lags behind a motion that has just ended."""
        return self.at_rest and bool((np.abs(self._torque.observer.v) < _STILL).all())

    def breakaway_s(self, error: float) -> float:
        """Time until no joint is kept ``error`` rad from its set-point; see `ComputedTorque`."""
        return self._torque.breakaway_s(error)

    def follow(
        self,
        trajectory: Trajectory,
        *,
        along_path: bool = False,
        may_touch: bool = False,
        compliant: bool = False,
        most_scale: float = 1.0,
    ) -> TrajectorySource:
        """Start following a trajectory; it must begin at the last set-point, and with its velocity.

        Args:
            trajectory: Trajectory from rest to rest.
            along_path: Whether the tool's path matters, not only its end.
            may_touch: Whether contact is intended: collision detection is disabled.
            compliant: Whether the arm is compliant, during the motion and afterwards.
            most_scale: Largest time scale of the motion, above 0 to 1.

        Raises:
            Failure: ``TRACKING_ERROR`` if it starts elsewhere, or at rest while the arm moves.
        """
        self._refuse_elsewhere(trajectory)
        motion = TrajectorySource(trajectory, along_path, most_scale)
        self._follow(motion, may_touch=may_touch, compliant=compliant)
        return motion

    def follow_with_others(self, motion: CoupledSource, *, compliant: bool = False) -> None:
        """Start following this arm's part of a coupled motion; contact is intended.

        Args:
            motion: Set-points of this arm; the first one is the last that was sent.
            compliant: Whether the arm is compliant, during the motion and afterwards.

        Raises:
            Failure: ``TRACKING_ERROR`` if it starts elsewhere, or at rest while the arm moves.
        """
        self._refuse_elsewhere(motion.trajectory)
        self._follow(motion, may_touch=True, compliant=compliant)

    def _follow(self, motion: TrajectorySource, *, may_touch: bool, compliant: bool) -> None:
        self._motion = motion
        self.fault = None
        self._followed = motion
        self._may_touch = may_touch
        self.compliance.active = compliant

    def expect_contact(self, *, compliant: bool = True) -> None:
        """Disable collision detection in the middle of a motion.

        Args:
            compliant: Whether the arm becomes compliant, see `Compliance.begin_moving`.
        """
        self._may_touch = True
        if compliant:
            self.compliance.begin_moving()

    def expect_no_contact(self) -> None:
        """Become stiff in the middle of a motion, with collision detection from now on."""
        self._may_touch = False
        self.compliance.active = False

    def _refuse_elsewhere(self, trajectory: Trajectory) -> None:
        q, v, _ = trajectory.set_point(0)
        away = float(np.abs(q - self.setpoint.q).max())
        if away > 1e-6:
            raise Failure(
                "TRACKING_ERROR",
                f"the motion starts {np.degrees(away):.3g}° from where the arm is",
                start_error_rad=away,
            )
        # The gate would let the arm leave the path, and with it what was checked and reserved.
        faster = float(np.abs(v - self.setpoint.v).max())
        if faster > 1e-6:
            raise Failure(
                "TRACKING_ERROR",
                f"the motion starts at rest, but the arm moves at {np.degrees(faster):.3g}°/s: "
                "a skill waits with arm.come_to_rest()",
                start_error_rad_s=faster,
            )

    def stream(self, source: Stream, *, may_touch: bool = False) -> None:
        """Follow a stream of set-points until ``stop``; ``may_touch`` as in ``follow``."""
        jerk = self._robot.limits.jerk
        self._motion = StreamSource(source, self.setpoint, self.period, jerk)
        self._followed = self._motion
        self.fault = None
        self._may_touch = may_touch
        self.compliance.active = False

    def stop(self) -> None:
        """Brake with bounded jerk and hold; no effect at rest or while the arm already brakes."""
        self.compliance.hold_force()
        if self._motion is not None and self._motion is not self._followed:
            return
        sent = self.setpoint
        if not sent.v.any() and not sent.a.any():
            self._motion = None
            self._hold = sent
            self._guard.rests(sent.q, self._world.time)
            return
        limits = self._robot.limits
        candidates = [stop(sent.q, sent.v, sent.a, limits, self.period)]
        # The shortest stop leaves the path, but at such a low speed only by micrometers.
        crawls = bool((np.abs(sent.v) <= _CRAWL * limits.velocity).all())
        if isinstance(self._motion, TrajectorySource):
            on_path = self._motion.halt(limits)
            if on_path is not None:
                candidates.insert(1 if crawls else 0, on_path)
        self._switch_to(self._guard.stop(self._motion, candidates, self._world.time))

    def update(self, time: float) -> None:
        """Send the set-point for ``time`` and command the torques until the next one.

        Raises:
            DivergenceError: A torque is not finite.
        """
        guard = self._guard
        limiter = self._limiter
        self._before = limiter.sent
        self._before_s = self._sent_s
        self._sent_s = time
        if self._motion is not None and self._motion is self._followed:
            self._abort(guard.look(self._motion, limiter.sent, time))
        desired = self._desired(time)
        if isinstance(self._motion, StreamSource) and not guard.is_free(time):
            # The guard judges set-points of a stream one by one, after limiting.
            sent = limiter.limited(desired)
            refusal = guard.permits(self._motion, sent, time)
            if refusal is not None:
                self._abort(refusal)
                sent = limiter.limited(self._desired(time))
            limiter.sent = self._torque.command(sent, time)
        else:
            limiter.sent = self._torque.send(desired, limiter, time)
        self._monitor(*self._torque.telemetry.tolist())

    def _abort(self, refusal: Failure | None) -> None:
        """Abort the motion because of a failure, if there is one: stop, or retreat from contact."""
        if refusal is None or self.fault is not None:
            return
        self.fault = refusal
        motion = self._motion
        alone = not isinstance(motion, CoupledSource)  # a retreat would tear at the object
        if motion is None or not (alone and isinstance(refusal, CONTACTS)):
            self.stop()
        else:
            q = self._hardware.q
            v = self.setpoint.v
            self._retreat(retreat_target(motion, refusal, q, v, self._is_free))

    def _is_free(self, q: Vector) -> bool:
        """Whether a configuration is free of collisions in the sensed world."""
        return CollisionChecker(self._world, self._name).contact(q) is None

    def _desired(self, time: float) -> SetPoint:
        """Next set-point of the motion, or the one that is held."""
        motion = self._motion
        if motion is None:
            return self._hold
        if isinstance(motion, TrajectorySource) and motion.along_path:
            motion.measure(self._nominal.tool_position_at(self._hardware.q))
        try:
            desired = motion.next(time)
        except RAISED_BY_SKILLS as error:
            self.fault = error
            self.stop()
            return self._desired(time)
        if motion.done:
            self._motion = None
            self._hold = SetPoint(desired.q, np.zeros_like(desired.q), np.zeros_like(desired.q))
            self._guard.rests(desired.q, time)
        return desired

    def _monitor(self, speed_share: float, position_error: float, contact_square: float) -> None:
        """Abort the motion on contact force, overspeed, position error, or a collision.

        Arguments are the telemetry of the control law, see `kernel_rows`.
        """
        excess = self._force.look(contact_square)
        if excess is not None:
            # Contact of a link is never allowed, and the more specific failure.
            self._abort(self._guard.touch() or excess)
        report = self._guard.report
        report.fastest_share = max(report.fastest_share, speed_share)
        if speed_share <= OVERSPEED:
            self._too_fast_steps = 0
        elif self.fault is None:
            speeds = np.abs(self._hardware.v)
            most = self._torque.top_speed
            is_too_fast = (speeds > np.maximum(OVERSPEED * most, most + OVERSPEED_RAD_S)).any()
            self._too_fast_steps = self._too_fast_steps + 1 if is_too_fast else 0
            if self._too_fast_steps * self.period > OVERSPEED_S:
                self.fault = overspeed_failure(self._robot, speeds / most)
                self.stop()
        if self._motion is None:
            return
        if position_error > MAX_POSITION_ERROR and self.fault is None:
            failure = tracking_failure(self._robot, self.setpoint.q - self._hardware.q)
            self.fault = self.naming_efforts(failure)
            if isinstance(self._motion, CoupledSource):
                self.stop()
            else:
                self._retreat(self._hardware.q)
        detector = self._torque.collision_detector
        if detector is None or self._may_touch or self._motion is not self._followed:
            return
        if self._torque.collision_detected:
            jacobian = self._nominal.tool_jacobian_at(self._hardware.q)[:3]
            self._abort(collision_failure(self._robot, detector, jacobian))

    def _retreat(self, q: Vector) -> None:
        """Brake, then move the set-point to ``q``, of shape (dof,), rad, to relieve the contact."""
        # Brake first: the motion back is planned from rest.
        limits = self._robot.limits
        sent = self.setpoint
        target = np.clip(q, limits.lower, limits.upper)
        braking = stop(sent.q, sent.v, sent.a, limits, self.period)
        back = braking.then(point_to_point(braking.q[-1], target, limits, self.period))
        self._switch_to(self._guard.stop(self._motion, (back, braking), self._world.time))

    def _switch_to(self, motion: Trajectory) -> None:
        """Follow a trajectory whose first set-point is the one that was sent last."""
        self._motion = TrajectorySource(motion)
        self._motion.next(self._world.time)
        if self._motion.done:
            self._motion = None
            self._hold = self.setpoint


def retreat_target(
    motion: SetPointSource,
    refusal: Failure,
    q: Vector,
    v: Vector,
    is_free: Callable[[Vector], bool],
) -> Vector:
    """Configuration on the path already traveled to which an arm retreats, of shape (dof,), rad.

    Args:
        motion: Motion that is being followed.
        refusal: Failure that causes the retreat.
        q: Joint positions, of shape (dof,), rad.
        v: Velocities of the last set-point, of shape (dof,), rad/s; a stream is retraced along
            them, as its past is not stored.
        is_free: Collision check of a configuration of shape (dof,), rad. After too much force an
            arm retreats until it is free: no plan could start earlier.
    """
    if not isinstance(motion, TrajectorySource):
        return q - BACK_OFF_S * v
    presses = isinstance(refusal, ForceLimitFailure)
    least = RECOIL_RAD if presses else 0.0
    now = motion.parameter.s
    ago = BACK_OFF_S
    current = motion.configuration(now)
    while True:
        target = motion.configuration(max(now - ago, 0.0))
        enough = float(np.abs(target - current).max()) >= least
        if ago >= now or (enough and (not presses or is_free(target))):
            return target
        ago *= 2.0


def tracking_failure(robot: Robot, error: Vector) -> Failure:
    """Failure for a joint too far from its set-point; errors of shape (dof,), rad."""
    joint = int(np.argmax(np.abs(error)))
    worst = float(np.abs(error[joint]))
    return Failure(
        "TRACKING_ERROR",
        f"joint {robot.joints[joint]} is {np.degrees(worst):.1f}° behind its set-point: "
        "the arm is blocked or its torque is insufficient",
        joint_error_rad=worst,
    )


def overspeed_failure(robot: Robot, shares: Vector) -> Failure:
    """Failure for a joint that is too fast; speeds per their limits, of shape (dof,)."""
    joint = int(np.argmax(shares))
    share = float(shares[joint])
    return Failure(
        "TRACKING_ERROR",
        f"joint {robot.joints[joint]} was {share:.2f} times as fast as the robot allows: "
        "the arm was pushed or its torque is insufficient",
        joint_speed_share=share,
    )


def collision_failure(
    robot: Robot, detector: CollisionDetector, jacobian: Matrix
) -> CollisionDetectedFailure:
    """Failure for a detected collision.

    A contact force affects the joints between the base and the contact, not those beyond: the last
    affected joint bounds the contact location. The force is the one at the tool that explains the
    torques best; nearer to the base it would have to be larger.

    Args:
        robot: Robot that collided.
        detector: Detector with torque changes above their thresholds.
        jacobian: Linear Jacobian of the tool, of shape (3, dof).
    """
    shares = np.abs(detector.change) / detector.threshold
    joint = int(np.argmax(shares))
    last = int(np.flatnonzero(shares > _AFFECTED)[-1])
    force = float(np.linalg.norm(np.linalg.pinv(jacobian.T) @ detector.change))
    torque = float(abs(detector.change[joint]))
    threshold = float(detector.threshold[joint])
    return CollisionDetectedFailure(
        f"joint {robot.joints[joint]} felt {torque:.1f} N m that its model does not explain, above "
        f"the threshold of {threshold:.1f} N m: a collision at {robot.joints[last]} or beyond, "
        f"of {force:.0f} N if at the tool",
        joint=robot.joints[joint],
        beyond=robot.joints[last],
        torque_nm=torque,
        threshold_nm=threshold,
        force_n=force,
    )
