"""One arm as its skills see it: where it is, how it moves, what it holds and sees."""

from __future__ import annotations

from collections.abc import Collection, Generator, Iterator, Sequence
from dataclasses import replace

from bt_dualarm.arm.execution import Executor
from bt_dualarm.arm.gripper import ArmGripper
from bt_dualarm.arm.move_to import WAIT_S, MoveTo
from bt_dualarm.arm.planning import ArmPlanner
from bt_dualarm.arm.shared import SharedArm
from bt_dualarm.arm.state import ArmState
from bt_dualarm.arm.touching import Touching
from bt_dualarm.errors import Failure, Number
from bt_dualarm.motion.collision.checker import CollisionChecker
from bt_dualarm.motion.planning.planners import DEFAULT_PLANNER, Planner
from bt_dualarm.motion.safety.plan_monitor import PlanMonitor
from bt_dualarm.motion.setpoints.stream_source import Stream
from bt_dualarm.motion.setpoints.trajectory_source import TrajectorySource
from bt_dualarm.motion.timing.trajectory import Trajectory
from bt_dualarm.pose import Matrix, Pose, Vector
from bt_dualarm.world.cameras.guarded_camera import GuardedCamera

_NOTHING: frozenset[str] = frozenset()


class Arm(ArmState):
    """An arm in the hands of one leaf: its state, with an executor, a planner and a lease.

    The lease lets only one leaf at a time move the arm; ``release`` stops what this leaf has begun.
    What a method takes and raises is said where it is done: of motions at `Executor`, of paths,
    plans and refusals at `ArmPlanner`, of going somewhere while others move at `MoveTo`.

    Args:
        shared: Arm as all leaves share it.
        leaf: Path of the leaf in its tree.

    Attributes:
        camera: Camera of this arm, if it has one; what its callbacks raise is this leaf's fault.
    """

    def __init__(self, shared: SharedArm, leaf: str) -> None:
        super().__init__(shared.world, shared.name, shared.controller, shared.kinematics)
        self.camera = None if shared.camera is None else GuardedCamera(shared.camera)
        self._lease = shared.lease.for_leaf(leaf)
        self._patience = shared.patience
        self._carrying = shared.carrying
        self._slip = shared.slip
        self._touching = Touching(shared.touches, shared.name)
        state = ArmState(shared.world, shared.name, shared.controller, shared.kinematics)
        self._gripper = ArmGripper(shared.world, shared.name, self._lease)
        self._executor = Executor(state, self._lease, shared.patience, self._touching, shared.slip)
        self._planner = ArmPlanner(
            state, self._lease, shared.planning, shared.carrying, shared.seed
        )

    @property
    def gripper(self) -> ArmGripper:
        """Gripper of this arm.

        Raises:
            Failure: ``NO_GRIPPER``: it has none.
        """
        if self.name not in self.world.grippers:
            raise Failure("NO_GRIPPER", f"{self.name} has no gripper: the file mounts none on it")
        return self._gripper

    def attach(self, thing: str, seen: Pose | None = None) -> None:
        """Weld an object to the tool as it lies now; again changes nothing.

        Args:
            thing: Name of the object.
            seen: Pose in the world where it was seen to lie; by default its true one is believed.
        """
        self._lease.refuse_other_threads()
        self.world.attach(self.name, thing, seen)

    def correct_camera(self, correction: Pose) -> None:
        """Believe the camera to be there, in the frame where it was believed to be so far."""
        self._lease.refuse_other_threads()
        self.world.nominal[self.name].correct_camera(correction)

    def detach(self, thing: str) -> bool:
        """Let go of an object; whether it was held."""
        self._lease.refuse_other_threads()
        return self.world.attachments.detach(self.name, thing)

    # How it moves: the executor

    def follow(self, trajectory: Trajectory, ignore: frozenset[str] = _NOTHING) -> Iterator[float]:
        """Execute a motion; yields its progress once a tick until the arm stands at its end."""
        return self._executor.follow(trajectory, ignore)

    def begin(
        self,
        trajectory: Trajectory,
        *,
        along_path: bool = False,
        may_touch: bool = False,
        compliant: bool = False,
    ) -> TrajectorySource:
        """Begin a motion and leave it to the caller to watch it with ``check``."""
        return self._executor.begin(
            trajectory, along_path=along_path, may_touch=may_touch, compliant=compliant
        )

    def watch(self, motion: TrajectorySource, ignore: frozenset[str] = _NOTHING) -> PlanMonitor:
        """A check of a motion against the world as it becomes while it runs."""
        return self._executor.watch(motion, ignore)

    def check(self) -> None:
        """Raise what went wrong with the motion since it began."""
        self._executor.check()

    def refuse_when_held_up(self, motion: TrajectorySource) -> None:
        """End a motion that the guard has stopped for longer than an arm waits."""
        self._executor.refuse_when_held_up(motion)

    def settle(self) -> Iterator[float]:
        """Wait until the arm stands on its last set-point; yields once a tick."""
        return self._executor.settle()

    def relax(self) -> Iterator[float]:
        """Take the set-point back to where the arm is, so that it no longer presses on anything."""
        return self._executor.relax()

    def stream(self, source: Stream) -> None:
        """Follow a stream of set-points until ``release`` or ``halt``."""
        self._executor.stream(source)

    def halt(self) -> Iterator[None]:
        """Brake with bounded jerk; yields once a tick until the arm stands still."""
        return self._executor.halt()

    def release(self) -> None:
        """Stop the motion that this leaf has begun; harmless otherwise."""
        self._executor.release()

    def touched(self, asked: Collection[str]) -> dict[str, Number]:
        """What the arm touched while this leaf moved it, but for what it was asked to: metrics."""
        return self._touching.end(asked)

    def enter(self, *, anew: bool) -> None:
        """Note that this thread ticks or halts the leaf, and whether a new run of it begins."""
        self._lease.enter(anew=anew)
        if anew and self.camera is not None:
            self.camera.fault = None

    def trouble(self) -> BaseException | None:
        """What this leaf's motion, stream or camera callback has raised since last asked."""
        if self.camera is not None and self.camera.fault is not None:
            fault, self.camera.fault = self.camera.fault, None
            return fault
        return self._executor.trouble()

    # How it finds its motions: the planner

    def think(self) -> Iterator[None]:
        """Let the simulated time of planning pass; plan afterwards, on the world as it is then."""
        return self._planner.think()

    def plan(
        self,
        goals: Sequence[Vector],
        speed: float,
        ignore: frozenset[str] = _NOTHING,
        planner: Planner = DEFAULT_PLANNER,
    ) -> Generator[None, None, Trajectory]:
        """A motion free of collisions to one of several configurations, straight where possible."""
        return self._planner.plan(goals, speed, ignore, planner)

    def line(self, start: Pose, end: Pose) -> Matrix:
        """Configurations, of shape (n, dof), rad, along a straight line of the tool."""
        return self._planner.line(start, end)

    def lines(self, *corners: Pose) -> Iterator[list[Matrix]]:
        """Straight lines of the tool from corner to corner, in each branch that allows all."""
        return self._planner.lines(*corners)

    def line_on(self, end: Pose) -> Matrix:
        """Configurations, of shape (n, dof), rad, straight on from the last set-point to a pose."""
        return self._planner.line_on(end)

    def line_after(self, q: Vector, end: Pose) -> Matrix:
        """As `line_on`, from another configuration ``q``, of shape (dof,), rad."""
        return self._planner.line_after(q, end)

    def time_path(self, q: Matrix, speed: float) -> Trajectory:
        """The motion through configurations, of shape (n, dof), at a share of the limits."""
        return self._planner.time_path(q, speed)

    def straight_to(self, goal: Vector, speed: float) -> Trajectory:
        """The motion to the configuration ``goal`` in which all joints turn evenly."""
        return self._planner.straight_to(goal, speed)

    def within_efforts(self, motion: Trajectory) -> Trajectory:
        """The motion, as much slower as what the arm holds asks for; itself where it may be."""
        return self._carrying.within_efforts(motion)

    @property
    def grip_pace(self) -> float:
        """Share of its pace that the gripper's friction allowed the last motion, up to 1."""
        return self._carrying.grip_pace

    @property
    def slips_felt(self) -> int:
        """How often a pull at what its gripper holds was felt, and answered where that could be."""
        return self._slip.felt

    def refuse_load(self, thing: str, q: Vector, seen: Pose | None = None) -> None:
        """Check an object, where it was ``seen`` or is, before it is taken at ``q`` (dof,), rad."""
        link = self.kinematics.forward(q) @ self.robot.tool.inverse
        self._carrying.refuse(thing, q, link, seen)

    def planned_tool_positions(self, trajectory: Trajectory) -> Matrix:
        """Positions of the tool in the world at a motion's set-points, of shape (n, 3), m."""
        return self._planner.planned_tool_positions(trajectory)

    def checker(self, ignore: frozenset[str] = _NOTHING) -> CollisionChecker:
        """A test of configurations against the world as it stands now."""
        return self._planner.checker(ignore)

    def refuse_collision(self, q: Vector, ignore: frozenset[str] = _NOTHING) -> None:
        """Check a configuration, of shape (dof,), rad, before anything moves."""
        self._planner.refuse_collision(q, ignore)

    def refuse_collision_along(
        self, way: Matrix | Trajectory, ignore: frozenset[str] = _NOTHING
    ) -> None:
        """Check a motion, or configurations of shape (n, dof), rad, before anything moves."""
        self._planner.refuse_collision_along(way, ignore)

    # Both together

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
        """Plan to one of several goals and follow the plan, past arms that move; once a tick."""
        move = self.past_others(speed, ignore)
        return replace(move, search=planner, give_way=give_way, wait_s=patience).go(goals)

    def past_others(self, speed: float, ignore: frozenset[str] = _NOTHING) -> MoveTo:
        """Other ways than to a goal that wait for arms that move, and are planned anew."""
        return MoveTo(self, self._executor, self._planner, self._patience, speed, ignore)
