"""An arm that gives way stands farther from the others than where it came from."""

from __future__ import annotations

import numpy as np

from bt_dualarm.collision.checker import CollisionChecker
from bt_dualarm.collision.distance import BoundingSpheres, apart
from bt_dualarm.planning.problem import yielding_configurations
from bt_dualarm.sim.world import World
from tests.sim.worlds import arm, box, file_of


def test_it_finds_free_places_far_from_the_others() -> None:
    """Not behind it: a wall stands there."""
    wall = box((-0.75, 0.0, 0.6), 0.5, fixed=True)
    arms = {"arm1": arm("ur5"), "arm2": arm("panda", (1.1, 0.0, 0.4), 180.0)}
    world = World(file_of(arms, {"wall": wall}))
    robot = world.robots["arm1"]
    checker = CollisionChecker(world, "arm1", 0.05)
    before = apart(*(BoundingSpheres(world, name).spheres() for name in arms))
    places = yielding_configurations(
        checker,
        [world.arms["arm2"].base.position],
        list(robot.postures.values()),
        robot.limits,
        np.random.default_rng(0),
    )
    assert places
    for q in places:
        assert checker.free(q)
        world.data.qpos[world.arms["arm1"].qpos_ids] = q
        world.step()
        assert apart(*(BoundingSpheres(world, name).spheres() for name in arms)) > before + 0.1


def test_a_joint_that_was_measured_beyond_its_limit_is_within_it_there() -> None:
    """The wrist stays where it is; the noise of an encoder may put that beyond a limit."""
    world = World(file_of({"arm1": arm("panda"), "arm2": arm("panda", (1.1, 0.0, 0.4), 180.0)}))
    robot = world.robots["arm1"]
    limits = robot.limits
    checker = CollisionChecker(world, "arm1", 0.05)
    checker.present = checker.present.copy()
    checker.present[6] = limits.upper[6] + 1e-5
    others = [world.arms["arm2"].base.position]
    places = yielding_configurations(checker, others, [], limits, np.random.default_rng(0))
    assert places
    for q in places:
        assert (limits.lower <= q).all()
        assert (q <= limits.upper).all()
