"""Planning with OMPL: the planners that may be named, and one bounded search."""

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


# The planners of OMPL that a skill may name.
#
# Those that end after a count of checks, or of rounds, and repeat with their seed. Left out: PRM
# and
# PRM* search in a second thread, FMT and BFMT draw all their samples before they look at the count,
# and the KPIECE family finds another way each time, whatever its seed.


Planner: TypeAlias = Literal[
    "RRTConnect",
    "RRT",
    "RRTstar",
    "InformedRRTstar",
    "SORRTstar",
    "BITstar",
    "AORRTC",
]
"""Names as OMPL has them; those that optimize (with ``star``, and AORRTC) use all their checks."""

PLANNERS: Final[tuple[Planner, ...]] = get_args(Planner)

DEFAULT_PLANNER: Final[Planner] = "RRTConnect"
"""Kuffner and LaValle 2000: two trees, from both ends, that grow toward each other."""

CHECKS_PER_ROUND: Final[Mapping[Planner, int]] = {"BITstar": 4}
"""Checks that a round counts for, where it is more than one: BITstar sorts edges for most of its
time, longer and longer, and looks at less and less; a round took as long as 10 to 40 checks."""


def made(
    name: Planner, longest_edge: float, geometric: ModuleType, space: ompl.base.SpaceInformation
) -> ompl.base.Planner:
    """A planner of OMPL for one search.

    Args:
        name: Name of the planner.
        longest_edge: Longest edge of its trees, in the space's measure, where it has such a bound.
        geometric: OMPL's module ``ompl.geometric``.
        space: What OMPL knows of the space that is searched.
    """
    planner = getattr(geometric, name)(space)
    if hasattr(planner, "setRange"):
        planner.setRange(longest_edge)
    return planner


# One search of OMPL for a path around obstacles, and what it may cost.


_ASK_EVERY = 16
"""Rounds of a planner from one question whether the search is still wanted to the next."""

_ROUNDS = 3
"""Rounds of shortcuts: more make paths hardly shorter."""

_IDLE = 5000
"""Rounds in which nothing is looked at, after which a search ends. Planners that optimize go round
for ever once the straight way is free in their eyes, as it may be at their resolution."""

_STRAIGHT = 1 + 1e-6
"""Length of a path, in those of the straight one, that is as short as can be. With that, SORRTstar
would throw samples away for ever within one round, where nothing could end it."""

_LONGEST_ROUND = 10_000
"""Configurations beyond the limit at which a search is broken off in the middle of a round. Rounds
look at some hundreds at most; AORRTC's may find no end where one of several goals is cut off."""


class EndlessRoundError(Exception):
    """A planner goes on and on without asking whether it shall."""


class Budget:
    """What searches may cost and have cost: when they shall end.

    Args:
        abandoned: Whether nobody waits for the result any more; asked now and then.

    Attributes:
        states: Number of configurations that have been looked at.
        limit: Number of them at which the search that runs ends; rounds count likewise, apart.
        given_up: Nobody waits any more.
    """

    def __init__(self, abandoned: Callable[[], bool]) -> None:
        self.states = 0
        self.limit = 0
        self.given_up = False
        self._abandoned = abandoned
        self._rounds = self._idle = self._turned = 0
        self._per_round = 1
        self._is_searching = False

    def look(self) -> None:
        """Count a configuration that is looked at.

        Raises:
            EndlessRoundError: The search that runs should have ended long ago.
        """
        self.states += 1
        if self._is_searching and self.states > self.limit + _LONGEST_ROUND:
            raise EndlessRoundError
        if self._idle <= _IDLE:  # else the search is over, and may still look once or twice
            self._idle = 0

    def begin(self, per_round: int = 1) -> None:
        """Another search begins, a round of which counts for so many configurations."""
        self._idle = 0
        self._per_round = per_round
        self._is_searching = True

    def end(self) -> None:
        """It has ended; what is looked at to shorten its path is only counted."""
        self._is_searching = False

    def is_spent(self) -> bool:
        """Whether no other search shall begin."""
        return self.given_up or max(self.states, self._turned) >= self.limit

    def is_over(self) -> bool:
        """Whether the search that runs shall end."""
        self._rounds += 1
        self._idle += 1
        self._turned += self._per_round
        if self._rounds % _ASK_EVERY == 0:
            self.given_up = self.given_up or self._abandoned()
        return self.is_spent() or self._idle > _IDLE


class OmplSearch:
    """A path from one start to one of several goals, shortened.

    Args:
        checker: Arm in its world.
        start: Configuration of shape (dof,), rad.
        goals: Configurations, each of shape (dof,), rad.
        limits: Position limits to stay within.
        radii: Meters that the arm moves at most per radian of each joint, of shape (dof,).
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
        ompl.util.RNG.setSeed(seed)  # before the space, which may draw something, too
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
        """Corners of the path found, of shape (n, dof); None if none was found. To be run once.

        Args:
            name: Name of the planner.
            longest_edge: Longest edge of its trees, in meters that the arm moves.
            resolution: Meters that it moves at most from one check to the next.
            budget: Counter of what is looked at, which ends the search.
        """
        ompl = self._ompl
        validity = _Validity(self._checker, self._radii, budget)
        self._information.setStateValidityChecker(validity)
        share = resolution / self._space.getMaximumExtent()
        self._information.setStateValidityCheckingResolution(share)
        self._information.setup()
        planner = made(name, longest_edge, ompl.geometric, self._information)
        planner.setProblemDefinition(self._problem)
        planner.setup()
        budget.begin(CHECKS_PER_ROUND.get(name, 1))
        with contextlib.suppress(EndlessRoundError):  # a path found before is kept all the same
            planner.solve(ompl.base.PlannerTerminationCondition(budget.is_over))
        budget.end()
        if not self._problem.hasExactSolution():  # an approximate one leads elsewhere
            return None
        path = self._problem.getSolutionPath()
        simplifier = ompl.geometric.PathSimplifier(self._information)
        for _ in range(_ROUNDS):
            simplifier.partialShortcutPath(path)
            simplifier.reduceVertices(path)
        return np.array([validity.angles(state) for state in path.getStates()])

    def _bounds(self, ends: Matrix, limits: JointLimits) -> ompl.base.RealVectorBounds:
        """Half a turn beyond the ends: joints with two turns would waste most samples."""
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
    """Whether a state of OMPL is free; counts how many have been asked about.

    Apart from the search: OMPL never frees what it calls back if that leads back to OMPL.
    """

    def __init__(self, checker: CollisionChecker, radii: Vector, budget: Budget) -> None:
        self._checker = checker
        self._radii = radii
        self._budget = budget
        self._joints = range(len(radii))

    def __call__(self, state: ompl.base.State) -> bool:
        self._budget.look()
        return self._checker.free(self.angles(state))

    def angles(self, state: ompl.base.State) -> Vector:
        """The configuration, of shape (dof,), that a state stands for."""
        return np.array([state[i] for i in self._joints]) / self._radii


@functools.cache
def _ompl() -> ModuleType:
    """OMPL without its messages, which go past the terminal's owner; imported when needed."""
    import ompl
    import ompl.base
    import ompl.geometric
    import ompl.util

    ompl.util.setLogLevel(ompl.util.LOG_NONE)
    package: ModuleType = ompl
    return package
