"""Grasps of tall objects: the fingers are beside them for the whole straight approach."""

from __future__ import annotations

import numpy as np
import pytest

from bt_dualarm.sim.world import World
from tests.families import some
from tests.plays import Stage

CASES = [
    ("tiago", "robotiq_2f85", 0.85, 0.5),
    ("tiago", "panda_hand", 0.85, 0.5),
    ("ur5e", "robotiq_2f85", 0.5, 0.1),
    ("panda", "panda_hand", 0.5, 0.1),
]


@pytest.mark.parametrize(("robot", "gripper", "ahead", "top"), some(CASES, 3), ids=str)
def test_approach_does_not_push_the_object(
    stage: Stage, robot: str, gripper: str, ahead: float, top: float
) -> None:
    """The can stays in place, upright, until the fingers close on it."""
    play = stage.play(
        {
            "world": {"scene": "empty", "reality": "lab", "time_limit": 20},
            "objects": {
                "bench": {
                    "shape": "box",
                    "size": [0.4, 0.6, top],
                    "mass": 5,
                    "fixed": True,
                    "pose": {"xyz": [ahead, 0, top / 2]},
                },
                "can": {
                    "shape": "cylinder",
                    "size": [0.0274, 0.2229],
                    "mass": 0.3,
                    "pose": {"xyz": [ahead - 0.05, 0, top + 0.112]},
                },
            },
            "arms": {
                "arm1": {
                    "robot": robot,
                    "gripper": gripper,
                    "base": {"xyz": [0, 0, 0]},
                    "tree": {"grasp": {"object": "can"}},
                }
            },
        }
    )
    start = play.world.object_pose("can")
    pushed: list[float] = []

    def record_push(world: World) -> None:
        now = world.object_pose("can")
        if world.grippers["arm1"].commanded.width > 0.0:
            pushed.append(np.hypot(*(now.position - start.position)[:2]) + 0.1 * now.angle(start))

    play.watchers.append(record_push)
    assert play.run().outcome == "SUCCESS", play.leaf("grasp").reason
    assert max(pushed) < 1e-3
