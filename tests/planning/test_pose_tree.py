"""Trees of poses: from the start alone, and from both ends."""

from __future__ import annotations

import itertools
from itertools import product

import numpy as np
import pytest

from bt_dualarm.core.pose import Pose, Vector
from bt_dualarm.planning.pose_tree import Meeting, PoseTree, PoseTrees
from tests.families import some

START = Pose.from_rpy((-1.0, 0.0, 0.0))
GOAL = Pose.from_rpy((1.0, 0.0, 0.0))
POCKET = 0.15
"""Half the edge of a square around an end of the path, open by 16 cm away from the other
end, m."""


def crosses_pocket(center: float, begin: Vector, end: Vector) -> bool:
    """Whether a line crosses a wall of the pocket around an end of the path."""
    for share in np.linspace(0.0, 1.0, 30):
        x, y, _ = begin + share * (end - begin)
        along = (x - center) * np.sign(center)  # positive away from the other end
        on_wall = abs(max(abs(along), abs(y)) - POCKET) < 0.02
        if on_wall and not (along > 0.0 and abs(y) < 0.08):
            return True
    return False


def straight(start: Pose, end: Pose, share: float) -> Pose:
    if share >= 1.0:
        return end
    return Pose(start.position + share * (end.position - start.position), start.quaternion)


class Maze:
    """The goal, and on demand the start, is in a pocket.

    The joint positions are the sides on which the edges began: trees may meet with different ones.
    """

    def __init__(self, *pockets: float) -> None:
        self.pockets = pockets

    def edge(self, start: Pose, end: Pose, q: Vector) -> Vector | None:
        is_blocked = any(
            crosses_pocket(center, start.position, end.position) for center in self.pockets
        )
        return None if is_blocked else q


def grown(tree: PoseTree | PoseTrees, seed: int, draws: int) -> list[Pose] | None:
    rng = np.random.default_rng(seed)
    for _ in range(draws):
        target = GOAL
        if rng.random() > 0.25:
            target = Pose.from_rpy((*rng.uniform(-1.5, 1.5, 2).tolist(), 0.0))
        found = tree.grow(target)
        if found is not None:
            return found.corners if isinstance(found, Meeting) else found
    return None


@pytest.mark.parametrize(
    ("pockets", "seed"), some(product([(), (1.0,), (-1.0,), (-1.0, 1.0)], range(4)), 3)
)
def test_two_trees_meet_whichever_end_is_enclosed(pockets: tuple[float, ...], seed: int) -> None:
    maze = Maze(*pockets)
    trees = PoseTrees(START, GOAL, np.zeros(1), np.ones(1), straight, maze.edge)
    corners = grown(trees, seed, 3000)
    assert corners is not None
    assert corners[0] is START
    assert corners[-1] is GOAL
    for begin, end in itertools.pairwise(corners):
        assert maze.edge(begin, end, np.zeros(1)) is not None


def test_two_trees_reach_an_enclosed_goal_more_often_than_one() -> None:
    """With the same number of samples; the goal is in a pocket."""
    found = {"one": 0, "two": 0}
    for seed in range(6):
        maze = Maze(1.0)
        trees = PoseTrees(START, GOAL, np.zeros(1), np.ones(1), straight, maze.edge)
        found["two"] += grown(trees, seed, 150) is not None
        maze = Maze(1.0)
        tree = PoseTree(START, GOAL, np.zeros(1), straight, maze.edge)
        found["one"] += grown(tree, seed, 150) is not None
    assert found["two"] > found["one"]
