"""Clearance: motions keep a distance from obstacles that they need not pass closely."""

from __future__ import annotations

from dataclasses import replace

import mujoco
import numpy as np
import pytest

from bt_dualarm.collision.checker import CollisionChecker
from bt_dualarm.core.pose import Matrix, Vector
from bt_dualarm.planning.problem import ROOM_M, admitted, motion_around, straight_motion
from bt_dualarm.sim.world import World
from tests.control.walls import LEFT, RIGHT, problem_in, walled_world


def gap(world: World, rows: Matrix, height: float | None = None) -> float:
    """Smallest distance in m between the arm, in some configurations, and the wall.

    Args:
        world: The arm and the wall.
        rows: Configurations, of shape (n, dof), rad.
        height: Height of the wall, m; None for the one that it has.
    """
    checker = CollisionChecker(world, "arm1")
    (wall,) = world.object_geoms("wall")
    model, data = checker.model, checker.data
    if height is not None:
        model.geom_size[wall, 2] = model.body_pos[model.geom_bodyid[wall], 2] = 0.5 * height
    gaps: list[float] = []
    for q in rows:
        checker.place(q)
        gaps += [
            mujoco.mj_geomDistance(model, data, geom, wall, 1.0, None)
            for geom in np.flatnonzero(checker.moving & checker._scratch.solid).tolist()
        ]
    return min(gaps)


def world_with_gap(wanted: float, start: Vector, end: Vector) -> World:
    """A wall over whose top the straight motion passes at a distance in m."""
    rows = np.linspace(start, end, 41)
    world = walled_world(height=0.05)
    low, high = 0.05, 0.9
    for _ in range(16):
        height = 0.5 * (low + high)
        low, high = (height, high) if gap(world, rows, height) > wanted else (low, height)
    return walled_world(height=low)


@pytest.mark.parametrize("wanted", [2e-4, 1e-3])
@pytest.mark.parametrize("lift", [0.0, 0.15])
def test_a_motion_that_need_not_pass_nearby_passes_farther_away(wanted: float, lift: float) -> None:
    start, end = RIGHT.copy(), LEFT.copy()
    start[1] -= lift
    end[1] -= lift
    world = world_with_gap(wanted, start, end)
    problem = admitted(problem_in(world, start, end))
    assert straight_motion(replace(problem, roomy=None)) is not None
    assert straight_motion(problem) is None
    motion = motion_around(problem)
    assert gap(world, motion.q[:: max(len(motion.q) // 400, 1)]) > ROOM_M - 1e-4


def test_a_motion_that_keeps_its_distance_is_straight() -> None:
    world = world_with_gap(ROOM_M + 3e-4, RIGHT, LEFT)
    assert straight_motion(admitted(problem_in(world, RIGHT, LEFT))) is not None


def test_clearance_of_an_end_is_enough_for_the_whole_motion() -> None:
    """The start is over the wall's top already."""
    world = world_with_gap(1e-3, RIGHT, LEFT)
    rows = np.linspace(RIGHT, LEFT, 41)
    over = min(rows, key=lambda q: gap(world, q[None]))
    problem = admitted(problem_in(world, over, LEFT))
    motion = straight_motion(problem)
    assert motion is not None
    assert gap(world, motion.q[:: max(len(motion.q) // 400, 1)]) == pytest.approx(1e-3, abs=1e-4)


def test_a_motion_without_alternative_passes_closely() -> None:
    """Only the base can turn: there is no other path."""
    world = world_with_gap(1e-3, RIGHT, LEFT)
    problem = problem_in(world, RIGHT, LEFT, checks=2000)
    fixed = problem.limits
    lower, upper = RIGHT - 1e-6, RIGHT + 1e-6
    lower[0], upper[0] = fixed.lower[0], fixed.upper[0]
    problem = admitted(replace(problem, limits=replace(fixed, lower=lower, upper=upper)))
    assert straight_motion(problem) is None
    motion = motion_around(problem)
    np.testing.assert_allclose(motion.q[:, 1:], np.tile(RIGHT[1:], (len(motion.q), 1)), atol=1e-5)
    assert gap(world, motion.q[:: max(len(motion.q) // 400, 1)]) == pytest.approx(1e-3, abs=1e-4)
