"""The force of a hand on an obstacle that it hits during an approach is limited."""

from __future__ import annotations

from pathlib import Path

import pytest
import yaml

from bt_dualarm.core.share import share_dir
from tests.plays import Stage
from tests.skills.scenarios import GRIPPING, ON_TABLE, Scenario, Tree


@pytest.mark.parametrize("reality", ["lab", "rough"])
def test_arm_is_compliant_while_it_brakes_after_contact(reality: str, stage: Stage) -> None:
    """A finger comes down on the cube; a stiff arm braked against it with 285 N and more."""
    arm = GRIPPING | {"gripper": "panda_hand"}
    aside = {"xyz": [0.42, -0.43, 0.405], "rpy": [0, 0, 0]}
    blind: Tree = {"grasp": {"object": "cube", "at": aside, "approach": [0, 0, -1]}}
    file = Scenario(ON_TABLE, arm=arm, scene="table").file(blind)
    file["world"]["reality"] = reality
    leaf = stage.run(file).leaf("grasp")
    assert leaf.code == "NOT_GRASPED", leaf
    assert 40.0 < float(leaf.metrics["approach_force_n"]) < 150.0, leaf


@pytest.mark.parametrize("seed", [1, 4])
def test_noise_of_a_heavy_arm_is_no_touch(seed: int, stage: Stage, tmp_path: Path) -> None:
    """With 17-bit encoders, those of a UR10 of 230 kg appear as 50 N where it touches nothing."""
    description = yaml.safe_load(
        (share_dir("assets") / "robots/ur10.yaml").read_text(encoding="utf-8")
    )
    masses = (62.2, 103.4, 31.0, 15.7, 15.7, 1.6)  # kg, eight times those of a UR10
    links = ("shoulder", "upper_arm", "forearm", "wrist_1", "wrist_2", "wrist_3")
    description["corrections"] = {
        "source": "a heavier arm of the same size",
        "links": {f"{n}_link": {"mass": mass} for n, mass in zip(links, masses, strict=True)},
    }
    effort = [2640.0, 2640.0, 1200.0, 448.0, 448.0, 448.0]
    description["limits"]["effort"] = {"value": effort, "source": "this test", "widens": True}
    del description["friction"]
    (tmp_path / "heavy.yaml").write_text(yaml.safe_dump(description), encoding="utf-8")
    arm = {"robot": str(tmp_path / "heavy.yaml"), "gripper": "robotiq_2f85"}
    stand = {"shape": "box", "size": [0.2] * 3, "fixed": True, "pose": {"xyz": [0.6, -0.3, 0.1]}}
    cube = {"shape": "box", "size": [0.05] * 3, "mass": 0.3, "pose": {"xyz": [0.6, -0.3, 0.225]}}
    file: Tree = {
        "name": "heavy",
        "world": {"scene": "empty", "reality": "rough", "seed": seed},
        "objects": {"stand": stand, "cube": cube},
        "arms": {"arm1": arm | {"tree": {"grasp": {"object": "cube"}}}},
    }
    leaf = stage.run(file).leaf("grasp")
    assert leaf.status == "SUCCESS", leaf.reason
