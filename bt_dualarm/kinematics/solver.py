"""Kinematic chains, and their numeric inverse: Gauss-Newton steps from several starts.

- `Chain` evaluates any configuration with PlaCo, and `Mechanism` those of several arms at once.
- `Posture` watches a simulated arm for singularities and joint limits, with MuJoCo's Jacobian.
- `Multistart` searches all solutions of a target, and follows paths from them.
- `Continuation` continues from one solution to that of nearby targets, as along a path.
- `Descent` iterates from one start to the targets.

Each step is a quadratic program of PlaCo's task-space solver, with the joint limits and the largest
step as constraints. It converges quadratically near a solution; far from one, it may get stuck,
which is why several starts are needed.

PlaCo never frees the memory of a robot model: unused models are kept for the next user of the same
URDF.
"""

from __future__ import annotations

import math
import warnings
import weakref
import xml.etree.ElementTree as ET
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Final

import mujoco
import numpy as np

from bt_dualarm.core.errors import Failure
from bt_dualarm.core.free_axes import REMEDY, FreeAxes, angle_to, pointing
from bt_dualarm.core.pose import Matrix, Pose, Vector
from bt_dualarm.robots.robot import Robot
from bt_dualarm.sim.world import World

if TYPE_CHECKING:
    import placo

__all__ = [
    "MOST_IDLE",
    "NEAR_LIMIT",
    "SINGULAR_CONDITION",
    "TOOL",
    "TURN",
    "Chain",
    "Mechanism",
    "Posture",
    "broken",
    "origin",
    "with_tool",
]

TOOL = "tool/frame"
"""Name of the tool frame that is added to the chain; no link's name contains a slash."""

SINGULAR_CONDITION = 50.0
"""Condition number of the Jacobian from which an arm counts as singular, and moves at half speed:
its worst direction needs fifty times the joint rates of its best. A UR5 has 8 in its home posture,
and 50 within 14° of a straight elbow, 5 mm before the end of its reach."""

_AT_LIMIT = 0.02
"""Distance from a position limit at which a joint counts as the reason of a broken path, rad."""

NEAR_LIMIT = 0.01
"""Distance of a joint from its position limit below which an arm moves at half speed, rad."""

MOST_IDLE: Final = 16
"""Maximum number of unused models that are kept for reuse."""

_PARTS = ("joints", "lower", "upper", "placo", "_lent", "_q_ids", "v_ids")
"""Attributes of a `Mechanism`, without those of its subclasses."""


class Mechanism:
    """Joints and links of a URDF in PlaCo, in the last configuration that was evaluated.

    Results never depend on that configuration.

    Args:
        urdf: URDF text without geometry.
        joints: Names of the movable joints.
        lower: Lower position limits, of shape (dof,), rad.
        upper: Upper position limits, of shape (dof,), rad.
    """

    def __init__(self, urdf: str, joints: Sequence[str], lower: Vector, upper: Vector) -> None:
        self.joints = tuple(joints)
        self.lower = lower
        self.upper = upper
        self._lent = _Lent(urdf)
        self.placo = self._lent.model.placo
        # The model may come from another user, with other limits.
        for name, least, most in zip(joints, lower, upper, strict=True):
            self.placo.set_joint_limits(name, least, most)
        self._q_ids = np.array([self.placo.get_joint_offset(name) for name in joints])
        self.v_ids = np.array([self.placo.get_joint_v_offset(name) for name in joints])

    @property
    def bare(self) -> Mechanism:
        """Mechanism that shares this one's joints, links and state.

        For solvers owned by this mechanism: if they referred to their owner, both would stay in
        memory until Python's cycle collector runs.
        """
        bare = object.__new__(Mechanism)
        vars(bare).update((name, vars(self)[name]) for name in _PARTS)
        return bare

    @property
    def dof(self) -> int:
        """Number of movable joints."""
        return len(self._q_ids)

    @property
    def state(self) -> Vector:
        """Copy of PlaCo's current configuration, of shape (dof,), rad."""
        q: Vector = self.placo.state.q[self._q_ids]
        return q

    def set_state(self, q: Vector) -> None:
        """Set PlaCo's configuration, of shape (dof,), rad."""
        self.placo.state.q[self._q_ids] = q
        self.placo.update_kinematics()

    def frame(self, name: str) -> Matrix:
        """Transform of a link in the world in the current configuration, of shape (4, 4)."""
        matrix: Matrix = self.placo.get_T_world_frame(name)
        return matrix


class Chain(Mechanism):
    """Kinematic chain of one arm: joint positions to tool pose and Jacobian, in the world.

    Args:
        robot: Robot description.
        base: Pose of its base link in the world.
        room: Margin by which joints stay away from their position limits, rad.
    """

    def __init__(self, robot: Robot, base: Pose, room: float = 0.0) -> None:
        self.robot = robot
        self.base = base
        limits = robot.limits
        super().__init__(with_tool(robot), robot.joints, limits.lower + room, limits.upper - room)
        self.placo.set_T_world_frame(robot.base_link, base.matrix)

    def matrix(self, q: Vector) -> Matrix:
        """Homogeneous transform of the tool in the world at ``q``, of shape (4, 4)."""
        self.set_state(q)
        return self.frame(TOOL)

    def forward(self, q: Vector) -> Pose:
        """Pose of the tool in the world at ``q``, of shape (dof,), rad."""
        return Pose.from_matrix(self.matrix(q))

    def jacobian(self, q: Vector, frame: str = TOOL) -> Matrix:
        """Jacobian of a link in world axes, linear velocity first, of shape (6, dof)."""
        self.set_state(q)
        jacobian: Matrix = self.placo.frame_jacobian(frame, "local_world_aligned")[:, self.v_ids]
        return jacobian

    def tool(self, q: Vector) -> tuple[Matrix, Matrix]:
        """Results of ``matrix`` and ``jacobian``, at the cost of one of them."""
        jacobian = self.jacobian(q)
        return self.frame(TOOL), jacobian

    def condition(self, q: Vector) -> float:
        """Condition number of the Jacobian: largest over smallest singular value; may be infinite.

        Meters and radians have equal weight.
        """
        values = np.linalg.svd(self.jacobian(q), compute_uv=False)
        return float(values[0] / values[-1]) if values[-1] > 0.0 else float("inf")

    def room(self, q: Vector) -> float:
        """Distance in rad from ``q``, of shape (dof,) or (n, dof), to the nearest joint limit."""
        limits = self.robot.limits
        return float(np.minimum(q - limits.lower, limits.upper - q).min())

    @cached_property
    def bounding_ball(self) -> tuple[Vector, float]:
        """Outer bound of the workspace: center in the world, of shape (3,), and radius in m.

        A ball around the first joint whose radius is the sum of distances from joint to joint to
        tool (triangle inequality): the tool may not reach all of it, but nothing beyond.
        """
        joints, tool, _ = self._joints_at_home
        steps = np.diff([*joints, tool.position], axis=0)
        return joints[0].copy(), float(np.linalg.norm(steps, axis=1).sum())

    @cached_property
    def _joints_at_home(self) -> tuple[Matrix, Pose, Vector]:
        """Positions of the joints, of shape (dof, 3), m, tool, and axis of the last joint, (3,).

        All in the world. Distances from joint to joint are the same in every configuration: any
        will do.
        """
        axis = self.jacobian(self.robot.postures["home"])[3:, -1]
        joints = np.array([self.frame(link)[:3, 3] for link in self.moved_links])
        return joints, Pose.from_matrix(self.frame(TOOL)), axis

    @cached_property
    def moved_links(self) -> tuple[str, ...]:
        """The link that each joint moves; its frame has its origin on the joint's axis."""
        children = {
            str(joint.get("name")): str(child.get("link"))
            for joint in ET.fromstring(self.robot.urdf_text).iter("joint")  # noqa: S314 # our own
            for child in joint.iter("child")
        }
        return tuple(children[name] for name in self.joints)


def with_tool(robot: Robot) -> str:
    """URDF text of a robot with the tool frame added as a link."""
    tool = (
        f'<link name="{TOOL}"/><joint name="{TOOL}_joint" type="fixed">'
        f'{origin(robot.tool)}<parent link="{robot.tool_link}"/>'
        f'<child link="{TOOL}"/></joint></robot>'
    )
    return robot.urdf_text.replace("</robot>", tool)


def origin(pose: Pose) -> str:
    """URDF ``origin`` element of a pose."""
    xyz = " ".join(map(repr, pose.position.tolist()))
    rpy = " ".join(map(repr, pose.rpy))
    return f'<origin xyz="{xyz}" rpy="{rpy}"/>'


class Posture:
    """Distance of a simulated arm from singularities and joint limits, and the speed it allows.

    Must be rebuilt after the world is recompiled.

    Args:
        world: World that contains the arm.
        arm: Name of the arm.

    Attributes:
        room: Distance to the nearest position limit at the last `look`, rad.
        condition: Condition number of the tool's Jacobian at the last `look`.
    """

    def __init__(self, world: World, arm: str) -> None:
        self._world = world
        self._body = world.arms[arm]
        self._limits = world.robots[arm].limits
        self._jacobian = np.zeros((6, world.model.nv))
        self.room = float("inf")
        self.condition = 1.0

    def look(self) -> None:
        """Update ``room`` and ``condition`` from the sensed joint positions."""
        limits = self._limits
        body = self._body
        model = self._world.model
        data = self._world.sensed
        q = data.qpos[body.qpos_ids]
        self.room = float(min((q - limits.lower).min(), (limits.upper - q).min()))
        # Jacobians refer to centers of mass, which the kinematics alone does not update.
        mujoco.mj_comPos(model, data)
        mujoco.mj_jacSite(model, data, self._jacobian[:3], self._jacobian[3:], body.tool_site)
        values = np.linalg.svd(self._jacobian[:, body.dof_ids], compute_uv=False)
        self.condition = float(values[0] / max(values[-1], 1e-9))

    @property
    def time_scale(self) -> tuple[float, str]:
        """Time scale of a motion along a path, and the reason if it is less than 1."""
        if self.condition > SINGULAR_CONDITION:
            return 0.5, f"it is near a singularity, condition number {self.condition:.0f}"
        if self.room < NEAR_LIMIT:
            return 0.5, f"a joint is {max(self.room, 0.0):.3f} rad from its limit"
        return 1.0, ""


def broken(
    arm: Chain, q: Vector, pose: Pose, fraction: float, branches: int, free: FreeAxes = ()
) -> Failure:
    """Failure for a path that cannot be followed to its end.

    Args:
        arm: Arm that should follow it.
        q: Configuration at the last sample that could be followed, of shape (dof,), rad.
        pose: First pose that could not.
        fraction: Fraction of the path up to there.
        branches: Number of start configurations that were tried.
        free: Rotations that the path leaves free.

    Returns:
        ``SINGULAR`` if the arm is singular at ``q``, otherwise ``PATH_BROKEN``.
    """
    position = ", ".join(f"{x:.3f}" for x in pose.position)
    how_far = f"the arm can follow only {100.0 * fraction:.0f} % of the path, to ({position}) m"
    numbers = {"fraction": fraction, "branches": branches}
    condition = min(arm.condition(q), 1e12)  # JSON has no infinity
    if condition > SINGULAR_CONDITION:
        return Failure(
            "SINGULAR", f"{how_far}: it is singular there", **numbers, condition=condition
        )
    room = np.minimum(q - arm.lower, arm.upper - q)
    joint = int(np.argmin(room))
    why = f": {arm.robot.joints[joint]} is at its limit" if room[joint] < _AT_LIMIT else ""
    why = why or _remedy(arm.dof, free)
    return Failure("PATH_BROKEN", how_far + why, **numbers)


class _Model:
    """Robot model of PlaCo, with its URDF for reuse."""

    def __init__(self, urdf: str) -> None:
        with warnings.catch_warnings():
            # Pinocchio 3.8, which PlaCo brings, imports a module that has been renamed.
            warnings.simplefilter("ignore", DeprecationWarning)
            import placo  # it takes long, and many checks of a file do without
        self.urdf = urdf
        self.placo = placo.RobotWrapper("", placo.Flags.ignore_collisions, urdf)
        self._first = self.placo.state.q.copy()

    def reset(self) -> None:
        """Restore the initial state; position limits are set by the next user."""
        self.placo.state.q[:] = self._first
        self.placo.update_kinematics()


_idle: list[_Model] = []


class _Lent:
    """Holds a model until the last reference to this object is gone."""

    def __init__(self, urdf: str) -> None:
        self.model = model = _taken(urdf) or _Model(urdf)
        weakref.finalize(self, _give_back, model).atexit = False


def _taken(urdf: str) -> _Model | None:
    """Unused model of this URDF in its initial state; None if there is none."""
    for model in tuple(_idle):
        if model.urdf == urdf:
            try:
                _idle.remove(model)
            except ValueError:  # another thread was faster
                continue
            model.reset()
            return model
    return None


def _give_back(model: _Model) -> None:
    """Keep a model for reuse; the oldest unused one is dropped if there are too many."""
    _idle.append(model)
    if len(_idle) > MOST_IDLE:
        _idle.pop(0)


_DAMPING = 1e-8
"""Weight of joint motion relative to frame errors: redundant joints move as little as possible, and
a solution is still accurate to 1e-12 m after six iterations."""

_PULL = 1e-7
"""Weight of the distance to a posture; it moves a frame by less than 1e-6 m."""

_CONVERGED = 1e-6
"""Error before a step, in m + rad, after which the solution is exact: convergence is quadratic."""

_STALLED = 1e-4
"""Largest joint step below which a descent that misses its target has stalled, rad."""

_LATE = 15
"""Iteration at which `_FAR` applies."""

_FAR = 0.05
"""A descent with an error above `_FAR` m + rad at iteration `_LATE` is abandoned: one in forty
would still converge, and a third of all iterations is saved."""

_STILL = 2e-3
"""Largest joint step below which redundant joints have reached their posture, rad."""

NEAR = 2.5
"""Motion of every joint below which a solution counts as near, rad: searching for a nearer one
takes twice the time, and finds one that is 2 % nearer on average."""

STEP = 0.6
"""Maximum motion of a joint per iteration, rad: more overshoots from far starts, less is slower."""

_RESTARTS = 150
"""Number of starts after which a target counts as unreachable; with 40, one in forty of the targets
that need every joint on a limit is missed."""

_ALL = 40
"""Number of starts when all solutions are searched."""

_ITERATIONS = 40
"""Maximum number of iterations from a far start."""

_ENOUGH = 3
"""Number of different solutions of which the nearest is taken."""

_CONVERGED_STARTS = 8
"""Number of converged starts of which the nearest is taken for a redundant mechanism. With three,
it was up to 1.6 times as far away as the best of all, depending on the seed; with eight, 1.3
times."""

_PULLED = 12
"""Iterations of redundant joints toward the posture; more of them get no nearer."""

_ALIKE = 1e-2
"""Largest joint difference of two solutions that count as the same, rad."""

TURN = 2.0 * np.pi
"""Rotation of a joint that leaves the pose of every link as it is, rad."""


@dataclass(frozen=True)
class Tolerance:
    """Allowed distance in m and angle in rad of the tool from its target."""

    position: float
    angle: float

    def holds(self, residual: tuple[float, float]) -> bool:
        """Whether a residual in m and rad is within the tolerance."""
        return residual[0] <= self.position and residual[1] <= self.angle


EXACT = Tolerance(1e-5, 1e-4)
"""Tolerance of solutions that motions are planned with."""

NEARLY = Tolerance(1e-4, 5e-3)
"""The same for an arm of fewer than six joints: its poses have no volume among all poses, so that
it takes none exactly that was measured, as that of an object in its hand."""


@dataclass(frozen=True)
class FrameTask:
    """Frame that has a target.

    Attributes:
        frame: Name of the frame.
        seen_from: Frame in which the target is given; None for the world.
        free: Rotations of the frame that the target leaves free; only of a target in the world.
    """

    frame: str
    seen_from: str | None = None
    free: FreeAxes = ()

    def __post_init__(self) -> None:
        if self.free and self.seen_from is not None:
            raise ValueError("only a target in the world may leave axes free")

    @property
    def constraints(self) -> int:
        """Number of coordinates that the target fixes."""
        return 6 - len(self.free)


class Multistart:
    """Searches configurations with all frames on their targets, and follows paths from them.

    Solutions keep the position limits, and their residuals were checked.

    Args:
        mechanism: Mechanism that moves.
        tasks: Frames that have targets.
        seed: Seed of the start configurations for difficult targets.

    Attributes:
        redundant: Whether the tasks leave joints free.
        continuation: Continuation from one solution to a nearby one.
    """

    def __init__(self, mechanism: Mechanism, tasks: Sequence[FrameTask], seed: int) -> None:
        self.redundant = mechanism.dof > sum(task.constraints for task in tasks)
        self.continuation = Continuation(mechanism, STEP, tasks, redundant=self.redundant)
        self._mechanism = mechanism
        self._tasks = tuple(tasks)
        rng = np.random.default_rng(seed)
        # Drawn once, so that a search does not depend on those before it.
        self._scatter = rng.uniform(0.0, 1.0, (_RESTARTS, mechanism.dof))
        self._whole_turns = mechanism.upper - mechanism.lower > TURN

    def residuals(self, q: Vector, goals: Sequence[Matrix]) -> list[tuple[float, float]]:
        """Distance in m and angle in rad of each frame from its target."""
        mechanism = self._mechanism
        mechanism.set_state(q)
        found = []
        for task, goal in zip(self._tasks, goals, strict=True):
            reached = mechanism.frame(task.frame)
            if task.seen_from is not None:
                reached = np.linalg.inv(mechanism.frame(task.seen_from)) @ reached
            found.append(residual_between(reached, goal, task.free))
        return found

    def holds(self, q: Vector, goals: Sequence[Matrix], tolerance: Tolerance) -> bool:
        """Whether every frame is within a tolerance of its target."""
        return all(tolerance.holds(residual) for residual in self.residuals(q, goals))

    def solutions(
        self,
        goals: Sequence[Matrix],
        near: Vector,
        tolerance: Tolerance,
        *,
        pull: bool = True,
        every: bool = False,
        near_enough: float = 0.0,
    ) -> tuple[list[Vector], Vector]:
        """Different solutions, in the order in which they were found.

        Args:
            goals: Target of each frame, each of shape (4, 4).
            near: Configuration at which the search begins, of shape (dof,), rad.
            tolerance: Tolerance of each residual.
            pull: Whether redundant joints are moved toward ``near``.
            every: Try more starts, instead of stopping when three solutions are found.
            near_enough: A first solution with all joints nearer than this to ``near`` ends the
                search, rad.

        Returns:
            The solutions, and the configuration with the smallest residual.
        """
        near = np.clip(near, self._mechanism.lower, self._mechanism.upper)
        found: list[Vector] = []
        closest = near
        least = float("inf")
        converged = 0
        for number, start in enumerate(self._starts(near)):
            # An unreachable target is known only after all starts.
            if every and found and number > _ALL:
                break
            q = self._descend(goals, start, near)
            residuals = self.residuals(q, goals)
            if not all(tolerance.holds(residual) for residual in residuals):
                if (missed := sum(map(sum, residuals))) < least:
                    closest = q
                    least = missed
                continue
            converged += 1
            # From ``near`` itself, damping has kept redundant joints as near as they can be.
            for solution in self._pulled(goals, q, near) if pull and start is not near else [q]:
                if different(found, solution):
                    found.append(solution)
            is_near = np.abs(found[0] - near).max() < near_enough
            # The branches of a redundant arm are not isolated: count starts instead of solutions.
            is_enough = converged == _CONVERGED_STARTS if self.redundant else len(found) == _ENOUGH
            if not every and (is_near or is_enough):
                break
        return found, closest

    def along(
        self,
        continuation: Continuation,
        goals: Sequence[Sequence[Matrix]],
        start: Vector,
        tolerance: Tolerance,
        max_step: float,
        guide: Matrix | None = None,
    ) -> list[Vector]:
        """Configurations along a path, each of shape (dof,), rad, as far as it can be followed.

        Args:
            continuation: Continuation: this search's own, or one with narrower limits.
            goals: Targets of the frames, each of shape (4, 4), at each sample.
            start: Configuration at the first sample, (dof,), rad; redundant joints stay near it.
            tolerance: Tolerance of each residual.
            max_step: Movement of a joint in rad that counts as a jump.
            guide: Configurations that redundant joints stay near instead, one for each sample, of
                shape (n, dof), rad.
        """
        rows: list[Vector] = []
        q = start
        continuation.pull_to(start)
        for index, targets in enumerate(goals):
            before = q
            if guide is not None:
                continuation.pull_to(guide[index])
            q = continuation.step_to(targets, q)
            jumped = float(np.abs(q - before).max()) > max_step
            if jumped or not self.holds(q, targets, tolerance):
                break
            rows.append(q)
        return rows

    def _descend(self, goals: Sequence[Matrix], start: Vector, near: Vector) -> Vector:
        """Configuration to which one start converges, of shape (dof,), rad."""
        return self._unwound(
            self.continuation.step_to(goals, start, pulled=0, exact=_ITERATIONS), near
        )

    def _pulled(self, goals: Sequence[Matrix], q: Vector, near: Vector) -> Iterator[Vector]:
        """The solution of this branch nearest to ``near``, then the one it was found from."""
        if self.redundant:
            self.continuation.pull_to(near)
            pulled = self.continuation.nearest(goals, q, steps=_PULLED)
            if self.holds(pulled, goals, EXACT):
                yield pulled
        yield q

    def _starts(self, near: Vector) -> Iterator[Vector]:
        """Start configurations: ``near``, then random ones within half a turn of it."""
        yield near
        lower = np.maximum(self._mechanism.lower, near - np.pi)
        upper = np.minimum(self._mechanism.upper, near + np.pi)
        yield from lower + self._scatter * (upper - lower)

    def _unwound(self, q: Vector, near: Vector) -> Vector:
        """Equivalent configuration within half a turn of ``near`` where limits permit it."""
        lower = self._mechanism.lower
        upper = self._mechanism.upper
        # Only joints with a range of more than a turn have an equivalent angle within it.
        turned = q - TURN * np.round((q - near) / TURN)
        fits = self._whole_turns & (turned >= lower) & (turned <= upper)
        return np.where(fits, turned, q)


def branches(solutions: Callable[[bool], Sequence[Vector]]) -> Iterator[Vector]:
    """Different solutions of one target: the nearest ones, then all others.

    Args:
        solutions: Returns solutions, nearest first; the argument is whether to try every start.
    """
    tried: list[Vector] = []
    for every in (False, True):
        for q in solutions(every):
            if different(tried, q):
                tried.append(q)
                yield q


def different(solutions: Sequence[Vector], q: Vector) -> bool:
    """Whether a configuration differs from all known ones."""
    return not any(np.abs(q - other).max() < _ALIKE for other in solutions)


class Continuation:
    """Continues a solution to nearby targets, with redundant joints near a posture.

    Args:
        mechanism: Mechanism that moves.
        step: Maximum motion of a joint per iteration, rad.
        tasks: Frames that have targets.
        redundant: Whether the tasks leave joints free.
    """

    def __init__(
        self, mechanism: Mechanism, step: float, tasks: Sequence[FrameTask], *, redundant: bool
    ) -> None:
        self.mechanism = mechanism
        self._exact = Descent(mechanism, step, tasks)
        self._pulled = PulledDescent(mechanism, step, tasks) if redundant else None

    def pull_to(self, posture: Vector) -> None:
        """Set the posture of redundant joints, of shape (dof,), rad."""
        if self._pulled is not None:
            self._pulled.pull_to(posture)

    def nearest(self, targets: Sequence[Matrix], q: Vector, *, steps: int) -> Vector:
        """Solution nearest to the posture, from a solution ``q``, of shape (dof,), rad."""
        if self._pulled is None:
            return q
        q = self._pulled.nearest(targets, q, steps)
        return self._exact.run(targets, q, 8)

    def step_to(
        self, targets: Sequence[Matrix], q: Vector, *, pulled: int = 6, exact: int = 8
    ) -> Vector:
        """Solution for targets near ``q``, of shape (dof,), rad; with limits per phase."""
        # First roughly, toward the posture as well; then exactly, wherever redundant joints are.
        q = _within(self.mechanism, q)
        if self._pulled is not None and pulled:
            q = self._pulled.run(targets, q, pulled)
        return self._exact.run(targets, q, exact)


class Descent:
    """Gauss-Newton iteration of a mechanism to its targets, within its position limits.

    Args:
        mechanism: Mechanism that moves.
        step: Maximum motion of a joint per iteration, rad.
        tasks: Frames that have targets.
    """

    def __init__(self, mechanism: Mechanism, step: float, tasks: Sequence[FrameTask]) -> None:
        self._mechanism = mechanism
        self._robot = mechanism.placo
        self._solver = capped_solver(mechanism, step, _DAMPING)
        self._world = []
        self._relative = []
        self._points = []
        self._directions = []
        parts = []
        for number, aim in enumerate(tasks):
            name = f"frame {number}"
            if aim.free:
                point = self._solver.add_position_task(aim.frame, np.zeros(3))
                point.configure(name, "soft", 1.0)
                self._points.append((number, point))
                parts.append(point)
                axis = pointing(aim.free)
                if axis is not None:
                    direction = self._solver.add_axisalign_task(aim.frame, axis, axis)
                    direction.configure(f"{name} direction", "soft", 1.0)
                    self._directions.append((number, axis, direction))
                    parts.append(direction)
                continue
            if aim.seen_from is None:
                task = self._solver.add_frame_task(aim.frame, np.eye(4))
                self._world.append((number, task))
            else:
                task = self._solver.add_relative_frame_task(aim.seen_from, aim.frame, np.eye(4))
                self._relative.append((number, task))
            task.configure(name, "soft", 1.0, 1.0)
            parts += [task.position(), task.orientation()]
        self._norms = [part.error_norm for part in parts]

    def run(self, targets: Sequence[Matrix], start: Vector, iterations: int) -> Vector:
        """Configuration after the iteration, of shape (dof,), rad; not necessarily on the targets.

        Args:
            targets: Target of each frame, each of shape (4, 4).
            start: Configuration within the position limits, of shape (dof,), rad.
            iterations: Maximum number of iterations.
        """
        robot = self._robot
        solver = self._solver
        self._set(targets, start)
        for i in range(iterations):
            step = solver.solve(True)
            robot.update_kinematics()
            error = 0.0
            for norm in self._norms:
                error += norm()
            # The error is from before the step: the step itself has squared it.
            if error < _CONVERGED:
                break
            if i == _LATE and error > _FAR:
                break
            # Checking the step costs as much as half a step.
            if i % 4 == 3 and np.abs(step).max() < _STALLED < error:
                break
        return self._state()

    def _set(self, targets: Sequence[Matrix], start: Vector) -> None:
        """Set the start, of shape (dof,), rad, and the targets."""
        for number, task in self._world:
            task.T_world_frame = targets[number]
        for number, task in self._relative:
            task.T_a_b = targets[number]
        for number, task in self._points:
            task.target_world = targets[number][:3, 3]
        for number, axis, task in self._directions:
            task.targetAxis_world = targets[number][:3, :3] @ axis
        self._mechanism.set_state(start)

    def _state(self) -> Vector:
        mechanism = self._mechanism
        return _within(mechanism, mechanism.state)


class PulledDescent(Descent):
    """Descent whose redundant joints move toward a posture instead of staying where they are.

    It converges linearly, by a digit per iteration, and ends up to 1e-6 m from the target: a plain
    `Descent` has to follow.
    """

    def __init__(self, mechanism: Mechanism, step: float, tasks: Sequence[FrameTask]) -> None:
        super().__init__(mechanism, step, tasks)
        self._joints = mechanism.joints
        self._posture = self._solver.add_joints_task()
        self._posture.configure("posture", "soft", _PULL)

    def nearest(self, targets: Sequence[Matrix], start: Vector, iterations: int) -> Vector:
        """Solution nearest to the posture, from a start on the targets, of shape (dof,), rad."""
        self._set(targets, start)
        for _ in range(iterations):
            step = self._solver.solve(True)
            self._robot.update_kinematics()
            if np.abs(step).max() < _STILL:
                break
        return self._state()

    def pull_to(self, posture: Vector) -> None:
        """Set the posture, of shape (dof,), rad."""
        self._posture.set_joints(dict(zip(self._joints, posture.tolist(), strict=True)))


def capped_solver(mechanism: Mechanism, step: float, damping: float) -> placo.KinematicsSolver:
    """PlaCo solver for a mechanism, without tasks yet, within its position limits.

    Args:
        mechanism: Mechanism that moves.
        step: Maximum motion of a joint per iteration, rad, so that far starts do not overshoot.
        damping: Weight of joint motion relative to the errors of the tasks, m²/rad².
    """
    solver = mechanism.placo.make_solver()
    # PlaCo has a floating base and velocity limits: with a fixed base and steps of 1 s, a velocity
    # limit in rad/s is the largest motion per step in rad.
    solver.mask_fbase(True)
    solver.dt = 1.0
    mechanism.placo.set_velocity_limits(step)
    solver.enable_velocity_limits(True)
    solver.add_regularization_task(damping)
    return solver


def _within(mechanism: Mechanism, q: Vector) -> Vector:
    """Nearest configuration within the position limits, of shape (dof,), rad."""
    # Minimum and maximum: np.clip costs three times as much.
    nearest: Vector = np.minimum(np.maximum(q, mechanism.lower), mechanism.upper)
    return nearest


def target_matrix(target: Pose) -> Matrix:
    """Homogeneous transform of a target, of shape (4, 4), after a check.

    Raises:
        Failure: ``INVALID_TARGET`` if an element is not finite or the quaternion has no unit
            length.
    """
    w, x, y, z = target.quaternion.tolist()
    unit = abs(w * w + x * x + y * y + z * z - 1.0) < 1e-3
    if not (unit and all(map(math.isfinite, target.position.tolist()))):
        raise Failure(
            "INVALID_TARGET",
            f"position {target.position.tolist()} with quaternion {target.quaternion.tolist()} "
            "is not a pose: numbers must be finite and the quaternion of unit length",
        )
    return target.matrix


def residual_between(reached: Matrix, goal: Matrix, free: FreeAxes = ()) -> tuple[float, float]:
    """Distance in m and angle in rad between two transforms, of shape (4, 4).

    Rotations in ``free`` do not count.
    """
    if free:
        distance = float(np.linalg.norm(reached[:3, 3] - goal[:3, 3]))
        return distance, angle_to(Pose.from_matrix(reached), Pose.from_matrix(goal), free)
    (a, b, c, x), (d, e, f, y), (g, h, i, z) = (reached - goal)[:3].tolist()
    # The Frobenius norm of the difference of two rotations is sqrt(8) sin(angle / 2).
    chord = math.hypot(a, b, c, d, e, f, g, h, i)
    return math.hypot(x, y, z), 2.0 * math.asin(min(1.0, chord / math.sqrt(8.0)))


def _remedy(joints: int, free: FreeAxes) -> str:
    """What helps an arm with too few joints for a pose, for messages; empty for other arms."""
    if joints >= 6 - len(free):
        return ""
    return f"; an arm of {joints} joints cannot take every orientation: {REMEDY}"


def unreachable(distance: float, angle: float, joints: int = 6, free: FreeAxes = ()) -> Failure:
    """Failure for a target that the tool misses by a distance in m and an angle in rad.

    Args:
        distance: Distance in m.
        angle: Angle in rad.
        joints: Number of joints of the arm.
        free: Rotations that the target leaves free.
    """
    digits = 1 if distance > 1e-4 or angle > 1e-3 else 4  # not "no closer than 0.0 mm and 0.0°"
    return Failure(
        "UNREACHABLE",
        f"the tool gets no closer to the target than {1e3 * distance:.{digits}f} mm "
        f"and {np.rad2deg(angle):.{digits}f}°{_remedy(joints, free)}",
        residual_m=distance,
        residual_rad=angle,
    )
