"""Trees of poses that grow from a start toward a goal: the core of an RRT over poses.

LaValle, Kuffner, Randomized kinodynamic planning, IJRR 2001; with a second tree from the goal:
Kuffner, LaValle, RRT-Connect, ICRA 2000. What the poses are of, how an edge is
checked and where samples come from is up to the search that uses the tree.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final, NamedTuple

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
        last, _ = self.toward(target, through=target is self._goal)
        if last is None or apart(self._nodes[last].pose, self._goal) >= SAME:
            return None
        return self.corners(last)

    def toward(self, target: Pose, *, through: bool) -> tuple[int | None, bool]:
        """Add edges toward a target.

        Args:
            target: The target.
            through: Whether to add all edges that are free, instead of one.

        Returns:
            Number of the last node that was added, None if there is none; whether it is at the
            target.
        """
        nodes = self._nodes
        near = min(range(len(nodes)), key=lambda i: apart(nodes[i].pose, target))
        last = None
        while True:
            node = self._extended(near, target)
            if node is None:
                return last, False
            nodes.append(node)
            near = last = len(nodes) - 1
            if apart(node.pose, target) < SAME:
                return last, True
            if not through:
                return last, False

    def pose(self, number: int) -> Pose:
        """Pose of a node."""
        return self._nodes[number].pose

    def corners(self, last: int) -> list[Pose]:
        """Poses from the root to a node."""
        found = []
        while last >= 0:
            found.append(self._nodes[last].pose)
            last = self._nodes[last].parent
        return found[::-1]

    def _extended(self, number: int, target: Pose) -> _Node | None:
        node = self._nodes[number]
        away = apart(node.pose, target)
        if away < SAME:
            return None
        end = self._step(node.pose, target, min(1.0, _STEP_M / away))
        q = self._edge(node.pose, end, node.q)
        return None if q is None else _Node(end, q, number)


class Meeting(NamedTuple):
    """Poses at which two trees meet: the last one of both paths.

    Attributes:
        from_start: Corners of a path from the start.
        from_goal: Corners of a path from the goal.
    """

    from_start: list[Pose]
    from_goal: list[Pose]

    @property
    def corners(self) -> list[Pose]:
        """Corners of the path from the start to the goal."""
        return [*self.from_start, *self.from_goal[-2::-1]]


class PoseTrees:
    """Two trees, one from the start and one from the goal, that grow toward each other.

    Where they meet, the joint positions of the two may differ: whether the path can be followed
    from the start, or how the joints get from the one to the other, has to be checked.

    Args:
        start: First pose.
        goal: Pose to reach.
        q: Joint positions at the start, rad.
        q_goal: Joint positions at the goal from which the second tree grows, rad.
        step: End of an edge toward a target.
        edge: Check of an edge.
    """

    def __init__(
        self, start: Pose, goal: Pose, q: Vector, q_goal: Vector, step: Step, edge: Edge
    ) -> None:
        self._goal = goal
        self._first = PoseTree(start, goal, q, step, edge)
        self._second = PoseTree(goal, start, q_goal, step, edge)
        self._is_first = False

    def grow(self, target: Pose) -> Meeting | None:
        """Grow one tree, in turn, toward a target, and the other one toward what was added.

        Args:
            target: A sample, or the goal, toward which the first tree adds all edges that are free.

        Returns:
            Where the trees meet, None if they do not.
        """
        if target is self._goal:
            corners = self._first.grow(target)
            return None if corners is None else Meeting(corners, [self._goal])
        self._is_first = not self._is_first
        one, other = (self._first, self._second)[:: 1 if self._is_first else -1]
        last, _ = one.toward(target, through=False)
        if last is None:
            return None
        met, is_reached = other.toward(one.pose(last), through=True)
        if met is None or not is_reached:
            return None
        paths = one.corners(last), other.corners(met)
        return Meeting(*(paths if self._is_first else paths[::-1]))
