"""Compiled search for paths: RRT-Connect with increasing effort, then shortcuts.

`QuickSearch` calls the kernels of `rrt_kernels`, which check whole edges with `swept_kernels`.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from typing import Final

import numpy as np

from bt_dualarm.collision.kernel_arrays import ConvexShapes, Joints, Pairs, Query, SweptArm, Trees
from bt_dualarm.core.pose import Matrix, Vector
from bt_dualarm.robots.robot import JointLimits

_NODES: Final = 20_000
"""Capacity of a tree."""

_ATTEMPTS: Final = (
    (2.0, 2_000, 2.5e-3),
    (1.0, 10_000, 2.5e-3),
    (0.5, 30_000, 2.5e-3),
    (1.0, 240_000, 5e-4),
)
"""Longest edge of the trees, as motion of the arm in m; number of checks after which the next
attempt begins; and clearance on top of the least distances in m, since passing closer takes many
checks. The first attempt is for the preferred goal, the others for any."""

_ENOUGH: Final = 500
"""Number of checks after which a search with a path does not begin another one; one that has begun
may take twice as many."""

_PATHS: Final = 3
"""Number of paths of which the shortest is returned."""

_TRIES: Final = 30
"""Number of shortcuts that are tried."""

_ROOM: Final = 200
"""Capacity for additional corners while a path is shortened."""


class QuickSearch:
    """Search for paths from one start to one of several goals.

    Args:
        swept: The arm in its world.
        start: Configuration of shape (dof,), rad.
        goals: Configurations, each of shape (dof,), rad.
        limits: Position limits to stay within.
        radii: Largest motion of the arm per radian of each joint, of shape (dof,), m/rad.
        seed: Random seed.
    """

    def __init__(
        self,
        swept: SweptArm,
        start: Vector,
        goals: Sequence[Vector],
        limits: JointLimits,
        radii: Vector,
        seed: int,
    ) -> None:
        self._swept = swept
        self._start = start
        self._goals = goals
        self._radii = radii
        ends = np.array((start, *goals))
        # Half a turn beyond the ends: for joints with two turns, most samples would be wasted.
        self._lower = np.maximum(ends.min(axis=0) - np.pi, limits.lower)
        self._upper = np.minimum(ends.max(axis=0) + np.pi, limits.upper)
        self._hints = swept.pairs.directions.copy()
        state = np.random.SeedSequence(seed).generate_state(1, np.uint64)
        self._draws = np.maximum(state, np.uint64(1))  # the state zero would repeat forever
        self._checks = np.zeros(1, np.int64)

    @property
    def states(self) -> int:
        """Number of configurations checked so far."""
        return int(self._checks[0])

    def shortest_path(self, most: int, abandoned: Callable[[], bool]) -> Matrix | None:
        """Corners of the shortest of a few paths, of shape (n, dof), rad; None if none was found.

        Args:
            most: Maximum number of checks.
            abandoned: Polled between searches; ends them when the path is no longer needed.
        """
        found: list[Matrix] = []
        for number, (longest, checks, clearance) in enumerate(_ATTEMPTS):
            self._swept = self._swept._replace(clearance=clearance)
            limit = min(checks, most)
            while self.states < limit and not abandoned():
                goals = self._goals if number else self._goals[:1]
                path = self._path(goals, longest, limit)
                if path is None:
                    break
                # RRT-Connect's first path depends on luck: a few more are worth their time.
                found.append(self._shortened(path))
                if len(found) == _PATHS or self.states > _ENOUGH:
                    break
                limit = min(limit, 2 * _ENOUGH)
            if found:
                return self._shortest(found)
        return None

    def _shortest(self, found: Sequence[Matrix]) -> Matrix:
        """Shortest path found, or a free straight path to another goal if that is shorter."""
        best = min(found, key=self._length)
        straight = (np.array((self._start, goal)) for goal in self._goals)
        shorter = [path for path in straight if self._length(path) < self._length(best)]
        free = (path for path in sorted(shorter, key=self._length) if self.is_free(path))
        return next(free, best)

    def _length(self, corners: Matrix) -> float:
        return float(np.linalg.norm(np.diff(corners, axis=0) * self._radii, axis=1).sum())

    def is_free(self, corners: Matrix) -> bool:
        """Whether straight segments between corners, of shape (n, dof), rad, are free."""
        from bt_dualarm.collision.swept_kernels import WHOLE, free_share

        return all(
            free_share(self._swept, here, there, WHOLE, self._hints, self._checks) == 1.0
            for here, there in itertools.pairwise(corners)
        )

    def is_dense_path_free(self, rows: Matrix) -> bool:
        """Whether a path of many close configurations, of shape (n, dof), rad, is free."""
        from bt_dualarm.collision.swept_kernels import first_too_near

        count = first_too_near(self._swept, rows, self._radii, self._hints, self._checks)
        return count == len(rows)

    def _path(self, goals: Sequence[Vector], longest: float, checks: int) -> Matrix | None:
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
        if not connect(self._swept, query, trees, self._hints, self._draws, self._checks):
            return None
        there, back = (_branch(trees, side) for side in (0, 1))
        return np.vstack((there[::-1], back[1:]))

    def _shortened(self, corners: Matrix) -> Matrix:
        """Path with shortcuts, of shape (n, dof), rad."""
        from bt_dualarm.planning.rrt_kernels import shorten, without_idle_corners

        swept = self._swept
        hints = self._hints
        checks = self._checks
        room = np.empty((len(corners) + _ROOM, corners.shape[1]))
        room[: len(corners)] = corners
        count = without_idle_corners(swept, room, len(corners), hints, checks)
        count = shorten(swept, room, count, self._radii, _TRIES, hints, self._draws, checks)
        count = without_idle_corners(swept, room, count, hints, checks)
        return room[:count].copy()


def _branch(trees: Trees, side: int) -> Matrix:
    """Nodes from the last one of a tree to its root, of shape (n, dof)."""
    nodes = []
    number = int(trees.counts[side]) - 1
    while number >= 0:
        nodes.append(trees.nodes[side, number])
        number = int(trees.parents[side, number])
    return np.array(nodes)


def warm_up_planning() -> None:
    """Compile all kernels of the search, on a small problem with a sphere and a plane."""
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
    far = np.full(2, 3.0)
    limits = JointLimits(-far, far, *np.ones((4, 2)))
    start = np.zeros(2)
    goal = np.array((0.5, -3.0))
    search = QuickSearch(
        SweptArm(joints, shapes, pairs, 1e-3), start, (goal,), limits, np.ones(2), 1
    )
    path = search.shortest_path(10_000, lambda: False)
    search.is_dense_path_free(np.array((start, goal)) if path is None else path)
