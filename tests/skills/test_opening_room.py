"""Fingers that are to take something open where there is room for it."""

from __future__ import annotations

from typing import Any

import pytest

from tests.plays import Play, Stage
from tests.skills.scenarios import CUBE, GRASP, GRIPPING, ON_TABLE, Scenario, Tree

SHUT: Tree = {"close_gripper": {"empty": True}}
DOWN: Tree = {"reach_to_pose": {"to": {"xyz": [0.25, -0.45, 0.43], "rpy": [180, 0, 0]}}}
"""Shut fingers, which open along y, low above the table."""


def beside(y: float, **more: Any) -> Tree:
    """A low wall whose near face is so many meters beside them."""
    size = [0.1, 0.02, 0.06]
    pose = {"xyz": [0.25, -0.45 + y + 0.01, 0.43]}
    return {"wall": CUBE | {"size": size, "pose": pose, "fixed": True, "color": "red"} | more}


def play(stage: Stage, gripper: str, walls: Tree) -> Play:
    arm = GRIPPING | {"gripper": gripper}
    scenario = Scenario(ON_TABLE | walls, arm=arm, scene="table")
    return stage.run(scenario.file(SHUT, DOWN, GRASP))


@pytest.mark.parametrize("gripper", ["robotiq_2f85", "panda_hand"])
def test_fingers_do_not_open_into_what_stands_beside_them(gripper: str, stage: Stage) -> None:
    """`grasp`, and `regrasp` after it had let go, opened them wherever the arm stood."""
    played = play(stage, gripper, beside(0.05))
    leaf = played.leaf("grasp")
    assert leaf.status == "SUCCESS", leaf
    assert "touched" not in leaf.metrics, leaf
