"""Inverse kinematics of one arm: for single poses, along whole paths, and the workspace.

A pose has several solutions, the branches of a serial arm. Along a path, an arm cannot change its
branch without a jump: `Kinematics` chooses one in which the whole path can be followed. The
workspace is the set of points that the tool can reach in any orientation.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Literal, TypeAlias

import numpy as np

from bt_dualarm.core.errors import Failure
from bt_dualarm.core.free_axes import FreeAxes
from bt_dualarm.core.pose import Matrix, Pose, Vector
from bt_dualarm.kinematics.solver import (
    EXACT,
    NEAR,
    NEARLY,
    SINGULAR_CONDITION,
    STEP,
    TOOL,
    TURN,
    Chain,
    Continuation,
    FrameTask,
    Multistart,
    Tolerance,
    branches,
    broken,
    capped_solver,
    different,
    target_matrix,
    unreachable,
)
from bt_dualarm.robots.robot import JointLimits, Robot, degrees_within

_STARTS = 8
"""Number of random starts besides the robot's postures."""

_ITERATIONS = 40
"""Maximum number of iterations from one start."""

_STEP = 0.4
"""Maximum motion of a joint per iteration, rad."""

_DAMPING = 1e-3
"""Weight of joint motion, m²/rad²: keeps steps short near a stretched arm, which is singular."""

_REACHED = 1e-4
"""Distance at which a point counts as reached, m."""

_GAIN = 1e-5
"""Gain of an iteration below which a descent ends, m."""

_STALLED = 1e-4
"""Step below which an ascent ends, rad."""

_CLIMBED = 1e-9
"""Minimum gain of a step of an ascent, m."""


class Workspace(Chain):
    """Reach of one arm's tool with free orientation.

    Args:
        robot: Robot description.
        base: Pose of its base link in the world.
    """

    def __init__(self, robot: Robot, base: Pose) -> None:
        super().__init__(robot, base)
        # Starts away from the limits, and within one turn of joints that have several.
        scatter = np.random.default_rng(0).uniform(0.2, 0.8, (_STARTS, self.dof))
        spread = np.clip(self.upper - self.lower, 0.0, 2 * np.pi)
        middle = np.clip(0.0, self.lower + spread / 2, self.upper - spread / 2)
        self._solver = capped_solver(self, _STEP, _DAMPING)
        self._task = self._solver.add_position_task(TOOL, np.zeros(3))
        self._task.configure("tool", "soft", 1.0)
        self._starts = [*robot.postures.values(), *(middle + (scatter - 0.5) * spread)]

    def gap(self, point: Vector) -> float:
        """Minimum distance in m from the tool to a point of shape (3,); 0 if it can be reached."""
        nearest = float("inf")
        for start in self._starts:
            nearest = min(nearest, self._descend(point, start))
            if nearest < _REACHED:
                return 0.0
        return nearest

    def farthest(self, frame: str = TOOL) -> float:
        """Largest distance of a link from the first joint within the position limits, m.

        The best of several local ascents: in practice the global maximum, to a millimeter.
        """
        center, _ = self.bounding_ball
        return max(self._ascend(center, start, frame) for start in self._starts)

    def _ascend(self, center: Vector, q: Vector, frame: str) -> float:
        """Local maximum of the distance in m, by gradient steps halved when they do not help."""
        away, slope = self._distance(center, q, frame)
        step = _STEP
        while step > _STALLED:
            # Joints at a limit that the gradient pushes against are left out of the step.
            blocked = ((q >= self.upper) & (slope > 0)) | ((q <= self.lower) & (slope < 0))
            slope = np.where(blocked, 0.0, slope)
            steepest = float(np.abs(slope).max())
            if steepest == 0.0:
                break
            moved = np.clip(q + step * slope / steepest, self.lower, self.upper)
            farther, there = self._distance(center, moved, frame)
            if farther > away + _CLIMBED:
                q = moved
                away = farther
                slope = there
            else:
                step /= 2
        return away

    def _distance(self, center: Vector, q: Vector, frame: str) -> tuple[float, Vector]:
        """Distance in m of a link from the center; its gradient, of shape (dof,), m/rad."""
        jacobian = self.jacobian(q, frame)
        arm = self.frame(frame)[:3, 3] - center
        away = float(np.linalg.norm(arm))
        return away, jacobian[:3].T @ arm / away

    def _descend(self, point: Vector, q: Vector) -> float:
        """Distance in m from the point that PlaCo's position task reaches from ``q``."""
        self.set_state(np.clip(q, self.lower, self.upper))
        self._task.target_world = point
        gap = float("inf")
        for _ in range(_ITERATIONS):
            self._solver.solve(True)
            self.placo.update_kinematics()
            last = gap
            gap = float(self._task.error_norm())
            if gap < _REACHED or abs(last - gap) < _GAIN:
                break
        return gap


@lru_cache(maxsize=64)
def reach(robot: Robot) -> float:
    """Largest distance of the tool from the first joint, m; takes 30 ms, once per robot."""
    return Workspace(robot, Pose.identity()).farthest()


@lru_cache(maxsize=64)
def _wrist_reach(robot: Robot) -> float:
    """Largest distance of the last joint but one from the first joint, m; takes 30 ms, once."""
    workspace = Workspace(robot, Pose.identity())
    return workspace.farthest(workspace.moved_links[-2])


_UNSURE_M = 2e-3
"""Distance beyond the largest one that was found, up to which a point may still be reached, m."""


Preference: TypeAlias = Literal["nearest", "conditioned"]
"""Order of solutions: nearest to a given configuration first, or best conditioned first."""


class _Search:
    """Search and continuations for targets that leave the same axes free.

    Attributes:
        multistart: Search for solutions of a target.
        continuations: Continuations along a path, the preferred one first.
    """

    def __init__(self, chain: Chain, seed: int, free: FreeAxes) -> None:
        tasks = (FrameTask(TOOL, free=free),)
        self.multistart = Multistart(chain.bare, tasks, seed)
        self.continuations = [self.multistart.continuation]
        if self.multistart.redundant:
            # Tried first: a redundant arm can often keep away from its limits all along a path.
            roomy = Chain(chain.robot, chain.base, _PATH_ROOM)
            self.continuations.insert(0, Continuation(roomy, STEP, tasks, redundant=True))


_ROOM = 0.1
"""Distance to a position limit below which a well conditioned solution still comes last, rad."""

_PATH_ROOM = 0.05
"""Distance that a redundant arm keeps from its limits along a path where possible, rad."""

_TOO_NEAR = 0.002
"""Distance to a limit below which another branch of a path is preferred, rad."""

_TURNED_ROOM = 0.1
"""Distance that joints rotated by whole turns keep from their limits, rad: motions that follow a
path, such as a retreat, were planned without the turn."""

_MOST_TURNED = 8
"""Number of proposals for each path with joints rotated by a whole turn: a UR5 has up to 31, and
those that rotate a single joint are among the nearest eight."""

_EVERY = 8
"""Samples of a path per evaluation of the condition number."""


class Kinematics(Chain):
    """Forward and inverse kinematics of one arm.

    All poses are of the tool frame in the world. Equal arguments give equal results (to 1e-8 rad),
    independent of earlier calls. Solutions keep the position limits. Not thread-safe.

    ``free`` of a method names the rotations about the tool's axes that its targets leave free, see
    `bt_dualarm.core.free_axes`; they become redundant, as the seventh joint of an arm.

    Args:
        robot: Robot description.
        base: Pose of its base link in the world.
        seed: Seed of the start configurations for difficult targets.
    """

    def __init__(self, robot: Robot, base: Pose, seed: int = 0) -> None:
        super().__init__(robot, base)
        self._seed = seed
        self._searches: dict[FreeAxes, _Search] = {(): _Search(self, seed, ())}

    def is_beyond(self, pose: Pose) -> bool:
        """Whether the tool cannot reach a pose in the world, known without a search for it.

        The pose determines the axis of the last joint, and so a circle about it on which the joint
        before it is. That has to have a point in a ball around the first joint.
        """
        joints, tool, axis = self._joints_at_home
        # In the frame of the tool, from the last joint:
        along = tool.inverse.turn(axis)
        last = tool.inverse.apply(joints[-1])
        center = pose.inverse.apply(joints[0]) - last
        before = tool.inverse.apply(joints[-2]) - last
        apart = float((center - before) @ along)
        across = np.linalg.norm(np.cross(along, center)) - np.linalg.norm(np.cross(along, before))
        return bool(np.hypot(apart, across) > _wrist_reach(self.robot) + _UNSURE_M)

    def _search(self, free: FreeAxes) -> _Search:
        """Search for targets that leave these axes free; made when it is first needed."""
        if free not in self._searches:
            self._searches[free] = _Search(self, self._seed, free)
        return self._searches[free]

    def _possible(self, tolerance: Tolerance) -> Tolerance:
        """A tolerance that the arm can keep: `NEARLY` of `EXACT` for fewer than six joints."""
        return NEARLY if self.dof < 6 and tolerance == EXACT else tolerance

    def residual(self, q: Vector, target: Pose, free: FreeAxes = ()) -> tuple[float, float]:
        """Distance in m and angle in rad between the tool at ``q`` and a target."""
        return self._search(free).multistart.residuals(q, (target_matrix(target),))[0]

    def solve(
        self,
        target: Pose,
        near: Vector,
        tolerance: Tolerance = EXACT,
        prefer: Preference = "nearest",
        *,
        free: FreeAxes = (),
    ) -> Vector:
        """Configuration, of shape (dof,), rad, with the tool on a target.

        The solution nearest to ``near``, of shape (dof,), rad, or the best conditioned one. A first
        solution within `NEAR` is returned without a search for others.

        Raises:
            Failure: ``INVALID_TARGET`` for an invalid pose, or one outside the workspace;
                ``UNREACHABLE`` with the smallest residual found.
        """
        if prefer != "nearest":
            return self.solutions(target, near, tolerance, prefer, free=free)[0]
        goals = (target_matrix(target),)
        self._refuse_outside(goals)
        return self._found(goals, near, tolerance, free, near_enough=NEAR)[0]

    def solutions(
        self,
        target: Pose,
        near: Vector,
        tolerance: Tolerance = EXACT,
        prefer: Preference = "nearest",
        *,
        every_branch: bool = False,
        free: FreeAxes = (),
    ) -> list[Vector]:
        """Different configurations with the tool on a target, the preferred one first.

        Args:
            target: Pose of the tool in the world.
            near: Configuration of shape (dof,), rad.
            tolerance: Tolerance of the residual.
            prefer: Order of the solutions. With ``"conditioned"``, all starts are tried, and
                solutions whose redundant joints were not moved toward ``near`` are included.
            every_branch: Try all starts, instead of stopping when three solutions are found.
            free: Rotations that the target leaves free.

        Raises:
            Failure: As ``solve``.
        """
        goals = (target_matrix(target),)
        every = every_branch or prefer == "conditioned"
        self._refuse_outside(goals)
        found = self._found(goals, near, tolerance, free, every=every)
        if prefer == "nearest":
            return found
        search = self._search(free).multistart
        if search.redundant:  # not only those that have been pulled toward ``near``
            found += search.solutions(goals, near, tolerance, every=True, pull=False)[0]
        return sorted(found, key=lambda q: (self.room(q) < _ROOM, self.condition(q)))

    def _found(
        self,
        goals: Sequence[Matrix],
        near: Vector,
        tolerance: Tolerance,
        free: FreeAxes,
        *,
        every: bool = False,
        near_enough: float = 0.0,
    ) -> list[Vector]:
        """Solutions, nearest first; arguments as in `Multistart.solutions`."""
        search = self._search(free).multistart
        found, closest = search.solutions(
            goals, near, self._possible(tolerance), every=every, near_enough=near_enough
        )
        if not found:
            raise unreachable(*search.residuals(closest, goals)[0], joints=self.dof, free=free)
        return sorted(found, key=lambda q: float(np.linalg.norm(q - near)))

    def follow(
        self,
        poses: Sequence[Pose],
        near: Vector,
        tolerance: Tolerance = EXACT,
        *,
        max_step: float = 0.2,
        free: FreeAxes = (),
    ) -> Matrix:
        """Configurations, of shape (n, dof), along a path of the tool, without a jump.

        The first of `branches_along`: the branch nearest to ``near`` in which the whole path stays
        away from singularities and limits; if there is none, the best conditioned of those in which
        it can be followed at all. The first row may therefore be far from ``near``; `follow_on`
        continues from a configuration.

        Args:
            poses: Poses of the tool in the world, close enough together that a joint moves less
                than ``max_step`` between two of them.
            near: Configuration before the path, of shape (dof,), rad.
            tolerance: Tolerance of each pose's residual.
            max_step: Movement of a joint between two poses, in rad, that counts as a jump.
            free: Rotations that every pose leaves free.

        Raises:
            Failure: ``INVALID_TARGET`` for an invalid pose, or one outside the workspace;
                ``UNREACHABLE`` for the first pose; ``PATH_BROKEN`` with the largest ``fraction``
                of the path that could be followed, or ``SINGULAR`` if a singularity ends it there.
        """
        return next(self.branches_along(poses, near, tolerance, max_step=max_step, free=free))

    def branches_along(
        self,
        poses: Sequence[Pose],
        near: Vector,
        tolerance: Tolerance = EXACT,
        *,
        max_step: float = 0.2,
        free: FreeAxes = (),
    ) -> Iterator[Matrix]:
        """Configurations along a path in each branch in which the whole path can be followed.

        Redundant joints stay near their start, so that a closed path closes in the joints too, and
        3° away from their limits where possible. Arguments as in `follow`.

        Yields:
            Configurations, of shape (n, dof), rad: first the branches away from singularities and
            limits, nearest to ``near`` first, each computed on demand; then the others,
            best conditioned first.

        Raises:
            Failure: As `follow`, if there is no such branch.
        """
        goals = [(target_matrix(pose),) for pose in poses]
        self._refuse_outside([goal for (goal,) in goals])
        # A redundant arm follows each branch with both continuations, often to the same end.
        ends: list[Vector] = []
        others: list[_Followed] = []
        failed: list[tuple[Vector, list[Vector]]] = []
        for start, rows in self._attempts(poses[0], goals, near, tolerance, max_step, free):
            if len(rows) < len(goals):
                failed.append((start, rows))
                continue
            path = self._rated(np.array(rows))
            if not path.good:
                others.append(path)
            elif different(ends, path.rows[-1]):
                ends.append(path.rows[-1])
                yield path.rows
        for path in sorted(others, key=lambda path: (path.cramped, path.condition)):
            if different(ends, path.rows[-1]):
                ends.append(path.rows[-1])
                yield path.rows
        if not ends:
            start, rows = max(failed, key=lambda attempt: len(attempt[1]))
            share = len(rows) / len(goals)
            branches = len(failed) // len(self._search(free).continuations)
            raise broken(self, (rows or [start])[-1], poses[len(rows)], share, branches, free)

    def follow_on(
        self,
        poses: Sequence[Pose],
        start: Vector,
        tolerance: Tolerance = EXACT,
        *,
        max_step: float = 0.2,
        free: FreeAxes = (),
        changes_posture: bool = False,
    ) -> Matrix:
        """Configurations, of shape (n, dof), along a path, from a given configuration.

        The branch is that of ``start``, and the first row is ``start`` itself: a motion along these
        rows begins where the arm is. `follow` may choose another branch.

        Args:
            poses: Poses of the tool in the world; the first is its pose at ``start``.
            start: Configuration of shape (dof,), rad.
            tolerance: Tolerance of each pose's residual.
            max_step: Movement of a joint between two poses, in rad, that counts as a jump.
            free: Rotations that every pose leaves free.
            changes_posture: Whether redundant joints may leave their start on the way if the path
                can be followed only like that: toward those of a branch that follows it backward.

        Raises:
            Failure: ``INVALID_TARGET`` for an invalid pose, or one outside the workspace;
                ``PATH_BROKEN`` or ``SINGULAR`` with the ``fraction`` that could be followed.
        """
        goals = [(target_matrix(pose),) for pose in poses[1:]]
        if not goals:
            return start[None].copy()
        self._refuse_outside([goal for (goal,) in goals])
        longest: list[Vector] = []
        cramped: Matrix | None = None
        search = self._search(free)
        tolerance = self._possible(tolerance)
        for continuation in search.continuations:
            within = continuation.mechanism
            if (
                continuation is not search.multistart.continuation
                and not ((start >= within.lower) & (start <= within.upper)).all()
            ):
                continue  # a start beyond the narrower limits would jump to them
            rows = search.multistart.along(continuation, goals, start, tolerance, max_step)
            if len(rows) < len(goals):
                longest = max(longest, rows, key=len)
                continue
            followed = np.vstack((start, rows))
            if self.room(followed) >= _TOO_NEAR:
                return followed
            cramped = followed if cramped is None else cramped
        if cramped is not None:
            return cramped
        share = (1 + len(longest)) / (1 + len(goals))
        refusal = broken(self, (longest or [start])[-1], poses[1 + len(longest)], share, 1, free)
        if changes_posture and search.multistart.redundant:
            try:
                backward = [*self.branches_along(poses[::-1], start, tolerance, free=free)]
            except Failure:
                raise refusal from None
            guides = [rows[::-1] for rows in backward]
            for guide in sorted(guides, key=lambda rows: float(np.linalg.norm(rows[0] - start))):
                rows = search.multistart.along(
                    search.multistart.continuation, goals, start, tolerance, max_step, guide[1:]
                )
                if len(rows) == len(goals):
                    return np.vstack((start, rows))
        raise refusal

    def turned(self, paths: Sequence[Matrix], near: Vector) -> list[Matrix]:
        """The same paths of the tool, with joints rotated by a whole turn.

        Solutions are within half a turn of ``near`` where the limits permit it. If the arm's own
        links or obstacles block that rotation of a joint, the opposite one may be free.

        Args:
            paths: Configurations along each path, of shape (n, dof), rad.
            near: Configuration before the path, of shape (dof,), rad.

        Returns:
            Configurations, of shape (n, dof), rad, that keep 0.1 rad from the limits: at most eight
            for each path, the nearest to ``near`` first.
        """
        found: list[Matrix] = []
        for rows in paths:
            lowest = np.ceil((self.lower + _TURNED_ROOM - rows.min(axis=0)) / TURN)
            highest = np.floor((self.upper - _TURNED_ROOM - rows.max(axis=0)) / TURN)
            choices = [
                [turn for turn in (0.0, -TURN, TURN) if not turn or low <= turn / TURN <= high]
                for low, high in zip(lowest.tolist(), highest.tolist(), strict=True)
            ]
            turns = [np.array(turn) for turn in itertools.product(*choices) if any(turn)]
            turns.sort(key=lambda turn: float(np.linalg.norm(rows[0] + turn - near)))
            found += [rows + turn for turn in turns[:_MOST_TURNED]]
        return sorted(found, key=lambda rows: float(np.linalg.norm(rows[0] - near)))

    def _attempts(
        self,
        first: Pose,
        goals: Sequence[tuple[Matrix]],
        near: Vector,
        tolerance: Tolerance,
        max_step: float,
        free: FreeAxes,
    ) -> Iterator[tuple[Vector, list[Vector]]]:
        """Start and followed rows of each branch at the first pose with each continuation."""
        search = self._search(free)
        tolerance = self._possible(tolerance)
        for start in self._branches(first, near, tolerance, free):
            for continuation in search.continuations:
                rows = search.multistart.along(continuation, goals, start, tolerance, max_step)
                yield start, rows

    def _rated(self, rows: Matrix) -> _Followed:
        """Quality of configurations along a path, of shape (n, dof), rad."""
        condition = max(self.condition(q) for q in rows[::_EVERY])
        return _Followed(rows, self.room(rows) < _TOO_NEAR, condition)

    def _refuse_outside(self, goals: Sequence[Matrix]) -> None:
        """Check that targets, each of shape (4, 4), are within the outer bound of the workspace."""
        center, radius = self.bounding_ball
        away = np.linalg.norm(np.array(goals)[:, :3, 3] - center, axis=1)
        worst = int(np.argmax(away))
        if away[worst] > radius:
            place = ", ".join(f"{x:.3f}" for x in goals[worst][:3, 3])
            limit = reach(self.robot)
            raise Failure(
                "INVALID_TARGET",
                f"({place}) m is outside the workspace: {away[worst]:.2f} m from the first joint "
                f"of this {self.robot.name}, whose tool reaches {limit:.2f} m",
                distance_m=float(away[worst]),
                reach_m=limit,
            )

    def _branches(
        self, first: Pose, near: Vector, tolerance: Tolerance, free: FreeAxes
    ) -> Iterator[Vector]:
        """Different solutions for the first pose: the nearest ones, then all others."""
        return branches(
            lambda every: self.solutions(first, near, tolerance, every_branch=every, free=free)
        )


@dataclass(frozen=True, eq=False)
class _Followed:
    """Branch in which a path was followed to its end.

    Attributes:
        rows: Configurations, of shape (n, dof), rad.
        cramped: Whether a joint comes nearer to its limit than `_TOO_NEAR`.
        condition: Largest condition number of the Jacobian.
    """

    rows: Matrix
    cramped: bool
    condition: float

    @property
    def good(self) -> bool:
        """Whether it is away from singularities and limits, so that no other branch is needed."""
        return self.condition <= SINGULAR_CONDITION and not self.cramped


def refuse_no_angles(joints: Sequence[str], q: Vector) -> None:
    """Check that a configuration has a finite angle, in rad, for each joint.

    Raises:
        Failure: ``INVALID_TARGET``.
    """
    if q.shape != (len(joints),) or not np.isfinite(q).all():
        raise Failure("INVALID_TARGET", f"{q.tolist()} are not the angles of {len(joints)} joints")


def refuse_beyond(joints: Sequence[str], q: Vector, limits: JointLimits) -> None:
    """Check a target configuration, of shape (dof,), rad, before anything moves.

    Raises:
        Failure: ``INVALID_TARGET`` for a wrong shape or an element that is not finite;
            ``JOINT_LIMIT`` with the joint that is farthest beyond its limit.
    """
    refuse_no_angles(joints, q)
    beyond = np.maximum(limits.lower - q, q - limits.upper)
    worst = int(np.argmax(beyond))
    if beyond[worst] > 1e-9:
        low, high = degrees_within(limits.lower[worst], limits.upper[worst])
        limit = low if q[worst] < limits.lower[worst] else high
        away = float(np.degrees(beyond[worst]))
        shown = f"{away:.1f}" if away >= 0.1 else f"{away:.1g}"
        raise Failure(
            "JOINT_LIMIT",
            f"{joints[worst]} would be {shown}° beyond its limit of {limit}°",
            joint=joints[worst],
            beyond_rad=float(beyond[worst]),
        )
