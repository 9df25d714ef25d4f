"""A tree of poses that grows from a start toward a goal: the core of an RRT over poses.

LaValle, Kuffner, Randomized kinodynamic planning, IJRR 2001. What the poses are of, how an edge is
checked and where samples come from is up to the search that uses the tree.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final

from bt_dualarm.core.pose import Pose, Vector

REACH_M: Final = 0.5
"""Distance around start and goal from which a search draws positions, m."""

TO_GOAL: Final = 0.25
"""Fraction of the edges that lead toward the goal."""

SAME: Final = 1e-6
"""Distance by `apart` below which two poses are the same."""

_STEP_M: Final = 0.25
"""Longest edge, m; a rotation by 1 rad counts as `_TURN_M`."""

_TURN_M: Final = 0.3

Step = Callable[[Pose, Pose, float], Pose]
"""Pose on an edge, from its beginning, its target, and the fraction of it, up to 1."""

Edge = Callable[[Pose, Pose, Vector], Vector | None]
"""Joint positions at the end of a straight edge, from those at its beginning; None if it is not
free."""


def apart(one: Pose, other: Pose) -> float:
    """Distance of two poses, m, in which a rotation by 1 rad counts as 0.3 m."""
    return one.distance(other) + _TURN_M * one.angle(other)


@dataclass(frozen=True, eq=False)
class _Node:
    """Node of the tree: pose, joint positions there, number of its parent."""

    pose: Pose
    q: Vector
    parent: int


class PoseTree:
    """Tree of poses that can be reached from a start along straight free edges.

    Args:
        start: First pose.
        goal: Pose to reach.
        q: Joint positions at the start, rad.
        step: End of an edge toward a target.
        edge: Check of an edge.
    """

    def __init__(self, start: Pose, goal: Pose, q: Vector, step: Step, edge: Edge) -> None:
        self._goal = goal
        self._step = step
        self._edge = edge
        self._nodes = [_Node(start, q, -1)]

    def grow(self, target: Pose) -> list[Pose] | None:
        """Add an edge toward a target, or all edges toward the goal itself that are free.

        Args:
            target: A sample, or the goal.

        Returns:
            Corners of the path from the start to the goal as soon as that is reached, else None.
        """
        nodes = self._nodes
        near = min(range(len(nodes)), key=lambda i: apart(nodes[i].pose, target))
        while True:
            node = self._extended(near, target)
            if node is None:
                return None
            nodes.append(node)
            near = len(nodes) - 1
            if apart(node.pose, self._goal) < SAME:
                return _corners(nodes, near)
            if target is not self._goal or apart(node.pose, target) < SAME:
                return None

    def _extended(self, number: int, target: Pose) -> _Node | None:
        node = self._nodes[number]
        away = apart(node.pose, target)
        if away < SAME:
            return None
        end = self._step(node.pose, target, min(1.0, _STEP_M / away))
        q = self._edge(node.pose, end, node.q)
        return None if q is None else _Node(end, q, number)


def _corners(nodes: Sequence[_Node], last: int) -> list[Pose]:
    found = []
    while last >= 0:
        found.append(nodes[last].pose)
        last = nodes[last].parent
    return found[::-1]
