"""One arm as its skills see it: where it is, how it moves, what it holds and sees."""

from __future__ import annotations

import copy
import zlib
from collections.abc import Generator, Iterator, Sequence

import numpy as np

from bt_dualarm.errors import Failure
from bt_dualarm.motion import timing
from bt_dualarm.motion.collision import CollisionChecker
from bt_dualarm.motion.controller import JointController
from bt_dualarm.motion.guard import clearance
from bt_dualarm.motion.ik import Kinematics
from bt_dualarm.motion.joint_motion import free_motion, refuse_contact
from bt_dualarm.motion.joint_range import refuse_beyond
from bt_dualarm.motion.limiter import SetPoint
from bt_dualarm.motion.motions import Motion, Stream, TrajectoryMotion
from bt_dualarm.motion.paths import line
from bt_dualarm.motion.plan_watch import PlanWatch
from bt_dualarm.motion.sweep import sweep_radii
from bt_dualarm.motion.trajectory import Trajectory
from bt_dualarm.pose import Matrix, Pose, Vector
from bt_dualarm.world.camera import Camera
from bt_dualarm.world.catalogue import JointLimits, Robot
from bt_dualarm.world.guarded_camera import GuardedCamera
from bt_dualarm.world.world import World

SETTLE_S = 1.0
"""Simulated seconds that the arm gets to stand still after the last set-point of a motion."""

HALT_S = 5.0
"""Simulated seconds that an arm gets to come to rest; the hardest stop takes less than one."""

SETTLED_RAD = 5e-4
"""Largest joint error at which a motion counts as executed."""

_RELAXATIONS = 4
_YIELD_S = 0.1  # that a contact gets to push the arm away

PLANNING_S = 0.1
"""Simulated seconds that planning costs, whatever it costs on the wall."""


PATIENCE_S = (0.5, 2.0)
"""Simulated seconds, drawn between these, that an arm waits for another one to clear its way."""

WAIT_S = 5.0
"""Simulated seconds that an arm waits for another one to leave its goal, unless said otherwise."""

REPLANS = 1
"""How often an arm plans anew when something has moved into its way."""

PLANNING_MARGIN_M = 0.045
"""Distance in metres that plans keep from other arms: more than the guard asks for."""


_IN_THE_WAY = ("IN_COLLISION", "TIMED_OUT")


class Arm:
    """Handed to every skill; all poses are of the tool frame, in the world.

    Only one leaf can move the arm at a time; ``release`` stops what this leaf has begun.

    Args:
        world: The world that the arm is in.
        name: Of the arm in the tree file.
        controller: Follows what the skills ask for.
        camera: Of this arm, if it has one.
        seed: Of everything random in this arm's planning.

    Attributes:
        world: For placing and measuring things. What a camera is meant to see is not taken from it.
    """

    def __init__(
        self, world: World, name: str, controller: JointController, camera: Camera | None, seed: int
    ) -> None:
        self.world = world
        self.name = name
        self._camera = camera
        self.camera = None if camera is None else GuardedCamera(camera)
        self.controller = controller
        self.kinematics = Kinematics(world.robots[name], world.arms[name].base, seed)
        self._seed = seed
        self._owner: list[object] = [None]
        self._leaf: object = None
        self._begun: Motion | None = None
        self._patience_rng = np.random.default_rng([seed, zlib.crc32(name.encode())])
        self._patience = self._draw_patience()

    def for_leaf(self, leaf: object) -> Arm:
        """The same arm in the hands of one leaf."""
        arm = copy.copy(self)
        arm._leaf = leaf
        arm.camera = None if self._camera is None else GuardedCamera(self._camera)
        return arm

    @property
    def robot(self) -> Robot:
        """What the catalogue says of it."""
        return self.world.robots[self.name]

    @property
    def period(self) -> float:
        """Seconds between two set-points."""
        return self.controller.period

    @property
    def time(self) -> float:
        """Simulated time in seconds."""
        return self.world.time

    @property
    def setpoint(self) -> SetPoint:
        """The last set-point sent: where motions begin."""
        return self.controller.setpoint

    @property
    def tool_pose(self) -> Pose:
        """Where the tool really is."""
        return self.world.arms[self.name].tool_pose

    @property
    def commanded_tool_pose(self) -> Pose:
        """Where the last set-point puts the tool: free of the servo error, so plans start here."""
        return self.kinematics.forward(self.setpoint.q)

    @property
    def held(self) -> tuple[str, ...]:
        """Objects attached to the tool."""
        return self.world.attachments.attached_to(self.name)

    def limits(self, speed: float) -> JointLimits:
        """The arm's limits with velocity, acceleration and jerk times ``speed``."""
        return self.robot.limits.scaled(speed)

    def checker(self, ignore: frozenset[str] = frozenset()) -> CollisionChecker:
        """A test of configurations against the world as it stands now.

        Args:
            ignore: Objects that may be touched.

        Returns:
            One that keeps `PLANNING_MARGIN_M` from other arms.
        """
        clear = PLANNING_MARGIN_M
        while True:  # nearer to another arm already: keep what there is
            checker = CollisionChecker(self.world, self.name, max(clear, 0.0), ignore)
            contact = checker.contact(self.setpoint.q) if clear > 0.0 else None
            if contact is None or contact.second.partition("/")[0] not in self.world.arms:
                return checker
            if -contact.depth <= 0.0:
                return checker
            clear = min(clearance(-contact.depth, clear), clear - 1e-4)

    def refuse_collision(self, q: Vector, ignore: frozenset[str] = frozenset()) -> None:
        """Check a configuration before anything moves.

        Raises:
            Failure: ``IN_COLLISION`` with the two bodies and how deep they are in each other.
        """
        contact = self.checker(ignore).contact(q)
        if contact is not None:
            raise contact.failure()

    def refuse_collision_along(self, q: Matrix, ignore: frozenset[str] = frozenset()) -> None:
        """Check configurations, of shape (n, dof), before anything moves.

        Raises:
            Failure: ``IN_COLLISION`` at the first one that touches something.
        """
        checker = self.checker(ignore)
        refuse_contact(checker, q, sweep_radii(checker))

    def posture(self, name: str) -> Vector:
        """Joint angles, of shape (dof,), of a named posture of the robot.

        Raises:
            Failure: ``INVALID_TARGET``; the sentence names the postures that there are.
        """
        postures = self.robot.postures
        if name not in postures:
            known = ", ".join(postures)
            raise Failure("INVALID_TARGET", f"{self.robot.name} has no posture {name!r}: {known}")
        return postures[name]

    def think(self) -> Iterator[None]:
        """Let the simulated time of planning pass; plan afterwards, on the world as it is then.

        What an earlier leaf has begun is braked meanwhile: plans start where the arm stands.

        Raises:
            Failure: ``BUSY`` when another leaf moves the arm.
        """
        until = self.time + PLANNING_S
        while self.time < until or self.controller.motion is not None:
            self._refuse_if_busy()
            yield

    def line(self, start: Pose, end: Pose) -> Matrix:
        """Configurations, of shape (n, dof), along a straight line of the tool.

        Raises:
            Failure: ``UNREACHABLE`` or ``PATH_BROKEN``.
        """
        return self.kinematics.follow(line(start, end).poses, self.setpoint.q)

    def time_path(self, q: Matrix, speed: float) -> Trajectory:
        """The motion through configurations, of shape (n, dof), at a share of the limits."""
        return timing.time_path(q, self.limits(speed), self.period)

    def straight_to(self, goal: Vector, speed: float) -> Trajectory:
        """The motion to the configuration ``goal`` in which all joints turn evenly.

        Raises:
            Failure: ``INVALID_TARGET``, ``JOINT_LIMIT`` or ``IN_COLLISION``.
        """
        refuse_beyond(self.robot.joints, goal, self.robot.limits)
        motion = timing.point_to_point(self.setpoint.q, goal, self.limits(speed), self.period)
        self.refuse_collision_along(motion.q)
        return motion

    def travel(
        self,
        goals: Sequence[Vector],
        speed: float,
        ignore: frozenset[str] = frozenset(),
        *,
        give_way: bool = False,
        patience: float = WAIT_S,
    ) -> Iterator[float | None]:
        """Plan to the first of several goals that has a way, and follow the plan.

        Where another arm stands at the goal or in the way, it waits for that to change. When
        something has moved into the way meanwhile, the arm stops and plans once more, from where
        it stands, around what is there then.

        Args:
            goals: Configurations of shape (dof,), the preferred one first.
            speed: Share of the limits.
            ignore: Objects that may be touched.
            give_way: Wait at home, so that two arms do not wait for each other.
            patience: Seconds that it waits at most.

        Raises:
            Failure: As ``plan_to_any`` and ``follow``.
        """
        replans = REPLANS
        while True:
            motion = yield from self._plan_when_clear(
                goals, speed, ignore, patience, give_way=give_way
            )
            try:
                yield from self.follow(motion, ignore)
            except Failure as failure:
                in_the_way = failure.code in _IN_THE_WAY and "progress" in failure.numbers
                if not in_the_way or replans == 0:
                    raise
            else:
                return
            replans -= 1
            yield from self.halt()
            yield from self.think()

    def _plan_when_clear(
        self,
        goals: Sequence[Vector],
        speed: float,
        ignore: frozenset[str],
        patience: float,
        *,
        give_way: bool,
    ) -> Generator[float | None, None, Trajectory]:
        began = self.time
        while True:
            try:
                return self.plan_to_any(goals, speed, ignore)
            except Failure as refusal:
                if not self._may_clear(refusal) or self.time - began > patience:
                    raise
            until = self.time + self._draw_patience()
            while self.time < until:
                yield None
            if give_way:
                yield from self._give_way(speed, ignore)

    def _give_way(self, speed: float, ignore: frozenset[str]) -> Iterator[float | None]:
        """Go home, as far as that is possible."""
        try:
            yield from self.follow(self.plan_to(self.posture("home"), speed, ignore), ignore)
        except Failure as failure:
            if failure.code not in (*_IN_THE_WAY, "NO_PLAN"):
                raise
            yield from self.halt()

    def _may_clear(self, refusal: Failure) -> bool:
        """Whether another arm is the reason, or may be."""
        others = self.world.arms.keys() - {self.name}
        owner = str(refusal.numbers.get("second", "")).partition("/")[0]
        return owner in others or (refusal.code == "NO_PLAN" and bool(others))

    def plan_to_any(
        self, goals: Sequence[Vector], speed: float, ignore: frozenset[str] = frozenset()
    ) -> Trajectory:
        """As ``plan_to``, to the first of several goals that has a way.

        Raises:
            Failure: Why the first goal has none, if no goal has one; ``NO_PLAN`` if one of them
                at least is free, and only the way to it is not.
        """
        refusals = []
        for goal in goals:
            try:
                return self.plan_to(goal, speed, ignore)
            except Failure as refusal:
                refusals.append(refusal)
        raise next((one for one in refusals if one.code == "NO_PLAN"), refusals[0])

    def attach(self, thing: str) -> None:
        """Weld an object to the tool as it lies now; again changes nothing."""
        self.world.attach(self.name, thing)

    def detach(self, thing: str) -> bool:
        """Let go of an object; whether it was held."""
        return self.world.attachments.detach(self.name, thing)

    def plan_to(
        self, goal: Vector, speed: float, ignore: frozenset[str] = frozenset()
    ) -> Trajectory:
        """A motion free of collisions to the configuration ``goal``, straight where possible.

        Raises:
            Failure: ``IN_COLLISION`` or ``NO_PLAN``.
        """
        return free_motion(
            self.checker(ignore),
            self.setpoint.q,
            goal,
            self.limits(speed),
            self.period,
            self._seed,
        )

    def follow(
        self, trajectory: Trajectory, ignore: frozenset[str] = frozenset()
    ) -> Iterator[float]:
        """Execute a motion; yields its progress once a tick until the arm stands at its end.

        Args:
            trajectory: From where the last set-point was.
            ignore: Objects that may be touched.

        Raises:
            Failure: ``BUSY`` when another leaf moves the arm, ``TRACKING_ERROR`` when the arm
                cannot follow, ``IN_COLLISION`` when something has come into the way,
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

    def watch(self, motion: TrajectoryMotion, ignore: frozenset[str] = frozenset()) -> PlanWatch:
        """A check of a motion against the world as it becomes while it runs."""
        return PlanWatch(self.world, self.name, motion, ignore)

    def refuse_when_held_up(self, motion: TrajectoryMotion) -> None:
        """End a motion that the guard has stopped for longer than an arm waits.

        Raises:
            Failure: ``TIMED_OUT`` with what is in the way.
        """
        if motion.held_since is None or self.time - motion.held_since <= self._patience:
            return
        self._patience = self._draw_patience()
        raise Failure(
            "TIMED_OUT",
            f"held up: {motion.held_up}",
            progress=motion.progress,
            waited_s=self.time - motion.held_since,
        )

    def _draw_patience(self) -> float:
        """Seconds; drawn, so that two arms in each other's way do not try at the same time."""
        return float(self._patience_rng.uniform(*PATIENCE_S))

    def begin(self, trajectory: Trajectory, *, along_path: bool = False) -> TrajectoryMotion:
        """Begin a motion and leave it to the caller to watch it with ``check``.

        Args:
            trajectory: From where the last set-point was.
            along_path: The tool's path matters, not only its end.
        """
        self._claim()
        self._begun = motion = self.controller.follow(trajectory, along_path=along_path)
        return motion

    def stream(self, source: Stream) -> None:
        """Follow a stream of set-points until ``release`` or ``halt``."""
        self._claim()
        self.controller.stream(source)
        self._begun = self.controller.motion

    def halt(self) -> Iterator[None]:
        """Brake with bounded jerk; yields once a tick until the arm stands still.

        Where it stands does not matter: an arm that leans on something is at rest as well.

        Raises:
            Failure: ``TRACKING_ERROR`` when it still moves after ``HALT_S``.
        """
        self._begun = None
        self.controller.stop()
        began = self.time
        while not self.controller.at_rest:
            if self.time - began > HALT_S:
                raise Failure("TRACKING_ERROR", f"the arm still moves {HALT_S:g} s after its stop")
            yield None

    def relax(self) -> Iterator[float]:
        """Take the set-point back to where the arm is, so that it no longer presses on anything.

        What it has pressed on pushes it away as it yields, so this takes a few times; where it
        comes to stand in the end does not matter.

        Raises:
            Failure: ``BUSY`` or ``TRACKING_ERROR``, as ``follow``.
        """
        limits = self.robot.limits
        for _ in range(_RELAXATIONS):
            here = np.clip(self.world.arms[self.name].q, limits.lower, limits.upper)
            way = timing.point_to_point(self.setpoint.q, here, limits, self.period)
            motion, began = self.begin(way), self.time
            latest = began + way.duration + SETTLE_S
            while self.time < began + _YIELD_S or not self.controller.at_rest:
                if self.time > latest:
                    break
                yield motion.progress
                self.check()
            if self._servo_error < SETTLED_RAD:
                return

    def check(self) -> None:
        """Raise what went wrong with the motion since it began.

        Raises:
            Failure: Among others ``INTERRUPTED``, when something else has stopped it.
        """
        if self.controller.fault is not None:
            raise self.controller.fault
        begun = self._begun
        if begun is not None and not begun.done and self.controller.motion is not begun:
            self._begun = None
            raise Failure("INTERRUPTED", f"something else has stopped the motion of {self.name}")

    def trouble(self) -> Exception | SystemExit | None:
        """What this leaf's motion, stream or camera callback has raised since last asked."""
        if self.camera is not None and self.camera.fault is not None:
            fault, self.camera.fault = self.camera.fault, None
            return fault
        if self._leaf is None or self._owner[0] is not self._leaf:
            return None
        try:
            self.check()
        except (Exception, SystemExit) as trouble:  # noqa: BLE001 - a stream may raise anything
            self.controller.fault = None
            return trouble
        return None

    def release(self) -> None:
        """Stop the motion that this leaf has begun; harmless otherwise."""
        if self._leaf is not None and self._owner[0] is self._leaf:
            self._owner[0] = self._begun = None
            self.controller.stop()

    def planned_tool_positions(self, trajectory: Trajectory) -> Matrix:
        """Where each set-point of a motion puts the tool, of shape (n, 3)."""
        return np.array([self.kinematics.matrix(q)[:3, 3] for q in trajectory.q])

    @property
    def _servo_error(self) -> float:
        """Largest joint error in rad."""
        return float(np.abs(self.setpoint.q - self.world.arms[self.name].q).max())

    def _claim(self) -> None:
        self._refuse_if_busy()
        self._owner[0] = self._leaf

    def _refuse_if_busy(self) -> None:
        owner = self._owner[0]
        if owner is not None and owner is not self._leaf and not self.controller.at_rest:
            raise Failure("BUSY", f"{owner} is moving {self.name} already", owner=str(owner))

    def settle(self) -> Iterator[float]:
        """Wait until the arm stands on its last set-point; yields once a tick.

        Raises:
            Failure: ``TRACKING_ERROR`` when it does not get there.
        """
        began = self.time
        while True:
            self.check()
            error = self._servo_error
            if self.controller.at_rest and error < SETTLED_RAD:
                if self._owner[0] is self._leaf:
                    self._owner[0] = None  # what comes next need not wait for the last tremor
                return
            if self.time - began > SETTLE_S:
                raise Failure(
                    "TRACKING_ERROR",
                    f"the arm does not come to rest on its goal: {np.degrees(error):.2f}° away",
                    joint_error_rad=error,
                )
            yield 1.0
