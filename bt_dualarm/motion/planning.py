"""Ways around obstacles: a straight line in joint space if it is free, else OMPL's RRT-Connect.

Planning is in scaled joint angles, metres that the farthest point of the arm moves, so that one
resolution holds for shoulder and wrist alike. It ends after a count of checks, not after a time,
and depends on the seed alone.
"""

from __future__ import annotations

import functools
import itertools
from typing import Any

import numpy as np

from bt_dualarm.errors import Failure
from bt_dualarm.motion.collision import CollisionChecker
from bt_dualarm.motion.joint_range import refuse_beyond
from bt_dualarm.motion.sweep import interpolated, sweep_radii
from bt_dualarm.pose import Matrix, Vector
from bt_dualarm.world.catalogue import JointLimits

FINE = 0.008
"""Most that a point of the arm moves between two checks of a result, in metres: together with the
thickness of a link, too little to step through a wall of 10 mm."""

_COARSE = 0.03
"""Likewise while planning; a result that does not pass the fine check is planned again, finer."""

_CHECKS = 60_000
"""Configurations that may be looked at in one attempt; about one and a half seconds."""

_REACH = 1.5
"""Longest edge of a tree, in metres that the arm moves."""


def plan(
    checker: CollisionChecker, start: Vector, goal: Vector, limits: JointLimits, seed: int = 0
) -> Matrix:
    """Corners of a free way from start to goal, of shape (n, dof); two if it is straight.

    Between corners the way is straight in joint space, and checked every ``FINE`` metres.

    Args:
        checker: The arm in its world.
        start: Of shape (dof,), rad.
        goal: Of shape (dof,), rad.
        limits: Position limits to stay within.
        seed: Chooses the way among many.

    Raises:
        Failure: ``IN_COLLISION`` at the start or the goal; ``JOINT_LIMIT`` if one of them is
            outside the limits; ``NO_PLAN``.
    """
    for q in (start, goal):
        _check_end(checker, q, limits)
    radii = sweep_radii(checker)
    straight = np.array((start, goal))
    if is_free(checker, straight, radii):
        return straight
    for attempt, resolution in enumerate((_COARSE, _COARSE / 2, FINE)):
        search = _Search(checker, start, goal, limits, radii, resolution)
        corners = search.run(seed + attempt + 1)
        if is_free(checker, corners, radii):
            return corners
    raise _no_plan(_CHECKS, "every way found was too close to something")


def is_free(checker: CollisionChecker, corners: Matrix, radii: Vector) -> bool:
    """Whether straight lines from corner to corner, of shape (n, dof), touch nothing."""
    pieces = (interpolated(a, b, radii, FINE) for a, b in itertools.pairwise(corners))
    return all(checker.first_contact(rows) is None for rows in pieces)


class _Search:
    """One attempt of RRT-Connect (Kuffner and LaValle 2000), shortcut afterwards."""

    def __init__(
        self,
        checker: CollisionChecker,
        start: Vector,
        goal: Vector,
        limits: JointLimits,
        radii: Vector,
        resolution: float,
    ) -> None:
        self._radii = radii
        self._validity = _Validity(checker, radii)
        self._ompl = ompl = _ompl()
        space = ompl.base.RealVectorStateSpace(len(start))
        space.setBounds(self._bounds(start, goal, limits))
        self._space = space
        self._information = ompl.base.SpaceInformation(space)
        self._information.setStateValidityChecker(self._validity)
        self._information.setStateValidityCheckingResolution(resolution / space.getMaximumExtent())
        self._information.setup()
        self._problem = ompl.base.ProblemDefinition(self._information)
        self._problem.setStartAndGoalStates(self._state(start), self._state(goal))

    def run(self, seed: int) -> Matrix:
        """Corners of the way found, of shape (n, dof).

        Raises:
            Failure: ``NO_PLAN``.
        """
        self._ompl.util.RNG.setSeed(seed)
        planner = self._ompl.geometric.RRTConnect(self._information)
        planner.setRange(_REACH)
        planner.setProblemDefinition(self._problem)
        planner.setup()
        planner.solve(self._ompl.base.PlannerTerminationCondition(self._validity.is_spent))
        if not self._problem.hasExactSolution():  # an approximate one leads elsewhere
            raise _no_plan(self._validity.checks, "no way free of collisions was found")
        path = self._problem.getSolutionPath()
        simplifier = self._ompl.geometric.PathSimplifier(self._information)
        for _ in range(3):
            simplifier.partialShortcutPath(path)
            simplifier.reduceVertices(path)
        return np.array([self._validity.angles(state) for state in path.getStates()])

    def _bounds(self, start: Vector, goal: Vector, limits: JointLimits) -> Any:
        """Half a turn beyond the ends: joints with two turns would waste most samples."""
        lower = np.maximum(np.minimum(start, goal) - np.pi, limits.lower) * self._radii
        upper = np.minimum(np.maximum(start, goal) + np.pi, limits.upper) * self._radii
        bounds = self._ompl.base.RealVectorBounds(len(start))
        for i, (low, high) in enumerate(zip(lower.tolist(), upper.tolist(), strict=True)):
            bounds.setLow(i, low)
            bounds.setHigh(i, high)
        return bounds

    def _state(self, q: Vector) -> Any:
        state = self._space.allocState()
        for i, value in enumerate((q * self._radii).tolist()):
            state[i] = value
        return state


class _Validity:
    """Whether a state of OMPL is free, and how many have been asked about.

    Apart from the search: OMPL never frees what it calls back if that leads back to OMPL.
    """

    def __init__(self, checker: CollisionChecker, radii: Vector) -> None:
        self._checker, self._radii = checker, radii
        self._joints = range(len(radii))
        self.checks = 0

    def __call__(self, state: Any) -> bool:
        self.checks += 1
        return self._checker.free(self.angles(state))

    def angles(self, state: Any) -> Vector:
        """The configuration, of shape (dof,), that a state stands for."""
        return np.array([state[i] for i in self._joints]) / self._radii

    def is_spent(self) -> bool:
        """Whether the attempt has had its checks."""
        return self.checks >= _CHECKS


def _check_end(checker: CollisionChecker, q: Vector, limits: JointLimits) -> None:
    refuse_beyond(checker.joints, q, limits)
    contact = checker.contact(q)
    if contact is not None:
        raise contact.failure()


def _no_plan(checks: int, reason: str) -> Failure:
    return Failure("NO_PLAN", f"{reason} (RRT-Connect, {checks} configurations)", checks=checks)


@functools.cache
def _ompl() -> Any:
    """OMPL without its messages, which go past the terminal's owner; imported when needed."""
    import ompl
    import ompl.base
    import ompl.geometric
    import ompl.util

    ompl.util.setLogLevel(ompl.util.LOG_NONE)
    return ompl
