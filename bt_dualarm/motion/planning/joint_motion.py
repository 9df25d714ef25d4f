"""A motion from one configuration to another that touches nothing."""

from __future__ import annotations

import itertools
from collections.abc import Callable

import numpy as np

from bt_dualarm.errors import Failure
from bt_dualarm.motion.collision.checker import CollisionChecker
from bt_dualarm.motion.collision.sweep import FINE
from bt_dualarm.motion.planning.corner_rounding import rounded
from bt_dualarm.motion.planning.problem import PlanningProblem, is_free
from bt_dualarm.motion.planning.way import Way, way_around
from bt_dualarm.motion.search.long_way import is_clear
from bt_dualarm.motion.timing.point_to_point import point_to_point, time_path
from bt_dualarm.motion.timing.trajectory import LONG, Trajectory
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
    way = way_around(problem, abandoned)
    motion = _rounded_motion(problem, way)
    if way.keeps_off(outline(motion, problem.checker.radii, FINE)):
        return motion
    try:
        refuse_contact(problem.checker, motion)
    except Failure:  # a spline that leaves its samples by more than there is room
        return _motion_by_corners(problem, way.corners)
    return motion


def _rounded_motion(problem: PlanningProblem, way: Way) -> Trajectory:
    """Through the corners, cut where there is room."""
    motion = Trajectory.rest(way.corners[0], problem.dt)
    for piece in rounded(way.corners, problem.checker.radii, way.is_free):
        motion = motion.then(time_path(piece, problem.limits, problem.dt))
    return motion


def _motion_by_corners(problem: PlanningProblem, corners: Matrix) -> Trajectory:
    """Straight from corner to corner, where it stops."""
    motion = Trajectory.rest(corners[0], problem.dt)
    for here, there in itertools.pairwise(corners):
        motion = motion.then(point_to_point(here, there, problem.limits, problem.dt))
    return motion


def refuse_contact(checker: CollisionChecker, way: Matrix | Trajectory) -> None:
    """Check configurations as they will be sent, every ``FINE`` metres.

    What is touched at neither end may not be touched in between: of what is thin, so little may be
    all that two checks see.

    Args:
        checker: Test of configurations.
        way: The configurations, of shape (n, dof), rad, or a motion.

    Raises:
        Failure: ``IN_COLLISION`` at the first one that touches something.
    """
    radii = checker.radii
    rows = outline(way, radii, FINE) if isinstance(way, Trajectory) else way
    strict = checker.keeping_off((rows[0], rows[-1]))
    if is_clear(strict, rows):
        return
    last = rows[0]
    for i, q in enumerate(rows):
        moved = abs(q - last) @ radii
        if 0 < i < len(rows) - 1 and moved + _step(rows, i, radii) <= FINE:
            continue
        last = q
        contact = strict.contact(q)
        if contact is not None:
            raise contact.failure()


def outline(motion: Trajectory, radii: Vector, most: float) -> Matrix:
    """Configurations of a motion, of shape (n, dof): all of them, unless it takes long.

    Then so many that no point of the arm moves more than half of ``most`` metres between two.

    Args:
        motion: The motion.
        radii: Metres that a point of the arm moves at most, by joint and radian, of shape (dof,).
        most: Metres.
    """
    if len(motion) <= LONG:
        return motion.q
    index = np.linspace(0, len(motion) - 1, LONG).astype(int)
    rows = motion.rows(index)[0]
    while True:
        wide = np.abs(np.diff(rows, axis=0)) @ radii > 0.5 * most
        wide &= np.diff(index) > 1
        if not wide.any():
            return rows
        middle = (index[:-1][wide] + index[1:][wide]) // 2
        after = np.flatnonzero(wide) + 1
        index = np.insert(index, after, middle)
        rows = np.insert(rows, after, motion.rows(middle)[0], axis=0)


def _step(rows: Matrix, i: int, radii: Vector) -> float:
    return float(abs(rows[i + 1] - rows[i]) @ radii)
