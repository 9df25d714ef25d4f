"""Between neighboring objects, fingers open only as far as the object needs."""

from __future__ import annotations

from typing import Any

import pytest

from tests.families import WHOLE, some
from tests.plays import Stage
from tests.skills.scenarios import CUBE, WALL, Scenario, Tree

AT = (0.40, -0.40)
TOP = 0.4
GRASP: Tree = {"grasp": {"object": "cube"}}


def between(gap: float, robot: str, gripper: str, *leaves: Tree) -> Tree:
    """A cube of 40 mm with a wall at a gap of `gap` m from each of its sides."""
    offset = 0.02 + gap + 0.01
    walls: dict[str, Any] = {
        name: WALL
        | {"spawned": True, "size": [*size, 0.06]}
        | {"pose": {"xyz": [AT[0] + x, AT[1] + y, TOP + 0.03]}}
        for name, x, y, size in (
            ("front", offset, 0.0, (0.02, 0.2)),
            ("back", -offset, 0.0, (0.02, 0.2)),
            ("left", 0.0, offset, (0.03, 0.02)),
            ("right", 0.0, -offset, (0.03, 0.02)),
        )
    }
    cube = CUBE | {"size": [0.04] * 3, "pose": {"xyz": [*AT, TOP + 0.02]}}
    arm = {"robot": robot, "gripper": gripper, "base": {"xyz": [0, 0, TOP]}}
    scenario = Scenario(walls | {"cube": cube}, arm=arm, scene="table")
    return scenario.file({"sequence": list(leaves or (GRASP,))})


PAIRS = [
    ("ur5", "robotiq_2f85", 0.034),
    ("xarm7", "robotiq_2f85", 0.034),
    ("panda", "panda_hand", 0.034),
    ("fr3", "panda_hand", 0.045),
]


@pytest.mark.parametrize(("robot", "gripper", "gap"), some(PAIRS, 2))
def test_fingers_open_half_between_near_walls(
    robot: str, gripper: str, gap: float, stage: Stage
) -> None:
    leaf = stage.run(between(gap, robot, gripper)).leaf("grasp")
    assert leaf.status == "SUCCESS", leaf.reason
    assert leaf.metrics["opening_m"] == pytest.approx(0.052)
    assert leaf.metrics["lifted_m"] > 0.03


def test_fingers_open_fully_where_there_is_room(stage: Stage) -> None:
    leaf = stage.run(between(0.06, "ur5", "robotiq_2f85")).leaf("grasp")
    assert leaf.status == "SUCCESS", leaf.reason
    assert "opening_m" not in leaf.metrics


@pytest.mark.parametrize(
    ("gap", "ports"), [(0.015, {}), (0.028, {"open_to": 0.08}), (0.028, {"most_force": 1.0})]
)
def test_failure_reports_the_reason_for_fully_open_fingers(
    gap: float, ports: dict[str, float], stage: Stage
) -> None:
    """Walls too near for half-open fingers, a given opening, and a reason other than the walls."""
    grasp = {"grasp": {"object": "cube", **ports}}
    leaf = stage.run(between(gap, "ur5", "robotiq_2f85", grasp)).leaf("grasp")
    assert leaf.code == ("INVALID_TARGET" if "most_force" in ports else "OUT_OF_REACH")
    assert "opening_m" not in leaf.metrics
    if "most_force" not in ports:
        assert "no room around 'cube'" in leaf.reason


def test_object_is_grasped_and_placed_between_near_walls(stage: Stage) -> None:
    """The half-open fingers also have room to release the object there."""
    here = {"place": {"object": "cube", "at": {"xyz": [*AT, TOP + 0.02]}}}
    play = stage.run(between(0.034, "ur5", "robotiq_2f85", GRASP, here))
    assert play.leaf("grasp").metrics["opening_m"] == pytest.approx(0.052)
    assert play.leaf("place").status == "SUCCESS", play.leaf("place").reason


@pytest.mark.skipif(not WHOLE, reason="one minute of waiting takes 10 s of CPU")
def test_blocking_arm_is_waited_for_only_once(stage: Stage) -> None:
    """Half-open fingers would have no room beside the other arm either."""
    stays = [
        {"reach_to_pose": {"to": {"xyz": [*AT, TOP + 0.14], "rpy": [180, 0, 0]}}},
        {"wait": {"seconds": 100.0}},
    ]
    file = between(0.06, "ur5", "robotiq_2f85", {"wait": {"seconds": 4.0}}, GRASP)
    file["world"]["time_limit"] = 110.0
    base = {"xyz": [1.0, -0.5, TOP], "rpy": [0, 0, 180]}
    file["arms"]["arm2"] = {"robot": "ur5", "base": base, "tree": {"sequence": stays}}
    leaf = stage.run(file).leaf("grasp")
    assert leaf.code == "OUT_OF_REACH"
    assert "arm2" in leaf.reason
    assert (leaf.ended_s or 0.0) - leaf.started_s < 70.0
