"""Path search: OMPL within a budget, its shortcuts, and a compiled RRT-Connect.

OMPL: I. A. Sucan, M. Moll, L. E. Kavraki, The Open Motion Planning Library, IEEE Robotics and
Automation Magazine 19(4), 2012. A search is reproducible: it ends after a count of checks, and its
random numbers depend on its seed. OMPL's own discrete motion validator is replaced: an edge is
checked by one call of `Edges`, so that Python is entered once per edge and not once per
configuration.

The compiled RRT-Connect takes over in narrow passages, with increasing effort. It differs from
OMPL's in what gets an arm out of a shelf or a cage: edges end before an obstacle instead of being
rejected, samples are drawn near nodes, and the smaller tree grows first. OMPL's Python bindings
allow none of these. Its kernels are in `rrt_kernels`; they check whole edges with `swept_kernels`.
"""

from __future__ import annotations

import contextlib
import functools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from types import ModuleType
from typing import TYPE_CHECKING, Final, Literal, TypeAlias, get_args

import numpy as np

from bt_dualarm.collision.checker import CollisionChecker
from bt_dualarm.collision.kernel_arrays import ConvexShapes, Joints, Pairs, Query, SweptArm, Trees
from bt_dualarm.collision.swept import CompiledEdges, Edges
from bt_dualarm.core.pose import Matrix, Vector
from bt_dualarm.robots.robot import JointLimits

if TYPE_CHECKING:
    import ompl.base
    import ompl.geometric


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

_SHORTCUTS = 30
"""Number of shortcuts that are tried: more of them hardly shorten a path."""

_IDLE = 5000
"""Rounds without a single check after which a search ends. Optimizing planners would never end once
the straight path is free."""

_STRAIGHT = 1 + 1e-6
"""Length of a path relative to the straight one at which it counts as optimal. With 1 exactly,
SORRTstar would reject samples forever within one round, which nothing can interrupt."""

_LONGEST_ROUND = 10_000
"""Checks beyond the limit at which a search is broken off within a round. Rounds make some hundreds
at most; AORRTC's may never end if one of several goals is unreachable."""


class OmplSearch:
    """Search for a path from one start to one of several goals; can be run only once.

    Args:
        arm: The arm, its checks, and the count of these.
        start: Configuration of shape (dof,), rad.
        goals: Configurations, each of shape (dof,), rad.
        seed: Random seed; at least 1.
        beyond: Range of samples beyond the ends, within the joint limits, rad. For joints with two
            turns, most samples would be wasted without it.
    """

    def __init__(
        self,
        arm: ArmChecks,
        start: Vector,
        goals: Sequence[Vector],
        seed: int,
        beyond: float = np.pi,
    ) -> None:
        ompl = _ompl()
        # OMPL has one global seed. It comes first: the space may draw random numbers, too.
        ompl.util.RNG.setSeed(seed)
        ends = np.array((start, *goals))
        lower = np.maximum(ends.min(axis=0) - beyond, arm.limits.lower)
        upper = np.minimum(ends.max(axis=0) + beyond, arm.limits.upper)
        self._budget = arm.budget
        self._space = _ScaledSpace(arm, lower, upper)
        information = self._space.information
        self._problem = ompl.base.ProblemDefinition(information)
        self._problem.addStartState(self._space.state(start))
        # OMPL would wait for a goal in contact to become free: a minute, until its rounds are over.
        free = [goal for goal in goals if arm.checker.free(goal)]
        self._is_hopeless = not free
        states = ompl.base.GoalStates(information)
        for goal in free:
            states.addState(self._space.state(goal))
        self._problem.setGoal(states)
        radii = arm.checker.radii
        shortest = min(float(np.linalg.norm((goal - start) * radii)) for goal in goals)
        length = ompl.base.PathLengthOptimizationObjective(information)
        length.setCostThreshold(ompl.base.Cost(_STRAIGHT * shortest))
        self._problem.setOptimizationObjective(length)

    def run(self, name: Planner, longest_edge: float) -> Matrix | None:
        """Corners of a shortened path, of shape (n, dof), rad; None if none was found.

        Args:
            name: Name of the planner.
            longest_edge: Longest edge of its trees, as motion of the arm, m.
        """
        if self._is_hopeless:
            return None
        ompl = _ompl()
        budget = self._budget
        planner = getattr(ompl.geometric, name)(self._space.information)
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
        return self._space.shortened(self._problem.getSolutionPath())


def shortened(corners: Matrix, arm: ArmChecks, seed: int) -> Matrix:
    """A path with shortcuts, of shape (n, dof), rad.

    Args:
        corners: Corners of the path, of shape (n, dof), rad.
        arm: The arm, its checks, and the count of these.
        seed: Random seed; at least 1.
    """
    ompl = _ompl()
    ompl.util.RNG.setSeed(seed)
    space = _ScaledSpace(arm, arm.limits.lower, arm.limits.upper)
    path = ompl.geometric.PathGeometric(space.information)
    for q in corners:
        path.append(space.state(q))
    return space.shortened(path)


@dataclass(frozen=True, eq=False)
class ArmChecks:
    """What a search knows of the arm.

    Attributes:
        checker: Collision checker of its configurations.
        edges: Collision checks of its straight motions.
        limits: Position limits to stay within.
        budget: Counter of both kinds of checks, which ends a search.
    """

    checker: CollisionChecker
    edges: Edges
    limits: JointLimits
    budget: Budget


class _ScaledSpace:
    """OMPL's space of joint angles times the radii, in m, with the checks of an arm.

    The Euclidean distance of two states is then comparable with the motion of the arm.

    Args:
        arm: The arm, its checks, and the count of these.
        lower: Lower bounds of samples, of shape (dof,), rad.
        upper: Upper bounds of samples, of shape (dof,), rad.
    """

    def __init__(self, arm: ArmChecks, lower: Vector, upper: Vector) -> None:
        base = _ompl().base
        self._radii = arm.checker.radii
        self._joints = slice(0, len(self._radii))  # OMPL states do not store their length
        self._space = base.RealVectorStateSpace(len(self._radii))
        bounds = base.RealVectorBounds(len(self._radii))
        scaled = zip((lower * self._radii).tolist(), (upper * self._radii).tolist(), strict=True)
        for i, (low, high) in enumerate(scaled):
            bounds.setLow(i, low)
            bounds.setHigh(i, high)
        self._space.setBounds(bounds)
        self.information = base.SpaceInformation(self._space)
        self.information.setStateValidityChecker(_Configurations(arm))
        self.information.setMotionValidator(_edge_validator()(self.information, arm))
        self.information.setup()

    def state(self, q: Vector) -> ompl.base.State:
        """State of a configuration of shape (dof,), rad."""
        state = self._space.allocState()
        state[self._joints] = (q * self._radii).tolist()
        return state

    def shortened(self, path: ompl.geometric.PathGeometric) -> Matrix:
        """Corners of a path with shortcuts, of shape (n, dof), rad; changes the path."""
        simplifier = _ompl().geometric.PathSimplifier(self.information)
        simplifier.reduceVertices(path)
        # From anywhere to anywhere: by default, shortcuts span a third of the corners at most.
        simplifier.partialShortcutPath(path, _SHORTCUTS, _SHORTCUTS, 1.0)
        simplifier.reduceVertices(path)
        return np.array([state[self._joints] for state in path.getStates()]) / self._radii


class _Configurations:
    """Validity checker for states of OMPL.

    Like the validator of edges, it does not refer to any object of OMPL: OMPL never frees a
    callback that refers back to it.
    """

    def __init__(self, arm: ArmChecks) -> None:
        self._arm = arm
        self._radii = arm.checker.radii
        self._joints = slice(0, len(self._radii))

    def __call__(self, state: ompl.base.State) -> bool:
        self._arm.budget.count_checks(1)
        return self._arm.checker.free(np.array(state[self._joints]) / self._radii)


@functools.cache
def _edge_validator() -> Callable[[ompl.base.SpaceInformation, ArmChecks], object]:
    """Class of the validator of edges, created on first use: its base class is OMPL's."""

    class EdgeValidator(_ompl().base.MotionValidator):  # type: ignore[misc]
        """Motion validator that checks a whole edge in one call."""

        def __init__(self, information: ompl.base.SpaceInformation, arm: ArmChecks) -> None:
            super().__init__(information)
            self._edges = arm.edges
            self._budget = arm.budget
            self._radii = arm.checker.radii
            self._joints = slice(0, len(self._radii))

        def checkMotion(self, start: ompl.base.State, end: ompl.base.State) -> bool:  # noqa: N802
            """Whether the edge is free; the name is OMPL's."""
            before = self._edges.checked
            free = self._edges.is_free(
                np.array(start[self._joints]) / self._radii,
                np.array(end[self._joints]) / self._radii,
            )
            self._budget.count_checks(self._edges.checked - before)
            return free

    return EdgeValidator


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

    def count_checks(self, count: int) -> None:
        """Count configurations that are checked.

        Raises:
            EndlessRoundError: The current search should have ended long ago.
        """
        self.states += count
        if self._is_searching and self.states > self.limit + _LONGEST_ROUND:
            raise EndlessRoundError
        if self._idle <= _IDLE:  # otherwise the search is over, and may still make a check or two
            self._idle = 0

    def begin(self, per_round: int = 1) -> None:
        """Begin another search, each round of which counts as ``per_round`` checks."""
        self._idle = 0
        self._per_round = per_round
        self._is_searching = True

    def end(self) -> None:
        """End the search; further checks, to shorten its path, are counted without a limit."""
        self._is_searching = False

    def is_abandoned(self) -> bool:
        """Whether the result is no longer needed; polls."""
        self.given_up = self.given_up or self._abandoned()
        return self.given_up

    def is_spent(self) -> bool:
        """Whether no further search may begin."""
        return self.given_up or max(self.states, self._cost_of_rounds) >= self.limit

    def is_over(self) -> bool:
        """Whether the current search must end; called by the planner once per round."""
        self._rounds += 1
        self._idle += 1
        self._cost_of_rounds += self._per_round
        if self._rounds % _ASK_EVERY == 0:
            self.is_abandoned()
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


_NODES: Final = 20_000
"""Capacity of a tree."""

_ATTEMPTS: Final = (
    (2.0, 2_000, 2.5e-3),
    (1.0, 10_000, 2.5e-3),
    (0.5, 30_000, 2.5e-3),
    (1.0, 240_000, 5e-4),
)
"""Longest edge of the trees, as motion of the arm in m; number of checks after which the next
attempt begins; and clearance on top of the minimum distances in m, since passing closer takes many
checks. The first attempt is for the preferred goal, the others for any."""


class CompiledRRTConnect:
    """Search for a path from one start to one of several goals.

    Args:
        edges: Collision checks of edges; their clearance is changed.
        start: Configuration of shape (dof,), rad.
        goals: Configurations, each of shape (dof,), rad.
        limits: Position limits to stay within.
        radii: Largest motion of the arm per radian of each joint, of shape (dof,), m/rad.
        seed: Random seed.
    """

    def __init__(
        self,
        edges: CompiledEdges,
        start: Vector,
        goals: Sequence[Vector],
        limits: JointLimits,
        radii: Vector,
        seed: int,
    ) -> None:
        self._edges = edges
        self._start = start
        self._goals = goals
        self._radii = radii
        ends = np.array((start, *goals))
        # Half a turn beyond the ends: for joints with two turns, most samples would be wasted.
        self._lower = np.maximum(ends.min(axis=0) - np.pi, limits.lower)
        self._upper = np.minimum(ends.max(axis=0) + np.pi, limits.upper)
        state = np.random.SeedSequence(seed).generate_state(1, np.uint64)
        self._draws = np.maximum(state, np.uint64(1))  # the state zero would repeat forever

    def path(self, most: int, abandoned: Callable[[], bool]) -> Matrix | None:
        """Corners of a path, of shape (n, dof), rad; None if none was found.

        Args:
            most: Maximum number of checks of the edges, those before this search included.
            abandoned: Polled between attempts; ends them when the path is no longer needed.
        """
        for number, (longest, checks, clearance) in enumerate(_ATTEMPTS):
            limit = min(checks, most)
            if self._edges.checked >= limit:
                continue
            if abandoned():
                return None
            self._edges.keep_clear(clearance)
            goals = self._goals if number else self._goals[:1]
            path = self._connected(goals, longest, limit)
            if path is not None:
                return path
        return None

    def _connected(self, goals: Sequence[Vector], longest: float, checks: int) -> Matrix | None:
        """Corners of a path to one of the goals, of shape (n, dof); None if none was found."""
        from bt_dualarm.planning.rrt_kernels import connect

        # The second tree has a root for each goal.
        trees = Trees(
            np.empty((2, _NODES, len(self._start))),
            np.empty((2, _NODES), np.int64),
            np.array((1, len(goals))),
        )
        trees.parents[0, 0] = trees.parents[1, : len(goals)] = -1
        trees.nodes[0, 0] = self._start
        trees.nodes[1, : len(goals)] = goals
        query = Query(self._lower, self._upper, self._radii, longest, checks)
        edges = self._edges
        if not connect(edges.arm, query, trees, edges.hints, self._draws, edges.spent):
            return None
        there, back = (_branch(trees, side) for side in (0, 1))
        return np.vstack((there[::-1], back[1:]))


def _branch(trees: Trees, side: int) -> Matrix:
    """Nodes from the last one of a tree to its root, of shape (n, dof)."""
    nodes = []
    number = int(trees.counts[side]) - 1
    while number >= 0:
        nodes.append(trees.nodes[side, number])
        number = int(trees.parents[side, number])
    return np.array(nodes)


def warm_up_edges() -> None:
    """Compile the kernel that checks dense paths, on a small problem."""
    edges, start, goal = _small_problem()
    edges.is_dense_path_free(np.array((start, goal)), np.ones(2))


def warm_up_search() -> None:
    """Compile the kernels of the search, on a small problem."""
    edges, start, goal = _small_problem()
    far = np.full(2, 3.0)
    limits = JointLimits(-far, far, *np.ones((4, 2)))
    CompiledRRTConnect(edges, start, (goal,), limits, np.ones(2), 1).path(10_000, lambda: False)
    edges.is_free(start, goal)


def _small_problem() -> tuple[CompiledEdges, Vector, Vector]:
    """A sphere and a plane around an arm, with start and goal, each of shape (2,), rad."""
    joints = Joints(np.zeros(2), np.zeros((2, 3)), np.eye(3)[:2].copy())
    places = np.array(((1.0, 0.0, 0.0), (0.0, 0.0, 1.5), (0.0, 0.0, -9.0)))
    shapes = ConvexShapes(
        corners=places,
        ranges=np.array(((0, 1, 2), (1, 2, 0), (2, 3, 0))),
        radii=np.full(3, 0.1),
        centers=places,
        bounds=np.array((0.1, 0.1, np.inf)),
        rotations=np.tile(np.eye(3), (3, 1, 1)),
        half_extents=np.full((3, 3), 0.1),
        normals=np.array(((0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 1.0))),
        reaches=np.ones((3, 2)),
    )
    pairs = Pairs(np.zeros(2, np.int64), np.array((1, 2)), np.zeros(2), places[[0, 0]] - places[1:])
    return CompiledEdges(SweptArm(joints, shapes, pairs, 1e-3)), np.zeros(2), np.array((0.5, -3.0))
