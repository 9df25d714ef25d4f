"""Compiled RRT-Connect for narrow passages, with increasing effort.

It differs from OMPL's in what gets an arm out of a shelf or a cage: edges end before an obstacle
instead of being rejected, samples are drawn near nodes, and the smaller tree grows first. OMPL's
Python bindings allow none of these. The kernels are in `rrt_kernels`; they check whole edges with
`swept_kernels`.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Final

import numpy as np

from bt_dualarm.collision.kernel_arrays import ConvexShapes, Joints, Pairs, Query, SweptArm, Trees
from bt_dualarm.core.pose import Matrix, Vector
from bt_dualarm.planning.edges import CompiledEdges
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
    edges = CompiledEdges(SweptArm(joints, shapes, pairs, 1e-3))
    radii = np.ones(2)
    path = CompiledRRTConnect(edges, start, (goal,), limits, radii, 1).path(10_000, lambda: False)
    edges.is_free(start, goal)
    edges.is_dense_path_free(np.array((start, goal)) if path is None else path, radii)
