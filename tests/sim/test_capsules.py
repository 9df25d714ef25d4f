"""Capsules as objects: their inertia, detection, handling and markers."""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np
import pytest

import bt_dualarm as bt
from bt_dualarm.sim.arm_models import inertia_per_mass
from bt_dualarm.spec.document import ObjectSpec
from bt_dualarm.spec.values import PoseSpec

PILL = {"shape": "capsule", "size": [0.02, 0.04], "mass": 0.3, "color": "yellow"}


@pytest.mark.parametrize("size", [(0.02, 0.04), (0.05, 0.01), (0.01, 0.2)])
def test_inertia_of_a_capsule_agrees_with_mujoco(size: tuple[float, float]) -> None:
    obj = ObjectSpec(shape="capsule", size=size, mass=2.0, pose=PoseSpec(xyz=(0, 0, 1)))
    spec = mujoco.MjSpec()
    body = spec.worldbody.add_body()
    body.add_freejoint()
    kind = mujoco.mjtGeom.mjGEOM_CAPSULE
    body.add_geom(type=kind, size=(size[0], size[1] / 2, 0), mass=2.0)
    model = spec.compile()
    axes = np.zeros(9)
    mujoco.mju_quat2Mat(axes, model.body_iquat[1])
    turned = axes.reshape(3, 3)
    inertia = turned @ np.diag(model.body_inertia[1]) @ turned.T
    assert np.diag(inertia) == pytest.approx(2.0 * inertia_per_mass(obj), rel=1e-9)


def test_capsule_is_located_grasped_carried_and_placed() -> None:
    """It is located by its color and shape alone."""
    pose = {"xyz": [0.41, -0.43, 0.42], "rpy": [0, 90, 25]}
    tree: list[dict[str, Any]] = [
        {"scan": {"object": "pill", "center": [0.40, -0.45, 0.40], "width": 0.1, "depth": 0.1}},
        {"locate": {"object": "pill", "pose": "{pose}", "score": "pill"}},
        {"grasp": {"object": "pill", "at": "{pose}"}},
        {"transport": {"to": {"xyz": [0.30, -0.45, 0.60]}}},
        {"place": {"at": {"xyz": [0.25, -0.50, 0.42]}}},
    ]
    camera = {"mount": "wrist", "resolution": [320, 240], "fov": 60, "fps": 30}
    file = {
        "bt_dualarm": 1,
        "name": "pill",
        "world": {"scene": "table", "reality": "lab", "time_limit": 90},
        "objects": {"pill": PILL | {"pose": pose}},
        "arms": {
            "arm1": {
                "robot": "ur5",
                "gripper": "robotiq_2f85",
                "base": {"xyz": [0, 0, 0.4]},
                "camera": camera,
                "tree": {"sequence": tree},
            }
        },
    }
    result = bt.run(file)
    leaves = result.arms["arm1"].leaves
    assert result.outcome == "SUCCESS", {n: (one.code, one.reason) for n, one in leaves.items()}
    assert float(leaves["sequence/locate"].metrics["located_error_m"]) < 0.003
    assert float(leaves["sequence/place"].metrics["placed_error_m"]) < 0.005


def test_marker_on_a_capsule_is_refused() -> None:
    marker = {"dictionary": "aruco_4x4_50", "id": 1, "size": 0.02}
    file = {
        "bt_dualarm": 1,
        "objects": {"pill": PILL | {"pose": {"xyz": [1, 0, 0.02]}, "marker": marker}},
        "arms": {"arm1": {"robot": "ur5", "tree": {"sequence": ["stop"]}}},
    }
    found = [problem.message for problem in bt.check(file)]
    assert any("a capsule has no face for a marker" in message for message in found), found
