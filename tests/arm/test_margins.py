"""An arm that starts within the planning margin of one arm keeps the margin to all others."""

from __future__ import annotations

from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from bt_dualarm.arm.arm import Arm
from bt_dualarm.arm.traffic import Traffic
from bt_dualarm.collision.checker import CollisionChecker
from bt_dualarm.collision.distance import PLANNING_MARGIN_M
from bt_dualarm.sim.world import World
from tests.families import some
from tests.sim.worlds import WIDE, arm, file_of

FAR_M = 3.0


def gap(world: World, other: str) -> float:
    """Distance of arm1 from another arm in m, at most FAR_M."""
    contact = CollisionChecker(world, "arm1", {other: FAR_M}).contact(world.arms["arm1"].q)
    return FAR_M if contact is None else -contact.depth


def beside(robot: str, distances: tuple[float, float]) -> World:
    """A UR5 between two other arms at distances in m: arm2 on one side, arm3 on the other."""
    right = 3.0
    left = 3.0
    for _ in range(8):
        arms = {
            "arm1": arm("ur5"),
            "arm2": arm(robot, (0.5, right, 0.4)),
            "arm3": arm(robot, (0.5, -left, 0.4)),
        }
        world = World(file_of(arms))
        right -= gap(world, "arm2") - distances[0]
        left -= gap(world, "arm3") - distances[1]
    return world


@pytest.mark.parametrize("robot", some((*WIDE[1:], WIDE[0]), 2))
def test_near_arm_does_not_reduce_the_margin_to_another(robot: str) -> None:
    world = beside(robot, (0.025, 0.05))
    assert 0.005 < gap(world, "arm2") < 0.035
    assert PLANNING_MARGIN_M < gap(world, "arm3") < 0.08
    q = world.arms["arm1"].q
    shared = SimpleNamespace(traffic=Traffic(lambda: 0.0))
    here = SimpleNamespace(q=q)
    state = SimpleNamespace(
        world=world,
        name="arm1",
        setpoint=here,
        _shared=shared,
        resting=frozenset(),
        left_out=frozenset(),
        _seen={},
    )
    checker = Arm.checker(cast("Arm", state))
    assert checker.free(q)
    of_third = CollisionChecker(world, "arm1", {"arm3": PLANNING_MARGIN_M})
    apart = CollisionChecker(world, "arm1")
    near = [
        one
        for one in q + np.random.default_rng(0).uniform(-0.2, 0.2, (1000, len(q)))
        if apart.free(one) and not of_third.free(one)
    ]
    assert len(near) > 5, len(near)
    assert not any(map(checker.free, near))
