"""Yielding: an arm moves farther away from the others than it was before."""

from __future__ import annotations

import numpy as np

from bt_dualarm.collision.checker import CollisionChecker
from bt_dualarm.collision.distance import BoundingSpheres, apart
from bt_dualarm.planning.problem import yielding_configurations
from bt_dualarm.sim.world import World
from tests.sim.worlds import arm, box, file_of


def test_yielding_configurations_are_free_and_far_from_other_arms() -> None:
    """The space behind the arm is blocked by a wall."""
    wall = box((-0.75, 0.0, 0.6), 0.5, fixed=True)
    arms = {"arm1": arm("ur5"), "arm2": arm("panda", (1.1, 0.0, 0.4), 180.0)}
    world = World(file_of(arms, {"wall": wall}))
    robot = world.robots["arm1"]
    checker = CollisionChecker(world, "arm1", 0.05)
    before = apart(*(BoundingSpheres(world, name).spheres() for name in arms))
    configurations = yielding_configurations(
        checker,
        [world.arms["arm2"].base.position],
        list(robot.postures.values()),
        robot.limits,
        np.random.default_rng(0),
    )
    assert configurations
    for q in configurations:
        assert checker.free(q)
        world.data.qpos[world.arms["arm1"].qpos_ids] = q
        world.step()
        assert apart(*(BoundingSpheres(world, name).spheres() for name in arms)) > before + 0.1


def test_yielding_configurations_are_within_limits_despite_encoder_noise() -> None:
    """The wrist stays where it is; the noise of an encoder may put that beyond a limit."""
    world = World(file_of({"arm1": arm("panda"), "arm2": arm("panda", (1.1, 0.0, 0.4), 180.0)}))
    robot = world.robots["arm1"]
    limits = robot.limits
    checker = CollisionChecker(world, "arm1", 0.05)
    checker.present = checker.present.copy()
    checker.present[6] = limits.upper[6] + 1e-5
    others = [world.arms["arm2"].base.position]
    configurations = yielding_configurations(checker, others, [], limits, np.random.default_rng(0))
    assert configurations
    for q in configurations:
        assert (limits.lower <= q).all()
        assert (q <= limits.upper).all()
