"""Path search with OMPL: the available planners, and one search within a budget.

OMPL: I. A. Sucan, M. Moll, L. E. Kavraki, The Open Motion Planning Library, IEEE Robotics and
Automation Magazine 19(4), 2012. A search is reproducible: it ends after a count of checks, and its
random numbers depend on its seed.
"""

from __future__ import annotations

import contextlib
import functools
from collections.abc import Callable, Mapping, Sequence
from types import ModuleType
from typing import TYPE_CHECKING, Final, Literal, TypeAlias, get_args

import numpy as np

from bt_dualarm.collision.checker import CollisionChecker
from bt_dualarm.core.pose import Matrix, Vector
from bt_dualarm.robots.robot import JointLimits

if TYPE_CHECKING:
    import ompl.base

Planner: TypeAlias = Literal[
    "RRTConnect",
    "RRT",
    "RRTstar",
    "InformedRRTstar",
    "SORRTstar",
    "BITstar",
    "AORRTC",
]
"""Names as in OMPL. Optimizing planners (those with ``star``, and AORRTC) use up all checks.

Planners that cannot be reproduced are left out: PRM and PRM* search in a second thread, FMT and
BFMT draw all samples before they look at the count, and the KPIECE family finds another path each
time whatever its seed."""

PLANNERS: Final[tuple[Planner, ...]] = get_args(Planner)

DEFAULT_PLANNER: Final[Planner] = "RRTConnect"
"""J. J. Kuffner, S. M. LaValle, RRT-Connect, ICRA 2000: two trees that grow toward each other."""

CHECKS_PER_ROUND: Final[Mapping[Planner, int]] = {"BITstar": 4}
"""Number of checks that a round of a planner counts as, if more than one. BITstar spends most of
its time sorting edges and checks less and less; a round took as long as 10 to 40 checks."""

_ASK_EVERY = 16
"""Rounds of a planner between two polls whether the plan is still needed."""

_ROUNDS = 3
"""Rounds of shortcuts: more of them hardly shorten a path."""

_IDLE = 5000
"""Rounds without a single check after which a search ends. Optimizing planners would never end once
they take the straight path for free, as it may be at their resolution."""

_STRAIGHT = 1 + 1e-6
"""Length of a path relative to the straight one at which it counts as optimal. With 1 exactly,
SORRTstar would reject samples forever within one round, which nothing can interrupt."""

_LONGEST_ROUND = 10_000
"""Checks beyond the limit at which a search is broken off within a round. Rounds make some hundreds
at most; AORRTC's may never end if one of several goals is unreachable."""


class OmplSearch:
    """Search for a path from one start to one of several goals.

    States of OMPL are joint angles times the radii, in m: the Euclidean distance of two states is
    then comparable with the motion of the arm.

    Args:
        checker: Collision checker of the arm.
        start: Configuration of shape (dof,), rad.
        goals: Configurations, each of shape (dof,), rad.
        limits: Position limits to stay within.
        radii: Largest motion of the arm per radian of each joint, of shape (dof,), m/rad.
        seed: Random seed; at least 1.
    """

    def __init__(
        self,
        checker: CollisionChecker,
        start: Vector,
        goals: Sequence[Vector],
        limits: JointLimits,
        radii: Vector,
        seed: int,
    ) -> None:
        self._checker = checker
        self._radii = radii
        self._ompl = ompl = _ompl()
        # OMPL has one global seed. It comes first: the space may draw random numbers, too.
        ompl.util.RNG.setSeed(seed)
        self._space = ompl.base.RealVectorStateSpace(len(start))
        self._space.setBounds(self._bounds(np.array((start, *goals)), limits))
        self._information = ompl.base.SpaceInformation(self._space)
        self._problem = ompl.base.ProblemDefinition(self._information)
        self._problem.addStartState(self._state(start))
        ends = ompl.base.GoalStates(self._information)
        for goal in goals:
            ends.addState(self._state(goal))
        self._problem.setGoal(ends)
        shortest = min(float(np.linalg.norm((goal - start) * radii)) for goal in goals)
        length = ompl.base.PathLengthOptimizationObjective(self._information)
        length.setCostThreshold(ompl.base.Cost(_STRAIGHT * shortest))
        self._problem.setOptimizationObjective(length)

    def run(
        self, name: Planner, longest_edge: float, resolution: float, budget: Budget
    ) -> Matrix | None:
        """Corners of a shortened path, of shape (n, dof), rad; None if none was found.

        A search can be run only once.

        Args:
            name: Name of the planner.
            longest_edge: Longest edge of its trees, as motion of the arm, m.
            resolution: Largest motion of the arm between two checks, m.
            budget: Counter of checks, which ends the search.
        """
        ompl = self._ompl
        validity = _Validity(self._checker, self._radii, budget)
        self._information.setStateValidityChecker(validity)
        # OMPL's resolution is a share of the space's diagonal.
        share = resolution / self._space.getMaximumExtent()
        self._information.setStateValidityCheckingResolution(share)
        self._information.setup()
        planner = getattr(ompl.geometric, name)(self._information)
        if hasattr(planner, "setRange"):
            planner.setRange(longest_edge)
        planner.setProblemDefinition(self._problem)
        planner.setup()
        budget.begin(CHECKS_PER_ROUND.get(name, 1))
        with contextlib.suppress(EndlessRoundError):  # a path found before is still valid
            planner.solve(ompl.base.PlannerTerminationCondition(budget.is_over))
        budget.end()
        if not self._problem.hasExactSolution():  # an approximate one ends elsewhere
            return None
        path = self._problem.getSolutionPath()
        simplifier = ompl.geometric.PathSimplifier(self._information)
        for _ in range(_ROUNDS):
            simplifier.partialShortcutPath(path)
            simplifier.reduceVertices(path)
        return np.array([validity.angles(state) for state in path.getStates()])

    def _bounds(self, ends: Matrix, limits: JointLimits) -> ompl.base.RealVectorBounds:
        """Half a turn beyond the ends: for joints with two turns, most samples would be wasted."""
        lower = np.maximum(ends.min(axis=0) - np.pi, limits.lower) * self._radii
        upper = np.minimum(ends.max(axis=0) + np.pi, limits.upper) * self._radii
        bounds = self._ompl.base.RealVectorBounds(len(lower))
        for i, (low, high) in enumerate(zip(lower.tolist(), upper.tolist(), strict=True)):
            bounds.setLow(i, low)
            bounds.setHigh(i, high)
        return bounds

    def _state(self, q: Vector) -> ompl.base.State:
        state = self._space.allocState()
        for i, value in enumerate((q * self._radii).tolist()):
            state[i] = value
        return state


class _Validity:
    """Validity checker for states of OMPL; counts its checks.

    Separate from the search: OMPL never frees a callback that refers back to OMPL.
    """

    def __init__(self, checker: CollisionChecker, radii: Vector, budget: Budget) -> None:
        self._checker = checker
        self._radii = radii
        self._budget = budget
        self._joints = range(len(radii))

    def __call__(self, state: ompl.base.State) -> bool:
        self._budget.count_check()
        return self._checker.free(self.angles(state))

    def angles(self, state: ompl.base.State) -> Vector:
        """Configuration of a state, of shape (dof,), rad."""
        return np.array([state[i] for i in self._joints]) / self._radii


class Budget:
    """Count of checks and rounds that ends searches.

    Args:
        abandoned: Whether the result is no longer needed; polled now and then.

    Attributes:
        states: Number of configurations checked so far.
        limit: Number of checks, and separately of rounds, at which the current search ends.
        given_up: Whether the result is no longer needed.
    """

    def __init__(self, abandoned: Callable[[], bool]) -> None:
        self.states = 0
        self.limit = 0
        self.given_up = False
        self._abandoned = abandoned
        self._rounds = 0
        self._idle = 0
        self._cost_of_rounds = 0
        self._per_round = 1
        self._is_searching = False

    def count_check(self) -> None:
        """Count a configuration that is checked.

        Raises:
            EndlessRoundError: The current search should have ended long ago.
        """
        self.states += 1
        if self._is_searching and self.states > self.limit + _LONGEST_ROUND:
            raise EndlessRoundError
        if self._idle <= _IDLE:  # else the search is over, and may still make a check or two
            self._idle = 0

    def begin(self, per_round: int = 1) -> None:
        """Begin another search, each round of which counts as ``per_round`` checks."""
        self._idle = 0
        self._per_round = per_round
        self._is_searching = True

    def end(self) -> None:
        """End the search; further checks, to shorten its path, are counted without a limit."""
        self._is_searching = False

    def is_spent(self) -> bool:
        """Whether no further search may begin."""
        return self.given_up or max(self.states, self._cost_of_rounds) >= self.limit

    def is_over(self) -> bool:
        """Whether the current search must end; called by the planner once per round."""
        self._rounds += 1
        self._idle += 1
        self._cost_of_rounds += self._per_round
        if self._rounds % _ASK_EVERY == 0:
            self.given_up = self.given_up or self._abandoned()
        return self.is_spent() or self._idle > _IDLE


class EndlessRoundError(Exception):
    """A planner does not end its round."""


@functools.cache
def _ompl() -> ModuleType:
    """OMPL, imported on first use; without its messages, which would bypass our output."""
    import ompl
    import ompl.base
    import ompl.geometric
    import ompl.util

    ompl.util.setLogLevel(ompl.util.LOG_NONE)
    package: ModuleType = ompl
    return package
