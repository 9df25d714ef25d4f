"""Fingers that need seconds to close are given that time."""

from __future__ import annotations

from pathlib import Path

from bt_dualarm.core.share import share_dir
from tests.plays import Stage
from tests.skills.scenarios import Scenario, Tree


def test_slow_fingers_close_from_their_full_opening(stage: Stage, tmp_path: Path) -> None:
    """They open fully around an object whose pose was measured, and then need 2 s."""
    description = (share_dir("assets") / "grippers/panda_hand.yaml").read_text(encoding="utf-8")
    slow = description.replace("[0.005, 0.100]", "[0.005, 0.020]")
    assert slow != description
    (tmp_path / "slow.yaml").write_text(slow, encoding="utf-8")
    pose = {"xyz": [0.45, -0.15, 0.02]}
    cube: Tree = {"cube": {"shape": "box", "size": [0.04] * 3, "mass": 0.05, "pose": pose}}
    arm = {"robot": "panda", "gripper": str(tmp_path / "slow.yaml")}
    at = pose | {"rpy": [0, 0, 0]}
    file = Scenario(cube, arm=arm, scene="empty").file({"grasp": {"object": "cube", "at": at}})
    file["world"]["reality"] = "lab"
    leaf = stage.run(file, seed=0).leaf("grasp")
    assert leaf.status == "SUCCESS", leaf.reason
