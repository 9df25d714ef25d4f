"""The recorded content of a gripper is true after any opening, failure or halt."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import bt_dualarm as bt
from bt_dualarm.sim.world import World
from tests.plays import Play, Stage
from tests.skills.scenarios import CUBE, GRASP, GRIPPING, ON_TABLE, Scenario, Tree

NEAR: Tree = {"approach_and_attach": {"object": "cube", "contact": False, "proximity": 0.05}}
OTHER = {"other": CUBE | {"color": "red", "pose": {"xyz": [0.25, -0.45, 0.425]}}}
PLACE: Tree = {"place": {"object": "cube", "at": {"xyz": [0.40, -0.35, 0.425]}}}
LOW: Tree = {"reach_to_pose": {"offset": {"xyz": [0, 0, -0.038]}}}
"""Moves down by most of the lift."""
TAKE_OTHER: Tree = {"grasp": {"object": "other"}}


def scene(gripper: str = "robotiq_2f85", robot: str = "ur5", **more: Any) -> Scenario:
    arm = GRIPPING | {"gripper": gripper, "robot": robot}
    return Scenario(ON_TABLE | OTHER | more, arm=arm, scene="table")


def codes(play: Play) -> list[str]:
    return [leaf.code or leaf.status for leaf in play.arm().runs]


def between_the_pads(world: World, name: str) -> bool:
    """Whether the true distance between object and tool is less than 4 cm."""
    offset = world.object_pose(name).position - world.arms["arm1"].tool_pose.position
    return bool(np.linalg.norm(offset) < 0.04)


@pytest.mark.parametrize("gripper", ["robotiq_2f85", "suction_cup"])
def test_full_gripper_refuses_another_object_and_keeps_its_own(gripper: str, stage: Stage) -> None:
    """It used to open, drop the first object, and succeed with both recorded as held."""
    play = stage.run(scene(gripper).file(GRASP, TAKE_OTHER))
    assert codes(play) == ["SUCCESS", "GRIPPER_FULL"]
    leaf = play.arm().runs[-1]
    assert "'cube'" in leaf.reason
    assert "place" in leaf.reason
    assert play.world.attachments.attached_to("arm1") == ("cube",)
    assert between_the_pads(play.world, "cube")


def test_grasp_beside_an_obstacle_waits_for_the_braking_of_a_halted_leaf(stage: Stage) -> None:
    """There the arm retreats before the fingers open: from where it comes to rest."""
    wall: Tree = {"shape": "box", "size": [0.02, 0.4, 0.1], "mass": 1, "fixed": True}
    wall |= {"spawned": False, "pose": {"xyz": [0.537, 0.11, 0.682]}}
    fast: Tree = {"move_linear": {"offset": {"xyz": [0, 0.12, 0]}, "speed": 1.0}}
    file = scene(wall=wall).file(
        {"force_success": {"child": "close_gripper"}},
        {"spawn": {"object": "wall"}},
        {"force_success": {"child": {"timeout": {"seconds": 0.3, "child": fast}}}},
        GRASP,
    )
    play = stage.run(file)
    assert codes(play)[1:] == ["SUCCESS", "HALTED", "SUCCESS"], play.arm().runs[-1].reason
    assert play.arm().clipped_setpoints == 0


def test_unnamed_object_fills_the_gripper(stage: Stage) -> None:
    file = scene().file(
        GRASP,
        LOW,
        {"release": {"width": 0.01}},
        {"close_gripper": {"force": 40}},
        TAKE_OTHER,
    )
    play = stage.run(file)
    assert codes(play)[-1] == "GRIPPER_FULL"
    assert "without a name" in play.arm().runs[-1].reason


def test_tool_with_an_attached_object_refuses_to_grasp(stage: Stage) -> None:
    play = stage.run(scene().file(NEAR, TAKE_OTHER))
    assert codes(play) == ["SUCCESS", "GRIPPER_FULL"]
    assert "detach" in play.arm().runs[-1].reason


def test_full_gripper_refuses_to_attach(stage: Stage) -> None:
    play = stage.run(scene().file(GRASP, {"approach_and_attach": {"object": "other"}}))
    assert codes(play) == ["SUCCESS", "GRIPPER_FULL"]
    assert play.world.attachments.attached_to("arm1") == ("cube",)


def test_task_can_be_retried_after_a_failed_place(stage: Stage) -> None:
    """`grasp` of a held object succeeds at once, so that the second `place` can run."""
    deep = {"place": {"object": "cube", "at": {"xyz": [0.40, -0.35, 0.4205]}, "tolerance": 0.001}}
    play = stage.run(scene().file(GRASP, {"selector": [deep, {"sequence": [GRASP, PLACE]}]}))
    assert codes(play) == ["SUCCESS", "NOT_REACHED", "SUCCESS", "SUCCESS"]
    assert len(play.world.attachments) == 0
    assert play.world.object_pose("cube").position[1] == pytest.approx(-0.35, abs=0.002)


@pytest.mark.parametrize("opening", ["open_gripper", "release"])
def test_object_is_released_if_opening_is_halted(opening: str, stage: Stage) -> None:
    """The fingers continue to open; the object is no longer held, and the next grasp may start."""
    halted: Tree = {"timeout": {"seconds": 0.04, "child": {opening: {}}}}
    leaves: Tree = {"selector": [halted, TAKE_OTHER]}
    play = stage.run(scene().file(GRASP, LOW, leaves))
    assert play.arm().outcome == "SUCCESS", play.arm().runs
    assert play.world.attachments.attached_to("arm1") == ("other",)


def test_grasp_halted_while_closing_can_be_retried(stage: Stage) -> None:
    """The object did not yet count as held: it is released, and grasped by the next attempt."""
    play = stage.play(scene().file(GRASP))
    closing: list[float] = []

    def record_closing(world: World) -> None:
        if world.grippers["arm1"].commanded.width == 0.0 and not closing:
            closing.append(world.time)

    play.watchers.append(record_closing)
    play.run()
    halted: Tree = {"timeout": {"seconds": closing[0] + 0.1, "child": GRASP}}
    play = stage.run(scene().file({"selector": [halted, GRASP]}))
    assert play.arm().outcome == "SUCCESS", play.arm().runs
    assert play.world.attachments.attached_to("arm1") == ("cube",)
    assert between_the_pads(play.world, "cube")


def test_object_is_still_held_after_a_narrow_opening(stage: Stage) -> None:
    """An opening narrower than the object only reduces the grip force."""
    loose: Tree = {"open_gripper": {"width": 0.0495}}
    play = stage.run(scene().file(GRASP, LOW, loose, {"close_gripper": {"object": "other"}}))
    assert codes(play)[-2:] == ["SUCCESS", "GRIPPER_FULL"]
    assert play.world.attachments.attached_to("arm1") == ("cube",)
    assert between_the_pads(play.world, "cube")


def test_object_lost_at_rest_frees_the_gripper(stage: Stage) -> None:
    def take_away(world: World) -> None:
        joint = world.model.body_jntadr[world.object_body("cube")]
        world.data.qpos[world.model.jnt_qposadr[joint]] += 2.0

    file = scene().file(GRASP, {"wait": {"seconds": 2.0}}, TAKE_OTHER)
    play = stage.play(file, interventions=((4.5, take_away),))
    play.run()
    assert play.world.attachments.attached_to("arm1") == ("other",), codes(play)


def test_removed_and_respawned_object_is_not_held(stage: Stage) -> None:
    again: Tree = {"spawn": {"object": "cube", "at": {"xyz": [0.40, -0.35, 0.425]}}}
    play = stage.run(scene().file(GRASP, {"remove": {"object": "cube"}}, again, TAKE_OTHER))
    assert play.arm().outcome == "SUCCESS", play.arm().runs
    assert play.world.attachments.attached_to("arm1") == ("other",)


def test_swapped_object_is_reported_as_wrong(stage: Stage) -> None:
    """`close_gripper` named the object 0.43 m away, and `holding` confirmed it."""

    def swap(world: World) -> None:
        for name, shift in (("cube", -0.15), ("other", 0.15)):
            joint = world.model.body_jntadr[world.object_body(name)]
            world.data.qpos[world.model.jnt_qposadr[joint]] += shift

    file = scene().file(
        GRASP,
        LOW,
        {"open_gripper": {}},
        {"wait": {"seconds": 1.0}},
        {"close_gripper": {"object": "cube", "force": 40}},
        {"holding": {"object": "cube"}},
    )
    play = stage.play(file)

    def swap_once(world: World) -> None:
        waits = any(one.kind == "wait" and one.new == "RUNNING" for one in play.changes)
        if waits and not done:
            done.append(True)
            swap(world)

    done: list[bool] = []
    play.watchers.append(swap_once)
    play.run()
    assert codes(play)[-1] == "WRONG_OBJECT", codes(play)
    assert len(play.world.attachments) == 0


def test_object_of_another_width_is_reported_as_wrong(stage: Stage) -> None:
    narrow: Tree = {"narrow": CUBE | {"size": [0.03] * 3, "pose": {"xyz": [0.25, -0.3, 0.415]}}}
    file = scene(**narrow).file(
        GRASP,
        LOW,
        {"open_gripper": {}},
        {"close_gripper": {"object": "narrow", "at": {"xyz": [0.40, -0.45, 0.425]}, "force": 40}},
    )
    play = stage.run(file)
    assert codes(play)[-1] == "WRONG_OBJECT", codes(play)


def test_pose_estimate_centers_the_part_between_the_fingers(stage: Stage) -> None:
    """The foot is 20 mm off the center of the object: the estimate had that error."""
    parts = {
        "post": {"shape": "box", "size": [0.06, 0.06, 0.12]},
        "foot": {"shape": "box", "size": [0.12, 0.03, 0.03], "pose": {"xyz": [0.08, 0.02, -0.045]}},
    }
    obj = {"shape": "compound", "mass": 0.3, "parts": parts}
    leaves: list[Tree] = [
        {"open_gripper": {}},
        {"reach_to_pose": {"to": {"xyz": [0.46, -0.403, 0.5], "rpy": [180, 0, 180]}}},
        {"move_linear": {"to": {"xyz": [0.46, -0.403, 0.418]}}},
        {"close_gripper": {"object": "thing", "force": 60}},
    ]
    play = stage.run(
        {
            "name": "foot",
            "world": {"scene": "table", "time_limit": 20},
            "objects": {"thing": obj | {"pose": {"xyz": [0.35, -0.42, 0.4605]}}},
            "arms": {
                "arm1": {
                    "robot": "ur5",
                    "gripper": "robotiq_2f85",
                    "base": {"xyz": [-0.1, 0, 0.4]},
                    "tree": {"sequence": leaves},
                }
            },
        }
    )
    assert play.leaf("close_gripper").status == "SUCCESS", play.leaf("close_gripper").reason
    world = play.world
    held = world.attachments.find("arm1", "thing")
    assert held is not None
    arm = world.arms["arm1"]
    estimated = arm.tool_pose @ world.robots["arm1"].tool.inverse @ held.relative
    assert estimated.distance(world.object_pose("thing")) < 2e-3


@pytest.mark.parametrize("gripper", ["robotiq_2f85", "suction_cup"])
@pytest.mark.parametrize(
    ("then", "code"),
    [
        (PLACE, "DROPPED"),
        ({"transport": {"object": "cube", "to": {"xyz": [0.3, -0.3, 0.6]}}}, "DROPPED"),
        ({"go_home": {}}, "DROPPED"),
        (TAKE_OTHER, "SUCCESS"),
        ({"wait": 0.1}, "SUCCESS"),
    ],
    ids=["place", "transport", "go home", "grasp", "wait"],
)
def test_an_object_that_is_lost_while_no_leaf_checks_is_detached_at_once(
    gripper: str, then: Tree, code: str
) -> None:
    """The controller counted on its inertia until a leaf checked, and could become unstable."""
    file = scene(gripper).file(GRASP, {"wait": 8}, then)
    file["faults"] = {"theft": {"kind": "removed_object", "object": "cube", "begin": "9 s"}}
    with bt.open({"bt_dualarm": 1} | file) as run:
        attachments = run.assembly.world.attachments
        run.step(9.0)
        assert attachments.attached_to("arm1") == ("cube",)
        run.step(0.8)
        assert attachments.attached_to("arm1") == ()
        leaves = run.finish().arms["arm1"].runs
    assert [leaf.code or leaf.status for leaf in leaves] == ["SUCCESS", "SUCCESS", code]
