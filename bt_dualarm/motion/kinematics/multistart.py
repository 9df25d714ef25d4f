"""The search for configurations of a mechanism that has its frames on their targets."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

import numpy as np

from bt_dualarm.motion.kinematics.gauss_newton import Continuation, FrameTask
from bt_dualarm.motion.kinematics.placo_model import Mechanism
from bt_dualarm.motion.kinematics.target import EXACT, Tolerance, residual_between
from bt_dualarm.pose import Matrix, Vector

NEAR = 2.5
"""Radians in every joint from which an answer is near: looking for a nearer one takes twice the
time, and finds one that is 2 % nearer on average."""

STEP = 0.6
"""Radians of a joint in one iteration: more overshoots from far starts, less takes longer."""

_RESTARTS = 150
"""Starts until a target counts as out of reach; with 40, one in forty is missed of those targets
that want every joint on a limit."""

_ALL = 40
"""Starts that are tried for all the answers that there are."""

_ITERATIONS = 40
_ENOUGH = 3  # answers of which the nearest is taken
_HITS = 8
"""Starts on their targets of which the nearest is taken where joints are left free: of three, that
was up to 1.6 times as far away as of all, by seed; of eight, 1.3 times."""

_PULLED = 12  # steps towards ``near``; more find nothing nearer
_ALIKE = 1e-2  # rad
_TURN = 2.0 * np.pi


class Multistart:
    """Finds answers and follows them; keeps position limits, and never says what it did not check.

    Args:
        mechanism: Mechanism that moves.
        tasks: Frames that have targets.
        seed: Seed of the configurations from which difficult targets are tried.

    Attributes:
        redundant: Whether the tasks leave joints free.
        continuation: Iteration that goes on from an answer to one close by.
    """

    def __init__(self, mechanism: Mechanism, tasks: Sequence[FrameTask], seed: int) -> None:
        self.redundant = mechanism.dof > 6 * len(tasks)
        self.continuation = Continuation(mechanism, STEP, tasks, redundant=self.redundant)
        self._mechanism = mechanism
        self._tasks = tuple(tasks)
        rng = np.random.default_rng(seed)
        self._scatter = rng.uniform(0.0, 1.0, (_RESTARTS, mechanism.dof))
        self._whole_turns = mechanism.upper - mechanism.lower > _TURN

    def residuals(self, q: Vector, goals: Sequence[Matrix]) -> list[tuple[float, float]]:
        """Distance in m and angle in rad of each frame from its target, of shape (4, 4)."""
        mechanism = self._mechanism
        mechanism.set_state(q)
        found = []
        for task, goal in zip(self._tasks, goals, strict=True):
            reached = mechanism.frame(task.frame)
            if task.seen_from is not None:
                reached = np.linalg.inv(mechanism.frame(task.seen_from)) @ reached
            found.append(residual_between(reached, goal))
        return found

    def holds(self, q: Vector, goals: Sequence[Matrix], tolerance: Tolerance) -> bool:
        """Whether every frame is within a tolerance of its target."""
        return all(tolerance.holds(residual) for residual in self.residuals(q, goals))

    def answers(
        self,
        goals: Sequence[Matrix],
        near: Vector,
        tolerance: Tolerance,
        *,
        pull: bool = True,
        every: bool = False,
        near_enough: float = 0.0,
    ) -> tuple[list[Vector], Vector]:
        """Different configurations on the targets, in the order in which they were found.

        Args:
            goals: Target of each frame, of shape (4, 4).
            near: Configuration at which the search begins, of shape (dof,), rad.
            tolerance: Tolerance of each residual.
            pull: Take redundant joints towards ``near``.
            every: Try more starts, instead of stopping when three answers are found.
            near_enough: Distance in rad; a first answer of which no joint is farther away ends the
                search.

        Returns:
            The answers, and where the search has come closest.
        """
        near = np.clip(near, self._mechanism.lower, self._mechanism.upper)
        found: list[Vector] = []
        closest, least, hits = near, float("inf"), 0
        for number, start in enumerate(self._starts(near)):
            if every and found and number > _ALL:
                break
            q = self._descend(goals, start, near)
            residuals = self.residuals(q, goals)
            if not all(tolerance.holds(residual) for residual in residuals):
                if (missed := sum(map(sum, residuals))) < least:
                    closest, least = q, missed
                continue
            hits += 1
            for answer in self._pulled(goals, q, near) if pull and start is not near else [q]:
                if different(found, answer):
                    found.append(answer)
            is_near = np.abs(found[0] - near).max() < near_enough
            if not every and (is_near or self._enough(hits, len(found))):
                break
        return found, closest

    def _enough(self, hits: int, found: int) -> bool:
        """Whether so many starts on their targets, and different answers, are compared."""
        return hits == _HITS if self.redundant else found == _ENOUGH

    def along(
        self,
        continuation: Continuation,
        goals: Sequence[Sequence[Matrix]],
        start: Vector,
        tolerance: Tolerance,
        max_step: float,
    ) -> list[Vector]:
        """Rows, of shape (dof,), as far as a path goes from one start.

        Args:
            continuation: Iteration that goes on: this search's own, or one with narrower limits.
            goals: Target of each frame, of shape (4, 4), at each sample.
            start: Configuration on the first sample, of shape (dof,); redundant joints stay near.
            tolerance: Tolerance of each residual.
            max_step: Movement of a joint in rad that counts as a jump.
        """
        rows: list[Vector] = []
        q = start
        continuation.pull_to(start)
        for targets in goals:
            before = q
            q = continuation.on(targets, q)
            jumped = float(np.abs(q - before).max()) > max_step
            if jumped or not self.holds(q, targets, tolerance):
                break
            rows.append(q)
        return rows

    def _descend(self, goals: Sequence[Matrix], start: Vector, near: Vector) -> Vector:
        """Where one start leads, of shape (dof,)."""
        return self._unwound(self.continuation.on(goals, start, pulled=0, exact=_ITERATIONS), near)

    def _pulled(self, goals: Sequence[Matrix], q: Vector, near: Vector) -> Iterator[Vector]:
        """The answer of this branch that is nearest to ``near``, then the one it was found from."""
        if self.redundant:
            self.continuation.pull_to(near)
            pulled = self.continuation.nearest(goals, q, steps=_PULLED)
            if self.holds(pulled, goals, EXACT):
                yield pulled
        yield q

    def _starts(self, near: Vector) -> Iterator[Vector]:
        """``near``, then configurations within half a turn of it."""
        yield near
        lower = np.maximum(self._mechanism.lower, near - np.pi)
        upper = np.minimum(self._mechanism.upper, near + np.pi)
        yield from lower + self._scatter * (upper - lower)

    def _unwound(self, q: Vector, near: Vector) -> Vector:
        """The same poses with every joint within half a turn of ``near``, limits allowing."""
        lower, upper = self._mechanism.lower, self._mechanism.upper
        turned = q - _TURN * np.round((q - near) / _TURN)
        fits = self._whole_turns & (turned >= lower) & (turned <= upper)
        return np.where(fits, turned, q)


def branches(answers: Callable[[bool], Sequence[Vector]]) -> Iterator[Vector]:
    """Different answers to one target: the nearest ones, then all others.

    Args:
        answers: Answers, nearest first; told whether to try every start for more of them.
    """
    tried: list[Vector] = []
    for every in (False, True):
        for q in answers(every):
            if different(tried, q):
                tried.append(q)
                yield q


def different(answers: Sequence[Vector], q: Vector) -> bool:
    """Whether a configuration is none of those that there are."""
    return not any(np.abs(q - other).max() < _ALIKE for other in answers)
