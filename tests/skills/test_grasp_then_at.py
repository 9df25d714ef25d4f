"""Grasps chosen to suit the pose at which the object will be placed."""

from __future__ import annotations

from typing import Any

import pytest

import bt_dualarm as bt
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
    place = {"object": "block", "at": {"xyz": [*GOAL]}}
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
