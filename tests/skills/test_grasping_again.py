"""What a grasp depends on, and what is left after one that failed: the next one may succeed."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest

from benchmarks.sequences import play
from tests.families import some
from tests.plays import Stage
from tests.skills.scenarios import CUBE, GRIPPING, ON_TABLE, Scenario, Tree

GRASP: Tree = {"grasp": {"object": "cube"}}


@pytest.mark.parametrize("shape", ["cylinder", "sphere"])
def test_how_something_round_is_turned_does_not_matter(shape: str, stage: Stage) -> None:
    """Of six azimuths about the can's own axis none was in reach, or one, by its yaw."""
    size, z = ([0.025, 0.08], 0.44) if shape == "cylinder" else ([0.025], 0.425)
    tools = []
    for yaw in (0.0, 17.0, 49.0):
        pose = {"xyz": [0.40, -0.45, z], "rpy": [0, 0, yaw]}
        can = {"cube": CUBE | {"shape": shape, "size": size, "pose": pose}}
        play = stage.run(Scenario(can, arm=GRIPPING, scene="table").file(GRASP))
        assert play.arm().outcome == "SUCCESS", play.arm().runs
        tools.append(play.world.arms["arm1"].tool_pose)
    assert all(tools[0].distance(one) < 1e-3 and tools[0].angle(one) < 0.01 for one in tools)


def test_a_grasp_waits_for_what_it_has_dropped() -> None:
    """Planned while the cube bounced, it came down 5 mm beside the middle and lost the cube."""
    leaves = play(710190, 3, "lab", ("release", "grasp", "circle")).leaves
    assert [status for skill, status, _, _ in leaves if skill == "grasp"] == ["SUCCESS"] * 2


def test_of_twins_the_one_is_taken_that_was_seen(stage: Stage) -> None:
    """The cube that is named is elsewhere: it stays an obstacle, and is not said to be held."""
    twin = {"twin": CUBE | {"pose": {"xyz": [0.25, -0.45, 0.425]}}}
    at = {"xyz": [0.2505, -0.45, 0.425]}
    grasp: Tree = {"grasp": {"object": "cube", "at": at}}
    again: Tree = {"grasp": {"object": "cube", "at": at}}
    file = Scenario(ON_TABLE | twin, arm=GRIPPING, scene="table").file(grasp, again)
    play = stage.run(file)
    assert play.arm().outcome == "SUCCESS", play.arm().runs
    assert play.world.attachments.attached_to("arm1") == ("twin",)
    assert play.leaves("grasp")[0].metrics["taken"] == "twin"
    assert play.world.object_pose("cube").position[0] == pytest.approx(0.40, abs=1e-4)


ASIDE = {"robotiq_2f85": 0.05, "panda_hand": 0.035}
"""Meters by which the cube is believed to be beside its place, so that a finger meets it."""


@pytest.mark.parametrize(
    ("robot", "gripper"), some(product(["ur5", "panda"], ["robotiq_2f85", "panda_hand"]), 3)
)
def test_a_grasp_succeeds_after_one_that_ran_into_something(
    robot: str, gripper: str, stage: Stage
) -> None:
    """It came down on the cube with a finger: the arm goes back out, where a plan may begin."""
    off = {"xyz": [0.40, -0.45 + ASIDE[gripper], 0.405], "rpy": [0, 0, 0]}
    blind: Tree = {"grasp": {"object": "cube", "at": off, "approach": [0, 0, -1]}}
    arm = GRIPPING | {"robot": robot, "gripper": gripper, "force_limit": 25}
    file = Scenario(ON_TABLE, arm=arm, scene="table").file({"selector": [blind, GRASP]})
    play = stage.run(file)
    first, second = play.leaves("grasp")
    assert first.code in ("FORCE_LIMIT", "NOT_GRASPED"), first
    assert second.status == "SUCCESS", second
    assert play.world.attachments.attached_to("arm1") == ("cube",)


@pytest.mark.parametrize("seed", some([0, 1], 2))
def test_what_is_weighed_and_too_heavy_is_put_back(seed: int, stage: Stage) -> None:
    """Nobody tells the mass in `rough`: a UR3 may hold 3 kg, and has 4.5 kg in its fingers."""
    heavy = {"cube": ON_TABLE["cube"] | {"mass": 4.5, "friction": 1.5}}
    arm = GRIPPING | {"robot": "ur3", "base": {"xyz": [0.2, -0.2, 0.4]}}
    grasp: Tree = {"grasp": {"object": "cube", "mass": 1.0, "force": 200, "lift": 0.08}}
    scenario = Scenario(heavy, arm=arm, scene="table")
    file = scenario.file(grasp)
    file["world"]["reality"] = "rough"
    play = stage.run(file, seed=seed)
    leaf = play.leaf("grasp")
    assert leaf.code == "OVERLOADED", leaf
    assert len(play.world.attachments) == 0
    assert play.world.object_pose("cube").position[2] == pytest.approx(0.425, abs=2e-3)
    assert np.linalg.norm(play.world.object_pose("cube").position[:2] - (0.40, -0.45)) < 0.02
