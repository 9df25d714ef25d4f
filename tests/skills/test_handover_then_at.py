"""Handovers after which the taker can place the object at its goal."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import bt_dualarm as bt
from tests.families import some

START: dict[str, Any] = {"xyz": [0.2, -0.4, 0.0161]}
GOAL: dict[str, Any] = {"xyz": [-0.2, 0.4, 0.026], "rpy": [180, 0, 0]}
HAMMER: dict[str, Any] = {
    "shape": "compound",
    "mass": 0.15,
    "friction": 2,
    "pose": START,
    "parts": {
        "handle": {"shape": "box", "size": [0.2, 0.032, 0.032]},
        "head": {"shape": "box", "size": [0.036, 0.072, 0.03], "pose": {"xyz": [0.118, 0, 0]}},
    },
}
BIN = {"shape": "bin", "size": [0.34, 0.3, 0.15], "wall": 0.01, "mass": 1, "fixed": True}


def _file(yaw: float, then_at: dict[str, Any] | None) -> dict[str, Any]:
    """Two arms that face each other: one hands a hammer over, the other puts it into a deep bin."""
    hammer = HAMMER | {"pose": START | {"rpy": [0, 0, yaw]}}
    bin_ = BIN | {"pose": {"xyz": [*GOAL["xyz"][:2], 0.075]}}
    take = {"object": "hammer", "from": "arm2"} | ({} if then_at is None else {"then_at": then_at})
    grasp = {"grasp": {"object": "hammer", "part": "handle"}}
    trees = (
        {"sequence": [{"take_over": take}, {"place": {"at": GOAL}}]},
        {"sequence": [grasp, {"hand_over": {"object": "hammer", "to": "arm1"}}, {"go_home": {}}]},
    )
    bases = ({"xyz": [0, 0.75, 0], "rpy": [0, 0, -90]}, {"xyz": [0, -0.75, 0], "rpy": [0, 0, 90]})
    arms = {
        f"arm{i + 1}": {"robot": "panda", "gripper": "panda_hand", "base": bases[i]}
        | {"tree": trees[i]}
        for i in range(2)
    }
    objects = {"hammer": hammer, "bin": bin_}
    world = {"scene": "empty", "time_limit": 60}
    return {"bt_dualarm": 1, "name": "into", "world": world, "objects": objects, "arms": arms}


@pytest.mark.parametrize("yaw", some([0.0, 40.0, 90.0, 130.0, 180.0, 240.0, 290.0], 7))
def test_taker_can_place_the_object(yaw: float) -> None:
    result = bt.run(_file(yaw, GOAL))
    assert [(one.skill, one.code) for one in result.arms["arm1"].runs] == [
        ("take_over", ""),
        ("place", ""),
    ]


def test_goal_that_no_grasp_allows_is_refused() -> None:
    (leaf,) = bt.run(_file(0.0, GOAL | {"xyz": [2.0, 0.4, 0.026]})).arms["arm1"].runs
    assert leaf.code == "OUT_OF_REACH"
    assert "`then_at`" in leaf.reason


def test_goal_needs_an_orientation() -> None:
    with pytest.raises(bt.SpecError, match="then_at needs an orientation"):
        bt.run(_file(0.0, {"xyz": GOAL["xyz"]}))


def test_hands_that_come_from_the_same_side_meet_where_the_taker_can_reach() -> None:
    """The taker needs a grasp from above, as the giver has: it could not face that.

    Most poses turn the giver's hand toward the taker, whose own hand would have to point back to
    its base: these are left out, instead of using up all attempts.
    """
    size = {"handle": [0.12, 0.03, 0.03], "head": [0.03, 0.05, 0.03]}
    parts: dict[str, Any] = {name: {"shape": "box", "size": edges} for name, edges in size.items()}
    parts["head"] |= {"pose": {"xyz": [0.075, 0, 0]}}
    pose = {"xyz": [-0.16, -0.33, 0.0152], "rpy": [0, 0, 82]}
    hammer = {"shape": "compound", "mass": 0.15, "friction": 3, "parts": parts, "pose": pose}
    bin_ = {"shape": "bin", "size": [0.3, 0.3, 0.1], "wall": 0.01, "fixed": True}
    bin_["pose"] = {"xyz": [-0.17, 0.28, 0.05]}
    pose = {"on": "bin", "rpy": [0, 0, 0]}
    head = {"object": "hammer", "part": "head", "approach": [0, 0, -1]}
    trees = (
        {"take_over": {"object": "hammer", "from": "arm2", "then_at": pose}},
        {"sequence": [{"grasp": head}, {"hand_over": {"object": "hammer", "to": "arm1"}}]},
    )
    bases = ({"xyz": [0, 0.6, 0], "rpy": [0, 0, -90]}, {"xyz": [0, -0.6, 0], "rpy": [0, 0, 90]})
    arms = {
        f"arm{i + 1}": {"robot": "xarm7", "gripper": "robotiq_2f85", "base": bases[i]}
        | {"tree": trees[i]}
        for i in range(2)
    }
    result = bt.run(
        {
            "bt_dualarm": 1,
            "name": "same_side",
            "world": {"scene": "empty", "time_limit": 60},
            "objects": {"hammer": hammer, "bin": bin_},
            "arms": arms,
        }
    )
    (taken,) = result.arms["arm1"].runs
    assert taken.status == "SUCCESS", taken.reason


BESIDE_A_STAND = """
bt_dualarm: 1
world: {scene: empty, reality: rough, seed: 2014, time_limit: 60}
objects:
  stand:
    shape: box
    size: [0.12, 0.12, 0.21]
    fixed: true
    pose: {xyz: [0.534, 0.194, 0.105]}
  bar:
    shape: cylinder
    size: [0.0219, 0.176]
    mass: 0.159
    pose: {xyz: [0.534, 0.194, 0.2985], rpy: [0, 0, 145]}
arms:
  a:
    robot: jaco2
    gripper: robotiq_2f85
    base: {xyz: [0, 0, 0.21], rpy: [0, 0, -1]}
    tree: {sequence: [grasp: {object: bar}, hand_over: {object: bar, to: b, speed: 0.3}]}
  b:
    robot: xarm7
    gripper: robotiq_2f85
    base: {xyz: [1.026, 0, 0.21], rpy: [0, 0, 206]}
    tree:
      take_over:
        object: bar
        from: a
        speed: 0.7
        then_at: {xyz: [0.731, -0.317, 0.298], rpy: [0, 0, -137]}
"""


def test_taker_does_not_lower_the_object_onto_something_to_lift_it() -> None:
    """Up was the giver's hand, and 30 mm down the bar met a stand: TRACKING_ERROR, with 38 N."""
    result = bt.run(BESIDE_A_STAND)
    (leaf,) = result.arms["b"].runs
    assert leaf.status == "SUCCESS", leaf.reason


@pytest.mark.parametrize(
    ("giver", "taker"),
    some([("panda", "ur5e"), ("fr3", "xarm7"), ("ur10e", "ur5"), ("ur5e", "panda")], 2),
)
@pytest.mark.parametrize("is_told", [False, True])
@pytest.mark.parametrize("shape", ["cylinder", "box"])
def test_short_object_is_turned_over_to_be_set_down(
    giver: str, taker: str, shape: str, *, is_told: bool
) -> None:
    """The giver holds it from above, so that the taker gets its lower end: IN_COLLISION."""
    at = {"xyz": [1.0, -0.45, 0.3855], "rpy": [0, 0, 0]}
    size = [0.025, 0.07] if shape == "cylinder" else [0.03, 0.04, 0.07]
    fixed = {"shape": "box", "fixed": True}
    objects = {
        "can": {"shape": shape, "size": size, "mass": 0.15, "pose": {"xyz": [0.4, 0.35, 0.2355]}},
        "stand": fixed | {"size": [0.2, 0.2, 0.2], "pose": {"xyz": [0.4, 0.35, 0.1]}},
        "shelf": fixed | {"size": [0.3, 0.22, 0.02], "pose": {"xyz": [1.0, -0.5, 0.34]}},
    }
    give = [{"grasp": {"object": "can"}}, {"hand_over": {"object": "can", "to": "b"}}, "go_home"]
    take = {"object": "can", "from": "a"} | ({"then_at": at} if is_told else {})
    arms: dict[str, Any] = {
        "a": {"robot": giver, "base": {"xyz": [0, 0, 0]}, "tree": {"sequence": give}},
        "b": {"robot": taker, "base": {"xyz": [1.1, 0, 0], "rpy": [0, 0, 180]}}
        | {"tree": {"sequence": [{"take_over": take}, {"place": {"at": at}}]}},
    }
    for arm in arms.values():
        arm["gripper"] = "robotiq_2f85" if arm["robot"].startswith("ur") else "panda_hand"
    world = {"scene": "empty", "reality": "lab", "time_limit": 90}
    file = {"bt_dualarm": 1, "name": "over", "world": world, "objects": objects, "arms": arms}
    leaves = bt.run(file).arms["b"].runs
    assert [leaf.code for leaf in leaves] == ["", ""], leaves[-1].reason
    assert leaves[-1].metrics["spun_rad"] == pytest.approx(np.pi)
