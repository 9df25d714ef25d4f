"""Bounding spheres limit how far an arm moves and how near it is to others."""

from __future__ import annotations

import numpy as np
import pytest

from bt_dualarm.collision.distance import BoundingSpheres, apart
from bt_dualarm.core.pose import Vector
from bt_dualarm.sim.world import World
from tests.sim.worlds import ROBOTS, world_with


def turned(world: World, q: Vector) -> None:
    """Puts the arm into a configuration."""
    world.data.qpos[world.arms["arm1"].qpos_ids] = q
    world.restore(world.state())


@pytest.mark.parametrize("robot", ROBOTS)
def test_no_sphere_moves_farther_than_its_bound(robot: str) -> None:
    """The bound holds for random small turns of all joints."""
    world = world_with(robot)
    rng = np.random.default_rng(4)
    hull = BoundingSpheres(world, "arm1")
    here = world.arms["arm1"].q.copy()
    before = hull.spheres()
    levers = hull.levers(before)
    for size in (0.01, 0.1, 0.3):
        turns = size * rng.random(len(here)) / len(here)
        turned(world, here + turns * rng.choice((-1.0, 1.0), len(here)))
        moved = np.linalg.norm(hull.spheres()[:, :3] - before[:, :3], axis=1).max()
        assert 0.0 < moved <= hull.reach(levers, turns)


def test_distance_of_spheres_is_that_of_the_nearest_two() -> None:
    """The result depends neither on their number nor on the distance of successive ones."""
    rng = np.random.default_rng(5)
    for count in (1, 5, 8, 9, 60):
        first = rng.random((7, 4))
        second = rng.random((count, 4)) + 3.0
        gaps = [np.linalg.norm(a[:3] - b[:3]) - a[3] - b[3] for a in first for b in second]
        assert apart(first, second) == pytest.approx(min(gaps))
