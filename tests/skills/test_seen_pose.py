"""Motions to an object at a pose that was seen keep off it until the straight part."""

from __future__ import annotations

from typing import Any

import pytest

from tests.families import some
from tests.plays import Stage

SEEN = {"xyz": [0.40, -0.45, 0.525], "rpy": [0, 0, 0]}
GRASP = {"grasp": {"object": "can", "at": SEEN, "approach": [0, 1, 0]}}
ATTACH = {"approach_and_attach": {"object": "can", "at": SEEN, "direction": [0, 1, 0]}}


@pytest.mark.parametrize(
    ("robot", "gripper", "leaf"),
    some(
        [
            ("ur10", "robotiq_2f85", GRASP),
            ("ur10", "robotiq_2f85", ATTACH),
            ("ur5", "robotiq_2f85", GRASP),
            ("panda", "panda_hand", GRASP),
        ],
        2,
    ),
)
@pytest.mark.parametrize("y", some([-0.25, -0.2], 1))
def test_an_arm_goes_around_what_it_has_seen(
    robot: str, gripper: str, leaf: dict[str, Any], y: float, stage: Stage
) -> None:
    """It begins behind the can, and swept it off: plans ignored it altogether."""
    can = {"shape": "cylinder", "size": [0.025, 0.25], "mass": 0.3, "color": "red"}
    behind = {"reach_to_pose": {"to": {"xyz": [0.40, y, 0.52], "rpy": [90, 0, 0]}}}
    arm = {"robot": robot, "gripper": gripper, "base": {"xyz": [0, 0, 0.4]}}
    file: dict[str, Any] = {
        "world": {"scene": "table", "time_limit": 60},
        "objects": {"can": can | {"pose": {"xyz": SEEN["xyz"]}}},
        "arms": {"arm1": arm | {"tree": {"sequence": [behind, leaf]}}},
    }
    (skill,) = leaf
    found = stage.run(file).leaf(skill)
    assert found.status == "SUCCESS", found.reason
