"""A motion from one configuration to another that touches nothing."""

from __future__ import annotations

import itertools
from collections.abc import Callable

from bt_dualarm.errors import Failure
from bt_dualarm.motion.collision.checker import CollisionChecker
from bt_dualarm.motion.collision.sweep import FINE
from bt_dualarm.motion.planning.corner_rounding import rounded
from bt_dualarm.motion.planning.problem import PlanningProblem, is_free, path_around
from bt_dualarm.motion.timing.point_to_point import point_to_point, time_path
from bt_dualarm.motion.timing.trajectory import Trajectory
from bt_dualarm.pose import Matrix, Vector


def straight_motion(problem: PlanningProblem) -> Trajectory | None:
    """The motion straight to the preferred goal of an admitted problem; None if not free."""
    if not is_free(problem.checker, problem.straight):
        return None
    return point_to_point(problem.start, problem.goals[0], problem.limits, problem.dt)


def motion_around(
    problem: PlanningProblem, abandoned: Callable[[], bool] = lambda: False
) -> Trajectory:
    """The motion to one of the goals of an admitted problem, around what is in the way.

    Args:
        problem: Admitted problem whose straight path is not free.
        abandoned: Whether nobody waits any more; asked now and then, it ends the search.

    Raises:
        Failure: ``NO_PLAN``.
    """
    corners = path_around(problem, abandoned)
    motion = _rounded_motion(problem, corners)
    try:
        refuse_contact(problem.checker, motion.q)
    except Failure:  # a spline that leaves its samples by more than there is room
        return _motion_by_corners(problem, corners)
    return motion


def _rounded_motion(problem: PlanningProblem, corners: Matrix) -> Trajectory:
    """Through the corners, cut where there is room."""
    motion = Trajectory.rest(corners[0], problem.dt)
    for piece in rounded(corners, problem.checker):
        motion = motion.then(time_path(piece, problem.limits, problem.dt))
    return motion


def _motion_by_corners(problem: PlanningProblem, corners: Matrix) -> Trajectory:
    """Straight from corner to corner, where it stops."""
    motion = Trajectory.rest(corners[0], problem.dt)
    for here, there in itertools.pairwise(corners):
        motion = motion.then(point_to_point(here, there, problem.limits, problem.dt))
    return motion


def refuse_contact(checker: CollisionChecker, rows: Matrix) -> None:
    """Check configurations, of shape (n, dof), as they will be sent, every ``FINE`` metres.

    Raises:
        Failure: ``IN_COLLISION`` at the first one that touches something.
    """
    radii = checker.radii
    last = rows[0]
    for i, q in enumerate(rows):
        way = abs(q - last) @ radii
        if 0 < i < len(rows) - 1 and way + _step(rows, i, radii) <= FINE:
            continue
        last = q
        contact = checker.contact(q)
        if contact is not None:
            raise contact.failure()


def _step(rows: Matrix, i: int, radii: Vector) -> float:
    return float(abs(rows[i + 1] - rows[i]) @ radii)
