"""Grasps of unnamed objects, by pose and width alone."""

from __future__ import annotations

from typing import Any

import pytest

import bt_dualarm as bt

AT = {"xyz": [0.40, -0.45, 0.425]}
TAKE = {"grasp": {"at": AT, "width": 0.05}}
CARRY = {"transport": {"to": {"xyz": [0.30, -0.45, 0.60]}}}
PUT = {"place": {"at": {"xyz": [0.25, -0.50, 0.425]}}}


def task(*leaves: dict[str, Any], gripper: str = "robotiq_2f85", **cube: Any) -> dict[str, Any]:
    obj = {"shape": "box", "size": [0.05, 0.05, 0.05], "mass": 0.3, "pose": AT} | cube
    return {
        "bt_dualarm": 1,
        "name": "unnamed",
        "world": {"scene": "table", "reality": "lab", "time_limit": 60},
        "objects": {"cube": obj},
        "arms": {
            "arm1": {
                "robot": "ur5",
                "gripper": gripper,
                "base": {"xyz": [0, 0, 0.4]},
                "tree": {"sequence": list(leaves)},
            }
        },
    }


@pytest.mark.parametrize("gripper", ["robotiq_2f85", "suction_cup"])
def test_unnamed_object_is_grasped_carried_and_placed(gripper: str) -> None:
    """It is 2 mm beside the given pose, and rotated: the fingers center it."""
    beside = {"xyz": [0.401, -0.4483, 0.425], "rpy": [0, 0, 2]}
    result = bt.run(task(TAKE, CARRY, PUT, gripper=gripper, pose=beside))
    leaves = result.arms["arm1"].leaves
    assert result.outcome == "SUCCESS"
    assert float(leaves["sequence/grasp"].metrics["lifted_m"]) > 0.035
    assert float(leaves["sequence/place"].metrics["placed_error_m"]) < 0.004


def failure(*leaves: dict[str, Any], **cube: Any) -> tuple[str, str]:
    """Code and reason of the last leaf of a run that fails."""
    result = bt.run(task(*leaves, **cube))
    assert result.outcome == "FAILURE"
    last = [leaf for leaf in result.arms["arm1"].leaves.values() if leaf.status == "FAILURE"][-1]
    return last.code, last.reason


def test_grasp_of_nothing_fails() -> None:
    code, reason = failure(TAKE, pose={"xyz": [0.20, -0.55, 0.425]})
    assert (code, reason) == ("NOT_GRASPED", "the gripper closed on something else or nothing")


def test_object_of_another_width_is_not_grasped() -> None:
    assert failure(TAKE, size=[0.05, 0.03, 0.05])[0] == "NOT_GRASPED"


def test_infeasible_measures_are_refused_before_any_motion() -> None:
    wide = failure({"grasp": {"at": AT, "width": 0.09}})
    assert wide == ("TOO_WIDE", "the object at this pose is 90 mm wide; the fingers open to 85 mm")
    heavy = failure({"grasp": {"at": AT, "width": 0.05, "mass": 8.0}})
    assert heavy == ("TOO_HEAVY", "the object at this pose weighs 8 kg; robotiq_2f85 may hold 5 kg")
    frail = failure({"grasp": {"at": AT, "width": 0.05, "most_force": 5.0}})
    assert frail[0] == "INVALID_TARGET"


def test_transport_and_place_need_a_held_object() -> None:
    assert failure(CARRY) == ("NOT_ATTACHED", "arm1 holds nothing to carry")
    assert failure(PUT) == ("NOT_HELD", "arm1 does not hold anything")


@pytest.mark.parametrize(
    ("ports", "message"),
    [
        ({}, "grasp: give exactly one of: object, width; none is given"),
        ({"width": 0.05}, "grasp: 'width' goes with 'at', which is missing"),
        ({"object": "cube", "height": 0.05}, "grasp: 'height' goes with 'width', which is missing"),
    ],
)
def test_missing_port_is_reported(ports: dict[str, Any], message: str) -> None:
    (problem,) = bt.check(task({"grasp": ports}))
    assert problem.message == message
