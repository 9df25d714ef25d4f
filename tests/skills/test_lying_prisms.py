"""Prisms that lie on a side are grasped at their edges if no two faces are vertical."""

from __future__ import annotations

import math
from typing import Any

import pytest

import bt_dualarm as bt
from bt_dualarm.core.pose import Pose
from tests.families import some

HANDS = {"ur5e": "robotiq_2f85", "panda": "panda_hand"}


def lying(sides: int, yaw: float) -> list[float]:
    """Orientation of a prism that height on a side, as a quaternion, w first."""
    on_side = Pose.from_rpy((0, 0, 0), (0, math.pi / 2, math.radians(yaw)))
    turned = Pose.from_rpy((0, 0, 0), (0, 0, -math.pi / sides))
    return [float(one) for one in (on_side @ turned).quaternion]


@pytest.mark.parametrize(
    ("sides", "radius", "robot"),
    some(
        [
            (sides, radius, robot)
            for sides in (6, 10, 7)
            for radius in (0.0196, 0.025)
            for robot in HANDS
        ],
        4,
    ),
)
def test_lying_prism_does_not_slip_during_motions(sides: int, radius: float, robot: str) -> None:
    """Its true pose matches the estimate after the hand moves and rotates."""
    height = 0.2 + radius * math.cos(math.pi / sides) + 2e-4
    peg: dict[str, Any] = {"shape": "prism", "size": [radius, 0.1], "sides": sides, "mass": 0.2}
    peg |= {"friction": 1.0, "pose": {"xyz": [0.45, 0.05, height], "quat": lying(sides, 30)}}
    table = {"shape": "box", "size": [0.6, 0.6, 0.2], "fixed": True}
    leaves = [
        {"grasp": {"object": "peg"}},
        {"move_linear": {"offset": {"xyz": [0, 0.1, 0.1]}, "speed": 1.0}},
        {"rotate_tool": {"axis": "y", "angle": 30}},
    ]
    file = {
        "bt_dualarm": 1,
        "name": "prism",
        "world": {"scene": "empty", "time_limit": 30, "reality": "lab"},
        "objects": {"peg": peg, "table": table | {"pose": {"xyz": [0.45, 0, 0.1]}}},
        "arms": {
            "arm1": {"robot": robot, "gripper": HANDS[robot], "tree": {"sequence": leaves}},
        },
    }
    with bt.open(file) as run:
        result = run.finish()
        world = run.world
        held = world.attachments.find("arm1", "peg")
        assert result.outcome == "SUCCESS", result.arms["arm1"].runs[-1].reason
        assert held is not None
        estimated = world.arms["arm1"].tool_pose @ world.robots["arm1"].tool.inverse @ held.relative
        assert world.object_pose("peg").distance(estimated) < 2e-3
        assert world.object_pose("peg").angle(estimated) < math.radians(3.0)
