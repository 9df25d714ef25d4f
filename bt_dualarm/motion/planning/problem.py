"""Paths around obstacles: a straight line in joint space if it is free, else a search by OMPL.

Planning is in scaled joint angles, metres that the farthest point of the arm moves, so that one
resolution holds for shoulder and wrist alike. It ends after a count of checks, not after a time,
and depends on the problem and its seed alone.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from bt_dualarm.errors import Failure
from bt_dualarm.motion.collision.checker import CollisionChecker
from bt_dualarm.motion.collision.sweep import FINE, interpolated
from bt_dualarm.motion.kinematics.joint_limits import refuse_beyond
from bt_dualarm.motion.planning.ompl_search import Budget, OmplSearch
from bt_dualarm.motion.planning.planners import DEFAULT_PLANNER, Planner
from bt_dualarm.motion.search.long_way import is_clear
from bt_dualarm.pose import Matrix, Vector
from bt_dualarm.world.robots.robot import JointLimits

_COARSE = 0.03
"""Metres that the arm moves at most between two checks of a search, as long as that is good enough;
what fails the fine check is searched for again, at half of it."""

_FINEST = 0.002
"""Likewise, at the least. OMPL measures along the diagonal, the fine check joint by joint."""

_ATTEMPTS = ((1.5, 0.1), (0.7, 0.4), (0.35, 1.0))
"""Longest edges of the trees, in metres that the arm moves, and the share of all checks after which
the next one is tried: long ones are quick, short ones find their way through narrow places."""

CHECKS = 240_000
"""Configurations that may be looked at in all; a few seconds."""


@dataclass(frozen=True, eq=False)
class PlanningProblem:
    """All that a plan depends on; it can be pickled, and is solved alike in any process.

    Attributes:
        checker: Arm in its world, as it stood when it was asked.
        start: Configuration of shape (dof,), rad.
        goals: Configurations, each of shape (dof,), rad, the preferred one first; at least one.
        limits: Limits of the arm, scaled by the speed.
        dt: Time between set-points in seconds.
        seed: Seed that chooses the path among many; at least 0.
        planner: Name of the planner, which searches where the straight path is not free.
        checks: Number of configurations that may be looked at.
    """

    checker: CollisionChecker
    start: Vector
    goals: tuple[Vector, ...]
    limits: JointLimits
    dt: float
    seed: int = 0
    planner: Planner = DEFAULT_PLANNER
    checks: int = CHECKS

    @property
    def straight(self) -> Matrix:
        """The straight path to the preferred goal, of shape (2, dof), free or not."""
        return np.array((self.start, self.goals[0]))


def admitted(problem: PlanningProblem) -> PlanningProblem:
    """The same problem with those goals alone in which the arm can stand, and free paths between.

    Raises:
        Failure: ``IN_COLLISION`` or ``JOINT_LIMIT`` of the start, or of the preferred goal if
            the arm can stand in none.
    """
    _check_end(problem, problem.start)
    refusals, goals = [], []
    for goal in problem.goals:
        try:
            _check_end(problem, goal)
        except Failure as refusal:
            # Its traceback refers to this frame, which must not refer back: it would stay.
            refusals.append(refusal.with_traceback(None))
        else:
            goals.append(goal)
    if not goals:
        raise refusals.pop(0)
    strict = problem.checker.keeping_off((problem.start, *goals))
    return replace(problem, checker=strict, goals=tuple(goals))


def is_free(checker: CollisionChecker, corners: Matrix) -> bool:
    """Whether straight lines from corner to corner, of shape (n, dof), touch nothing."""
    clear = is_clear(checker, corners)
    if clear is not None:
        return clear
    pieces = (interpolated(a, b, checker.radii, FINE) for a, b in itertools.pairwise(corners))
    return all(checker.first_contact(rows) is None for rows in pieces)


def path_by_ompl(problem: PlanningProblem, abandoned: Callable[[], bool] = lambda: False) -> Matrix:
    """Corners of a free path to one of the goals, of shape (n, dof).

    Between corners the path is straight in joint space, and checked every ``FINE`` metres. A short
    search for one to the preferred goal comes first, then longer ones to any of them; a straight
    path to another goal that is shorter than what was found is taken instead.

    Args:
        problem: Admitted problem whose straight path is not free.
        abandoned: Whether nobody waits any more; asked now and then, it ends the search.

    Raises:
        Failure: ``NO_PLAN``.
    """
    radii = problem.checker.radii
    budget = Budget(abandoned)
    resolution, seed = _COARSE, problem.seed
    for number, (longest_edge, share) in enumerate(_ATTEMPTS):
        goals = problem.goals if number else problem.goals[:1]
        budget.limit = round(share * problem.checks)
        while not budget.is_spent():
            seed += 1
            search = OmplSearch(problem.checker, problem.start, goals, problem.limits, radii, seed)
            corners = search.run(problem.planner, longest_edge, resolution, budget)
            if corners is None:
                break
            if is_free(problem.checker, corners):
                return _shorter_straight(problem, corners)
            resolution = max(resolution / 2, _FINEST)
    raise _no_plan(problem, budget)


def _shorter_straight(problem: PlanningProblem, corners: Matrix) -> Matrix:
    """The shortest straight path to a goal that is free and shorter than one found; else that."""
    radii = problem.checker.radii
    least = float((np.abs(np.diff(corners, axis=0)) @ radii).sum())
    paths = [np.array((problem.start, goal)) for goal in problem.goals]
    lengths = [float(np.abs(path[1] - path[0]) @ radii) for path in paths]
    for length, path in sorted(zip(lengths, paths, strict=True), key=lambda one: one[0]):
        if length < least and is_free(problem.checker, path):
            return path
    return corners


def _check_end(problem: PlanningProblem, q: Vector) -> None:
    refuse_beyond(problem.checker.joints, q, problem.limits)
    contact = problem.checker.contact(q)
    if contact is not None:
        raise contact.failure()


def _no_plan(problem: PlanningProblem, budget: Budget) -> Failure:
    if budget.given_up:
        return Failure("INTERRUPTED", "nobody waits for this plan any more")
    goals = "" if len(problem.goals) == 1 else f" to any of {len(problem.goals)} configurations"
    return Failure(
        "NO_PLAN",
        f"no way free of collisions{goals} was found "
        f"({problem.planner}, {budget.states} configurations)",
        planner=problem.planner,
        states=budget.states,
    )
