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


def test_fingers_do_not_narrow_onto_what_is_between_them(stage: Stage) -> None:
    """For a small cube they close a little on the way, where the plan had left them wide open."""
    size = [0.03, 0.064, 0.04]  # the fingers open to 80 mm
    post = CUBE | {"size": size, "pose": {"xyz": [0.25, -0.45, 0.42]}, "fixed": True}
    small = CUBE | {"size": [0.03] * 3, "pose": {"xyz": [0.40, -0.45, 0.415]}}
    over: Tree = {"reach_to_pose": {"to": {"xyz": [0.25, -0.45, 0.43], "rpy": [180, 0, 0]}}}
    arm = GRIPPING | {"gripper": "panda_hand"}
    scenario = Scenario({"cube": small, "post": post}, arm=arm, scene="table")
    played = stage.run(scenario.file({"open_gripper": {}}, over, GRASP))
    leaf = played.leaf("grasp")
    assert leaf.status == "SUCCESS", leaf
    assert "touched" not in leaf.metrics, leaf


@pytest.mark.parametrize("width", [0.069, 0.071])
@pytest.mark.parametrize("size", [[0.03, 0.03, 0.03], [0.05, 0.03, 0.03]])
def test_place_lets_go_between_near_walls(width: float, size: list[float], stage: Stage) -> None:
    """With a millimeter beside each finger, these pressed against the walls: `NOT_OPEN`.

    A cube fits the other way around as well, where there is room.
    """
    crate = CUBE | {"shape": "bin", "size": [0.12, width, 0.04], "wall": 0.004, "mass": 0.2}
    objects = {
        "cube": CUBE | {"size": size, "pose": {"xyz": [0.45, -0.1, 0.0155]}},
        "crate": crate | {"pose": {"xyz": [0.45, 0.15, 0.0205]}},
    }
    arm = {"robot": "panda", "gripper": "panda_hand"}
    place: Tree = {"place": {"at": {"on": "crate"}}}
    goal = {"in": {"object": "cube", "on": "crate", "held": False}}
    scenario = Scenario(objects, arm=arm, scene="empty")
    played = stage.run(scenario.file(GRASP, place) | {"goal": goal})
    assert played.leaf("place").status == "SUCCESS", played.leaf("place")
    assert played.result is not None
    assert played.result.goals_met
