"""A pull at a held object soon makes the grip firmer; an object pulled out is reported as lost."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from bt_dualarm.sim.world import World
from tests.plays import Play, Stage
from tests.skills.scenarios import GRIPPING, ON_TABLE, Scenario, Tree

CARRY: Tree = {"transport": {"object": "cube", "to": {"xyz": [0.35, 0.2, 0.7]}, "speed": 1.0}}
GOING = 3.6
"""Simulated time at which the cube is being carried, s."""


def pulls(newton: float, axis: int = 2) -> Callable[[World], None]:
    """A steady pull at the cube in N along a tool axis; the default is away from the palm."""

    def pull(world: World) -> None:
        along = world.arms["arm1"].tool_pose.rotation_matrix[:, axis]
        world.data.xfrc_applied[world.object_body("cube"), :3] = newton * along

    return pull


def play(
    stage: Stage, newton: float, axis: int = 2, gripper: str = "robotiq_2f85", **ports: Any
) -> tuple[Play, list[tuple[float, float]]]:
    """Pulls for 0.1 s while the cube is carried; returns (time in s, grip force in N) changes."""
    grasp: Tree = {"grasp": {"object": "cube", **ports}}
    cube = {"cube": ON_TABLE["cube"] | {"mass": 0.5}}
    arm = GRIPPING | {"gripper": gripper}
    file = Scenario(cube, arm=arm, scene="table").file(grasp, CARRY)
    interventions = ((GOING, pulls(newton, axis)), (GOING + 0.1, pulls(0.0)))
    one = stage.play(file, interventions=interventions)
    commands: list[tuple[float, float]] = []

    def note(world: World) -> None:
        force = world.grippers["arm1"].commanded.force
        if world.attachments.find("arm1", "cube") and (not commands or commands[-1][1] != force):
            commands.append((world.time, force))

    one.watchers.append(note)
    one.run()
    return one, commands


def test_grip_force_is_constant_without_a_pull(stage: Stage) -> None:
    one, commands = play(stage, 0.0)
    assert one.arm().outcome == "SUCCESS"
    assert len(commands) == 1
    assert "slips_felt" not in one.leaf("transport").metrics


def test_pull_beyond_friction_is_answered_within_50_ms(stage: Stage) -> None:
    one, commands = play(stage, 40.0)
    leaf = one.leaf("transport")
    assert leaf.status == "SUCCESS", leaf.reason
    (_, first), (at, firmer), *_ = commands
    assert 0.0 < at - GOING <= 0.016  # two readings of the pads and two set-points
    assert firmer > 2.0 * first
    assert float(leaf.metrics["slips_felt"]) >= 1
    assert leaf.metrics["grip_force_n"] == commands[-1][1]


@pytest.mark.parametrize("axis", [0, 1])
def test_sideways_pull_is_answered_within_50_ms(axis: int, stage: Stage) -> None:
    one, commands = play(stage, 40.0, axis)
    assert one.arm().outcome == "SUCCESS"
    assert 0.0 < commands[1][0] - GOING <= 0.05


def test_sideways_pull_at_a_cup_is_felt_by_the_joints(stage: Stage) -> None:
    """A cup cannot hold more firmly: the pull is counted, and the arm carries the cube on."""
    one, commands = play(stage, 12.0, 0, "suction_cup")
    leaf = one.leaf("transport")
    assert leaf.status == "SUCCESS", leaf.reason
    assert float(leaf.metrics["slips_felt"]) >= 1
    assert len(commands) == 1


def test_carrying_a_cube_by_a_cup_is_no_pull(stage: Stage) -> None:
    one, _ = play(stage, 0.0, 0, "suction_cup")
    assert one.arm().outcome == "SUCCESS"
    assert "slips_felt" not in one.leaf("transport").metrics


def test_slip_response_respects_the_most_force_of_the_object(stage: Stage) -> None:
    _, commands = play(stage, 40.0, most_force=30.0)
    assert max(force for _, force in commands) == 30.0


def test_object_torn_out_of_the_grip_is_reported_as_dropped(stage: Stage) -> None:
    """The pull exceeds what a grip of 21 N bears."""
    one, _ = play(stage, 300.0, most_force=21.0)
    leaf = one.leaf("transport")
    assert leaf.code in ("DROPPED", "SLIPPED"), leaf.reason
    away = one.world.object_pose("cube").position - one.world.arms["arm1"].tool_pose.position
    assert np.linalg.norm(away) > 0.05


@pytest.mark.parametrize("force", [5.0, 19.0])
def test_object_that_bears_less_than_the_least_grip_force_is_refused(
    force: float, stage: Stage
) -> None:
    grasp: Tree = {"grasp": {"object": "cube", "most_force": force}}
    file = Scenario(ON_TABLE, arm=GRIPPING, scene="table").file(grasp)
    leaf = stage.run(file).leaf("grasp")
    assert leaf.code == "INVALID_TARGET"
    assert leaf.metrics["most_force_n"] == force


@pytest.mark.parametrize("reality", ["lab", "rough"])
def test_cup_bears_its_described_load_on_a_vibrating_arm(reality: str, stage: Stage) -> None:
    """1.2 kg are a fifth of its 60 N; a model with a rigid lip lost the cube during the lift."""
    cube = {"cube": ON_TABLE["cube"] | {"mass": 1.2}}
    arm = GRIPPING | {"robot": "ur10", "gripper": "suction_cup", "reality": reality}
    file = Scenario(cube, arm=arm, scene="table").file({"grasp": {"object": "cube"}}, CARRY)
    one = stage.run(file)
    assert one.arm().outcome == "SUCCESS"
    assert float(one.leaf("transport").metrics["slid_m"]) < 2e-4
