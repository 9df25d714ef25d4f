"""An arm as skills drive it: state, motions, motion plans, and moving among other arms.

`SharedArm` exists once per arm and holds what all leaves of its tree share. Each leaf gets an `Arm`
of its own, which needs the lease to move. `MoveTo` adds what other arms make necessary: waiting,
yielding and replanning.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Collection, Generator, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TypeAlias, TypeVar

import numpy as np

from bt_dualarm.arm.gripper import ArmGripper
from bt_dualarm.arm.payload import PayloadCheck
from bt_dualarm.arm.slip_response import SlipResponse
from bt_dualarm.arm.state import ArmContacts, ArmState, Backoff, Lease
from bt_dualarm.collision.checker import CollisionChecker
from bt_dualarm.control.controller import JointController
from bt_dualarm.core.errors import (
    RAISED_BY_SKILLS,
    BlockedFailure,
    CollisionFailure,
    Failure,
    Number,
    SkillError,
)
from bt_dualarm.core.pose import Matrix, Pose, Vector
from bt_dualarm.kinematics.inverse_kinematics import Kinematics, refuse_beyond
from bt_dualarm.planning.ompl_planner import DEFAULT_PLANNER, Planner
from bt_dualarm.planning.problem import (
    PlanningProblem,
    admitted,
    refuse_contact,
    straight_motion,
    yielding_configurations,
)
from bt_dualarm.planning.process import PlanningProcess
from bt_dualarm.safety.guard import PlanMonitor, clearance
from bt_dualarm.sim.camera import Camera, GuardedCamera
from bt_dualarm.sim.contact_monitor import Contacts
from bt_dualarm.sim.world import World
from bt_dualarm.trajectory.limits import SetPointSource
from bt_dualarm.trajectory.paths import line
from bt_dualarm.trajectory.point_to_point import point_to_point, time_path
from bt_dualarm.trajectory.sources import Stream, TrajectorySource
from bt_dualarm.trajectory.trajectory import Trajectory

SETTLE_S = 1.0
"""Simulated seconds in which the arm has to come to rest after the last set-point of a motion."""

HALT_S = 5.0
"""Simulated seconds in which an arm has to stop; the hardest stop takes less than one."""

SETTLED_RAD = 5e-4
"""Largest joint error at which a motion counts as executed."""

PLANNING_S = 0.1
"""Simulated seconds that planning takes, independent of the computing time, so that runs repeat."""

PLANNING_MARGIN_M = 0.045
"""Distance in meters that plans keep from other arms: more than the guard keeps."""

REPLANS = 1
"""How often an arm replans when something has moved into its path."""

WAIT_S = 5.0
"""Simulated seconds that an arm waits by default for another one to leave its goal."""

_RELAXATIONS = 4
_YIELD_S = 0.1  # in which a contact can push the arm away
_WAITS_ON = ("IN_COLLISION", "TIMED_OUT", "NO_PLAN")  # failures of yielding: wait at this pose
_NOTHING: frozenset[str] = frozenset()


class SharedArm(ArmState):
    """An arm with what all leaves of its tree share.

    Args:
        world: World that the arm is in.
        name: Name of the arm in the tree file.
        controller: Controller that follows the motions of the skills.
        camera: Camera of this arm, if it has one.
        seed: Random seed in this arm's planning.
        planning: Process that searches for collision-free paths.
        touches: True contacts of the arms, for scoring.

    Attributes:
        carrying: Check of loads and motions against what the arm can carry.
        lease: Right to move the arm.
        patience: Backoff while another arm is in the way.
        slip: Slip response of the gripper.
    """

    def __init__(
        self,
        world: World,
        name: str,
        controller: JointController,
        camera: Camera | None,
        seed: int,
        planning: PlanningProcess,
        touches: Contacts,
    ) -> None:
        kinematics = Kinematics(world.robots[name], world.arms[name].base, seed)
        super().__init__(world, name, controller, kinematics)
        self.camera = camera
        self.seed = seed
        self.planning = planning
        self.touches = touches
        self.carrying = PayloadCheck(world, name)
        self.lease = Lease(name, lambda: controller.at_rest)
        self.patience = Backoff(name, seed)
        self.slip = SlipResponse(world, name, controller)


class Arm(ArmState):
    """An arm as one leaf drives it: its state, its motions and its motion plans.

    Only the leaf that holds the lease moves the arm; a motion takes the lease, and ``release``
    stops what this leaf has begun. Configurations are of shape (dof,) in rad, poses are those of
    the tool frame in the world, and ``speed`` is the fraction of the joint limits, above 0 to 1.
    ``ignore`` holds names of objects that may be touched.

    Args:
        shared: The arm with what its leaves share.
        leaf: Path of the leaf in its tree.

    Attributes:
        camera: Camera of this arm, if it has one; an error in a callback fails this leaf.
    """

    def __init__(self, shared: SharedArm, leaf: str) -> None:
        super().__init__(shared.world, shared.name, shared.controller, shared.kinematics)
        self.camera = None if shared.camera is None else GuardedCamera(shared.camera)
        self._shared = shared
        self._lease = shared.lease.for_leaf(leaf)
        self._gripper = ArmGripper(shared.world, shared.name, self._lease)
        self._contacts = ArmContacts(shared.touches, shared.name)
        self._begun: SetPointSource | None = None

    # Gripper, objects and camera

    @property
    def gripper(self) -> ArmGripper:
        """Gripper of this arm.

        Raises:
            Failure: ``NO_GRIPPER``: it has none.
        """
        if self.name not in self.world.grippers:
            raise Failure("NO_GRIPPER", f"{self.name} has no gripper: the file mounts none on it")
        return self._gripper

    def attach(self, name: str, seen: Pose | None = None) -> None:
        """Weld an object to the tool at its current pose; repeated calls change nothing.

        Args:
            name: Name of the object.
            seen: Estimated pose in the world, for the nominal model; the true one by default.
        """
        self._lease.refuse_other_threads()
        self.world.attach(self.name, name, seen)

    def detach(self, name: str) -> bool:
        """Release an attached object; returns whether it was held."""
        self._lease.refuse_other_threads()
        return self.world.attachments.detach(self.name, name)

    def correct_camera(self, correction: Pose) -> None:
        """Correct the camera mount of the nominal model by a pose in the frame assumed so far."""
        self._lease.refuse_other_threads()
        self.world.nominal[self.name].correct_camera(correction)

    @property
    def slips_felt(self) -> int:
        """Number of slips that were detected, whether the grip could become firmer or not."""
        return self._shared.slip.felt

    def touched(self, asked: Collection[str]) -> dict[str, Number]:
        """Metrics of unwanted contacts while this leaf moved the arm.

        Args:
            asked: Names of the objects that the leaf was asked to handle: those do not count.
        """
        return self._contacts.end(asked)

    # The leaf's life

    def enter(self, *, anew: bool) -> None:
        """Register the thread that ticks or halts the leaf, and whether a new run of it begins."""
        self._lease.enter(anew=anew)
        if anew and self.camera is not None:
            self.camera.fault = None

    def trouble(self) -> BaseException | None:
        """Return and clear the error of this leaf's motion, stream or camera callback, if any."""
        if self.camera is not None and self.camera.fault is not None:
            fault = self.camera.fault
            self.camera.fault = None
            return fault
        if self._lease.intrusion:
            error = SkillError(self._lease.intrusion)
            self._lease.intrusion = ""
            return error
        if not self._lease.has_it:
            return None
        try:
            self.check()
        except RAISED_BY_SKILLS as trouble:
            self.controller.fault = None
            return trouble
        return None

    def release(self) -> None:
        """Stop the motion that this leaf has begun; harmless otherwise."""
        if self._lease.give_back():
            self._begun = None
            if self.is_present:
                self.controller.stop()

    # Motions

    def follow(self, trajectory: Trajectory, ignore: frozenset[str] = _NOTHING) -> Iterator[float]:
        """Execute a motion; yields its progress once per tick until the arm is at rest at its end.

        Args:
            trajectory: Motion that begins at the last set-point.
            ignore: Names of the objects that may be touched.

        Raises:
            Failure: ``BUSY`` when another leaf moves the arm, ``TRACKING_ERROR`` when the arm
                cannot follow, ``IN_COLLISION`` when something has moved into the path,
                ``TIMED_OUT`` when another arm does not leave it, ``INTERRUPTED``.
        """
        motion = self.begin(trajectory)
        watch = self.watch(motion, ignore)
        while not motion.done:
            yield motion.progress
            self.check()
            watch.look(self.time)
            self.refuse_when_held_up(motion)
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
            Failure: ``BUSY`` when another leaf moves the arm.
        """
        self._lease.take()
        self._contacts.begin()
        self._shared.slip.may_touch = may_touch
        self._begun = motion = self.controller.follow(
            trajectory, along_path=along_path, may_touch=may_touch, compliant=compliant
        )
        return motion

    def stream(self, source: Stream) -> None:
        """Follow a stream of set-points until ``release`` or ``halt``.

        Raises:
            Failure: ``BUSY`` when another leaf moves the arm.
        """
        self._lease.take()
        self._contacts.begin()
        self._shared.slip.may_touch = False
        self.controller.stream(source)
        self._begun = self.controller.motion

    def watch(self, motion: TrajectorySource, ignore: frozenset[str] = _NOTHING) -> PlanMonitor:
        """Monitor that checks a running motion against the world as it changes."""
        return PlanMonitor(self.world, self.name, motion, ignore)

    def check(self) -> None:
        """Raise the error of the running motion, if there is one.

        Raises:
            Failure: Among others ``INTERRUPTED``, when something else has stopped it, and
                ``DROPPED``, when the gripper has lost the object.
        """
        if self.controller.fault is not None:
            raise self.controller.fault
        self._shared.slip.refuse_lost()
        begun = self._begun
        if begun is not None and not begun.done and self.controller.motion is not begun:
            self._begun = None
            raise Failure(
                "INTERRUPTED",
                f"the motion of {self.name} was stopped externally",
                **({"progress": begun.progress} if isinstance(begun, TrajectorySource) else {}),
            )

    def refuse_when_held_up(self, motion: TrajectorySource) -> None:
        """Refuse to wait longer than the backoff for a motion that the guard has stopped.

        Raises:
            Failure: ``TIMED_OUT`` with what is in the way.
        """
        waited_s = 0.0 if motion.held_since is None else self.time - motion.held_since
        if waited_s <= self._shared.patience.seconds:
            return
        self._shared.patience.renew()
        raise BlockedFailure(
            "TIMED_OUT",
            f"blocked: {motion.held_up}",
            progress=motion.progress,
            waited_s=waited_s,
        )

    def settle(self) -> Iterator[float]:
        """Wait until the arm has settled at its last set-point; yields once per tick.

        Raises:
            Failure: ``TRACKING_ERROR`` when it does not get there within `SETTLE_S`.
        """
        self.controller.compliance.active = False
        began = self.time
        while True:
            self.check()
            error = self._servo_error
            if self.controller.at_rest and error < SETTLED_RAD:
                self._lease.give_back()  # the next leaf need not wait for the last oscillation
                return
            if self.time - began > SETTLE_S:
                raise Failure(
                    "TRACKING_ERROR",
                    f"the arm does not come to rest at its goal: {np.degrees(error):.2f}° away",
                    joint_error_rad=error,
                )
            yield 1.0

    def relax(self) -> Iterator[float]:
        """Move the set-point to the measured configuration, which ends any contact force.

        As the arm yields, the contact pushes it farther away, so this takes a few iterations; the
        final configuration does not matter.

        Raises:
            Failure: ``BUSY`` or ``TRACKING_ERROR``, as ``follow``.
        """
        limits = self.robot.limits
        for _ in range(_RELAXATIONS):
            here = np.clip(self.q, limits.lower, limits.upper)
            retreat = point_to_point(self.setpoint.q, here, limits, self.period)
            motion = self.begin(
                retreat, may_touch=True, compliant=self.controller.compliance.active
            )
            began = self.time
            latest = began + retreat.duration + SETTLE_S
            while self.time < began + _YIELD_S or not self.controller.at_rest:
                if self.time > latest:
                    break
                yield motion.progress
                self.check()
            if self._servo_error < SETTLED_RAD:
                return

    def halt(self, *, give_way: bool = False) -> Iterator[None]:
        """Brake with bounded jerk; yields once per tick until the arm is at rest.

        An arm that is pressed against something is at rest as well, wherever its set-point is. A
        compliant one does not increase its force over time.

        Args:
            give_way: Whether to become compliant at once, since the arm has just touched something.

        Raises:
            Failure: ``TRACKING_ERROR`` when it still moves after `HALT_S`.
        """
        self._lease.refuse_other_threads()
        self._begun = None
        if give_way:
            self.controller.compliance.soften()
        self.controller.stop()
        began = self.time
        while not self.controller.at_rest:
            if self.time - began > HALT_S:
                raise Failure("TRACKING_ERROR", f"the arm still moves {HALT_S:g} s after its stop")
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
        yield from self._come_to_rest()
        yield from self._pass_until(began + PLANNING_S)

    def plan(
        self,
        goals: Sequence[Vector],
        speed: float,
        ignore: frozenset[str] = _NOTHING,
        planner: Planner = DEFAULT_PLANNER,
    ) -> Generator[None, None, Trajectory]:
        """Plan a collision-free motion to one of several configurations, straight where possible.

        Yields once per tick. The plan is made in the world at the start, takes `PLANNING_S`, and is
        checked against the world at its end; if that has changed too much, the arm replans once.

        Args:
            goals: Configurations, each of shape (dof,), rad, the preferred one first.
            speed: Fraction of the limits, above 0 to 1.
            ignore: Names of the objects that may be touched.
            planner: Planner to use if the straight path to the preferred goal is blocked.

        Raises:
            Failure: ``IN_COLLISION`` or ``JOINT_LIMIT`` of the start, or of the preferred goal if
                none of the goals is free; ``NO_PLAN``; ``OVERLOADED``; ``BUSY`` when another leaf
                moves the arm; ``TRACKING_ERROR`` when it does not come to rest.
        """
        yield from self._come_to_rest()
        for replan in range(REPLANS, -1, -1):
            found = yield from self._plan_once(goals, speed, ignore, planner)
            motion = self.within_efforts(found)
            try:
                refuse_contact(self.checker(ignore), motion)
            except Failure:
                if not replan:
                    raise
            else:
                break
        return motion

    def _plan_once(
        self, goals: Sequence[Vector], speed: float, ignore: frozenset[str], planner: Planner
    ) -> Generator[None, None, Trajectory]:
        due = self.time + PLANNING_S
        problem = admitted(
            PlanningProblem(
                self.checker(ignore),
                self.setpoint.q,
                tuple(goals),
                self.limits(speed),
                self.period,
                self._shared.seed,
                planner,
            )
        )
        straight = straight_motion(problem)
        if straight is not None:
            yield from self._pass_until(due)
            return straight
        pending = self._shared.planning.solve(problem)
        try:
            yield from self._pass_until(due)
            try:
                return pending.result()
            except Failure as refusal:
                refusal.noting(planning_s=PLANNING_S)
                raise
        finally:
            pending.abandon()

    def _come_to_rest(self) -> Iterator[None]:
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

    def lines(self, *corners: Pose) -> Iterator[list[Matrix]]:
        """Straight lines of the tool from corner to corner, for each branch that allows all.

        Args:
            corners: Poses of the tool in the world, at least two.

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
        for rows in self.kinematics.branches_along(poses, self.setpoint.q):
            yield [rows[first : last + 1] for first, last in itertools.pairwise(ends)]

    def line_on(self, end: Pose) -> Matrix:
        """Configurations, of shape (n, dof), rad, straight on from the last set-point to a pose.

        The first one is that set-point, and the arm stays in its branch.

        Raises:
            Failure: ``PATH_BROKEN`` or ``SINGULAR``.
        """
        return self.line_after(self.setpoint.q, end)

    def line_after(self, q: Vector, end: Pose) -> Matrix:
        """Configurations as of `line_on`, from a configuration ``q`` instead of the set-point."""
        start = self.kinematics.forward(q)
        return self.kinematics.follow_on(line(start, end).poses, q)

    def time_path(self, q: Matrix, speed: float) -> Trajectory:
        """Time-parameterized motion through configurations of shape (n, dof), rad.

        Raises:
            Failure: ``OVERLOADED``.
        """
        return self.within_efforts(time_path(q, self.limits(speed), self.period))

    def straight_to(self, goal: Vector, speed: float) -> Trajectory:
        """Motion to a configuration along a straight line in joint space.

        Raises:
            Failure: ``INVALID_TARGET``, ``JOINT_LIMIT``, ``OVERLOADED`` or ``IN_COLLISION``.
        """
        refuse_beyond(self.robot.joints, goal, self.robot.limits)
        motion = point_to_point(self.setpoint.q, goal, self.limits(speed), self.period)
        self.refuse_collision_along(motion)
        return self.within_efforts(motion)

    def within_efforts(self, motion: Trajectory) -> Trajectory:
        """Slow a motion to what joint efforts and grip allow with the current load.

        Raises:
            Failure: ``OVERLOADED`` if the joints' efforts do not suffice at any speed.
        """
        return self._shared.carrying.within_efforts(motion)

    @property
    def grip_pace(self) -> float:
        """Speed scale, up to 1, to which the grip's friction limited the last motion."""
        return self._shared.carrying.grip_pace

    def planned_tool_positions(self, trajectory: Trajectory) -> Matrix:
        """Positions of the tool in the world at a motion's set-points, of shape (n, 3), m."""
        return np.array([self.kinematics.matrix(q)[:3, 3] for q in trajectory.q])

    def checker(self, ignore: frozenset[str] = _NOTHING) -> CollisionChecker:
        """Collision checker of configurations in the current world.

        It keeps `PLANNING_MARGIN_M` from other arms, or the current distance from an arm that is
        already nearer.
        """
        margins = dict.fromkeys(self.world.arms, PLANNING_MARGIN_M)
        while True:
            checker = CollisionChecker(self.world, self.name, margins, ignore)
            contact = checker.contact(self.setpoint.q)
            if contact is None or contact.depth >= 0.0:
                return checker
            near = contact.second.partition("/")[0]
            if margins.get(near, 0.0) <= 0.0:
                return checker
            # 0.1 mm less each time, so that the loop ends whatever the rounding is.
            reduced = min(clearance(-contact.depth, margins[near]), margins[near] - 1e-4)
            margins[near] = max(reduced, 0.0)

    def refuse_collision(self, q: Vector, ignore: frozenset[str] = _NOTHING) -> None:
        """Check a configuration before anything moves.

        Raises:
            Failure: ``IN_COLLISION`` with the two bodies and their penetration depth.
        """
        contact = self.checker(ignore).contact(q)
        if contact is not None:
            raise contact.failure()

    def refuse_collision_along(
        self, way: Matrix | Trajectory, ignore: frozenset[str] = _NOTHING
    ) -> None:
        """Check a motion, or configurations of shape (n, dof), rad, before anything moves.

        Raises:
            Failure: ``IN_COLLISION`` of the first configuration that touches something.
        """
        refuse_contact(self.checker(ignore), way)

    def first_link_contact(self, rows: Matrix) -> tuple[int, CollisionFailure] | None:
        """First configuration in which a link that is no part of the tool would touch something.

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
        tool_link = self.kinematics.forward(q) @ self.robot.tool.inverse
        self._shared.carrying.refuse(name, q, tool_link, seen)

    # Moving among other arms

    def travel(
        self,
        goals: Sequence[Vector],
        speed: float,
        ignore: frozenset[str] = _NOTHING,
        *,
        give_way: bool = False,
        patience: float = WAIT_S,
        planner: Planner = DEFAULT_PLANNER,
    ) -> Iterator[float | None]:
        """Plan to one of several goals and execute the plan, waiting for other arms; once per tick.

        Args:
            goals: Configurations, each of shape (dof,), rad, the preferred one first.
            speed: Fraction of the limits, above 0 to 1.
            ignore: Names of the objects that may be touched.
            give_way: Whether the arm moves aside while it waits for another one.
            patience: Simulated seconds after which it no longer waits or replans.
            planner: Planner to use if the straight path is blocked.

        Raises:
            Failure: As `plan` and `follow`.
        """
        move = self.past_others(speed, ignore)
        return replace(move, search=planner, give_way=give_way, wait_s=patience).go(goals)

    def past_others(self, speed: float, ignore: frozenset[str] = _NOTHING) -> MoveTo:
        """Motions other than `travel` that wait for moving arms and replan."""
        return MoveTo(self, self._shared.patience, speed, ignore)


Planning: TypeAlias = Callable[[], Generator[None, None, Trajectory]]
"""Plans a motion from the current configuration, in the current world; yields once per tick."""

_Found = TypeVar("_Found")


@dataclass(frozen=True, eq=False)
class MoveTo:
    """Motions of one leaf in a world in which other arms move.

    Attributes:
        arm: Arm of the leaf.
        backoff: Time that the arm waits before it tries again.
        speed: Fraction of the limits, above 0 to 1.
        ignore: Names of the objects that may be touched.
        search: Planner to use if the straight path is blocked.
        give_way: Whether the arm moves aside while it waits, so that two arms do not wait
            for each other.
        wait_s: Simulated seconds after which it no longer waits or replans.
    """

    arm: Arm
    backoff: Backoff
    speed: float
    ignore: frozenset[str] = frozenset()
    search: Planner = DEFAULT_PLANNER
    give_way: bool = False
    wait_s: float = WAIT_S

    def go(self, goals: Sequence[Vector]) -> Iterator[float | None]:
        """Plan and execute a motion to one of several goals; yields once per tick.

        Args:
            goals: Configurations, each of shape (dof,), rad, the preferred one first.

        Raises:
            Failure: As `Arm.plan` and `Arm.follow`.
        """
        return self.along(lambda: self.arm.plan(goals, self.speed, self.ignore, self.search))

    def straight(self, end: Pose, *, known_free: bool = False) -> Iterator[float | None]:
        """Move the tool straight to a pose in the world, as `along`; yields once per tick.

        Args:
            end: Pose of the tool.
            known_free: Whether only another arm can be in the way of the whole line.

        Raises:
            Failure: As `Arm.line_on`, `Arm.time_path` and `Arm.follow`; ``IN_COLLISION``.
        """
        start = self.arm.setpoint.q

        def planned() -> Generator[None, None, Trajectory]:
            rows = self.arm.line_on(end)
            # After an interruption the line begins elsewhere, where nothing is known to be free.
            has_not_moved = bool(np.array_equal(self.arm.setpoint.q, start))
            yield from self._checked(rows, known_free and has_not_moved)
            return self.arm.time_path(rows, self.speed)

        return self.along(planned)

    def until_free(self, rows: Matrix, *, known_free: bool = False) -> Iterator[float | None]:
        """Wait until no other arm blocks a path; yields once per tick.

        Args:
            rows: Configurations along the path, of shape (n, dof), rad.
            known_free: Whether only another arm can be in the way.

        Raises:
            Failure: ``IN_COLLISION`` with what else is in the way, or with an arm that stays.
        """
        until = self.arm.time + self.wait_s
        return self._when_clear(lambda: self._checked(rows, known_free), until)

    def along(self, planning: Planning) -> Iterator[float | None]:
        """Plan and execute the plan to its end; yields once per tick.

        If another arm is at the goal or in the path, the arm waits for that to change. If something
        moves into the path during the motion, it stops and replans from its current configuration:
        once at least, and again within ``wait_s``.

        Args:
            planning: Makes the plan, each time.

        Raises:
            Failure: As ``planning`` and `Arm.follow`.
        """
        until = self.arm.time + self.wait_s
        replans = REPLANS
        while True:
            motion = yield from self._when_clear(planning, until)
            try:
                yield from self.arm.follow(motion, self.ignore)
            except BlockedFailure:
                if replans <= 0 and self.arm.time > until:
                    raise
            else:
                return
            replans -= 1
            yield from self.arm.halt()

    def may_clear(self, refusal: Failure) -> bool:
        """Whether another arm, or what it holds, is or may be the reason of a failure."""
        attempts = refusal.__cause__
        neighbors = self.arm.controller.neighbors
        if isinstance(attempts, ExceptionGroup):
            return any(
                isinstance(one, Failure) and self.may_clear(one) for one in attempts.exceptions
            )
        if not isinstance(refusal, CollisionFailure):
            return refusal.code == "NO_PLAN" and bool(neighbors)
        held = self.arm.world.attachments
        return refusal.obstacle in neighbors or any(
            held.find(name, refusal.obstacle) is not None for name in neighbors
        )

    def _when_clear(
        self, attempt: Callable[[], Generator[None, None, _Found]], until: float
    ) -> Generator[float | None, None, _Found]:
        """Repeat an attempt while another arm makes it fail, until a simulated time."""
        while True:
            try:
                return (yield from attempt())
            except Failure as refusal:
                if not self.may_clear(refusal) or self.arm.time > until:
                    raise
            again = self.arm.time + self.backoff.renew()
            while self.arm.time < again:
                yield None
            if self.give_way:
                yield from self._yield_to_others()

    def _yield_to_others(self) -> Iterator[float | None]:
        """Move away from the other arms, as far as that is possible."""
        arm = self.arm
        others = [arm.world.arms[name].base.position for name in arm.controller.neighbors]
        goals = yielding_configurations(
            arm.checker(self.ignore),
            others,
            tuple(arm.robot.postures.values()),
            arm.robot.limits,
            self.backoff.rng,
        )
        if not goals:
            return
        try:
            motion = yield from arm.plan(goals, self.speed, self.ignore, DEFAULT_PLANNER)
            yield from arm.follow(motion, self.ignore)
        except Failure as failure:
            if failure.code not in _WAITS_ON:
                raise
            yield from arm.halt()

    def _checked(self, rows: Matrix, known_free: bool) -> Generator[None, None, None]:
        """Refuse a blocked path; if it is known to be free, only one that an arm blocks."""
        yield from ()
        if known_free and not self.arm.controller.neighbors:
            return
        try:
            self.arm.refuse_collision_along(rows, self.ignore)
        except CollisionFailure as refusal:
            if not known_free or self.may_clear(refusal):
                raise
