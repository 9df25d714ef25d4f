"""What a base stands on: what is there, else a pedestal."""

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
def test_a_raised_base_gets_a_pedestal(height: float) -> None:
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
def test_a_base_that_stands_on_something_gets_none(
    xyz: Place, objects: dict[str, ObjectSpec]
) -> None:
    world = World(file_of({"arm1": arm("panda", xyz)}, objects))
    assert pedestal_of(world) is None
    assert len(world.data.contact) == 0


def test_a_base_that_hangs_gets_none() -> None:
    upside_down = arm("ur5").model_copy(update={"base": PoseSpec(xyz=(0, 0, 2), rpy=(180, 0, 0))})
    assert pedestal_of(World(file_of({"arm1": upside_down}))) is None


@pytest.mark.parametrize(("robot", "height"), some(product(ROBOTS, [0.3, 0.8]), 3))
def test_what_an_arm_stood_on_may_be_taken_away(robot: str, height: float) -> None:
    """A base belongs to the world: it stays where it is, and an arm returns to it as it began."""
    block = box((0.5, 0.4, height / 2), height, fixed=True)
    world = World(file_of({"arm1": arm(robot, (0.5, 0.4, height))}, {"block": block}))
    began = world.arms["arm1"].q
    pose = world.arms["arm1"].tool_pose
    world.remove_object("block")
    assert world.arms["arm1"].tool_pose.distance(pose) == 0.0
    world.remove_arm("arm1")
    world.spawn_arm("arm1")
    assert (world.arms["arm1"].q == began).all()
    assert world.arms["arm1"].tool_pose.distance(pose) == 0.0
    world.step()
    assert len(world.data.contact) == 0, "no pedestal has grown through the arm"
