"""`place` beside an arm that stays where it is."""

from __future__ import annotations

from typing import Any

from tests.plays import Stage
from tests.skills.scenarios import CUBE

GOAL = (0.45, 0.1, 0.02)
STAYS_S = 15.0


def test_object_is_turned_by_its_symmetry_instead_of_waiting(stage: Stage) -> None:
    """As it is held, the wide hand has no room beside the other one; turned by 90° it has."""
    cube = CUBE | {"size": [0.04] * 3, "pose": {"xyz": [0.45, -0.25, 0.02]}}
    places: list[Any] = [
        {"await": "beside"},
        {"grasp": {"object": "cube", "approach": [0, 0, -1]}},
        {"place": {"at": {"xyz": [*GOAL], "rpy": [0, 0, 0]}}},
    ]
    beside = {"xyz": [GOAL[0], GOAL[1] + 0.18, 0.12], "rpy": [180, 0, 0]}
    stays: list[Any] = [
        {"reach_to_pose": {"to": beside}},
        {"signal": "beside"},
        {"hold_still": {"duration": STAYS_S}},
    ]
    base = {"xyz": [1.1, 0.1, 0], "rpy": [0, 0, 180]}
    arms = {
        "arm1": {"robot": "panda", "gripper": "panda_hand", "tree": {"sequence": places}},
        "arm2": {"robot": "ur5", "base": base, "tree": {"sequence": stays}},
    }
    cell = {"signals": {"beside": {"type": "boolean", "written_by": ["arm2"]}}}
    world = {"scene": "empty", "time_limit": 60}
    play = stage.run({"world": world, "objects": {"cube": cube}, "arms": arms, "cell": cell})
    leaf = play.leaf("place")
    assert leaf.status == "SUCCESS", leaf.reason
    assert leaf.ended_s is not None
    assert leaf.ended_s < STAYS_S
    assert abs(leaf.metrics["spun_rad"]) > 1.5
