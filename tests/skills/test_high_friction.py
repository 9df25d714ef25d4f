"""Joints whose dry friction is large for their inertia need longer to come to rest."""

from __future__ import annotations

from pathlib import Path

import pytest
import yaml

from bt_dualarm.core.share import share_dir
from tests.plays import Stage


@pytest.mark.parametrize("reality", ["lab", "rough"])
def test_arm_comes_to_rest_at_its_goal(reality: str, stage: Stage, tmp_path: Path) -> None:
    """The integral action of a wrist without rotor needs 1.4 s to overcome 5 N m."""
    description = yaml.safe_load(
        (share_dir("assets") / "robots/ur5.yaml").read_text(encoding="utf-8")
    )
    description["rotor_inertia"] = 0.0
    dry = [27.0, 27.0, 27.0, 5.0, 5.0, 5.0]
    viscous = [2.1, 2.1, 2.1, 0.4, 0.4, 0.4]
    description["friction"] = {"coulomb": dry, "viscous": viscous, "source": "this test"}
    effort = [225.0, 225.0, 225.0, 42.0, 42.0, 42.0]
    description["limits"]["effort"] = {"value": effort, "source": "this test", "widens": True}
    (tmp_path / "dry.yaml").write_text(yaml.safe_dump(description), encoding="utf-8")
    goal = {"xyz": [0.4, -0.3, 0.5], "rpy": [180, 0, 0]}
    tree = {
        "sequence": [
            {"reach_to_pose": {"to": goal}},
            {"circle": {"plane": "xy", "radius": 0.05}},
            "go_home",
        ]
    }
    file = {
        "name": "dry",
        "world": {"scene": "empty", "reality": reality, "seed": 1},
        "arms": {"arm1": {"robot": str(tmp_path / "dry.yaml"), "tree": tree}},
    }
    leaves = stage.run(file).leaves
    for skill in ("reach_to_pose", "circle", "go_home"):
        leaf = leaves(skill)[-1]
        assert leaf.status == "SUCCESS", leaf.reason
