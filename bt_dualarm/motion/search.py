"""The search for configurations of a mechanism that has its frames on their targets."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from bt_dualarm.motion.descent import Aim, Continuation
from bt_dualarm.motion.mechanism import Mechanism
from bt_dualarm.motion.target import EXACT, Tolerance, residual_between
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
_ALIKE = 1e-2  # rad
_TURN = 2.0 * np.pi


class Search:
    """Finds answers and follows them; keeps position limits, and never says what it did not check.

    Args:
        mechanism: That moves.
        aims: The frames that have targets.
        seed: Chooses the configurations from which difficult targets are tried.
    """

    def __init__(self, mechanism: Mechanism, aims: Sequence[Aim], seed: int) -> None:
        self.redundant = mechanism.dof > 6 * len(aims)
        self.way = Continuation(mechanism, STEP, aims, redundant=self.redundant)
        self._mechanism = mechanism
        self._aims = tuple(aims)
        rng = np.random.default_rng(seed)
        self._scatter = rng.uniform(0.0, 1.0, (_RESTARTS, mechanism.dof))
        self._whole_turns = mechanism.upper - mechanism.lower > _TURN

    def residuals(self, q: Vector, goals: Sequence[Matrix]) -> list[tuple[float, float]]:
        """Distance in m and angle in rad of each aim from its target, of shape (4, 4)."""
        mechanism = self._mechanism
        mechanism.set_state(q)
        found = []
        for aim, goal in zip(self._aims, goals, strict=True):
            reached = mechanism.frame(aim.frame)
            if aim.seen_from is not None:
                reached = np.linalg.inv(mechanism.frame(aim.seen_from)) @ reached
            found.append(residual_between(reached, goal))
        return found

    def holds(self, q: Vector, goals: Sequence[Matrix], tolerance: Tolerance) -> bool:
        """Whether every aim is within a tolerance."""
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
            goals: Of each aim, of shape (4, 4).
            near: Where the search begins, of shape (dof,).
            tolerance: Of each residual.
            pull: Take redundant joints towards ``near``.
            every: Try more starts, instead of stopping when three answers are found.
            near_enough: Stop at a first answer that no joint is farther away from, in rad.

        Returns:
            The answers, and where the search has come closest.
        """
        near = np.clip(near, self._mechanism.lower, self._mechanism.upper)
        found: list[Vector] = []
        closest, least = near, float("inf")
        for number, start in enumerate(self._starts(near)):
            if every and found and number > _ALL:
                break
            q = self._descend(goals, start, near, pull=pull)
            residuals = self.residuals(q, goals)
            if not all(tolerance.holds(residual) for residual in residuals):
                if (missed := sum(map(sum, residuals))) < least:
                    closest, least = q, missed
                continue
            if different(found, q):
                found.append(q)
            if every:
                continue
            if len(found) == _ENOUGH or np.abs(found[0] - near).max() < near_enough:
                break
        return found, closest

    def along(
        self,
        way: Continuation,
        goals: Sequence[Sequence[Matrix]],
        start: Vector,
        tolerance: Tolerance,
        max_step: float,
    ) -> list[Vector]:
        """Rows, of shape (dof,), as far as a path goes from one start.

        Args:
            way: How to go on: the search's own, or one with narrower limits.
            goals: Of each aim, of shape (4, 4), at each sample.
            start: On the first sample; redundant joints stay near it.
            tolerance: Of each residual.
            max_step: Movement of a joint in rad that counts as a jump.
        """
        rows: list[Vector] = []
        q = start
        way.pull_to(start)
        for targets in goals:
            before = q
            q = way.on(targets, q)
            jumped = float(np.abs(q - before).max()) > max_step
            if jumped or not self.holds(q, targets, tolerance):
                break
            rows.append(q)
        return rows

    def _descend(
        self, goals: Sequence[Matrix], start: Vector, near: Vector, *, pull: bool
    ) -> Vector:
        """Where one start leads; redundant joints then go on to the posture nearest ``near``."""
        q = self._unwound(self.way.on(goals, start, pulled=0, exact=_ITERATIONS), near)
        if not (pull and self.redundant) or start is near or not self.holds(q, goals, EXACT):
            return q
        self.way.pull_to(near)
        pulled = self.way.on(goals, q, exact=6)
        return pulled if self.holds(pulled, goals, EXACT) else q

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


def different(answers: Sequence[Vector], q: Vector) -> bool:
    """Whether a configuration is none of those that there are."""
    return not any(np.abs(q - other).max() < _ALIKE for other in answers)
