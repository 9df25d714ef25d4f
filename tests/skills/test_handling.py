"""Taking, carrying and letting go, against what the simulator knows to be true."""

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


def test_attached_is_welded_where_it_was(stage: Stage) -> None:
    """The cube stands still while it is taken, and rises with the arm by as much as the arm."""
    play = stage.play(TABLE.file(PICK, UP))
    start = play.world.object_pose("cube").position
    heights: list[float] = []

    def note(world: World) -> None:
        held = world.attachments.find("arm1", "cube")
        if held is not None and not heights:
            assert np.linalg.norm(world.object_pose("cube").position - start) < 1e-3
            heights.append(world.arms["arm1"].tool_pose.position[2])

    play.watchers.append(note)
    play.run()
    assert play.world.attachments.attached_to("arm1") == ("cube",)
    tool = play.world.arms["arm1"].tool_pose.position[2] - heights[0]
    cube = play.world.object_pose("cube").position[2] - start[2]
    assert tool == pytest.approx(0.15, abs=0.003)
    assert cube == pytest.approx(tool, abs=1e-3)


def test_attaching_twice_and_letting_go_twice_is_harmless(stage: Stage) -> None:
    play = stage.run(TABLE.file(PICK, PICK, LET_GO, LET_GO))
    assert [leaf.status for leaf in play.arm().runs] == ["SUCCESS"] * 4
    assert len(play.world.attachments) == 0


@pytest.mark.parametrize(
    ("robot", "gripper"),
    some([("ur5", "panda_hand"), ("ur10", "panda_hand"), ("ur10", "robotiq_2f85")], 2),
)
def test_fingers_that_hold_nothing_touch_it_with_their_tips(
    robot: str, gripper: str, stage: Stage
) -> None:
    """Open, they would go down beside the cube, and the arm would wait for a touch in vain.

    They touch it at the end of the way: in the middle of it a UR10 is too fast.
    """
    hand = {"robot": robot, "gripper": gripper, "base": {"xyz": [0, 0, 0.4]}}
    play = stage.run(Scenario(ON_TABLE, arm=hand, scene="table").file(PICK, UP))
    assert [leaf.status for leaf in play.arm().runs] == ["SUCCESS"] * 2, play.arm().runs
    assert play.world.object_pose("cube").position[2] == pytest.approx(0.575, abs=0.005)


def test_one_tool_holds_several_things(stage: Stage) -> None:
    """The second cube is taken with the first in the hand: cubes of a tower, from the top."""
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
    assert rises["cube"] > 0.15, "it was in the hand before, while the tool drew back"


def test_carrying_goes_where_it_says(stage: Stage) -> None:
    play = stage.run(TABLE.file(PICK, CARRY))
    assert play.leaf("transport").status == "SUCCESS"
    away = play.world.object_pose("cube").position - (0.3, -0.4, 0.65)
    assert np.linalg.norm(away) < 0.002
    assert float(play.leaf("transport").metrics["object_error_m"]) == pytest.approx(
        float(np.linalg.norm(away)), abs=5e-4
    )


def tear_off(world: World) -> None:
    world.attachments.detach("arm1", "cube")


def test_what_is_lost_on_the_way_is_told(stage: Stage) -> None:
    """Torn off behind the arm's back: the arm arrives, the cube does not."""
    play = stage.play(TABLE.file(PICK, CARRY), deeds=((4.6, tear_off),))
    play.run()
    leaf = play.leaf("transport")
    assert leaf.code == "NOT_ATTACHED", leaf.reason
    assert "lost" in leaf.reason
    assert play.arm().outcome == "FAILURE"


def test_what_slips_in_the_hand_is_not_where_it_should_be(stage: Stage) -> None:
    """Attached again with another relative pose on the way: NOT_REACHED with its numbers."""

    def slip(world: World) -> None:
        world.attachments.detach("arm1", "cube")
        joint = world.model.body_jntadr[world.object_body("cube")]
        world.data.qpos[world.model.jnt_qposadr[joint] + 2] -= 0.03
        world.step()
        world.attach("arm1", "cube")

    play = stage.play(TABLE.file(PICK, CARRY), deeds=((4.6, slip),))
    play.run()
    leaf = play.leaf("transport")
    assert leaf.code == "NOT_REACHED", leaf.reason
    assert float(leaf.metrics["object_error_m"]) == pytest.approx(0.03, abs=0.005)


def test_removing_what_is_held_ends_the_attachment(stage: Stage) -> None:
    """The arm goes on without it, and can be told so."""
    play = stage.run(TABLE.file(PICK, {"remove": {"object": "cube"}}, UP))
    assert play.arm().outcome == "SUCCESS"
    assert len(play.world.attachments) == 0
    assert "cube" not in play.world.objects


def test_removed_while_it_is_carried(stage: Stage) -> None:
    """Somebody takes it out of the world on the way: a failure with a reason, not an exception."""
    play = stage.play(TABLE.file(PICK, CARRY), deeds=((4.6, lambda w: w.remove_object("cube")),))
    play.run()
    leaf = play.leaf("transport")
    assert leaf.code == "NOT_ATTACHED", leaf.reason


def test_put_down_lies_where_it_was_left(stage: Stage) -> None:
    down: Tree = {"transport": {"object": "cube", "to": {"xyz": [0.25, -0.5, 0.426]}, "speed": 0.3}}
    play = stage.run(TABLE.file(PICK, CARRY, down, LET_GO, UP, {"wait": {"seconds": 0.5}}))
    assert play.arm().outcome == "SUCCESS", play.arm().runs
    assert len(play.world.attachments) == 0
    place = play.world.object_pose("cube").position
    assert place == pytest.approx((0.25, -0.5, 0.425), abs=0.003)


@pytest.mark.parametrize(("shape", "mass"), some(product(["cylinder", "sphere"], [0.01, 2.0]), 3))
def test_other_shapes_and_weights(shape: str, mass: float, stage: Stage) -> None:
    """From a feather to two kilograms, taken at the top and lifted."""
    size = {"cylinder": [0.03, 0.06], "sphere": [0.03]}[shape]
    obj = {"shape": shape, "size": size, "mass": mass, "pose": {"xyz": [0.40, -0.45, 0.43]}}
    play = stage.run(Scenario({"cube": obj}, scene="table").file(PICK, UP))
    assert play.arm().outcome == "SUCCESS", play.arm().runs
    assert play.world.object_pose("cube").position[2] == pytest.approx(0.58, abs=0.005)


def test_scenario_of_detach_holds_first(stage: Stage) -> None:
    """The example of detach lets go of something: else its success would say nothing."""
    play = stage.run(SCENARIOS["detach"].file(LET_GO))
    assert play.leaf("approach_and_attach").status == "SUCCESS"
    assert len(play.world.attachments) == 0


@pytest.mark.parametrize("tilt", some([-2.0, -0.1, 0.0, 0.1, 2.0], 2))
def test_taken_along_its_axis_a_tilted_cube_is_taken_as_a_straight_one(
    tilt: float, stage: Stage
) -> None:
    """The tool does not turn about its axis, nor does the arm go around by another way."""
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

    def note(world: World) -> None:
        farthest.append(float(np.abs(world.arms["arm1"].q - start).max()))

    play.watchers.append(note)
    play.run()
    assert play.arm().runs[0].status == "SUCCESS", play.arm().runs[0].reason
    assert max(farthest) < np.radians(30)


@pytest.mark.parametrize("gripper", ["robotiq_2f85", "suction_cup"])
def test_what_a_gripper_holds_is_not_let_go_of_by_forgetting_it(gripper: str, stage: Stage) -> None:
    """Fingers and cups do not open where a weld is taken away: it is held, and known to be."""
    hand = {"robot": "ur5", "gripper": gripper, "base": {"xyz": [0, 0, 0.4]}}
    grasp: Tree = {"grasp": {"object": "cube"}}
    play = stage.run(Scenario(ON_TABLE, arm=hand, scene="table").file(grasp, LET_GO))
    assert play.leaf("detach").code == "STILL_HELD"
    assert play.world.attachments.attached_to("arm1") == ("cube",)
