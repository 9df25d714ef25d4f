"""Several arms hold objects at the same time; each object moves with its own gripper."""

from __future__ import annotations

from typing import Any

import bt_dualarm

PLACES = {"left": 0.0, "middle": 1.6, "right": 3.2}
GRIPPERS = {"left": "robotiq_2f85", "middle": "suction_cup", "right": "panda_hand"}


def _lift(arm: str) -> dict[str, Any]:
    return {
        "sequence": [
            {"grasp": {"object": f"cube_{arm}"}},
            {"reach_to_pose": {"offset": {"xyz": [0, 0.1, 0.1]}}},
            {"holding": {"object": f"cube_{arm}"}},
        ]
    }


def test_three_arms_lift_their_own_objects() -> None:
    file = {
        "bt_dualarm": 1,
        "name": "at_once",
        "world": {"scene": "empty", "time_limit": 20},
        "objects": {
            f"cube_{arm}": {
                "shape": "box",
                "size": [0.04, 0.04, 0.04],
                "mass": 0.2,
                "pose": {"xyz": [0.45, y, 0.02]},
            }
            for arm, y in PLACES.items()
        },
        "arms": {
            arm: {
                "robot": "ur5",
                "gripper": GRIPPERS[arm],
                "base": {"xyz": [0, y, 0]},
                "tree": _lift(arm),
            }
            for arm, y in PLACES.items()
        },
    }
    with bt_dualarm.open(file) as run:
        assert run.finish().outcome == "SUCCESS", run.result.arms
        for arm, y in PLACES.items():
            x_now, y_now, z_now = run.world.object_pose(f"cube_{arm}").position
            assert abs(x_now - 0.45) < 2e-3
            assert abs(y_now - (y + 0.1)) < 2e-3
            assert abs(z_now - 0.16) < 2e-3
