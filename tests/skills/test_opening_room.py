"""Fingers open for a grasp only where there is room."""

from __future__ import annotations

from typing import Any

import pytest

from tests.plays import Play, Stage
from tests.skills.scenarios import CUBE, GRASP, GRIPPING, ON_TABLE, Scenario, Tree

SHUT: Tree = {"close_gripper": {"empty": True}}
DOWN: Tree = {"reach_to_pose": {"to": {"xyz": [0.25, -0.45, 0.43], "rpy": [180, 0, 0]}}}
"""Moves the shut fingers, which open along y, low above the table."""


def beside(y: float, **more: Any) -> Tree:
    """A low wall whose near face is `y` m beside the fingers."""
    size = [0.1, 0.02, 0.06]
    pose = {"xyz": [0.25, -0.45 + y + 0.01, 0.43]}
    return {"wall": CUBE | {"size": size, "pose": pose, "fixed": True, "color": "red"} | more}


def play(stage: Stage, gripper: str, walls: Tree) -> Play:
    arm = GRIPPING | {"gripper": gripper}
    scenario = Scenario(ON_TABLE | walls, arm=arm, scene="table")
    return stage.run(scenario.file(SHUT, DOWN, GRASP))


@pytest.mark.parametrize("gripper", ["robotiq_2f85", "panda_hand"])
def test_fingers_do_not_open_into_a_wall_beside_them(gripper: str, stage: Stage) -> None:
    """`grasp`, and `regrasp` after a release, opened them wherever the arm was."""
    played = play(stage, gripper, beside(0.05))
    leaf = played.leaf("grasp")
    assert leaf.status == "SUCCESS", leaf
    assert "touched" not in leaf.metrics, leaf
