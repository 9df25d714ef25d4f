"""Grasps chosen to suit the pose at which the object will be placed."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

import bt_dualarm as bt
from bt_dualarm.arm.arm import Arm
from bt_dualarm.core.pose import Matrix, Pose
from tests.families import some

SIZE = (0.03, 0.05, 0.06)
GOAL = (0.45, 0.2, 0.03)
WALLS = 0.012  # room beside the object, m: fingers do not fit


def _task(axis: int, robot: str, gripper: str, then_at: dict[str, Any] | None) -> dict[str, Any]:
    """Task to place a block between two walls, which leave no room for fingers along one axis."""
    objects: dict[str, Any] = {
        "block": {
            "shape": "box",
            "size": [*SIZE],
            "mass": 0.1,
            "color": "red",
            "pose": {"xyz": [0.45, -0.2, SIZE[2] / 2]},
        }
    }
    distance = SIZE[axis] / 2 + WALLS + 0.01
    for name, side in (("one", 1.0), ("other", -1.0)):
        xyz = [*GOAL]
        xyz[axis] += side * distance
        size = [0.05, 0.05, 0.06]
        size[axis] = 0.02
        objects[name] = {
            "shape": "box",
            "size": size,
            "mass": 1.0,
            "color": "gray",
            "fixed": True,
            "pose": {"xyz": xyz},
        }
    grasp = {"object": "block"} | ({} if then_at is None else {"then_at": then_at})
    place = {"object": "block", "at": {"xyz": [*GOAL], "rpy": [0, 0, 0]}}
    tree = {"sequence": [{"grasp": grasp}, {"place": place}]}
    arms = {"arm1": {"robot": robot, "gripper": gripper, "tree": tree}}
    world = {"scene": "empty", "time_limit": 60}
    return {"bt_dualarm": 1, "name": "between", "world": world, "objects": objects, "arms": arms}


@pytest.mark.parametrize(
    ("robot", "gripper"), some([("panda", "panda_hand"), ("ur5", "robotiq_2f85")], 2)
)
def test_grasp_leaves_room_for_the_fingers_at_the_goal(robot: str, gripper: str) -> None:
    at = {"xyz": [*GOAL]}
    beside = {"beside": "one", "side": "-y", "by": WALLS}
    planned = [bt.run(_task(axis, robot, gripper, at)) for axis in (0, 1)]
    assert [run.outcome for run in planned] == ["SUCCESS", "SUCCESS"]
    unplanned = (bt.run(_task(axis, robot, gripper, None)) for axis in (1, 0))
    assert any(run.outcome == "FAILURE" for run in unplanned), "these goals suit any grasp"
    relative = bt.run(_task(1, robot, gripper, beside))
    assert relative.outcome == "SUCCESS"


def test_goal_that_no_grasp_allows_is_refused_before_any_motion() -> None:
    result = bt.run(_task(1, "panda", "panda_hand", {"xyz": [1.5, 0.0, GOAL[2]]}))
    (leaf,) = result.arms["arm1"].runs
    assert (leaf.skill, leaf.code) == ("grasp", "OUT_OF_REACH")
    assert "could not be set down at `then_at`" in leaf.reason
    assert leaf.ended_s is not None
    assert leaf.ended_s < 1.5  # it only opens its gripper


def test_hand_without_room_at_the_goal_is_checked_in_one_branch(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Cup in a cup: all branches of 24 rotations of 16 grasps took over a minute."""
    lines = Arm.lines
    branches: list[int] = []

    def counted(self: Arm, *poses: Pose) -> Iterator[list[Matrix]]:
        branches.append(0)
        for rows in lines(self, *poses):
            branches[-1] += 1
            yield rows

    monkeypatch.setattr(Arm, "lines", counted)
    cups = {"outer": ([0.04, 0.08], -0.2), "inner": ([0.03, 0.07], 0.2)}
    objects = {
        name: {"shape": "cup", "size": size, "mass": 0.1, "pose": {"xyz": [0.45, y, size[1] / 2]}}
        for name, (size, y) in cups.items()
    }
    grasp = {
        "object": "inner",
        "approach": [0, 0, -1],
        "then_at": {"on": "outer", "rpy": [0, 0, 0]},
    }
    arm = {"robot": "panda", "gripper": "panda_hand", "tree": {"grasp": grasp}}
    world = {"scene": "empty", "time_limit": 5}
    result = bt.run({"bt_dualarm": 1, "world": world, "objects": objects, "arms": {"arm1": arm}})
    (leaf,) = result.arms["arm1"].runs
    assert leaf.code == "OUT_OF_REACH"
    assert "deep in outer" in leaf.reason
    assert max(branches) == 1


OVEN = {
    "floor": ([0.552, 0.35, 0.038], [0, 0, 0.019]),
    "top": ([0.552, 0.35, 0.031], [0, 0, 0.2835]),
    "back": ([0.552, 0.02, 0.23], [0, 0.165, 0.153]),
    "left": ([0.04, 0.33, 0.23], [-0.256, -0.01, 0.153]),
    "right": ([0.181, 0.33, 0.23], [0.1855, -0.01, 0.153]),
}
"""Sizes and places of the parts of an oven that is open at its front, m."""


@pytest.mark.parametrize("xyz", some([[0.364, -0.286, 0.016], [0.412, -0.391, 0.016]], 2), ids=str)
def test_the_few_free_branches_of_a_redundant_arm_are_found_in_an_oven(xyz: list[float]) -> None:
    """Its elbow has room in a small part of its self-motion: both leaves have to find that."""
    parts = {
        name: {"shape": "box", "size": size, "pose": {"xyz": at}}
        for name, (size, at) in OVEN.items()
    }
    objects = {
        "oven": {"shape": "compound", "mass": 10, "fixed": True, "parts": parts}
        | {"pose": {"xyz": [0.7, 0, 0], "rpy": [0, 0, -90]}},
        "cube": {"shape": "box", "size": [0.032] * 3, "mass": 0.01, "pose": {"xyz": xyz}},
    }
    inside = {"xyz": [0.625, 0.064, 0.054], "rpy": [0, 0, 0]}
    base = {"xyz": [0, -0.05, 0.33], "rpy": [51.2, -10, 26.6]}
    grasp = {"object": "cube", "then_at": inside}
    tree = {"sequence": [{"grasp": grasp}, {"place": {"at": inside}}]}
    arm = {"robot": "fr3", "gripper": "robotiq_2f85", "base": base, "tree": tree}
    world = {"scene": "empty", "time_limit": 60}
    file = {"bt_dualarm": 1, "name": "oven", "world": world, "objects": objects}
    result = bt.run(file | {"arms": {"arm1": arm}})
    assert [leaf.status for leaf in result.arms["arm1"].runs] == ["SUCCESS"] * 2


def _in_a_channel(
    robot: str, gripper: str, yaw: float, heading: float, grasp: dict[str, Any]
) -> dict[str, Any]:
    """Task to set a block down between two walls, between which the hand fits lengthwise only."""
    at = {"xyz": [0.45, 0.12, 0.4255]}
    turn = np.radians(heading)
    objects: dict[str, Any] = {
        "block": {"shape": "box", "size": [0.06, 0.03, 0.05], "mass": 0.1}
        | {"pose": {"xyz": [0.45, -0.3, 0.4255], "rpy": [0, 0, yaw]}},
        "stand": {"shape": "box", "size": [0.4, 1.0, 0.4], "fixed": True}
        | {"pose": {"xyz": [0.5, 0, 0.2]}},
    }
    for name, away in (("one", 0.0425), ("other", -0.0425)):
        x, y = 0.45 - away * np.sin(turn), 0.12 + away * np.cos(turn)
        wall = {"shape": "box", "size": [0.3, 0.01, 0.1], "fixed": True}
        objects[name] = wall | {"pose": {"xyz": [float(x), float(y), 0.45], "rpy": [0, 0, heading]}}
    sequence = [{"grasp": {"object": "block"} | grasp}, {"place": {"at": at}}]
    arm = {"robot": robot, "gripper": gripper, "base": {"xyz": [0, -0.1, 0.4]}}
    return {
        "bt_dualarm": 1,
        "name": "channel",
        "world": {"scene": "empty", "reality": "lab", "time_limit": 60},
        "objects": objects,
        "arms": {"arm1": arm | {"tree": {"sequence": sequence}}},
    }


@pytest.mark.parametrize(
    ("robot", "gripper"),
    some(
        [
            ("panda", "panda_hand"),
            ("ur5e", "robotiq_2f85"),
            ("xarm7", "panda_hand"),
            ("ur10e", "robotiq_2f85"),
        ],
        2,
    ),
)
@pytest.mark.parametrize(("yaw", "heading"), [(0, 40), (30, -35)])
def test_heading_is_left_to_place_where_the_goal_has_no_orientation(
    robot: str, gripper: str, yaw: float, heading: float
) -> None:
    """It was `OUT_OF_REACH`; `place` rotates the block where `grasp` asks for no heading."""
    at = {"xyz": [0.45, 0.12, 0.4255]}
    task = _in_a_channel(robot, gripper, yaw, heading, {"then_at": at})
    leaves = bt.run(task).arms["arm1"].runs
    assert [leaf.status for leaf in leaves] == ["SUCCESS"] * 2, leaves[-1].reason
    oriented = at | {"rpy": [0, 0, yaw]}
    (leaf,) = (
        bt.run(_in_a_channel(robot, gripper, yaw, heading, {"then_at": oriented})).arms["arm1"].runs
    )
    assert leaf.code == "OUT_OF_REACH"
    assert "could not be set down at `then_at`" in leaf.reason


@pytest.mark.parametrize(
    ("robot", "gripper"),
    some(
        [
            ("ur5e", "robotiq_2f85"),
            ("panda", "panda_hand"),
            ("ur10e", "robotiq_2f85"),
            ("xarm7", "panda_hand"),
        ],
        2,
    ),
)
@pytest.mark.parametrize("room", [0.06, 0.015])
def test_goal_below_a_board_is_reached_by_a_grasp_from_the_side(
    robot: str, gripper: str, room: float
) -> None:
    """It was `OUT_OF_REACH`: only grasps from above were tried, and only descents of 50 mm."""
    at = {"xyz": [0.62, 0.1, 0.5855]}
    task = _in_a_channel(robot, gripper, 0, 0, {"object": "can", "then_at": at})
    board = {"shape": "box", "size": [0.2, 0.5, 0.02], "fixed": True}
    task["objects"] = {
        "can": {"shape": "cylinder", "size": [0.025, 0.07], "mass": 0.15}
        | {"pose": {"xyz": [0.5, -0.3, 0.4355]}},
        "stand": {"shape": "box", "size": [0.2, 0.2, 0.4], "fixed": True}
        | {"pose": {"xyz": [0.5, -0.3, 0.2]}},
        "shelf": board | {"pose": {"xyz": [0.66, 0.1, 0.54]}},
        "above": board | {"pose": {"xyz": [0.66, 0.1, 0.63 + room]}},
    }
    task["arms"]["arm1"]["base"] = {"xyz": [0, 0, 0.4]}
    task["arms"]["arm1"]["tree"]["sequence"][1]["place"]["at"] = at
    leaves = bt.run(task).arms["arm1"].runs
    assert [leaf.status for leaf in leaves] == ["SUCCESS"] * 2, leaves[-1].reason


@pytest.mark.parametrize(("yaw", "heading"), [(0, 20), (-60, -15)])
def test_fingers_need_not_open_fully_at_the_goal(yaw: float, heading: float) -> None:
    """It was `OUT_OF_REACH`: `place` opens them only as wide as the bin allows."""
    at = {"on": "crate"}
    task = _in_a_channel("ur5e", "robotiq_2f85", yaw, 0, {"then_at": at})
    del task["objects"]["one"], task["objects"]["other"]
    task["objects"]["crate"] = {
        "shape": "bin", "size": [0.12, 0.07, 0.04], "wall": 0.004, "mass": 0.3, "fixed": True,
        "pose": {"xyz": [0.45, 0.05, 0.4205], "rpy": [0, 0, heading]},
    }  # fmt: skip
    task["arms"]["arm1"]["tree"]["sequence"][1]["place"]["at"] = at
    leaves = bt.run(task).arms["arm1"].runs
    assert [leaf.status for leaf in leaves] == ["SUCCESS"] * 2, leaves[-1].reason


def test_redundant_arm_places_in_the_branch_for_which_it_chose_the_grasp() -> None:
    """It was `IN_COLLISION`: of its endless branches, 16 near the set-point were tried, in vain."""
    at = {"xyz": [0.162, -0.32, 0.149], "rpy": [0, 0, 25]}
    stand: dict[str, Any] = {"shape": "box", "fixed": True}
    task = {
        "bt_dualarm": 1,
        "world": {"scene": "empty", "reality": "rough", "seed": 110, "time_limit": 60},
        "objects": {
            "from": stand | {"size": [0.16, 0.16, 0.262], "pose": {"xyz": [-0.182, -0.316, 0.131]}},
            "onto": stand | {"size": [0.16, 0.16, 0.119], "pose": {"xyz": [0.162, -0.32, 0.0595]}},
            "board": stand | {"size": [0.4, 0.4, 0.02], "pose": {"xyz": [0.162, -0.32, 0.256]}},
            "part": {"shape": "box", "size": [0.042, 0.055, 0.059], "mass": 0.458, "color": "red"}
            | {"pose": {"xyz": [-0.182, -0.316, 0.292], "rpy": [0, 0, -27]}},
        },
        "arms": {
            "a": {
                "robot": "xarm7",
                "gripper": "panda_hand",
                "tree": {
                    "sequence": [
                        {"grasp": {"object": "part", "then_at": at}},
                        {"place": {"object": "part", "at": at}},
                    ]
                },
            }
        },
    }
    leaves = bt.run(task).arms["a"].runs
    assert [leaf.status for leaf in leaves] == ["SUCCESS"] * 2, leaves[-1].reason


@pytest.mark.parametrize("gripper", ["robotiq_2f85", "panda_hand", "suction_cup"])
def test_goal_at_which_the_object_has_no_room_is_refused_before_it_is_grasped(gripper: str) -> None:
    """The can would stand in a post: `place` failed after the arm had carried it there."""
    at = {"xyz": [0.62, 0.1, 0.0355]}
    task = _in_a_channel("ur5e", gripper, 0, 0, {"object": "can", "then_at": at})
    post = {"shape": "box", "size": [0.06, 0.06, 0.2], "fixed": True}
    task["objects"] = {
        "can": {"shape": "cylinder", "size": [0.025, 0.07], "mass": 0.15}
        | {"pose": {"xyz": [0.5, -0.3, 0.0355]}},
        "post": post | {"pose": {"xyz": [0.67, 0.1, 0.1]}},
    }
    task["arms"]["arm1"]["base"] = {"xyz": [0, 0, 0]}
    (leaf,) = bt.run(task).arms["arm1"].runs
    assert leaf.code == "OUT_OF_REACH"
    assert "'can' could not be set down at `then_at`: can would be" in leaf.reason
    assert "deep in post" in leaf.reason
