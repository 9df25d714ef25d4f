"""Motions of an arm, and their plans.

`ArmMotions` is the part of an `Arm` that moves it and that plans its motions. Only the leaf that
holds the lease moves the arm; a plan does not.
"""

from __future__ import annotations

import itertools
from collections.abc import Collection, Generator, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from typing import Final

import numpy as np

from bt_dualarm.arm.passengers import kept_upright, poured_out
from bt_dualarm.arm.shared_arm import SharedArm
from bt_dualarm.arm.state import ArmContacts, ArmState
from bt_dualarm.collision.checker import TOUCH, CollisionChecker
from bt_dualarm.collision.distance import PLANNING_MARGIN_M, RESTING_MARGIN_M
from bt_dualarm.control.computed_torque import SOFTEST
from bt_dualarm.control.dynamics import BANDWIDTH, most_force
from bt_dualarm.control.tool_following import ToolFollowing
from bt_dualarm.core.errors import (
    RAISED_BY_SKILLS,
    BlockedFailure,
    CollisionFailure,
    Failure,
    Number,
    SkillError,
    rounded_down,
    rounded_up,
)
from bt_dualarm.core.free_axes import FreeAxes, nearest_allowed
from bt_dualarm.core.pose import Matrix, Pose, Vector
from bt_dualarm.kinematics.inverse_kinematics import Preference, refuse_beyond, refuse_no_angles
from bt_dualarm.kinematics.solver import Chain, different
from bt_dualarm.planning.path_constraints import POSES, ConstrainedProblem, PathConstraint
from bt_dualarm.planning.path_search import DEFAULT_PLANNER, Planner
from bt_dualarm.planning.problem import (
    CHECKS,
    ROOM_M,
    PlanningProblem,
    admitted,
    refuse_contact,
    refuse_infeasible,
    straight_motion,
)
from bt_dualarm.robots.gripper import GRIPPER
from bt_dualarm.safety.guard import RESCALED, PlanMonitor, clearance
from bt_dualarm.sim.world import World
from bt_dualarm.trajectory.coupled import CoupledSource
from bt_dualarm.trajectory.overlap import OverlappedMotion
from bt_dualarm.trajectory.path_timing import SpeedBound, point_to_point, time_path, time_path_below
from bt_dualarm.trajectory.paths import line
from bt_dualarm.trajectory.set_points import SetPointSource, Stream, TrajectorySource
from bt_dualarm.trajectory.trajectory import Trajectory

SETTLE_S = 1.0
"""Simulated seconds in which the arm has to come to rest after the last set-point of a motion."""

HALT_S = 5.0
"""Simulated seconds in which an arm has to stop; the hardest stop takes less than one."""

SETTLED_RAD = 5e-4
"""Largest joint error at which a motion counts as executed."""

PLANNING_S = 0.1
"""Simulated seconds that a search for a path takes, and the computation of a curve, independent of
the computing time, so that runs repeat. To check a straight motion takes a few milliseconds."""

_STAYS_CLEAR_M = 0.003  # by which an arm sags at most, at rest

REPLANS = 1
"""How often an arm replans when something has moved into its path."""

WAIT_S = 60.0
"""Simulated seconds that an arm waits by default for others to leave its goal or its path: long
enough for several of them, one after the other, to pick and place there."""

_STAYS_S = 1.0  # after which arms that the guard has stopped stay there, unless others move

_RELAXATIONS = 4
_YIELD_S = 0.1  # time for a contact to push the arm away


_YIELDS_RAD: Final = 0.02
"""Motion of a joint up to which an arm yields near a configuration, rad."""

_OPENS_M: Final = 0.0005
"""Difference from which fingers count as opening, m."""


def open_as_commanded(world: World, arm: str, q: Vector, checker: CollisionChecker) -> None:
    """Let a checker open the fingers of an arm as far as they have been told to open.

    Args:
        world: World with the arm.
        arm: Name of the arm.
        q: Where it is, of shape (dof,), rad: if such fingers would touch something there, they stay
            as they are.
        checker: Collision checker of the arm.
    """
    gripper = world.grippers.get(arm)
    if gripper is None or not gripper.gripper.fingers:
        return
    now, asked = gripper.width, gripper.commanded.width
    if asked > now + _OPENS_M:
        checker.open_fingers(min(asked, gripper.gripper.stroke))
        if checker.contact(q) is not None:
            checker.open_fingers(now)


class ArmMotions(ArmState):
    """An arm as one leaf moves it: its motions and its motion plans.

    Only the leaf that holds the lease moves the arm; a motion takes the lease, and ``release``
    stops what this leaf has begun. Configurations are of shape (dof,) in rad, poses are those of
    the tool frame in the world, and ``speed`` is the fraction of the joint limits, above 0 to 1.
    ``ignore`` holds names of objects that may be touched.

    Args:
        shared: The arm with what its leaves share.
        leaf: Path of the leaf in its tree.

    Attributes:
        checks: Maximum number of configurations that a plan with the default planner checks.
        resting: Names of the other arms that are known to stay where they are.
        may_turn: Whether plans may end in their ``turned`` goals: not while another arm may be the
            reason that there is no motion to the others.
        left_out: Names of other arms that plans leave out, to find out whether these are the reason
            that there is none.
    """

    def __init__(self, shared: SharedArm, leaf: str) -> None:
        super().__init__(shared.world, shared.name, shared.controller, shared.kinematics)
        self._shared = shared
        self._lease = shared.lease.for_leaf(leaf)
        self._contacts = ArmContacts(shared.touches, shared.name)
        self._begun: SetPointSource | None = None
        self._checks_itself = False
        self._raised: BaseException | None = None
        self.checks = CHECKS
        self.resting: frozenset[str] = frozenset()
        self.may_turn = True
        self._seen: Mapping[str, Pose] = {}
        self.left_out: frozenset[str] = frozenset()

    # The leaf's life

    @property
    def leaf(self) -> str:
        """Path of the leaf in its tree."""
        return self._lease.leaf

    def enter(self, *, anew: bool) -> None:
        """Register the thread that ticks or halts the leaf, and whether a new run of it begins."""
        self._lease.enter(anew=anew)
        if anew:
            self._checks_itself = False
            self._raised = self.controller.fault  # that of a motion before this run, if any

    def pending_fault(self) -> BaseException | None:
        """Return and clear the error of this leaf's motion or stream, if any.

        An error of the motion is left to a skill that has called `check` in its last tick: it will
        do so in this one, where code that knows how to go on can handle it. Raised from outside, it
        would appear in the outermost generator, past the one that handles it.
        """
        if self._lease.intrusion:
            error = SkillError(self._lease.intrusion)
            self._lease.intrusion = ""
            return error
        if not self._lease.has_it:
            return None
        if self._checks_itself:
            self._checks_itself = False
            return None
        try:
            self._check()
        except RAISED_BY_SKILLS as pending_fault:
            self.controller.fault = None
            return pending_fault
        return None

    def release(self, *, done: bool = False) -> None:
        """Stop the motion that this leaf has begun; ``done``: it has succeeded."""
        self._shared.unfinished = self._shared.unfinished or not done
        self._shared.traffic.arrive(self.name, self.leaf)
        if self._lease.give_back():
            self._begun = None
            self._stop_following_tool()
            self._shared.traffic.give_up_motion(self.name)
            if self.is_present:
                self.controller.stop()

    def touched(self, asked: Collection[str]) -> dict[str, Number]:
        """Metrics of unwanted contacts while this leaf moved the arm.

        Args:
            asked: Names of the objects that the leaf was asked to handle: those do not count.
        """
        return self._contacts.end(asked)

    # Motions

    def follow(
        self,
        trajectory: Trajectory,
        ignore: frozenset[str] = frozenset(),
        wait_s: float = WAIT_S,
    ) -> Iterator[float]:
        """Execute a motion; yields its progress once per tick until the arm is at rest at its end.

        Args:
            trajectory: Motion that begins at the last set-point.
            ignore: Names of the objects that may be touched.
            wait_s: Simulated seconds that it waits for another arm to leave its path. If they are
                fewer than `WAIT_S`, the caller has another plan, and an arm that has stopped in the
                path ends the motion before it gets there.

        Raises:
            Failure: ``BUSY`` when another leaf moves the arm, ``TRACKING_ERROR`` when the arm
                cannot follow, ``IN_COLLISION`` when something has moved into the path,
                ``TIMED_OUT`` when another arm does not leave it, ``INTERRUPTED``.
        """
        motion = self.begin(trajectory)
        holders = {one for name in ignore for one in self.world.attachments.holders(name)}
        # Unless it may touch something that another arm holds.
        motion.tool_avoids_payloads = holders <= {self.name}
        watch = self.watch(motion, ignore, waits_for_arms=wait_s >= WAIT_S)
        while not motion.done:
            yield motion.progress
            self.check()
            watch.look(self.time)
            self.refuse_when_held_up(motion, wait_s)
        yield from self.settle()

    def begin(
        self,
        trajectory: Trajectory,
        *,
        along_path: bool = False,
        may_touch: bool = False,
        compliant: bool = False,
    ) -> TrajectorySource:
        """Begin a motion that the caller monitors with ``check``.

        Args:
            trajectory: Motion that begins at the last set-point.
            along_path: Whether the tool's path matters, not only its end.
            may_touch: Whether contact is intended, which disables collision detection.
            compliant: Whether the arm complies on contact, until the next motion begins.

        Raises:
            Failure: ``BUSY`` when another leaf moves the arm; ``TRACKING_ERROR`` if the motion
                begins elsewhere, or at rest while the arm still moves, see `come_to_rest`;
                ``INVALID_TARGET`` if it holds something that moves on a joint or that another arm
                holds as well, unless contact is intended, or if the arm cannot follow the motion;
                ``JOINT_LIMIT``.
        """
        if type(trajectory) is Trajectory:  # others are computed on demand, by planners only
            refuse_infeasible(trajectory, self.robot, self.period)
        if not may_touch:
            self._refuse_bound()
        self._lease.take()
        self._contacts.begin()
        self._shared.slip.may_touch = may_touch
        self._begun = motion = self.controller.follow(
            trajectory,
            along_path=along_path,
            may_touch=may_touch,
            compliant=compliant,
            most_scale=self._shared.traffic.time_scale_of(self.name, trajectory),
        )
        self._shared.traffic.begin_motion(self.name, self._lease.leaf, motion)
        self._checks_itself = True  # also if the motion ends before the first call of `check`
        return motion

    def _refuse_bound(self) -> None:
        """Refuse to move something held that cannot follow: it is on a joint, or in other hands."""
        for name in self.held:
            if self.world.objects[name].joint is not None:
                held = self.world.attachments.find(self.name, name)
                # Opening the gripper does not let go of what is attached.
                release = "release" if held is None or held.by_gripper else "detach"
                reason = f"{self.name} holds {name!r}, which moves on a joint: `operate` it"
                raise Failure("INVALID_TARGET", f"{reason}, or `{release}` it first")
        self.refuse_shared()

    def refuse_shared(self) -> None:
        """Refuse to move alone what another arm holds as well: they would tear at it.

        Both may hold it while they have consented to that, as in a handover.

        Raises:
            Failure: ``INVALID_TARGET``.
        """
        attachments = self.world.attachments
        consents = {(one.partner, one.object) for one in attachments.shared_grasps(self.name)}
        for name in self.held:
            others = [
                other
                for other in attachments.holders(name)
                if other != self.name and (other, name) not in consents
            ]
            if others:
                raise Failure(
                    "INVALID_TARGET",
                    f"{self.name} holds {name!r} together with {' and '.join(others)}: "
                    "`carry_together` moves it, or `release` it first",
                )

    def expect_contact(self, *, compliant: bool = True) -> None:
        """Change the running motion: contact is intended from now on.

        Args:
            compliant: Whether the arm complies from now on. Its friction and model errors are the
                mean disturbance since then: contact has to come later by a tenth of a second.
        """
        self._lease.refuse_other_threads()
        self._shared.slip.may_touch = True
        self.controller.expect_contact(compliant=compliant)

    def expect_no_contact(self) -> None:
        """Change the running motion: no contact is intended any more, and the arm is stiff."""
        self._lease.refuse_other_threads()
        self._shared.slip.may_touch = False
        self.controller.expect_no_contact()

    def begin_with_others(self, motion: CoupledSource, *, compliant: bool = False) -> None:
        """Begin this arm's part of a coupled motion, which the caller monitors with ``check``.

        It moves once all arms of the motion have begun it. Contact is intended.

        Args:
            motion: Set-points of this arm.
            compliant: Whether the arm complies on contact, until the next motion begins.

        Raises:
            Failure: ``BUSY`` when another leaf moves the arm.
        """
        self._lease.take()
        self._contacts.begin()
        self._shared.slip.may_touch = True
        self.controller.follow_with_others(motion, compliant=compliant)
        self._begun = motion
        self._checks_itself = True

    def stream(self, source: Stream) -> None:
        """Follow a stream of set-points until ``release`` or ``halt``.

        Raises:
            Failure: ``BUSY`` when another leaf moves the arm; ``INVALID_TARGET`` if it holds
                something that moves on a joint or that another arm holds as well.
        """
        self._refuse_bound()
        self._lease.take()
        self._contacts.begin()
        self._shared.slip.may_touch = False
        self.controller.stream(source)
        self._begun = self.controller.motion

    def follow_tool(self, leader: str, offset: Pose, speed: float) -> ToolFollowing:
        """Keep a transform to another arm's tool until `release` or `halt`.

        Motions of the other arm that begin meanwhile are slowed to what this one can follow.

        Args:
            leader: Name of the other arm.
            offset: Pose of this arm's tool in that of the other one.
            speed: Fraction of the limits, above 0 to 1.

        Raises:
            Failure: ``INVALID_TARGET`` if the other arm is this one, is not in the world, or
                follows this one; ``BUSY`` when another leaf moves the arm.
        """
        traffic = self._shared.traffic
        if leader == self.name or leader in traffic.followers(self.name):
            raise Failure("INVALID_TARGET", f"{leader} follows the tool of {self.name} itself")
        if leader not in self.world.arms:
            raise Failure("INVALID_TARGET", f"there is no arm {leader!r} in the world now")
        body = self.world.arms[leader]
        following = ToolFollowing(
            self.kinematics,
            self.limits(speed),
            self.period,
            self.setpoint,
            Chain(self.world.robots[leader], body.base),
            self._shared.controllers[leader].commanded_at,
            offset,
            # The other arm moves along; the guard keeps the two apart.
            lambda motion: refuse_contact(self.checker(frozenset({leader})), motion),
        )
        self.stream(following)
        traffic.lead(self.name, leader, following.time_scale_of)
        motion = self._shared.controllers[leader].motion
        if isinstance(motion, TrajectorySource):  # already running
            row = round(motion.parameter.s / motion.trajectory.dt)
            left = motion.trajectory.piece(row, len(motion.trajectory))
            motion.cap(min(motion.most_scale, following.time_scale_of(left)))
        return following

    def _stop_following_tool(self) -> None:
        """Follow no tool any more; a motion of the other arm is slowed down for it no longer."""
        traffic = self._shared.traffic
        leader = traffic.leader(self.name)
        if leader is None:
            return
        traffic.stop_leading(self.name)
        motion = self._shared.controllers[leader].motion
        if not isinstance(motion, TrajectorySource) or traffic.followers(leader):
            return
        if motion.partner is None:  # otherwise it remains as slow as that one
            motion.cap(1.0)

    def tool_pose_of(self, other: str) -> Pose:
        """Measured pose of another arm's tool, from its encoders."""
        return self.world.nominal[other].tool_pose_at(self.world.hardware[other].q)

    def commanded_tool_pose_of(self, other: str) -> Pose:
        """Pose of another arm's tool at its last set-point, as its controller knows it."""
        return self.world.nominal[other].tool_pose_at(self._shared.controllers[other].setpoint.q)

    def watch(
        self,
        motion: TrajectorySource,
        ignore: frozenset[str] = frozenset(),
        until_s: float | None = None,
        *,
        waits_for_arms: bool = False,
    ) -> PlanMonitor:
        """Monitor that checks a running motion against the world as it changes.

        Args:
            motion: Motion that has just begun.
            ignore: Names of the objects that may be touched.
            until_s: Time of the motion as planned after which contact is intended, s.
            waits_for_arms: Whether the motion waits for other arms that stand in its path, instead
                of another plan.
        """
        # Arms that follow this one's tool yield on their own; the guard keeps them apart.
        ignore |= self._shared.traffic.followers(self.name)
        # What the motion pours out falls off sooner or later, and is then where nobody knows yet.
        ignore |= poured_out(motion.trajectory, self.world, self.name)
        return PlanMonitor(
            self.world, self.name, motion, ignore, until_s, waits_for_arms=waits_for_arms
        )

    def check(self) -> None:
        """Raise the error of the running motion, if there is one.

        Raises:
            Failure: Among others ``INTERRUPTED``, when something else has stopped it, ``TIMED_OUT``
                when another arm does not leave its path, and ``DROPPED``, when the gripper has lost
                the object.
        """
        self._checks_itself = True
        self._check()

    def _check(self) -> None:
        fault = self.controller.fault
        if fault is not None and fault is not self._raised:
            self._raised = fault  # once: a skill that handles it may go on
            self._begun = None
            raise fault
        self._shared.slip.refuse_lost()
        begun = self._begun
        if begun is not None and not begun.done and self.controller.motion is not begun:
            self._begun = None
            raise Failure(
                "INTERRUPTED",
                f"the motion of {self.name} was stopped externally",
                **({"progress": begun.progress} if isinstance(begun, TrajectorySource) else {}),
            )
        if isinstance(begun, TrajectorySource) and begun.held_since is not None:
            self.refuse_when_held_up(begun)

    def refuse_when_held_up(self, motion: TrajectorySource, wait_s: float = WAIT_S) -> None:
        """Refuse to wait longer than a time in s for a motion that the guard has stopped.

        While it waits, arms that wait for this one in turn move aside. It does not wait for arms
        whose trees have ended.

        Raises:
            Failure: ``TIMED_OUT`` with what is in the way.
        """
        traffic = self._shared.traffic
        if motion.held_since is None or motion.held_up == RESCALED:
            traffic.advance(self.name)
            return
        waited_s = self.time - motion.held_since
        traffic.block(
            self.name,
            self._lease.leaf,
            self.controller.neighbors,
            may_yield=False,
            # Who waits less gives the path up then. At first the others may still be braking.
            has_other_path=wait_s < WAIT_S or waited_s < _STAYS_S,
            why=motion.held_up,
        )
        try:
            stays = self.refuse_deadlock()
        except Failure as deadlock:
            # This path is blocked for good; another one may lead past the arms that stay.
            traffic.advance(self.name)
            raise BlockedFailure(
                deadlock.code, deadlock.reason, progress=motion.progress
            ) from deadlock
        if waited_s <= wait_s and not stays:
            return
        raise BlockedFailure(
            "TIMED_OUT",
            f"blocked: {motion.held_up}",
            stays=stays,
            progress=motion.progress,
            waited_s=waited_s,
        )

    def refuse_deadlock(self) -> bool:
        """Refuse to wait for arms that are waiting for this one.

        Returns:
            Whether the arms in the way have ended, and are going to stay there.

        Raises:
            Failure: ``DEADLOCK`` with the arms and what they wait for.
        """
        refusal = self._shared.traffic.take_refusal(self.name)
        if refusal is not None and refusal.code == "DEADLOCK":
            raise refusal
        return refusal is not None

    def settle(self, most: float = SETTLED_RAD) -> Iterator[float]:
        """Wait until the arm has settled at its last set-point; yields once per tick.

        Args:
            most: Joint error at rest that is accepted after `SETTLE_S`, rad: arms that hold one
                object may keep each other from their set-points.

        Raises:
            Failure: ``TRACKING_ERROR`` when it does not get there within `SETTLE_S`, or the time
                in which its joints break away if their dry friction takes longer to overcome.
        """
        self.controller.compliance.active = False
        began = self.time
        while True:
            self.check()
            error = self._servo_error
            passed = self.time - began
            late = passed > SETTLE_S
            if self.controller.at_rest and error < (most if late else SETTLED_RAD):
                self._lease.give_back()  # the next leaf need not wait for the last oscillation
                return
            if late and passed > self.controller.breakaway_s(SETTLED_RAD):
                reason = f"the arm does not come to rest at its goal: {np.degrees(error):.2f}° away"
                failure = Failure("TRACKING_ERROR", reason, joint_error_rad=error)
                raise self.controller.naming_efforts(failure)
            yield 1.0

    def relax(
        self, *, stays_compliant: bool = False, near: Vector | None = None
    ) -> Iterator[float]:
        """Move the set-point to the measured configuration, which ends any contact force.

        As the arm yields, the contact pushes it farther away, so this takes a few iterations; the
        final configuration does not matter. It ends early where the guard does not let the arm move
        at all: an object that it has just taken may be in the path of another arm.

        Args:
            stays_compliant: Whether a compliant arm stays so: its contact continues. It then yields
                twice only.
            near: Configuration, of shape (dof,), rad, from which the set-point moves by at most
                `_YIELDS_RAD`: a joint that walks, as what compensates its dry friction pushes it,
                goes on and on.

        Raises:
            Failure: ``BUSY`` or ``TRACKING_ERROR``, as ``follow``.
        """
        limits = self.robot.limits
        lower, upper = limits.lower, limits.upper
        if near is not None:
            lower = np.maximum(lower, near - _YIELDS_RAD)
            upper = np.minimum(upper, near + _YIELDS_RAD)
        for left in range(2 if stays_compliant else _RELAXATIONS, 0 if stays_compliant else -1, -1):
            here = np.clip(self.q, lower, upper)
            retreat = point_to_point(self.setpoint.q, here, limits, self.period)
            # A compliant arm with a wrong load model sinks away from every set-point: in the end it
            # holds its place.
            compliant = self.controller.compliance.active and left > 0
            motion = self.begin(retreat, may_touch=True, compliant=compliant)
            began = self.time
            latest = began + retreat.duration + SETTLE_S
            while self.time < began + _YIELD_S or not self.controller.at_rest:
                if self.time > latest:
                    break
                yield motion.progress
                try:
                    self.check()
                except BlockedFailure:
                    return
            if self._servo_error < SETTLED_RAD:
                return

    def yield_to(self, force: Vector) -> None:
        """Yield to a part of the measured contact force; see `Compliance.yield_to`.

        Args:
            force: Force on the tool in the world, of shape (3,), N, by which the contact force
                shall decrease.
        """
        self._lease.refuse_other_threads()
        jacobian = self.world.nominal[self.name].tool_jacobian_at(self.q)[:3]
        self.controller.compliance.yield_to(jacobian.T @ force)

    def spring_bandwidth(self, compliance: float) -> float:
        """Bandwidth with which the tool yields by a distance per force in its softest direction.

        A joint stiffness of M w² gives the tool the compliance J M⁻¹ Jᵀ / w² (Khatib, A unified
        approach for motion and force control of robot manipulators, IEEE J. Robot. Autom. 1987).

        Args:
            compliance: Displacement of the tool per force, m/N.

        Returns:
            Bandwidth for `Compliance.spring`, rad/s.

        Raises:
            Failure: ``INVALID_TARGET`` if the arm cannot be as soft, or is softer, in this
                configuration.
        """
        jacobian = self.world.nominal[self.name].tool_jacobian_at(self.q)[:3]
        mobility = jacobian @ np.linalg.solve(self.controller.touch.inertia, jacobian.T)
        softest = float(np.linalg.eigvalsh(mobility)[-1])
        bandwidth = float(np.sqrt(softest / compliance))
        if not SOFTEST <= bandwidth <= BANDWIDTH:
            least = softest / BANDWIDTH**2
            most = softest / SOFTEST**2
            raise Failure(
                "INVALID_TARGET",
                f"the compliance of {1e3 * compliance:.3g} mm/N is not possible here: this "
                f"{self.robot.name} allows {rounded_up(1e3 * least, 2):g} to "
                f"{rounded_down(1e3 * most, 2):g} mm/N in this configuration",
                compliance_m_per_n=compliance,
                least_m_per_n=least,
                most_m_per_n=most,
            )
        return bandwidth

    def halt(self, *, give_way: bool = False, longest_s: float = HALT_S) -> Iterator[None]:
        """Brake with bounded jerk; yields once per tick until the arm is at rest.

        An arm that is pressed against something is at rest as well, wherever its set-point is. A
        compliant one does not increase its force over time.

        Args:
            give_way: Whether to become compliant at once, since the arm has just touched something.
            longest_s: Simulated seconds in which it has to come to rest.

        Raises:
            Failure: ``TRACKING_ERROR`` when it still moves then.
        """
        self._lease.refuse_other_threads()
        self._begun = None
        self._stop_following_tool()
        self._shared.traffic.abandon_motion(self.name)
        if give_way:
            self.controller.compliance.soften()
        self.controller.stop()
        began = self.time
        while not self.controller.at_rest:
            if self.time - began > longest_s:
                reason = f"the arm still moves {longest_s:g} s after its stop"
                raise Failure("TRACKING_ERROR", reason)
            yield None

    @property
    def _servo_error(self) -> float:
        """Largest joint error in rad."""
        return float(np.abs(self.setpoint.q - self.q).max())

    # Motion plans; none of these moves the arm

    def think(self) -> Iterator[None]:
        """Wait for rest and for the simulated planning time; then plan in the current world.

        The motion of an earlier leaf is braked first: plans start at the current configuration.

        Raises:
            Failure: ``BUSY`` when another leaf moves the arm; ``TRACKING_ERROR`` when it does not
                come to rest.
        """
        began = self.time
        yield from self.come_to_rest()
        yield from self._pass_until(began + PLANNING_S)

    def configurations(
        self, target: Pose, *, prefer: Preference = "nearest", free: FreeAxes = ()
    ) -> list[Vector]:
        """Different configurations with the tool on a target, the preferred one first.

        One in which the arm would nearly touch something, itself included, comes after those of
        every branch that are clear of everything: an arm that stays there sags against it.

        Args:
            target: Pose of the tool in the world.
            prefer: Their order, see `Kinematics.solutions`.
            free: Rotations that the target leaves free.

        Returns:
            At least one, each of shape (dof,), rad.

        Raises:
            Failure: ``INVALID_TARGET`` for an invalid pose, or one outside the workspace;
                ``UNREACHABLE`` with the smallest residual found.
        """
        now = self.setpoint.q
        found = self.kinematics.solutions(target, now, prefer=prefer, free=free)
        clear = self.checker()
        clear.keep_clear(_STAYS_CLEAR_M, itself=True)
        if clear.free(found[0]):
            return found
        others = self.kinematics.solutions(target, now, prefer=prefer, every_branch=True, free=free)
        every = found + [q for q in others if different(found, q)]
        best = [q for q in every if clear.free(q)]
        if best:
            return best + [q for q in found if different(best, q)]
        checker = self.checker()
        return found if any(checker.free(q) for q in found) else every

    def turned(self, paths: Sequence[Matrix]) -> list[Matrix]:
        """Paths with joints rotated by whole turns, nearest first, see `Kinematics.turned`.

        Args:
            paths: Configurations along each path, of shape (n, dof), rad.
        """
        return self.kinematics.turned(paths, self.setpoint.q)

    def plan(
        self,
        goals: Sequence[Vector],
        speed: float,
        ignore: frozenset[str] = frozenset(),
        planner: Planner = DEFAULT_PLANNER,
        keep: PathConstraint | None = None,
        began_s: float | None = None,
        turned: Sequence[Vector] = (),
    ) -> Generator[None, None, Trajectory]:
        """Plan a collision-free motion to one of several configurations, straight where possible.

        Yields once per tick. The straight motion is found at once. A search is made in the world at
        the start, takes `PLANNING_S`, and is checked against the world at its end; if that has
        changed too much, the arm replans once.

        Args:
            goals: Configurations, each of shape (dof,), rad, the preferred one first.
            speed: Fraction of the limits, above 0 to 1.
            ignore: Names of the objects that may be touched.
            planner: Planner to use if the straight path to the preferred goal is blocked.
            keep: Constraint along the whole path, if there is one; the motion may then end in
                another configuration with the tool at the same pose. By default, what rides on a
                held object is kept upright, if it stands so at both ends; the motion then ends in
                one of the goals.
            began_s: Simulated time at which the caller began to plan, s; by default now.
            turned: Goals with joints rotated by whole turns, see `turned`: tried if there is no
                motion to the others, and nothing to be kept.

        Raises:
            Failure: ``IN_COLLISION`` or ``JOINT_LIMIT`` of the start, or of the preferred goal if
                none of the goals is free; ``NO_PLAN``; ``OVERLOADED``; ``BUSY`` when another leaf
                moves the arm; ``TRACKING_ERROR`` when it does not come to rest.
        """
        yield from self.come_to_rest()
        goals = self._configurations(goals)
        at_goals = keep is None
        if keep is None:
            ends = (self.setpoint.q, goals[0])
            keep = kept_upright(self.world, self.robot, self.kinematics, self.name, ends)
        due = (self.time if began_s is None else began_s) + PLANNING_S
        for replan in range(REPLANS, -1, -1):
            found = yield from self._plan_once(
                goals, turned, speed, ignore, planner, keep, at_goals, due
            )
            due = self.time + PLANNING_S
            motion = self.within_efforts(found)
            try:
                refuse_contact(self.checker(ignore), motion)
            except Failure:
                if not replan:
                    raise
            else:
                break
        return motion

    def _configurations(self, goals: Sequence[Vector]) -> list[Vector]:
        """Goals as arrays.

        Raises:
            Failure: ``INVALID_TARGET`` if there is none, or one does not have an angle per joint.
        """
        found = [np.asarray(goal, dtype=np.float64) for goal in goals]
        if not found:
            raise Failure(
                "INVALID_TARGET", "there is no goal: at least one configuration is needed"
            )
        joints = self.robot.joints
        for goal in found:
            if goal.ndim == 0:
                why = "each goal is a configuration of"
                why = f"{why} {len(joints)} angles: a single one is given as [q]"
                raise Failure("INVALID_TARGET", why)
            refuse_no_angles(joints, goal)
        return found

    def _plan_once(
        self,
        goals: Sequence[Vector],
        turned: Sequence[Vector],
        speed: float,
        ignore: frozenset[str],
        planner: Planner,
        keep: PathConstraint | None,
        at_goals: bool,
        due: float,
    ) -> Generator[None, None, Trajectory]:
        """Plan once; arguments as for `plan` and `ConstrainedProblem`, and when the plan is due."""
        problem = admitted(
            PlanningProblem(
                self.checker(ignore),
                self.setpoint.q,
                tuple(goals),
                self.limits(speed),
                self.period,
                self._shared.seed,
                planner,
                self.checks if planner == DEFAULT_PLANNER else CHECKS,
                turned=tuple(turned) if self.may_turn and keep is None else (),
            )
        )
        fault = self._shared.no_plan()
        if fault:
            yield from self._pass_until(due)
            reason = f"no path was found: injected by the fault '{fault}' of the file"
            raise Failure("NO_PLAN", reason, planner=planner, planning_s=PLANNING_S)
        constrained = None
        if keep is not None:
            # A quick search is as much shorter as one without a constraint.
            poses = POSES * problem.checks // CHECKS
            constrained = ConstrainedProblem(problem, keep, poses, at_goals)
        straight = straight_motion(problem)
        if straight is not None and (constrained is None or constrained.keeps(straight)):
            return straight
        pending = self._shared.planning.solve(problem if constrained is None else constrained)
        try:
            yield from self._pass_until(due)
            try:
                return pending.result()
            except Failure as refusal:
                refusal.noting(planning_s=PLANNING_S)
                if refusal.code == "NO_PLAN":
                    self._name_enclosing(refusal, goals, ignore)
                raise
        finally:
            pending.abandon()

    def _name_enclosing(
        self, refusal: Failure, goals: Sequence[Vector], ignore: frozenset[str]
    ) -> None:
        """Add what the tool or a held object is between, now or at all goals, to a refused plan."""
        checker = self.checker(ignore)
        enclosing = checker.enclosing(self.setpoint.q)
        if enclosing is not None:
            own, where = enclosing[0], _between(enclosing)
            refusal.adding(f"{own} is {where}: `move_linear` can take it out first")
            return
        at_goals = [checker.enclosing(goal) for goal in goals]
        if at_goals and at_goals[0] is not None and None not in at_goals:
            own, where = at_goals[0][0], _between(at_goals[0])
            refusal.adding(f"at the goal, {own} would be {where} already")
            refusal.noting(goal_enclosed=True)

    def come_to_rest(self) -> Iterator[None]:
        """Wait until an earlier motion, such as the braking of a halted leaf, has ended.

        Raises:
            Failure: ``BUSY`` when another leaf moves the arm; ``TRACKING_ERROR`` when it does not
                come to rest.
        """
        began = self.time
        self._lease.refuse_if_busy()
        while self.controller.motion is not None:
            if self.time - began > HALT_S:
                raise Failure("TRACKING_ERROR", f"{self.name} still moves after {HALT_S:g} s")
            yield
            self._lease.refuse_if_busy()

    def _pass_until(self, time: float) -> Iterator[None]:
        while self.time < time:
            self._lease.refuse_if_busy()
            yield

    def line(self, start: Pose, end: Pose) -> Matrix:
        """Configurations, of shape (n, dof), rad, along a straight line of the tool.

        The branch is chosen for the line, see `Kinematics.follow`: the arm has to move to the first
        configuration before. For a line from the current pose use `line_on`.

        Raises:
            Failure: ``UNREACHABLE``, ``PATH_BROKEN`` or ``SINGULAR``.
        """
        return self.kinematics.follow(line(start, end).poses, self.setpoint.q)

    def lines(self, *corners: Pose, near: Vector | None = None) -> Iterator[list[Matrix]]:
        """Straight lines of the tool from corner to corner, for each branch that allows all.

        Args:
            corners: Poses of the tool in the world, at least two.
            near: Configuration of shape (dof,), rad, to which the preferred branches are near; by
                default the last set-point.

        Yields:
            For each line its configurations, of shape (n, dof), rad; each begins where the one
            before ends. The preferred branch comes first, see `Kinematics.branches_along`.

        Raises:
            Failure: ``UNREACHABLE``, ``PATH_BROKEN`` or ``SINGULAR``, if there is none.
        """
        poses = [corners[0]]
        ends = [0]
        for start, end in itertools.pairwise(corners):
            poses += line(start, end).poses[1:]
            ends.append(len(poses) - 1)
        near = self.setpoint.q if near is None else near
        for rows in self.kinematics.branches_along(poses, near):
            yield [rows[first : last + 1] for first, last in itertools.pairwise(ends)]

    def line_on(self, end: Pose) -> Matrix:
        """Configurations, of shape (n, dof), rad, straight on from the last set-point to a pose.

        The first one is that set-point, and the arm stays in its branch.

        Raises:
            Failure: ``PATH_BROKEN`` or ``SINGULAR``.
        """
        return self.line_after(self.setpoint.q, end)

    def line_after(self, q: Vector, end: Pose, free: FreeAxes = ()) -> Matrix:
        """Configurations as for `line_on`, from a configuration ``q`` instead of the set-point.

        Args:
            q: Configuration of shape (dof,), rad.
            end: Pose of the tool in the world.
            free: Rotations about the tool's axes that do not count on the line.
        """
        start = self.kinematics.forward(q)
        poses = line(start, nearest_allowed(start, end, free)).poses
        return self.kinematics.follow_on(poses, q, free=free)

    def time_path(self, q: Matrix, speed: float) -> Trajectory:
        """Time-parameterized motion through configurations of shape (n, dof), rad.

        Raises:
            Failure: ``OVERLOADED``.
        """
        return self.within_efforts(time_path(q, self.limits(speed), self.period))

    def overlapped(
        self,
        before: OverlappedMotion,
        motion: Trajectory,
        speed: float,
        longest_s: float,
        ignore: frozenset[str] = frozenset(),
        *,
        opening: float | None = None,
    ) -> OverlappedMotion:
        """A motion that begins before the one before has ended, so that the arm does not stop.

        Limits, efforts and grip allow the whole, and the overlap keeps `ROOM_M` from objects; at
        worst there is none.

        Args:
            before: Motions before, from the last set-point on.
            motion: Motion that begins where they end.
            speed: Fraction of the limits for the whole, above 0 to 1.
            longest_s: Longest overlap, s.
            ignore: Names of the objects that may be touched in the overlap.
            opening: Opening of the fingers then, m; None for the present one.
        """
        checker = self.checker(ignore)
        if opening is not None:
            checker.open_fingers(opening)

        def is_allowed(whole: Trajectory, first: int, last: int) -> bool:
            piece = whole.piece(first, last + 1)
            try:
                # Both motions have been checked, but not what cuts the corner between them.
                refuse_contact(checker.keeping(ROOM_M, (piece.q[0], piece.q[-1])), piece)
            except Failure:
                return False
            return self.within_efforts(whole) is whole

        return before.then(motion, self.limits(speed), longest_s, is_allowed)

    def slow_path(
        self, q: Matrix, speed: float, most_m_s: float, acceleration_scale: float
    ) -> tuple[Trajectory, float]:
        """Motion through configurations with a bounded speed of the tool, soon reached.

        Args:
            q: Configurations, of shape (n, dof), rad.
            speed: Fraction of the velocity limits, above 0 to 1.
            most_m_s: Highest speed of the tool, m/s.
            acceleration_scale: Fraction of the acceleration and jerk limits, above 0 to 1.

        Returns:
            The motion, and the highest speed of the tool on it, m/s.

        Raises:
            Failure: ``OVERLOADED``.
        """
        limits = replace(self.limits(acceleration_scale), velocity=self.limits(speed).velocity)
        motion = time_path(q, limits, self.period)
        top = self._top_speed(motion)
        if top > most_m_s:
            share = float((np.abs(motion.v) / limits.velocity).max()) * most_m_s / top
            slower = replace(limits, velocity=share * limits.velocity)
            motion = time_path(q, slower, self.period)
            top = self._top_speed(motion)
        return self.within_efforts(motion), top

    def slowing_path(self, q: Matrix, speed: float, most_m_s: SpeedBound) -> Trajectory:
        """Motion through configurations with a speed of the tool that is bounded at each point.

        Args:
            q: Configurations, of shape (n, dof), rad.
            speed: Fraction of the limits, above 0 to 1.
            most_m_s: Highest speed of the tool at lengths of its path from the first of them.

        Raises:
            Failure: ``OVERLOADED``.
        """
        lengths = np.concatenate(((0.0,), np.cumsum(self._tool_steps(q))))
        limits = self.limits(speed)
        return self.within_efforts(time_path_below(q, lengths, most_m_s, limits, self.period))

    def least_speed(self, q: Matrix, speed: float) -> float:
        """Highest speed that the tool can have all along configurations, m/s.

        Args:
            q: Configurations, of shape (n, dof), rad, no two in a row the same.
            speed: Fraction of the velocity limits, above 0 to 1.
        """
        shortest_s = (np.abs(np.diff(q, axis=0)) / self.limits(speed).velocity).max(axis=1)
        return float((self._tool_steps(q) / shortest_s).min())

    def most_force(self, q: Matrix, direction: Vector) -> float:
        """Largest force with which the tool can press in each of several configurations, N.

        Args:
            q: Configurations, of shape (n, dof), rad.
            direction: Unit vector in the world, of shape (3,).
        """
        dynamics = self._shared.carrying.dynamics
        torques = np.array([dynamics.at_rest(row) for row in q])
        levers = np.array([direction @ self.kinematics.jacobian(row)[:3] for row in q])
        return most_force(torques, levers, self.world.nominal[self.name].robot)

    def _tool_steps(self, q: Matrix) -> Vector:
        """Distances of the tool between configurations of shape (n, dof), rad; (n - 1,), m."""
        steps: Vector = np.linalg.norm(np.diff(self._tool_positions(q), axis=0), axis=1)
        return steps

    def _tool_positions(self, q: Matrix) -> Matrix:
        """Positions of the tool in the world at configurations, (n, dof), rad; (n, 3), m."""
        return np.array([self.kinematics.matrix(row)[:3, 3] for row in q])

    def _top_speed(self, motion: Trajectory) -> float:
        return float(self._tool_steps(motion.q).max(initial=0.0)) / motion.dt

    def straight_to(self, goal: Vector, speed: float) -> Trajectory:
        """Motion to a configuration along a straight line in joint space.

        Raises:
            Failure: ``INVALID_TARGET``, ``JOINT_LIMIT``, ``OVERLOADED`` or ``IN_COLLISION``.
        """
        refuse_beyond(self.robot.joints, goal, self.robot.limits)
        motion = point_to_point(self.setpoint.q, goal, self.limits(speed), self.period)
        # A held object may keep touching what it lies on, but is not set down: a joint motion has
        # no goal pose for it.
        checker = self.checker().without_new_contacts([self.setpoint.q])
        refuse_contact(checker, motion)
        return self.within_efforts(motion)

    def within_efforts(self, motion: Trajectory) -> Trajectory:
        """Slow a motion to what joint efforts, grip and passengers allow with the current load.

        Raises:
            Failure: ``OVERLOADED`` if the joints' efforts do not suffice at any speed.
        """
        return self._shared.carrying.within_efforts(motion)

    @property
    def grip_speed_scale(self) -> float:
        """Speed scale, up to 1, to which the grip's friction limited the last motion."""
        return self._shared.carrying.grip_speed_scale

    def is_of_hand(self, failure: Failure) -> bool:
        """Whether the hand, or what it holds, would touch something on a straight line.

        It would do so in all branches of the inverse kinematics, so that none after the one that
        was refused has to be tried. This holds only where the tool's path is the same in all of
        them: it has no free axis.
        """
        if not isinstance(failure, CollisionFailure) or failure.obstacle == self.name:
            return False
        return (
            failure.first == f"{self.name}/{self.robot.tool_link}"
            or failure.first.startswith(f"{self.name}/{GRIPPER}")
            or failure.first in self.world.carried_by(self.name)
        )

    @contextmanager
    def avoiding(self, seen: Mapping[str, Pose]) -> Iterator[None]:
        """Let plans within the block avoid objects where they were seen, not where they are.

        Args:
            seen: Estimated poses in the world by the object's name; none of those that are fixed,
                or move on a joint, count.
        """
        self._seen = seen
        try:
            yield
        finally:
            self._seen = {}

    def checker(self, ignore: frozenset[str] = frozenset()) -> CollisionChecker:
        """Collision checker of configurations in the current world.

        It keeps `PLANNING_MARGIN_M` from other arms (`RESTING_MARGIN_M` from those that stay where
        they are), or the current distance from an arm that is already nearer. Arms that follow this
        one's tool are left out. Fingers that are opening count as far apart as they will be, unless
        they would touch something where the arm is now.
        """
        left_out = self._shared.traffic.followers(self.name) | self.left_out
        ignore |= left_out
        margins = {name: PLANNING_MARGIN_M for name in self.world.arms if name not in left_out}
        margins |= dict.fromkeys(self.resting & margins.keys(), RESTING_MARGIN_M)
        while True:
            checker = CollisionChecker(self.world, self.name, margins, ignore)
            for name, pose in self._seen.items():
                if name in self.world.objects and self.world.objects[name].is_free:
                    checker.move_object(name, pose)
            contact = checker.contact(self.setpoint.q)
            if contact is None:
                open_as_commanded(self.world, self.name, self.setpoint.q, checker)
                return checker
            if contact.depth >= 0.0:
                # A tool that is set on something may by its encoders be a hair above it.
                checker.let_stand(self.setpoint.q, TOUCH)
                return checker
            near = self.world.arm_of(contact.second)
            if margins.get(near, 0.0) <= 0.0:
                return checker
            # 0.1 mm less each time, so that the loop ends whatever the rounding is.
            reduced = min(clearance(-contact.depth, margins[near]), margins[near] - 1e-4)
            margins[near] = max(reduced, 0.0)

    def refuse_collision(self, q: Vector, ignore: frozenset[str] = frozenset()) -> None:
        """Check a configuration before anything moves.

        Raises:
            Failure: ``IN_COLLISION`` with the two bodies and their penetration depth;
                ``INVALID_TARGET`` if it does not have an angle per joint.
        """
        contact = self.checker(ignore).contact(*self._configurations([q]))
        if contact is not None:
            raise contact.failure()

    def refuse_collision_along(
        self,
        path: Matrix | Trajectory,
        ignore: frozenset[str] = frozenset(),
        *,
        opening: float | None = None,
    ) -> None:
        """Check a motion, or configurations of shape (n, dof), rad, before anything moves.

        Args:
            path: The motion, or the configurations.
            ignore: Names of the objects that may be touched.
            opening: Opening of the fingers then, m; None for the present one.

        Raises:
            Failure: ``IN_COLLISION`` of the first configuration that touches something.
        """
        checker = self.checker(ignore)
        if opening is not None:
            checker.open_fingers(opening)
        refuse_contact(checker, path)

    def first_link_contact(self, rows: Matrix) -> tuple[int, CollisionFailure] | None:
        """First configuration in which a link that is not part of the tool would touch something.

        Args:
            rows: Configurations along a path, of shape (n, dof), rad.

        Returns:
            Its index, and the failure ``IN_COLLISION`` with the two bodies; None if there is none.
        """
        checker = CollisionChecker(self.world, self.name, tool_may_touch=True)
        found = checker.first_contact(rows)
        return None if found is None else (found[0], found[1].failure())

    def refuse_load(self, name: str, q: Vector, seen: Pose | None = None) -> None:
        """Check, before an object is picked, whether the arm can hold it.

        Args:
            name: Name of the object.
            q: Configuration in which it is picked, of shape (dof,), rad.
            seen: Estimated pose of the object in the world; its true one by default.

        Raises:
            Failure: ``OVERLOADED``, as `PayloadCheck.refuse`.
        """
        if self.world.objects[name].joint is not None:  # its joint supports it
            return
        tool_link = self.kinematics.forward(q) @ self.robot.tool.inverse
        self._shared.carrying.refuse(name, q, tool_link, seen)


def _between(enclosing: tuple[str, str, str]) -> str:
    """Place of something that two sides enclose, as `CollisionChecker.enclosing` returns them."""
    _, one, other = enclosing
    return f"in {one}" if one == other else f"between {one} and {other}"
