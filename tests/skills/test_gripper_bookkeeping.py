"""What a gripper is believed to hold is what it holds, whoever opens it, fails or is halted."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from bt_dualarm.sim.world import World
from tests.plays import Play, Stage
from tests.skills.scenarios import CUBE, GRASP, GRIPPING, ON_TABLE, Scenario, Tree

NEAR: Tree = {"approach_and_attach": {"object": "cube", "contact": False, "proximity": 0.05}}
OTHER = {"other": CUBE | {"color": "red", "pose": {"xyz": [0.25, -0.45, 0.425]}}}
PLACE: Tree = {"place": {"object": "cube", "at": {"xyz": [0.40, -0.35, 0.425]}}}
LOW: Tree = {"reach_to_pose": {"offset": {"xyz": [0, 0, -0.038]}}}
"""Down again by most of the lift."""
TAKE_OTHER: Tree = {"grasp": {"object": "other"}}


def scene(gripper: str = "robotiq_2f85", robot: str = "ur5", **more: Any) -> Scenario:
    arm = GRIPPING | {"gripper": gripper, "robot": robot}
    return Scenario(ON_TABLE | OTHER | more, arm=arm, scene="table")


def codes(play: Play) -> list[str]:
    return [leaf.code or leaf.status for leaf in play.arm().runs]


def between_the_pads(world: World, name: str) -> bool:
    """The truth: the object is less than 4 cm from the tool."""
    away = world.object_pose(name).position - world.arms["arm1"].tool_pose.position
    return bool(np.linalg.norm(away) < 0.04)


@pytest.mark.parametrize("gripper", ["robotiq_2f85", "suction_cup"])
def test_a_full_gripper_takes_nothing_else_and_keeps_what_it_has(
    gripper: str, stage: Stage
) -> None:
    """It used to open, drop the first object, and say SUCCESS with both in its books."""
    play = stage.run(scene(gripper).file(GRASP, TAKE_OTHER))
    assert codes(play) == ["SUCCESS", "GRIPPER_FULL"]
    leaf = play.arm().runs[-1]
    assert "'cube'" in leaf.reason
    assert "place" in leaf.reason
    assert play.world.attachments.attached_to("arm1") == ("cube",)
    assert between_the_pads(play.world, "cube")


def test_what_has_no_name_fills_a_gripper_too(stage: Stage) -> None:
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


def test_a_tool_with_something_attached_grasps_nothing(stage: Stage) -> None:
    play = stage.run(scene().file(NEAR, TAKE_OTHER))
    assert codes(play) == ["SUCCESS", "GRIPPER_FULL"]
    assert "detach" in play.arm().runs[-1].reason


def test_a_full_gripper_attaches_nothing_else(stage: Stage) -> None:
    play = stage.run(scene().file(GRASP, {"approach_and_attach": {"object": "other"}}))
    assert codes(play) == ["SUCCESS", "GRIPPER_FULL"]
    assert play.world.attachments.attached_to("arm1") == ("cube",)


def test_retry_of_a_job_whose_place_failed(stage: Stage) -> None:
    """Grasping what is held already succeeds at once, so that the second `place` may work."""
    deep = {"place": {"object": "cube", "at": {"xyz": [0.40, -0.35, 0.4205]}, "tolerance": 0.001}}
    play = stage.run(scene().file(GRASP, {"selector": [deep, {"sequence": [GRASP, PLACE]}]}))
    assert codes(play) == ["SUCCESS", "NOT_REACHED", "SUCCESS", "SUCCESS"]
    assert len(play.world.attachments) == 0
    assert play.world.object_pose("cube").position[1] == pytest.approx(-0.35, abs=0.002)


@pytest.mark.parametrize("opening", ["open_gripper", "release"])
def test_halted_while_it_opens(opening: str, stage: Stage) -> None:
    """The fingers go on; what they have come off is held no more, and the next grasp is free."""
    halted: Tree = {"timeout": {"seconds": 0.04, "child": {opening: {}}}}
    tries: Tree = {"selector": [halted, TAKE_OTHER]}
    play = stage.run(scene().file(GRASP, LOW, tries))
    assert play.arm().outcome == "SUCCESS", play.arm().runs
    assert play.world.attachments.attached_to("arm1") == ("other",)


def test_halted_while_it_closes(stage: Stage) -> None:
    """Nobody believed yet that it is held: it is let go of, and taken by the next try."""
    play = stage.play(scene().file(GRASP))
    closing: list[float] = []

    def note(world: World) -> None:
        if world.grippers["arm1"].commanded.width == 0.0 and not closing:
            closing.append(world.time)

    play.watchers.append(note)
    play.run()
    halted: Tree = {"timeout": {"seconds": closing[0] + 0.1, "child": GRASP}}
    play = stage.run(scene().file({"selector": [halted, GRASP]}))
    assert play.arm().outcome == "SUCCESS", play.arm().runs
    assert play.world.attachments.attached_to("arm1") == ("cube",)
    assert between_the_pads(play.world, "cube")


def test_what_is_not_opened_is_still_held(stage: Stage) -> None:
    """An opening narrower than what is between the fingers lets nothing go, only hold less."""
    loose: Tree = {"open_gripper": {"width": 0.0495}}
    play = stage.run(scene().file(GRASP, LOW, loose, {"close_gripper": {"object": "other"}}))
    assert codes(play)[-2:] == ["SUCCESS", "GRIPPER_FULL"]
    assert play.world.attachments.attached_to("arm1") == ("cube",)
    assert between_the_pads(play.world, "cube")


def test_what_is_lost_while_nothing_moves_does_not_fill_the_gripper(stage: Stage) -> None:
    def take_away(world: World) -> None:
        joint = world.model.body_jntadr[world.object_body("cube")]
        world.data.qpos[world.model.jnt_qposadr[joint]] += 2.0

    file = scene().file(GRASP, {"wait": {"seconds": 2.0}}, TAKE_OTHER)
    play = stage.play(file, deeds=((4.5, take_away),))
    play.run()
    assert play.world.attachments.attached_to("arm1") == ("other",), codes(play)


def test_removed_and_spawned_again_it_is_not_held(stage: Stage) -> None:
    again: Tree = {"spawn": {"object": "cube", "at": {"xyz": [0.40, -0.35, 0.425]}}}
    play = stage.run(scene().file(GRASP, {"remove": {"object": "cube"}}, again, TAKE_OTHER))
    assert play.arm().outcome == "SUCCESS", play.arm().runs
    assert play.world.attachments.attached_to("arm1") == ("other",)


def test_a_swapped_object_does_not_get_the_name_of_the_other(stage: Stage) -> None:
    """`close_gripper` named what was 0.43 m away, and `holding` believed it."""

    def swap(world: World) -> None:
        for name, way in (("cube", -0.15), ("other", 0.15)):
            joint = world.model.body_jntadr[world.object_body(name)]
            world.data.qpos[world.model.jnt_qposadr[joint]] += way

    file = scene().file(
        GRASP,
        LOW,
        {"open_gripper": {}},
        {"wait": {"seconds": 1.0}},
        {"close_gripper": {"object": "cube", "force": 40}},
        {"holding": {"object": "cube"}},
    )
    play = stage.play(file)

    def look(world: World) -> None:
        waits = any(one.kind == "wait" and one.new == "RUNNING" for one in play.changes)
        if waits and not done:
            done.append(True)
            swap(world)

    done: list[bool] = []
    play.watchers.append(look)
    play.run()
    assert codes(play)[-1] == "WRONG_OBJECT", codes(play)
    assert len(play.world.attachments) == 0


def test_an_object_of_another_width_does_not_get_the_name(stage: Stage) -> None:
    narrow: Tree = {"narrow": CUBE | {"size": [0.03] * 3, "pose": {"xyz": [0.25, -0.3, 0.415]}}}
    file = scene(**narrow).file(
        GRASP,
        LOW,
        {"open_gripper": {}},
        {"close_gripper": {"object": "narrow", "at": {"xyz": [0.40, -0.45, 0.425]}, "force": 40}},
    )
    play = stage.run(file)
    assert codes(play)[-1] == "WRONG_OBJECT", codes(play)


def test_the_part_between_the_fingers_is_centered_not_the_whole_object(stage: Stage) -> None:
    """The foot is 20 mm beside the middle of the object: the arm was that wrong about it."""
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
    believed = arm.tool_pose @ world.robots["arm1"].tool.inverse @ held.relative
    assert believed.distance(world.object_pose("thing")) < 2e-3
