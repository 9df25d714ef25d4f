"""Attaching, carrying and detaching, compared with the true state of the simulator."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest

from bt_dualarm.sim.world import World
from tests.families import some
from tests.plays import Stage
from tests.skills.scenarios import CUBE, ON_TABLE, PICK, PRESENTING, SCENARIOS, Scenario, Tree

CARRY: Tree = {"transport": {"object": "cube", "to": {"xyz": [0.3, -0.4, 0.65]}}}
LET_GO: Tree = {"detach": {"object": "cube"}}
UP: Tree = {"reach_to_pose": {"offset": {"xyz": [0, 0, 0.15]}}}
TABLE = Scenario(ON_TABLE, scene="table")


def test_attaching_does_not_move_the_object(stage: Stage) -> None:
    """The cube rests while it is attached, and then rises by as much as the arm."""
    play = stage.play(TABLE.file(PICK, UP))
    start = play.world.object_pose("cube").position
    heights: list[float] = []

    def record(world: World) -> None:
        held = world.attachments.find("arm1", "cube")
        if held is not None and not heights:
            assert np.linalg.norm(world.object_pose("cube").position - start) < 1e-3
            heights.append(world.arms["arm1"].tool_pose.position[2])

    play.watchers.append(record)
    play.run()
    assert play.world.attachments.attached_to("arm1") == ("cube",)
    tool = play.world.arms["arm1"].tool_pose.position[2] - heights[0]
    cube = play.world.object_pose("cube").position[2] - start[2]
    assert tool == pytest.approx(0.15, abs=0.003)
    assert cube == pytest.approx(tool, abs=1e-3)


def test_attaching_and_detaching_twice_is_harmless(stage: Stage) -> None:
    play = stage.run(TABLE.file(PICK, PICK, LET_GO, LET_GO))
    assert [leaf.status for leaf in play.arm().runs] == ["SUCCESS"] * 4
    assert len(play.world.attachments) == 0


@pytest.mark.parametrize(
    ("robot", "gripper"),
    some([("ur5", "panda_hand"), ("ur10", "panda_hand"), ("ur10", "robotiq_2f85")], 2),
)
def test_empty_fingers_touch_the_object_with_their_tips(
    robot: str, gripper: str, stage: Stage
) -> None:
    """Open, they would pass beside the cube, and the arm would wait for contact in vain.

    Contact must come at the end of the motion: in its middle a UR10 is too fast.
    """
    hand = {"robot": robot, "gripper": gripper, "base": {"xyz": [0, 0, 0.4]}}
    play = stage.run(Scenario(ON_TABLE, arm=hand, scene="table").file(PICK, UP))
    assert [leaf.status for leaf in play.arm().runs] == ["SUCCESS"] * 2, play.arm().runs
    assert play.world.object_pose("cube").position[2] == pytest.approx(0.575, abs=0.005)


def test_tool_holds_several_objects(stage: Stage) -> None:
    """The second cube of a tower, from the top, is attached while the first is held."""
    tower = {
        "cube": CUBE | {"pose": {"xyz": [0.40, -0.45, 0.475]}},
        "lower": CUBE | {"color": "red", "pose": {"xyz": [0.40, -0.45, 0.425]}},
    }
    side: Tree = {"approach_and_attach": {"object": "lower", "proximity": 0.08, "contact": False}}
    play = stage.play(Scenario(tower, scene="table").file(PICK, side, UP))
    play.run()
    assert play.world.attachments.attached_to("arm1") == ("cube", "lower"), play.arm().runs
    rises = {
        name: play.world.object_pose(name).position[2] - height
        for name, height in (("cube", 0.475), ("lower", 0.425))
    }
    assert rises["lower"] == pytest.approx(0.15, abs=0.003)
    assert rises["cube"] > 0.15, "it was already held while the tool retreated"


def test_transport_reaches_its_goal(stage: Stage) -> None:
    play = stage.run(TABLE.file(PICK, CARRY))
    assert play.leaf("transport").status == "SUCCESS"
    error = play.world.object_pose("cube").position - (0.3, -0.4, 0.65)
    assert np.linalg.norm(error) < 0.002
    assert float(play.leaf("transport").metrics["object_error_m"]) == pytest.approx(
        float(np.linalg.norm(error)), abs=5e-4
    )


def tear_off(world: World) -> None:
    world.attachments.detach("arm1", "cube")


def test_object_lost_in_transport_is_reported(stage: Stage) -> None:
    """The cube is torn off unnoticed: the arm arrives, the cube does not."""
    play = stage.play(TABLE.file(PICK, CARRY), interventions=((4.6, tear_off),))
    play.run()
    leaf = play.leaf("transport")
    assert leaf.code == "NOT_ATTACHED", leaf.reason
    assert "lost" in leaf.reason
    assert play.arm().outcome == "FAILURE"


def test_slip_in_transport_is_reported_as_not_reached(stage: Stage) -> None:
    """Reattached with another relative pose during the motion: NOT_REACHED with the error."""

    def slip(world: World) -> None:
        world.attachments.detach("arm1", "cube")
        joint = world.model.body_jntadr[world.object_body("cube")]
        world.data.qpos[world.model.jnt_qposadr[joint] + 2] -= 0.03
        world.step()
        world.attach("arm1", "cube")

    play = stage.play(TABLE.file(PICK, CARRY), interventions=((4.6, slip),))
    play.run()
    leaf = play.leaf("transport")
    assert leaf.code == "NOT_REACHED", leaf.reason
    assert float(leaf.metrics["object_error_m"]) == pytest.approx(0.03, abs=0.005)


def test_removing_a_held_object_ends_the_attachment(stage: Stage) -> None:
    """The arm continues without it."""
    play = stage.run(TABLE.file(PICK, {"remove": {"object": "cube"}}, UP))
    assert play.arm().outcome == "SUCCESS"
    assert len(play.world.attachments) == 0
    assert "cube" not in play.world.objects


def test_removal_of_a_carried_object_is_a_failure(stage: Stage) -> None:
    """If the object vanishes during the motion, the leaf fails with a reason, not an exception."""
    play = stage.play(
        TABLE.file(PICK, CARRY), interventions=((4.6, lambda w: w.remove_object("cube")),)
    )
    play.run()
    leaf = play.leaf("transport")
    assert leaf.code == "NOT_ATTACHED", leaf.reason


def test_detached_object_stays_where_it_was_put_down(stage: Stage) -> None:
    down: Tree = {"transport": {"object": "cube", "to": {"xyz": [0.25, -0.5, 0.426]}, "speed": 0.3}}
    play = stage.run(TABLE.file(PICK, CARRY, down, LET_GO, UP, {"wait": {"seconds": 0.5}}))
    assert play.arm().outcome == "SUCCESS", play.arm().runs
    assert len(play.world.attachments) == 0
    position = play.world.object_pose("cube").position
    assert position == pytest.approx((0.25, -0.5, 0.425), abs=0.003)


@pytest.mark.parametrize(("shape", "mass"), some(product(["cylinder", "sphere"], [0.01, 2.0]), 3))
def test_light_and_heavy_round_objects_are_lifted(shape: str, mass: float, stage: Stage) -> None:
    """From 10 g to 2 kg."""
    size = {"cylinder": [0.03, 0.06], "sphere": [0.03]}[shape]
    obj = {"shape": shape, "size": size, "mass": mass, "pose": {"xyz": [0.40, -0.45, 0.43]}}
    play = stage.run(Scenario({"cube": obj}, scene="table").file(PICK, UP))
    assert play.arm().outcome == "SUCCESS", play.arm().runs
    assert play.world.object_pose("cube").position[2] == pytest.approx(0.58, abs=0.005)


def test_scenario_of_detach_holds_first(stage: Stage) -> None:
    """The example of `detach` must release an object: otherwise its success would mean nothing."""
    play = stage.run(SCENARIOS["detach"].file(LET_GO))
    assert play.leaf("approach_and_attach").status == "SUCCESS"
    assert len(play.world.attachments) == 0


@pytest.mark.parametrize("tilt", some([-2.0, -0.1, 0.0, 0.1, 2.0], 2))
def test_tilted_cube_is_attached_without_a_detour(tilt: float, stage: Stage) -> None:
    """The tool does not turn about its axis, and the arm takes no other path."""
    stand = {"shape": "box", "size": [0.03, 0.06, 0.676], "mass": 5, "fixed": True}
    objects = {
        "cube": CUBE | {"pose": {"xyz": [0.68, 0.11, 0.701], "rpy": [0, 0, tilt]}},
        "stand": stand | {"pose": {"xyz": [0.68, 0.11, 0.338]}},
    }
    scenario = Scenario(objects, arm=PRESENTING)
    play = stage.play(
        scenario.file(
            {"approach_and_attach": {"object": "cube", "direction": [1, 0, 0], "standoff": 0.08}}
        )
    )
    start = play.world.arms["arm1"].q
    farthest = [0.0]

    def record(world: World) -> None:
        farthest.append(float(np.abs(world.arms["arm1"].q - start).max()))

    play.watchers.append(record)
    play.run()
    assert play.arm().runs[0].status == "SUCCESS", play.arm().runs[0].reason
    assert max(farthest) < np.radians(30)


@pytest.mark.parametrize("gripper", ["robotiq_2f85", "suction_cup"])
def test_detach_does_not_release_a_grasped_object(gripper: str, stage: Stage) -> None:
    """Removing a weld does not open fingers or cups: the object is held, and recorded as held."""
    hand = {"robot": "ur5", "gripper": gripper, "base": {"xyz": [0, 0, 0.4]}}
    grasp: Tree = {"grasp": {"object": "cube"}}
    play = stage.run(Scenario(ON_TABLE, arm=hand, scene="table").file(grasp, LET_GO))
    assert play.leaf("detach").code == "STILL_HELD"
    assert play.world.attachments.attached_to("arm1") == ("cube",)
