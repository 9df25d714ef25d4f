"""Inverse kinematics of one arm on PlaCo: of poses, of streams of poses, and along whole paths."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any, Literal, TypeAlias

import numpy as np

from bt_dualarm.errors import Failure
from bt_dualarm.motion.broken import SINGULAR_CONDITION, broken
from bt_dualarm.motion.chain import TOOL, Chain
from bt_dualarm.motion.descent import Aim, Continuation
from bt_dualarm.motion.search import NEAR, STEP, Search, different
from bt_dualarm.motion.target import EXACT, STREAM, Tolerance, target_matrix, unreachable
from bt_dualarm.pose import Matrix, Pose, Vector
from bt_dualarm.world.catalogue import Robot

Preference: TypeAlias = Literal["nearest", "conditioned"]
"""Of several configurations the nearest to the present one, or the best conditioned."""

_AIMS = (Aim(TOOL),)

_ROOM = 0.1
"""Radians to a limit below which a well conditioned configuration comes last nevertheless."""

_PATH_ROOM = 0.05
"""Radians that a redundant arm stays away from its limits along a path, where it can."""

_TOO_NEAR = 0.002
"""Radians to a limit from which a path is not followed in this branch if another one has more."""

_EVERY = 8
"""Of the samples of a path one in so many is looked at for how well conditioned it is."""


class Kinematics(Chain):
    """Forward and inverse kinematics of one arm.

    All poses are of the tool frame in the world. Equal arguments give equal answers (to 1e-8 rad),
    whatever was asked before. Answers keep the position limits. Not for use by two threads at once.

    Args:
        robot: The arm.
        base: Pose of its base link in the world.
        seed: Chooses the configurations from which a difficult target is tried.
    """

    def __init__(self, robot: Robot, base: Pose, seed: int = 0) -> None:
        super().__init__(robot, base)
        self._search = Search(self, _AIMS, seed)
        self._ways = [self._search.way]
        if self._search.redundant:
            roomy = Chain(robot, base, _PATH_ROOM)
            self._ways.insert(0, Continuation(roomy, STEP, _AIMS, redundant=True))

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
            target: The tool in the world.
            near: Configuration of shape (dof,).
            tolerance: Of the residual.
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
        self, goals: Sequence[Matrix], near: Vector, tolerance: Tolerance, **wishes: Any
    ) -> list[Vector]:
        """What the search finds, nearest first; ``wishes`` are its."""
        found, closest = self._search.answers(goals, near, tolerance, **wishes)
        if not found:
            raise unreachable(*self._search.residuals(closest, goals)[0])
        return sorted(found, key=lambda q: float(np.linalg.norm(q - near)))

    def track(
        self,
        target: Pose,
        near: Vector,
        posture: Vector | None = None,
        tolerance: Tolerance = STREAM,
    ) -> Vector:
        """The configuration for a target close to the tool at ``near``: for the control rate.

        Args:
            target: The tool in the world.
            near: The configuration asked for last, of shape (dof,).
            posture: Where redundant joints go, of shape (dof,): keep it the same through a motion
                (best the configuration at its start), and the answer depends on the target alone.
                Without it they move as little as they can, which may drift over many turns.
            tolerance: Of the residual.

        Raises:
            Failure: ``INVALID_TARGET``; ``UNREACHABLE`` when the tool cannot follow.
        """
        goals, way = (target_matrix(target),), self._search.way
        if posture is not None:
            way.pull_to(posture)
        q = way.on(goals, near, pulled=0 if posture is None else 2, exact=4)
        residual = self._search.residuals(q, goals)[0]
        if not tolerance.holds(residual):
            raise unreachable(*residual)
        return q

    def follow(
        self,
        poses: Sequence[Pose],
        near: Vector,
        tolerance: Tolerance = EXACT,
        *,
        max_step: float = 0.2,
    ) -> Matrix:
        """Configurations, of shape (n, dof), along a path of the tool, without a jump.

        The branch is chosen once: of all answers for the first pose, nearest first, the first one
        from which the whole path can be followed away from singularities and limits; if there is
        none, the best conditioned of those from which it can be followed at all. The first row may
        thus be far from ``near``. Redundant joints stay near their start, so that a closed path
        closes in the joints too, and 3° from their limits where that is possible.

        Args:
            poses: The tool in the world, close enough together that a joint moves less than
                ``max_step`` between two of them.
            near: Configuration before the path, of shape (dof,).
            tolerance: Of each pose's residual.
            max_step: Movement of a joint between two poses, in rad, that counts as a jump.

        Raises:
            Failure: ``INVALID_TARGET`` for what is no pose, or outside the workspace;
                ``UNREACHABLE`` for the first pose; ``PATH_BROKEN`` with the largest ``fraction``
                of the path that could be followed, or ``SINGULAR`` if a singularity of the arm is
                what ends it there.
        """
        goals = [(target_matrix(pose),) for pose in poses]
        self._refuse_outside([goal for (goal,) in goals])
        longest: list[Vector] = []
        whole: list[tuple[bool, float, Matrix]] = []
        starts: list[Vector] = []
        for start in self._branches(poses[0], near, tolerance):
            starts.append(start)
            for way in self._ways:
                rows = self._search.along(way, goals, start, tolerance, max_step)
                if len(rows) < len(goals):
                    longest = max(longest, rows, key=len)
                    continue
                path = np.array(rows)
                cramped = self.room(path) < _TOO_NEAR
                condition = max(self.condition(q) for q in path[::_EVERY])
                if condition <= SINGULAR_CONDITION and not cramped:
                    return path
                whole.append((cramped, condition, path))
        if whole:
            return min(whole, key=lambda one: one[:2])[2]
        end = longest[-1] if longest else starts[0]
        raise broken(self, end, poses[len(longest)], len(longest) / len(goals), len(starts))

    def _refuse_outside(self, goals: Sequence[Matrix]) -> None:
        """Refuse targets, of shape (4, 4), that no configuration can come near to."""
        centre, radius = self.workspace
        away = np.linalg.norm(np.array(goals)[:, :3, 3] - centre, axis=1)
        worst = int(np.argmax(away))
        if away[worst] > radius:
            place = ", ".join(f"{x:.3f}" for x in goals[worst][:3, 3])
            raise Failure(
                "INVALID_TARGET",
                f"({place}) m is outside the workspace: {away[worst]:.2f} m from the first joint "
                f"of this {self.robot.name}, whose tool is never more than {radius:.2f} m from it",
                distance_m=float(away[worst]),
                reach_m=radius,
            )

    def _branches(self, first: Pose, near: Vector, tolerance: Tolerance) -> Iterator[Vector]:
        """Different configurations for the first pose: the nearest ones, then all others."""
        tried: list[Vector] = []
        for every in (False, True):
            for start in self.solutions(first, near, tolerance, every_branch=every):
                if different(tried, start):
                    tried.append(start)
                    yield start
