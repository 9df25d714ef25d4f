"""Inverse kinematics on PlaCo: tool poses in the world to joint angles, never unchecked."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from bt_dualarm.motion.broken import broken
from bt_dualarm.motion.chain import Chain
from bt_dualarm.motion.descent import Descent, PulledDescent
from bt_dualarm.motion.target import (
    EXACT,
    STREAM,
    Tolerance,
    residual_between,
    target_matrix,
    unreachable,
)
from bt_dualarm.pose import Matrix, Pose, Vector
from bt_dualarm.world.catalogue import Robot

_TURN = 2.0 * np.pi


class Kinematics(Chain):
    """Forward and inverse kinematics of one arm.

    All poses are of the tool frame in the world. Equal arguments give equal answers (to 1e-8 rad),
    whatever was asked before. Answers keep the position limits. Not for use by two threads at once.

    Args:
        robot: The arm.
        base: Pose of its base link in the world.
        seed: Chooses the configurations from which a difficult target is tried.
    """

    restarts = 30
    iterations = 40
    step = 0.6  # rad in one iteration: more overshoots from far starts, less takes longer
    enough = 3  # answers of which the nearest is taken
    near_enough = 1.0  # rad: a first answer this near is taken at once

    def __init__(self, robot: Robot, base: Pose, seed: int = 0) -> None:
        super().__init__(robot, base)
        self._scatter = np.random.default_rng(seed).uniform(0.0, 1.0, (self.restarts, self.dof))
        self._descent = Descent(self, self.step)
        self._pulled = PulledDescent(self, self.step)
        self._whole_turns = self.upper - self.lower > _TURN

    def residual(self, q: Vector, target: Pose) -> tuple[float, float]:
        """Distance in metres and angle in radians from the tool at ``q`` to a target."""
        return self._residual_at(q, target_matrix(target))

    def solve(self, target: Pose, near: Vector, tolerance: Tolerance = EXACT) -> Vector:
        """The configuration, of shape (dof,), that puts the tool on a target.

        Of the answers found it is the one nearest to ``near``, of shape (dof,).

        Raises:
            Failure: ``INVALID_TARGET`` for what is no pose; ``UNREACHABLE`` with the smallest
                residual found.
        """
        return self.solutions(target, near, tolerance)[0]

    def solutions(
        self,
        target: Pose,
        near: Vector,
        tolerance: Tolerance = EXACT,
        *,
        every_branch: bool = False,
    ) -> list[Vector]:
        """Different configurations that put the tool on a target, nearest to ``near`` first.

        Args:
            target: The tool in the world.
            near: Configuration of shape (dof,).
            tolerance: Of the residual.
            every_branch: Try all starts, instead of stopping when enough is found.

        Raises:
            Failure: As ``solve``.
        """
        goal = target_matrix(target)
        near = np.clip(near, self.lower, self.upper)
        found: list[Vector] = []
        closest = (float("inf"), float("inf"))
        for start in self._starts(near):
            q = self._descend(goal, start, near)
            residual = self._residual_at(q, goal)
            if not tolerance.holds(residual):
                closest = min(closest, residual, key=sum)
                continue
            if not any(np.abs(q - other).max() < 1e-2 for other in found):
                found.append(q)
            if not every_branch and (len(found) == self.enough or self._is_near(found[0], near)):
                break
        if not found:
            raise unreachable(*closest)
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
        goal = target_matrix(target)
        q = np.clip(near, self.lower, self.upper)
        if posture is not None and self.dof > 6:
            self._pulled.pull_to(posture)
            q = self._pulled.run(goal, q, 2)
        q = self._descent.run(goal, q, 4)
        residual = self._residual_at(q, goal)
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
        from which the whole path can be followed. The first row may thus be far from ``near``.
        Redundant joints stay near their start, so that a closed path closes in the joints too.

        Args:
            poses: The tool in the world, close enough together that a joint moves less than
                ``max_step`` between two of them.
            near: Configuration before the path, of shape (dof,).
            tolerance: Of each pose's residual.
            max_step: Movement of a joint between two poses, in rad, that counts as a jump.

        Raises:
            Failure: ``UNREACHABLE`` for the first pose; ``PATH_BROKEN`` with the largest
                ``fraction`` of the path that could be followed, or ``SINGULAR`` if a singularity
                of the arm is what ends it there.
        """
        goals = [target_matrix(pose) for pose in poses]
        best: list[Vector] = []
        tried: list[Vector] = []
        for every in (False, True):
            for start in self.solutions(poses[0], near, tolerance, every_branch=every):
                if any(np.abs(start - other).max() < 1e-2 for other in tried):
                    continue
                tried.append(start)
                rows = self._follow_from(goals, start, tolerance, max_step)
                if len(rows) == len(goals):
                    return np.array(rows)
                best = max(best, rows, key=len)
        end = best[-1] if best else tried[0]
        raise broken(self, end, poses[len(best)], len(best) / len(goals), len(tried))

    def _follow_from(
        self, goals: Sequence[Matrix], start: Vector, tolerance: Tolerance, max_step: float
    ) -> list[Vector]:
        """Rows as far as the path goes from one start."""
        rows: list[Vector] = []
        q = start
        self._pulled.pull_to(start)
        for goal in goals:
            before = q
            if self.dof > 6:
                q = self._pulled.run(goal, q, 6)
            q = self._descent.run(goal, q, 8)
            residual = self._residual_at(q, goal)
            jumped = float(np.abs(q - before).max()) > max_step
            if jumped or not tolerance.holds(residual):
                break
            rows.append(q)
        return rows

    def _descend(self, goal: Matrix, start: Vector, near: Vector) -> Vector:
        """Where one start leads; a redundant arm then goes on to the posture nearest ``near``."""
        q = self._unwound(self._descent.run(goal, start, self.iterations), near)
        if self.dof <= 6 or start is near or not EXACT.holds(self._residual_at(q, goal)):
            return q
        self._pulled.pull_to(near)
        pulled = self._descent.run(goal, self._pulled.run(goal, q, 6), 6)
        return pulled if EXACT.holds(self._residual_at(pulled, goal)) else q

    def _residual_at(self, q: Vector, goal: Matrix) -> tuple[float, float]:
        return residual_between(self.matrix(q), goal)

    def _starts(self, near: Vector) -> Iterator[Vector]:
        """``near``, then configurations within half a turn of it."""
        yield near
        lower = np.maximum(self.lower, near - np.pi)
        upper = np.minimum(self.upper, near + np.pi)
        yield from lower + self._scatter * (upper - lower)

    def _unwound(self, q: Vector, near: Vector) -> Vector:
        """The same tool pose with every joint within half a turn of ``near``, limits allowing."""
        turned = q - _TURN * np.round((q - near) / _TURN)
        fits = self._whole_turns & (turned >= self.lower) & (turned <= self.upper)
        return np.where(fits, turned, q)

    def _is_near(self, q: Vector, near: Vector) -> bool:
        return float(np.abs(q - near).max()) < self.near_enough
