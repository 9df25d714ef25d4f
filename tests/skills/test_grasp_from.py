"""Grasps with an approach direction that the tree prescribes."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import bt_dualarm as bt
from tests.plays import Stage
from tests.skills.test_unnamed_objects import failure, task

TALL: dict[str, Any] = {"size": [0.04, 0.04, 0.20], "pose": {"xyz": [0.40, -0.45, 0.50]}}


@pytest.mark.parametrize("approach", [[0, 0, -2], [0, -1, 0]])
def test_gripper_approaches_along_the_requested_direction(approach: list[float]) -> None:
    tree = {"grasp": {"object": "cube", "approach": approach}}
    with bt.open(task(tree, **TALL)) as run:
        result = run.finish()
        along = run.world.arms["arm1"].tool_pose.rotation_matrix[:, 2]
    assert result.outcome == "SUCCESS"
    expected = np.array(approach) / np.linalg.norm(approach)
    assert along @ expected > np.cos(np.radians(30.0))


def failure_of(**ports: Any) -> tuple[str, str]:
    return failure({"grasp": {"object": "cube"} | ports}, **TALL)


def test_impossible_approach_is_refused_before_any_motion() -> None:
    """From below the table blocks the approach."""
    assert failure_of(approach=[0, 0, 1])[0] == "OUT_OF_REACH"
    flat = failure(
        {"grasp": {"object": "cube", "approach": [0, 0, -1]}},
        size=[0.2, 0.2, 0.04],
        pose={"xyz": [0.40, -0.45, 0.42]},
    )
    assert flat[0] == "OUT_OF_REACH"
    assert "no grasp of 'cube' within 30° of `approach` is possible; " in flat[1]


def test_object_too_heavy_for_the_requested_grasps_fails_with_too_heavy() -> None:
    """The hand can grasp the beam at its end, but such a grasp does not bear its weight."""
    code, reason = failure(
        {"grasp": {"object": "cube", "approach": [1, 0, 0]}},
        size=[0.3, 0.05, 0.05],
        mass=4.0,
        pose={"xyz": [0.40, -0.45, 0.425]},
    )
    assert code == "TOO_HEAVY", reason
    assert "no grasp of 'cube' within 30° of `approach` bears 4 kg; " in reason


def test_obstacle_that_leaves_no_room_for_the_gripper_is_named() -> None:
    """The tube is named, not the post that is far enough away, and how many grasps have room."""
    file = task({"grasp": {"object": "cube", "approach": [0, -1, 0]}}, **TALL)
    fixed = {"mass": 1, "fixed": True}
    file["objects"] |= {
        "post": fixed
        | {"shape": "box", "size": [0.02, 0.02, 0.3], "pose": {"xyz": [0.55, -0.45, 0.55]}},
        "tube": fixed
        | {"shape": "tube", "size": [0.08, 0.2], "wall": 0.01, "pose": {"xyz": [0.40, -0.45, 0.5]}},
    }
    with bt.open(file) as run:
        (leaf,) = [one for one in run.finish().arms["arm1"].runs if one.skill == "grasp"]
    assert leaf.code == "OUT_OF_REACH"
    assert leaf.reason.startswith("no grasp of 'cube' within 30° of `approach` has room: tube is")
    assert leaf.reason.endswith(f"; {leaf.metrics['other_grasps']:g} others have")


@pytest.mark.parametrize("seed", [0, 3])
def test_friction_near_a_singular_posture_is_not_taken_for_contact(seed: int, stage: Stage) -> None:
    """For a cube straight in front of a UR5, 104 and 111 N were estimated without any contact."""
    look = {"at": {"xyz": [0, 0.42, 0.025]}, "distance": 0.5, "direction": [0, 1, -1.5]}
    steps = [
        {"look_at": {**look, "lean": 15}},
        {"locate": {"object": "cube", "pose": "{where}"}},
        {"grasp": {"object": "cube", "at": "{where}"}},
    ]
    cube = {"shape": "box", "size": [0.05, 0.05, 0.05], "mass": 0.15, "color": "green"}
    file = {
        "world": {"scene": "empty", "reality": "lab", "time_limit": 60},
        "objects": {"cube": {**cube, "pose": {"xyz": [0, 0.42, 0.025], "rpy": [0, 0, 10]}}},
        "arms": {
            "arm1": {
                "robot": "ur5",
                "gripper": "robotiq_2f85",
                "camera": {},
                "tree": {"sequence": steps},
            }
        },
    }
    leaf = stage.run(file, seed=seed).leaf("grasp")
    assert leaf.status == "SUCCESS", leaf.reason
    assert float(leaf.metrics["approach_force_n"]) < 30
