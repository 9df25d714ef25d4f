"""Spheres hold what they wrap, wherever an arm stands, and bound how far it gets."""

from __future__ import annotations

import numpy as np
import pytest

from bt_dualarm.collision.distance import BoundingSpheres, apart
from bt_dualarm.core.pose import Vector
from bt_dualarm.sim.world import World
from tests.sim.worlds import ROBOTS, world_with


def turned(world: World, q: Vector) -> None:
    """Put the arm into a configuration."""
    world.data.qpos[world.arms["arm1"].qpos_ids] = q
    world.restore(world.state())


@pytest.mark.parametrize("robot", ROBOTS)
def test_no_sphere_gets_farther_than_is_said(robot: str) -> None:
    """Random small turns of all joints."""
    world = world_with(robot)
    rng = np.random.default_rng(4)
    hull = BoundingSpheres(world, "arm1")
    here = world.arms["arm1"].q.copy()
    before = hull.spheres()
    levers = hull.levers(before)
    for size in (0.01, 0.1, 0.3):
        way = size * rng.random(len(here)) / len(here)
        turned(world, here + way * rng.choice((-1.0, 1.0), len(here)))
        moved = np.linalg.norm(hull.spheres()[:, :3] - before[:, :3], axis=1).max()
        assert 0.0 < moved <= hull.reach(levers, way)


def test_the_distance_of_spheres_is_that_of_the_nearest_two() -> None:
    """However many there are, and however far apart those lie that follow each other."""
    rng = np.random.default_rng(5)
    for count in (1, 5, 8, 9, 60):
        first = rng.random((7, 4))
        second = rng.random((count, 4)) + 3.0
        gaps = [np.linalg.norm(a[:3] - b[:3]) - a[3] - b[3] for a in first for b in second]
        assert apart(first, second) == pytest.approx(min(gaps))
