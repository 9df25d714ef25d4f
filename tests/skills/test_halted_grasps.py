"""Motions after a grasp that was halted while the gripper closed leave the object where it is."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import bt_dualarm as bt

Tree = dict[str, Any]

AT = (0.45, 0.2)
CAN = {"shape": "cylinder", "size": [0.02, 0.09], "mass": 0.06, "pose": {"xyz": [*AT, 0.1453]}}
STAND = {
    "shape": "box",
    "size": [0.16, 0.16, 0.1],
    "fixed": True,
    "pose": {"xyz": [*AT, 0.05]},
}
GRASP: Tree = {"grasp": {"object": "can"}}
AFTERWARDS: dict[str, Tree] = {
    "again": GRASP,
    "home": {"go_home": {}},
    "back": {"move_linear": {"offset": {"xyz": [0, 0, -0.08], "frame": "tool"}}},
}


def opened(robot: str, gripper: str, *nodes: Tree) -> bt.Run:
    """A run of an arm beside a can on a stand."""
    arm = {"robot": robot, "gripper": gripper, "tree": {"sequence": list(nodes)}}
    return bt.open(
        {
            "bt_dualarm": 1,
            "world": {"scene": "empty", "reality": "lab", "time_limit": 60},
            "objects": {"can": CAN, "stand": STAND},
            "arms": {"arm1": arm},
        }
    )


def closing_s(robot: str, gripper: str) -> tuple[float, float]:
    """Simulated times at which a grasp begins to close the gripper, and holds."""
    with opened(robot, gripper, GRASP) as run:
        hand = run.world.grippers["arm1"]
        began = None
        while not run.world.attachments.holders("can"):
            assert not run.done, run.result
            run.step(0.02)
            if began is None and hand.commanded.width <= 0.0:
                began = run.time
        return began or run.time, run.time


@pytest.mark.parametrize("then", AFTERWARDS)
@pytest.mark.parametrize(
    ("robot", "gripper"),
    [
        ("ur10e", "suction_cup"),
        ("fr3", "suction_cup"),
        ("panda", "robotiq_2f85"),
        ("xarm7", "panda_hand"),
    ],
)
def test_motion_after_a_halted_grasp_leaves_the_object(robot: str, gripper: str, then: str) -> None:
    """A cup whose vacuum lasted dragged a can along; fingers that opened had no room for a plan."""
    began, holds = closing_s(robot, gripper)
    for share in (0.3, 0.6, 0.9):
        seconds = round(began + share * (holds - began), 2)
        halted = {"timeout": {"seconds": seconds, "child": GRASP}}
        with opened(robot, gripper, {"selector": [halted, AFTERWARDS[then]]}) as run:
            result = run.finish()
            can = run.world.data.body("can")
            off = float(np.linalg.norm(can.xpos[:2] - AT))
            upright = float(can.xmat[8])
            held = run.world.attachments.holders("can")
        leaves = result.arms["arm1"].runs
        assert result.outcome == "SUCCESS", (seconds, leaves)
        assert upright > 0.999, (seconds, leaves)
        assert held or off < 2e-3, (seconds, leaves)
