"""The distance of two arms, against that of each pair of their shapes."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from bt_dualarm.collision.distance import ArmDistance
from bt_dualarm.sim.world import World
from tests.families import some
from tests.sim.worlds import arm, file_of

HORIZON = 0.1


@pytest.mark.parametrize(
    ("robot", "hand", "other_hand"),
    some(
        [
            ("ur5", "robotiq_2f85", "panda_hand"),
            ("xarm7", "panda_hand", "robotiq_2f85"),
            ("panda", "suction_cup", "robotiq_2f85"),
            ("ur3", "robotiq_2f85", "robotiq_2f85"),
        ],
        2,
    ),
)
def test_it_is_that_of_the_nearest_shapes(robot: str, hand: str, other_hand: str) -> None:
    """Fingers and palms are boxes, of which MuJoCo reports one pair in six not at all."""
    arms = {
        "arm1": arm(robot, gripper=hand),
        "arm2": arm("ur5", (0.9, 0.0, 0.4), 180.0, gripper=other_hand),
    }
    world = World(file_of(arms))
    distance = ArmDistance(world, "arm1")
    model, data = world.model, distance.data
    solid = (model.geom_contype != 0) | (model.geom_conaffinity != 0)
    own, its = (
        [int(geom) for geom in world.arms[name].geom_ids if solid[geom]] for name in world.arms
    )
    rng = np.random.default_rng(0)
    near = 0
    while near < 25:
        q = {
            name: world.robots[name].postures["home"]
            + rng.uniform(-0.6, 0.6, world.robots[name].dof)
            for name in world.arms
        }
        found = distance.gap(q, HORIZON)
        if found.meters <= 0.0:
            continue  # depths are those of contacts
        exact = min(
            mujoco.mj_geomDistance(model, data, one, other, HORIZON, None)
            for one in own
            for other in its
        )
        near += exact < HORIZON
        assert min(found.meters, HORIZON) == pytest.approx(exact, abs=1e-5), found
