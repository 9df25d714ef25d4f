"""Inverse kinematics of one arm on PlaCo: of poses, of streams of poses, and along whole paths."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Literal, TypeAlias

import numpy as np

from bt_dualarm.errors import Failure
from bt_dualarm.motion.kinematics.chain import TOOL, Chain
from bt_dualarm.motion.kinematics.gauss_newton import Continuation, FrameTask
from bt_dualarm.motion.kinematics.multistart import (
    NEAR,
    STEP,
    Multistart,
    branches,
    different,
)
from bt_dualarm.motion.kinematics.path_failure import SINGULAR_CONDITION, broken
from bt_dualarm.motion.kinematics.target import EXACT, Tolerance, target_matrix, unreachable
from bt_dualarm.motion.kinematics.workspace import Workspace
from bt_dualarm.pose import Matrix, Pose, Vector
from bt_dualarm.world.robots.robot import Robot

Preference: TypeAlias = Literal["nearest", "conditioned"]
"""Of several configurations the nearest to the present one, or the best conditioned."""

_TASKS = (FrameTask(TOOL),)

_ROOM = 0.1
"""Radians to a limit below which a well conditioned configuration comes last nevertheless."""

_PATH_ROOM = 0.05
"""Radians that a redundant arm stays away from its limits along a path, where it can."""

_TOO_NEAR = 0.002
"""Radians to a limit from which a path is not followed in this branch if another one has more."""

_EVERY = 8
"""Of the samples of a path one in so many is looked at for how well conditioned it is."""


@dataclass(frozen=True, eq=False)
class _Followed:
    """A path that was followed to its end.

    Attributes:
        rows: Configurations, of shape (n, dof), rad.
        cramped: A joint comes too near to its limit.
        condition: Largest condition number of the Jacobian.
    """

    rows: Matrix
    cramped: bool
    condition: float

    @property
    def good(self) -> bool:
        """Away from singularities and limits: no other branch is looked for."""
        return self.condition <= SINGULAR_CONDITION and not self.cramped


class Kinematics(Chain):
    """Forward and inverse kinematics of one arm.

    All poses are of the tool frame in the world. Equal arguments give equal answers (to 1e-8 rad),
    whatever was asked before. Answers keep the position limits. Not for use by two threads at once.

    Args:
        robot: Robot that the arm is.
        base: Pose of its base link in the world.
        seed: Seed of the configurations from which a difficult target is tried.
    """

    def __init__(self, robot: Robot, base: Pose, seed: int = 0) -> None:
        super().__init__(robot, base)
        self._search = Multistart(self.bare, _TASKS, seed)
        self._continuations = [self._search.continuation]
        if self._search.redundant:
            roomy = Chain(robot, base, _PATH_ROOM)
            self._continuations.insert(0, Continuation(roomy, STEP, _TASKS, redundant=True))

    def residual(self, q: Vector, target: Pose) -> tuple[float, float]:
        """Distance in metres and angle in radians from the tool at ``q`` to a target."""
        return self._search.residuals(q, (target_matrix(target),))[0]

    def solve(
        self,
        target: Pose,
        near: Vector,
        tolerance: Tolerance = EXACT,
        prefer: Preference = "nearest",
    ) -> Vector:
        """The configuration, of shape (dof,), that puts the tool on a target.

        Of the answers found it is the one nearest to ``near``, of shape (dof,), or the best
        conditioned; an answer that is near is not compared with others.

        Raises:
            Failure: ``INVALID_TARGET`` for what is no pose, or outside the workspace;
                ``UNREACHABLE`` with the smallest residual found.
        """
        if prefer != "nearest":
            return self.solutions(target, near, tolerance, prefer)[0]
        goals = (target_matrix(target),)
        self._refuse_outside(goals)
        return self._answers(goals, near, tolerance, near_enough=NEAR)[0]

    def solutions(
        self,
        target: Pose,
        near: Vector,
        tolerance: Tolerance = EXACT,
        prefer: Preference = "nearest",
        *,
        every_branch: bool = False,
    ) -> list[Vector]:
        """Different configurations that put the tool on a target, the preferred one first.

        Args:
            target: Pose of the tool in the world.
            near: Configuration of shape (dof,), rad.
            tolerance: Tolerance of the residual.
            prefer: What comes first. For ``"conditioned"`` all starts are tried, and redundant
                joints are left where each of them leads, too.
            every_branch: Try all starts, instead of stopping when three are found.

        Raises:
            Failure: As ``solve``.
        """
        goals, every = (target_matrix(target),), every_branch or prefer == "conditioned"
        self._refuse_outside(goals)
        found = self._answers(goals, near, tolerance, every=every)
        if prefer == "nearest":
            return found
        if self._search.redundant:  # not only those that have been pulled towards ``near``
            found += self._search.answers(goals, near, tolerance, every=True, pull=False)[0]
        return sorted(found, key=lambda q: (self.room(q) < _ROOM, self.condition(q)))

    def _answers(
        self,
        goals: Sequence[Matrix],
        near: Vector,
        tolerance: Tolerance,
        *,
        every: bool = False,
        near_enough: float = 0.0,
    ) -> list[Vector]:
        """What the search finds, nearest first; the wishes are those of `Multistart.answers`."""
        found, closest = self._search.answers(
            goals, near, tolerance, every=every, near_enough=near_enough
        )
        if not found:
            raise unreachable(*self._search.residuals(closest, goals)[0])
        return sorted(found, key=lambda q: float(np.linalg.norm(q - near)))

    def follow(
        self,
        poses: Sequence[Pose],
        near: Vector,
        tolerance: Tolerance = EXACT,
        *,
        max_step: float = 0.2,
    ) -> Matrix:
        """Configurations, of shape (n, dof), along a path of the tool, without a jump.

        It is the first of `branches_along`: the branch nearest to ``near`` in which the whole path
        is followed away from singularities and limits; if there is none, the best conditioned of
        those in which it can be followed at all. The first row may thus be far from ``near``; to
        go on from a configuration, see `follow_on`.

        Args:
            poses: Poses of the tool in the world, close enough together that a joint moves less
                than ``max_step`` between two of them.
            near: Configuration before the path, of shape (dof,), rad.
            tolerance: Tolerance of each pose's residual.
            max_step: Movement of a joint between two poses, in rad, that counts as a jump.

        Raises:
            Failure: ``INVALID_TARGET`` for what is no pose, or outside the workspace;
                ``UNREACHABLE`` for the first pose; ``PATH_BROKEN`` with the largest ``fraction``
                of the path that could be followed, or ``SINGULAR`` if a singularity of the arm is
                what ends it there.
        """
        return next(self.branches_along(poses, near, tolerance, max_step=max_step))

    def branches_along(
        self,
        poses: Sequence[Pose],
        near: Vector,
        tolerance: Tolerance = EXACT,
        *,
        max_step: float = 0.2,
    ) -> Iterator[Matrix]:
        """A path of the tool in every branch in which the whole of it can be followed.

        Redundant joints stay near their start, so that a closed path closes in the joints too, and
        3° from their limits where that is possible.

        Yields:
            Configurations, of shape (n, dof), rad: those away from singularities and limits first,
            nearest to ``near`` first, found one by one as they are asked for; then the others, the
            best conditioned first.

        Raises:
            Failure: As `follow`, if there is none at all.
        """
        goals = [(target_matrix(pose),) for pose in poses]
        self._refuse_outside([goal for (goal,) in goals])
        ends: list[Vector] = []  # a redundant arm is followed in two ways, often to the same end
        others: list[_Followed] = []
        failed: list[tuple[Vector, list[Vector]]] = []
        for start, rows in self._attempts(poses[0], goals, near, tolerance, max_step):
            if len(rows) < len(goals):
                failed.append((start, rows))
                continue
            path = self._judged(np.array(rows))
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
            share, branches = len(rows) / len(goals), len(failed) // len(self._continuations)
            raise broken(self, (rows or [start])[-1], poses[len(rows)], share, branches)

    def follow_on(
        self,
        poses: Sequence[Pose],
        start: Vector,
        tolerance: Tolerance = EXACT,
        *,
        max_step: float = 0.2,
    ) -> Matrix:
        """Configurations, of shape (n, dof), along a path, from a given configuration on.

        The branch is that of ``start``, and the first row is ``start`` itself: a motion along these
        rows begins where the arm stands. `follow` may choose another branch.

        Args:
            poses: Poses of the tool in the world; the first is the one that it has at ``start``.
            start: Configuration of shape (dof,), rad.
            tolerance: Tolerance of each pose's residual.
            max_step: Movement of a joint between two poses, in rad, that counts as a jump.

        Raises:
            Failure: ``INVALID_TARGET`` for what is no pose, or outside the workspace;
                ``PATH_BROKEN`` or ``SINGULAR`` with the ``fraction`` that could be followed.
        """
        goals = [(target_matrix(pose),) for pose in poses[1:]]
        if not goals:
            return start[None].copy()
        self._refuse_outside([goal for (goal,) in goals])
        longest: list[Vector] = []
        cramped: Matrix | None = None
        for continuation in self._continuations:
            within = continuation.mechanism
            if (
                continuation is not self._search.continuation
                and not ((start >= within.lower) & (start <= within.upper)).all()
            ):
                continue  # from beyond its narrower limits the roomy one would jump to them
            rows = self._search.along(continuation, goals, start, tolerance, max_step)
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
        raise broken(self, (longest or [start])[-1], poses[1 + len(longest)], share, 1)

    def _attempts(
        self,
        first: Pose,
        goals: Sequence[tuple[Matrix]],
        near: Vector,
        tolerance: Tolerance,
        max_step: float,
    ) -> Iterator[tuple[Vector, list[Vector]]]:
        """Each branch at the first pose, followed in each way: its start, and as far as it gets."""
        for start in self._branches(first, near, tolerance):
            for continuation in self._continuations:
                yield start, self._search.along(continuation, goals, start, tolerance, max_step)

    def _judged(self, rows: Matrix) -> _Followed:
        """How good configurations along a path, of shape (n, dof), are."""
        condition = max(self.condition(q) for q in rows[::_EVERY])
        return _Followed(rows, self.room(rows) < _TOO_NEAR, condition)

    @cached_property
    def _reach(self) -> float:
        """The tool's largest distance in m from the first joint, for people; takes 30 ms."""
        return Workspace(self.robot, Pose.identity()).farthest()

    def _refuse_outside(self, goals: Sequence[Matrix]) -> None:
        """Refuse targets, of shape (4, 4), that no configuration can come near to."""
        centre, radius = self.bounding_ball
        away = np.linalg.norm(np.array(goals)[:, :3, 3] - centre, axis=1)
        worst = int(np.argmax(away))
        if away[worst] > radius:
            place = ", ".join(f"{x:.3f}" for x in goals[worst][:3, 3])
            reach = self._reach
            raise Failure(
                "INVALID_TARGET",
                f"({place}) m is outside the workspace: {away[worst]:.2f} m from the first joint "
                f"of this {self.robot.name}, whose tool reaches {reach:.2f} m",
                distance_m=float(away[worst]),
                reach_m=reach,
            )

    def _branches(self, first: Pose, near: Vector, tolerance: Tolerance) -> Iterator[Vector]:
        """Different configurations for the first pose: the nearest ones, then all others."""
        return branches(lambda every: self.solutions(first, near, tolerance, every_branch=every))
