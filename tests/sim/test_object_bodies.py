"""Objects as bodies: round objects stay where they are declared, and come to rest."""

from __future__ import annotations

from collections.abc import Callable
from itertools import product

import mujoco
import numpy as np
import pytest

from bt_dualarm.core.pose import Pose
from bt_dualarm.sim.world import World
from bt_dualarm.spec.document import ObjectSpec
from bt_dualarm.spec.values import PoseSpec
from tests.families import some
from tests.sim.worlds import arm, file_of

Kind = Callable[[float], ObjectSpec]

RADII = (0.01, 0.03, 0.06)  # m
OBLIQUE = (75.0, 60.0, 35.0)  # degrees


def ball(radius: float) -> ObjectSpec:
    pose = PoseSpec(xyz=(0.0, 0.0, radius), rpy=OBLIQUE)
    return ObjectSpec(shape="sphere", size=(radius,), mass=0.15, pose=pose)


def lying(radius: float) -> ObjectSpec:
    pose = PoseSpec(xyz=(0.0, 0.0, radius), rpy=(90.0, 0.0, 35.0))
    return ObjectSpec(shape="cylinder", size=(radius, 0.08), mass=0.15, pose=pose)


def standing(radius: float) -> ObjectSpec:
    pose = PoseSpec(xyz=(0.0, 0.0, 0.04))
    return ObjectSpec(shape="cylinder", size=(radius, 0.08), mass=0.15, pose=pose)


def after(world: World, seconds: float, name: str = "thing") -> Pose:
    for _ in range(round(seconds / world.timestep)):
        world.step()
    return world.object_pose(name)


def world_of(obj: ObjectSpec, reality: str, seed: int = 0) -> World:
    far = arm("ur3", xyz=(5.0, 0.0, 0.0), spawned=False)
    return World(file_of({"arm1": far}, {"thing": obj}, reality=reality), seed)


@pytest.mark.parametrize(
    ("kind", "radius", "reality"),
    some(product([ball, lying, standing], RADII, ["ideal", "lab", "rough"]), 2),
)
def test_round_object_stays_where_it_is_declared(kind: Kind, radius: float, reality: str) -> None:
    """Within 1 mm for 2 s, for any sampled mass and center of mass."""
    for seed in range(2):
        world = world_of(kind(radius), reality, seed)
        before = world.object_pose("thing")
        assert after(world, 2.0).distance(before) < 1e-3


@pytest.mark.parametrize("yaw", some([-20.6384, 0.0, 117.0], 2))
def test_upright_can_stands_for_a_minute(yaw: float) -> None:
    """Rounding errors of an exactly upright can make MuJoCo lose its contacts with the floor."""
    radius = 0.029878281602216544
    pose = PoseSpec(xyz=(0.24661, -0.218896, 0.035364), rpy=(0.0, 0.0, yaw))
    can = ObjectSpec(
        shape="cylinder", size=(radius, 0.06972853818401056), mass=0.17832953583037264, pose=pose
    )
    far = arm("ur3", xyz=(5.0, 0.0, 0.0), spawned=False, gripper="panda_hand")
    world = World(file_of({"arm1": far}, {"cube": can}, reality="lab"), 21664)
    before = after(world, 0.2, "cube")
    assert after(world, 60.0, "cube").distance(before) < 1e-4


@pytest.mark.parametrize("reality", ["ideal", "rough"])
@pytest.mark.parametrize("radius", RADII)
@pytest.mark.parametrize("kind", [ball, lying])
def test_rolling_object_comes_to_rest(kind: Kind, radius: float, reality: str) -> None:
    """From 0.05 m/s within 25 mm and 2 s: about the rolling resistance of real wood."""
    world = world_of(kind(radius), reality)
    across = world.object_pose("thing").rotation_matrix[:, 2] if kind is lying else np.eye(3)[1]
    joint = world.data.joint("thing")
    joint.qvel[:3] = 0.05 * np.cross(across, (0, 0, 1))
    start = world.object_pose("thing")
    distance = after(world, 2.0).distance(start)
    assert 1e-3 < distance < 0.025
    assert np.linalg.norm(world.object_velocity("thing")) < 1e-3


def test_only_rolling_objects_keep_their_center_of_mass() -> None:
    """Standing cylinders have the sampled center of mass, lying ones only along their axis."""
    for kind, kept in ((ball, (0, 0, 0)), (lying, (0, 0, 1)), (standing, (1, 1, 1))):
        world = world_of(kind(0.03), "rough")
        shift = world.devices.sampled_object("thing").shift
        body = mujoco.mj_name2id(world.model, mujoco.mjtObj.mjOBJ_BODY, "thing")
        assert world.model.body_ipos[body] == pytest.approx(shift * kept)
