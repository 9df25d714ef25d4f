"""Where none of the usual grasps is possible, the directions halfway between them are tried."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from tests.plays import Stage
from tests.skills.scenarios import CUBE

BASE = {"xyz": [-0.05, 0.3, 0.0375]}
INSIDE = {"xyz": [0.56, -0.16, 0.024], "rpy": [0, 0, 0]}
"""Pose in a box that a tool that points straight down does not reach; tilted by 45°, it would touch
the walls."""


def test_tilted_hand_reaches_farther_into_a_box(stage: Stage) -> None:
    box = {"shape": "bin", "size": [0.2, 0.244, 0.08], "wall": 0.008, "fixed": True}
    objects: dict[str, Any] = {
        "box": box | {"pose": {"xyz": [0.6, -0.2, 0.04]}},
        "cube": CUBE | {"size": [0.032] * 3, "pose": {"xyz": [0.5, 0.2, 0.016]}},
    }
    tree = {
        "sequence": [{"grasp": {"object": "cube", "then_at": INSIDE}}, {"place": {"at": INSIDE}}]
    }
    arm = {"robot": "xarm7", "gripper": "robotiq_2f85", "base": BASE, "tree": tree}
    world = {"scene": "empty", "time_limit": 60}
    play = stage.run({"world": world, "objects": objects, "arms": {"arm1": arm}})
    leaf = play.leaf("grasp")
    assert leaf.status == "SUCCESS", leaf.reason
    assert play.leaf("place").status == "SUCCESS", play.leaf("place").reason
    tilt = np.arccos(-play.opened.world.arms["arm1"].tool_pose.rotation_matrix[2, 2])
    assert tilt == pytest.approx(np.radians(22.5), abs=0.01)
