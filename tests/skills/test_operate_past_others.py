"""`operate` waits for other arms, as other motions do."""

from __future__ import annotations

from typing import Any

from tests.plays import Stage

CHEST: dict[str, Any] = {
    "shape": "compound",
    "mass": 3,
    "fixed": True,
    "pose": {"xyz": [0.6, -0.2, 0]},
    "parts": {
        "body": {
            "shape": "bin",
            "size": [0.2, 0.244, 0.08],
            "wall": 0.008,
            "pose": {"xyz": [0, 0, 0.04]},
        },
        "lid": {"shape": "box", "size": [0.2, 0.244, 0.01], "pose": {"xyz": [0, 0, 0.086]}},
        "handle": {
            "shape": "box",
            "size": [0.016, 0.06, 0.016],
            "pose": {"xyz": [-0.135, -0.085, 0.086]},
        },
        "stem": {
            "shape": "box",
            "size": [0.03, 0.02, 0.01],
            "pose": {"xyz": [-0.113, -0.085, 0.086]},
        },
    },
    "joints": {
        "hinge": {
            "type": "hinge",
            "parts": ["lid", "handle", "stem"],
            "axis": [0, 1, 0],
            "anchor": [0.08, 0, 0.086],
            "range": [0, 88],
            "mass": 0.5,
            "damping": 0.05,
            "friction": 0.05,
        }
    },
}


def test_an_arm_above_the_lid_is_waited_for(stage: Stage) -> None:
    """The lid opens through where the other arm is, which leaves after a while."""
    opening = [
        {"grasp": {"object": "chest", "part": "handle", "approach": [0, 1, 0], "then_to": 70}},
        {"operate": {"object": "chest", "joint": "hinge", "to": 70}},
    ]
    above = {"xyz": [0.58, -0.22, 0.29], "rpy": [180, 0, 0]}
    passing = [{"reach_to_pose": {"to": above}}, {"wait": {"seconds": 9.0}}, "go_home"]
    arms = {
        name: {
            "robot": "ur5e",
            "gripper": "robotiq_2f85",
            "base": {"xyz": [-0.05, y, 0.0375]},
            "tree": {"sequence": leaves},
        }
        for name, y, leaves in (("opens", -0.3, opening), ("passes", 0.3, passing))
    }
    world = {"scene": "empty", "time_limit": 60}
    play = stage.run({"world": world, "objects": {"chest": CHEST}, "arms": arms})
    leaf = play.leaf("operate", "opens")
    assert leaf.started_s < play.leaf("go_home", "passes").started_s, "it did not have to wait"
    assert leaf.status == "SUCCESS", leaf.reason
