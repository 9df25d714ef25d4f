"""A base stands on the ground or a fixed object, or else on a pedestal."""

from __future__ import annotations

from itertools import product
from typing import Any

import mujoco
import pytest

from bt_dualarm.sim.world import World
from bt_dualarm.spec.document import ObjectSpec
from bt_dualarm.spec.values import PoseSpec
from tests.families import some
from tests.sim.worlds import ROBOTS, Place, arm, box, file_of


def pedestal_of(world: World) -> Any:
    geom = mujoco.mj_name2id(world.model, mujoco.mjtObj.mjOBJ_GEOM, "arm1/pedestal")
    return None if geom < 0 else geom


@pytest.mark.parametrize("height", [0.03, 0.4, 1.2])
def test_raised_base_gets_a_pedestal(height: float) -> None:
    """It reaches from the ground to the base, and the arm does not collide with it."""
    world = World(file_of({"arm1": arm("panda", (0.3, 0.2, height), 40.0)}))
    geom = pedestal_of(world)
    assert geom is not None
    assert world.data.geom_xpos[geom] == pytest.approx([0.3, 0.2, height / 2])
    assert world.model.geom_size[geom][2] == pytest.approx(height / 2)
    assert len(world.data.contact) == 0


@pytest.mark.parametrize(
    ("xyz", "objects"),
    [
        ((0.0, 0.0, 0.0), {}),  # on the ground
        ((0.0, 0.0, 0.01), {}),  # on a thick plate
        ((0.5, 0.4, 0.5), {"block": box((0.5, 0.4, 0.25), 0.5, fixed=True)}),  # on a fixed object
    ],
)
def test_supported_base_gets_no_pedestal(xyz: Place, objects: dict[str, ObjectSpec]) -> None:
    world = World(file_of({"arm1": arm("panda", xyz)}, objects))
    assert pedestal_of(world) is None
    assert len(world.data.contact) == 0


def test_hanging_base_gets_no_pedestal() -> None:
    upside_down = arm("ur5").model_copy(update={"base": PoseSpec(xyz=(0, 0, 2), rpy=(180, 0, 0))})
    assert pedestal_of(World(file_of({"arm1": upside_down}))) is None


@pytest.mark.parametrize(("robot", "height"), some(product(ROBOTS, [0.3, 0.8]), 3))
def test_support_of_an_arm_can_be_removed(robot: str, height: float) -> None:
    """The base stays in place, and a respawned arm has its initial posture there."""
    block = box((0.5, 0.4, height / 2), height, fixed=True)
    world = World(file_of({"arm1": arm(robot, (0.5, 0.4, height))}, {"block": block}))
    initial = world.arms["arm1"].q
    pose = world.arms["arm1"].tool_pose
    world.remove_object("block")
    assert world.arms["arm1"].tool_pose.distance(pose) == 0.0
    world.remove_arm("arm1")
    world.spawn_arm("arm1")
    assert (world.arms["arm1"].q == initial).all()
    assert world.arms["arm1"].tool_pose.distance(pose) == 0.0
    world.step()
    assert len(world.data.contact) == 0, "no pedestal intersects the arm"
