"""Composition of a world: initial poses by seed and name, and contacts of thin cylinders."""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np

from bt_dualarm.core.pose import Pose
from bt_dualarm.sim import composition
from bt_dualarm.sim.world import World
from bt_dualarm.spec.document import NoiseSpec, ObjectSpec, WorldSpec
from tests.sim.worlds import Place, arm, box, file_of


def noisy(xyz: Place = (0.5, 0.4, 0.2), **fields: Any) -> ObjectSpec:
    return box(xyz, noise=NoiseSpec(xyz=(0.1, 0.2, 0.0), yaw=45.0), **fields)


def test_noise_depends_only_on_seed_and_name() -> None:
    """Other objects, their order and the time of spawning have no influence."""
    alone = file_of({"arm1": arm("ur5")}, {"cube": noisy()})
    others = {"a": noisy(), "cube": noisy(spawned=False), "z": noisy()}
    among = World(file_of({"arm1": arm("ur5")}, others), seed=7)
    among.spawn_object("cube")
    pose = World(alone, seed=7).object_pose("cube")
    assert pose.distance(among.object_pose("cube")) < 1e-12
    assert pose.angle(among.object_pose("cube")) < 1e-7
    assert among.object_pose("a").distance(pose) > 1e-3
    assert World(alone, seed=8).object_pose("cube").distance(pose) > 1e-3


def test_noise_stays_within_its_widths() -> None:
    names = [f"cube{i}" for i in range(40)]
    file = file_of({"arm1": arm("ur5")}, {name: noisy(spawned=False) for name in names})
    world = World(file, seed=1)
    poses = {}
    for name in names:  # one after the other, as they would overlap
        world.spawn_object(name)
        poses[name] = world.object_pose(name)
        world.remove_object(name)
    offsets = np.array([pose.position for pose in poses.values()]) - (0.5, 0.4, 0.2)
    assert (np.abs(offsets) <= (0.1, 0.2, 1e-12)).all()
    assert (np.ptp(offsets, axis=0)[:2] > (0.1, 0.2)).all()
    turns = [pose.angle(Pose.identity()) for pose in poses.values()]
    assert np.radians(30.0) < max(turns) <= np.radians(45.0)


def test_barely_touching_cylinder_has_no_deep_contact() -> None:
    """In this pose, with 0.1 µm of penetration, a pot at the edge of a stove was thrown aside."""
    spec = composition.scene_spec(WorldSpec(scene="empty"))
    stove = spec.worldbody.add_body(pos=[0.5, 0.3, 0.832])
    stove.add_geom(type=mujoco.mjtGeom.mjGEOM_BOX, size=[0.175, 0.14, 0.01])
    rotation = [
        [0.0008856240468176901, -0.999999607802833, 8.014315607547317e-06],
        [0.9999996073234747, 0.0008856237900101149, -3.199062867027503e-05],
        [3.198351845507837e-05, 8.042644130536919e-06, 0.9999999994561858],
    ]
    matrix = np.eye(4)
    matrix[:3, :3] = rotation
    matrix[:3, 3] = [0.5301177609052558, 0.29981888210959967, 0.8442546937468322]
    pose = Pose.from_matrix(matrix)
    floor = spec.worldbody.add_body(pos=pose.position, quat=pose.quaternion)
    floor.add_freejoint()
    floor.add_geom(type=mujoco.mjtGeom.mjGEOM_CYLINDER, size=[0.14775, 0.00225, 0.0])
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    depths = [-contact.dist for contact in data.contact[: data.ncon]]
    assert depths
    assert max(depths) < 1e-5
