"""Placing follows one branch of the inverse kinematics, from above the goal to out of the way."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import bt_dualarm as bt
from bt_dualarm.behaviors.report import LeafReport
from tests.families import some


def placed(robot: str, gripper: str, objects: dict[str, Any], *leaves: Any) -> LeafReport:
    """The last leaf of a run of an arm beside the table."""
    arm = {"robot": robot, "gripper": gripper, "base": {"xyz": [0, 0, 0.4]}}
    result = bt.run(
        {
            "bt_dualarm": 1,
            "name": "placing",
            "world": {"scene": "table", "reality": "lab", "seed": 0, "time_limit": 60},
            "objects": objects,
            "arms": {"arm1": arm | {"tree": {"sequence": list(leaves)}}},
        }
    )
    return result.arms["arm1"].runs[-1]


def board(x: float, y: float, z: float) -> dict[str, Any]:
    """A fixed board, its middle there."""
    pose = {"xyz": [x, y, z]}
    return {"shape": "box", "size": [0.25, 0.25, 0.02], "mass": 5, "fixed": True, "pose": pose}


def in_shelf(yaw: float, obj: dict[str, Any]) -> LeafReport:
    """A Panda's `place` in a shelf, of what it has taken from the side, turned by a yaw, °."""
    return placed(
        "panda",
        "panda_hand",
        {
            "thing": obj | {"pose": {"xyz": [0.40, -0.40, 0.45]}},
            "low": board(0.55, 0.1, 0.55),
            "high": board(0.55, 0.1, 0.83),
        },
        {"grasp": {"object": "thing", "approach": [0, -1, 0]}},
        {"transport": {"object": "thing", "to": {"xyz": [0.40, -0.2, 0.70]}}},
        {"place": {"object": "thing", "at": {"xyz": [0.55, 0.1, 0.61], "rpy": [0, 0, yaw]}}},
    )


@pytest.mark.parametrize("yaw", some([45, 105, 90], 2))
def test_a_panda_places_sideways_into_a_shelf_after_carrying(yaw: float) -> None:
    """It failed: the line down began 13.7° from where the arm was, in another posture.

    At 90° 50 mm above are out of reach, and not the goal.
    """
    leaf = in_shelf(yaw, {"shape": "cylinder", "size": [0.025, 0.10], "mass": 0.3})
    assert (leaf.skill, leaf.status) == ("place", "SUCCESS"), leaf.reason
    assert float(leaf.metrics["placed_error_m"]) < 2e-3
    assert "spun_rad" not in leaf.metrics
    assert ("lowered_from_m" in leaf.metrics) == (yaw == 90)


def test_what_is_round_is_turned_where_that_makes_its_goal_reachable() -> None:
    """As it was asked for, the arm gets there from no height; nobody sees the turn.

    The way back out is as long as was found to be free before, though the arm first comes off by
    3 mm: here 3 mm more are singular.
    """
    leaf = in_shelf(-135, {"shape": "cylinder", "size": [0.025, 0.10], "mass": 0.3})
    assert (leaf.skill, leaf.status) == ("place", "SUCCESS"), leaf.reason
    assert abs(float(leaf.metrics["spun_rad"])) == pytest.approx(np.radians(15))
    assert float(leaf.metrics["placed_error_m"]) < 2e-3


def test_a_box_is_turned_into_itself_only() -> None:
    """A quarter turn of a square base shows no difference; 15° would."""
    leaf = in_shelf(-45, {"shape": "box", "size": [0.05, 0.05, 0.10], "mass": 0.3})
    assert (leaf.skill, leaf.status) == ("place", "SUCCESS"), leaf.reason
    turned = abs(float(leaf.metrics["spun_rad"]))
    assert min(abs(turned - np.pi / 2), abs(turned - np.pi)) < 1e-9
    assert float(leaf.metrics["placed_turned_rad"]) < np.radians(1.0)


def test_what_would_look_otherwise_is_not_turned() -> None:
    """The marker on the box would be elsewhere than was asked for."""
    marked = {"shape": "box", "size": [0.05, 0.05, 0.10], "mass": 0.3}
    leaf = in_shelf(-45, marked | {"marker": {"id": 1, "size": 0.03}})
    assert (leaf.skill, leaf.code) == ("place", "SINGULAR"), leaf.reason
    assert "impact_n" not in leaf.metrics, "before it moves"


@pytest.mark.parametrize(
    ("robot", "gripper", "room", "x"),
    some([("ur10", "robotiq_2f85", 0.03, 0.60), ("xarm7", "panda_hand", 0.02, 0.48)], 2),
)
def test_under_a_board_the_way_down_begins_lower(
    robot: str, gripper: str, room: float, x: float
) -> None:
    """So much room is above it there, less than the 50 mm from which it is lowered elsewhere."""
    leaf = placed(
        robot,
        gripper,
        {
            "brick": {"shape": "box", "size": [0.04, 0.04, 0.10], "mass": 0.2}
            | {"pose": {"xyz": [0.40, -0.40, 0.4505]}},
            "low": board(x + 0.07, 0.1, 0.55),
            "high": board(x + 0.07, 0.1, 0.66 + room + 0.01),
        },
        {"grasp": {"object": "brick", "approach": [1, 0, 0]}},
        {"place": {"object": "brick", "at": {"xyz": [x, 0.1, 0.61], "rpy": [0, 0, 0]}}},
    )
    assert (leaf.skill, leaf.status) == ("place", "SUCCESS"), leaf.reason
    assert 0.008 <= float(leaf.metrics["lowered_from_m"]) < room
    assert float(leaf.metrics["placed_error_m"]) < 2e-3


def test_a_stretched_arm_lowers_as_slowly_as_it_has_to() -> None:
    """Far out, 2 mm/s are less than a thousandth of the UR10's limits: that was an exception."""
    leaf = placed(
        "ur10",
        "robotiq_2f85",
        {
            "cube": {"shape": "box", "size": [0.05, 0.05, 0.05], "mass": 0.2}
            | {"pose": {"xyz": [0.60, -0.40, 0.425]}},
            "shelf": board(0.95, -0.3, 0.39),
        },
        {"grasp": {"object": "cube"}},
        {"place": {"object": "cube", "at": {"xyz": [0.90, -0.3, 0.425]}}},
    )
    assert (leaf.skill, leaf.status) == ("place", "SUCCESS"), leaf.reason
    assert float(leaf.metrics["impact_n"]) < 15.0


@pytest.mark.parametrize(("angle", "code"), [(15, "NOT_SUPPORTED"), (45, "IN_COLLISION")])
def test_why_it_cannot_be_placed_is_said_of_what_is_held_askew(angle: float, code: str) -> None:
    """Without an orientation the goal is that of the hand, which has turned since the grasp."""
    box = {"shape": "box", "size": [0.06, 0.06, 0.06], "mass": 0.2}
    leaf = placed(
        "ur5",
        "robotiq_2f85",
        {"thing": box | {"pose": {"xyz": [0.40, -0.45, 0.43]}}},
        {"grasp": {"object": "thing"}},
        {"rotate_tool": {"axis": "x", "angle": angle}},
        {"place": {"at": {"xyz": [0.35, -0.45, 0.43]}}},
    )
    assert leaf.code == code, leaf
    assert "no orientation" in leaf.reason
    assert f"{angle}° from upright" in leaf.reason
