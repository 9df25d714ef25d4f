"""A way around obstacles: found by a compiled search, else by OMPL; and what is free beside it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from bt_dualarm.motion.collision.checker import CollisionChecker
from bt_dualarm.motion.planning.planners import DEFAULT_PLANNER
from bt_dualarm.motion.planning.problem import PlanningProblem, is_free, path_by_ompl
from bt_dualarm.motion.search.quick_search import QuickSearch
from bt_dualarm.motion.search.swept import UnknownShapeError, swept
from bt_dualarm.pose import Matrix

_SAMPLES = 12
"""Configurations on a path at which MuJoCo confirms what the compiled search says."""

_NEAR_ENDS_M = 0.005
"""So near to its ends it confirms all of them: there the arm may touch something, as it stands."""


@dataclass(frozen=True, eq=False)
class Way:
    """Corners of a free path, between which it is straight in joint space.

    Attributes:
        corners: The corners, of shape (n, dof), rad.
        checker: Test of configurations that holds for it.
        quick: The search that found it; None where OMPL has.
    """

    corners: Matrix
    checker: CollisionChecker
    quick: QuickSearch | None

    def is_free(self, corners: Matrix) -> bool:
        """Whether a path beside it, of shape (n, dof), touches nothing."""
        if self.quick is None:
            return is_free(self.checker, corners)
        return self.quick.is_free(corners)

    def keeps_off(self, rows: Matrix) -> bool:
        """Whether nothing is touched on the way through many configurations, of shape (n, dof)."""
        if self.quick is None or not self.quick.keeps_off(rows):
            return False
        moved = np.abs(np.diff(rows, axis=0)) @ self.checker.radii
        near = np.cumsum(moved) < _NEAR_ENDS_M, np.cumsum(moved[::-1]) < _NEAR_ENDS_M
        first, last = (int(side.sum()) for side in near)
        return _is_confirmed(
            self.checker, rows, (*range(first), *range(len(rows) - last, len(rows)))
        )


def way_around(problem: PlanningProblem, abandoned: Callable[[], bool] = lambda: False) -> Way:
    """A free way to one of the goals.

    The compiled search is for the planner that nobody has to name; where it finds nothing, and for
    others, OMPL searches.

    Args:
        problem: Admitted problem whose straight path is not free.
        abandoned: Whether nobody waits any more; asked now and then, it ends the search.

    Raises:
        Failure: ``NO_PLAN``.
    """
    if problem.planner == DEFAULT_PLANNER:
        quick = _quick_search(problem)
        corners = None if quick is None else quick.shortest_path(problem.checks, abandoned)
        if corners is not None and _is_confirmed(problem.checker, corners):
            return Way(corners, problem.checker, quick)
    return Way(path_by_ompl(problem, abandoned), problem.checker, None)


def _quick_search(problem: PlanningProblem) -> QuickSearch | None:
    """The compiled search for a problem; None where it does not know all of its shapes."""
    try:
        arm = swept(problem.checker, (problem.start, *problem.goals))
    except UnknownShapeError:
        return None
    return QuickSearch(
        arm, problem.start, problem.goals, problem.limits, problem.checker.radii, problem.seed
    )


def _is_confirmed(checker: CollisionChecker, rows: Matrix, more: Sequence[int] = ()) -> bool:
    """Whether MuJoCo finds nothing in some configurations of a path, its ends among them."""
    picked = np.linspace(0, len(rows) - 1, _SAMPLES).astype(int).tolist()
    return all(checker.free(rows[i]) for i in {*picked, *more})
