"""The force of a hand on an obstacle that it hits during an approach is limited."""

from __future__ import annotations

import pytest

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
