"""A guarded move ends at the first contact, and not before, despite model errors."""

from __future__ import annotations

from itertools import product

import pytest

from benchmarks.sequences import play
from bt_dualarm.core.pose import Pose
from bt_dualarm.kinematics.inverse_kinematics import Kinematics
from bt_dualarm.robots.robot_description import load_robot
from tests.families import some
from tests.plays import Stage
from tests.skills.scenarios import ABOVE, Tree

GAP_M = 0.05
DOWN: Tree = {"move_until_contact": {"direction": [0, 0, -1], "distance": 0.09}}


def above(robot: str, reality: str, plate: bool) -> Tree:
    """An arm above a plate, or above nothing."""
    description = load_robot(robot)
    kinematics = Kinematics(description, Pose.from_rpy((0.0, 0.0, 0.40)))
    x, y, z = kinematics.forward(description.postures["home"]).position.tolist()
    slab: Tree = {"shape": "box", "size": [0.3, 0.3, 0.04], "mass": 5, "fixed": True}
    slab["pose"] = {"xyz": [x, y, z - GAP_M - 0.02]}
    return {
        "world": {"scene": "empty", "time_limit": 30, "reality": reality},
        "objects": {"plate": slab} if plate else {},
        "arms": {"arm1": {"robot": robot, "base": ABOVE, "tree": DOWN}},
    }


@pytest.mark.parametrize(
    ("robot", "reality", "seed"),
    some([("ur5", "lab", 1), ("xarm7", "lab", 0), ("ur10", "rough", 0), ("ur3", "rough", 2)], 2),
)
def test_guarded_move_ends_at_surface(robot: str, reality: str, seed: int, stage: Stage) -> None:
    leaf = stage.run(above(robot, reality, plate=True), seed=seed).leaf("move_until_contact")
    assert leaf.status == "SUCCESS", leaf.reason
    assert leaf.metrics["contact_after_m"] == pytest.approx(GAP_M, abs=2e-3)
    assert float(leaf.metrics["contact_force_n"]) > 15.0
    assert leaf.metrics["touched"] == "plate"


@pytest.mark.parametrize(
    ("robot", "reality"),
    some([("panda", "lab"), ("xarm7", "rough"), ("ur3e", "lab"), ("baxter_right", "lab")], 2),
)
def test_fast_guarded_move_succeeds_although_contact_blocks_its_set_point(
    robot: str, reality: str, stage: Stage
) -> None:
    """At ten times the speed, the arm backs off, and does not come to rest at its set-point."""
    file = above(robot, reality, plate=True)
    quick = {"move_until_contact": DOWN["move_until_contact"] | {"speed": 0.1}}
    up: Tree = {"move_linear": {"offset": {"xyz": [0, 0, 0.03]}}}
    file["arms"]["arm1"]["tree"] = {"sequence": [quick, up]}
    play = stage.run(file)
    leaf = play.leaf("move_until_contact")
    assert leaf.status == "SUCCESS", leaf.reason
    assert leaf.metrics["touched"] == "plate"
    assert play.leaf("move_linear").status == "SUCCESS"


@pytest.mark.parametrize(
    ("robot", "gripper", "reality"),
    some(
        [
            ("xarm7", "suction_cup", "ideal"),
            ("xarm7", "suction_cup", "rough"),
            ("ur10", "panda_hand", "rough"),
            ("ur10", "panda_hand", "ideal"),
            ("ur5", "suction_cup", "ideal"),
            ("ur5", "suction_cup", "rough"),
        ],
        2,
    ),
)
def test_contact_force_is_not_compensated(
    robot: str, gripper: str, reality: str, stage: Stage
) -> None:
    """The arm pressed with 48 to 121 N, and without joint friction might never come to rest."""
    file = above(robot, reality, plate=True)
    down = {"move_until_contact": {"direction": [0, 0, -1], "distance": 0.2}}
    file["arms"]["arm1"]["tree"] = {"sequence": [down, {"hold_still": {"duration": 1.0}}]}
    file["arms"]["arm1"] |= {"gripper": gripper, "base": {"xyz": [0, 0, 0.5]}}
    play = stage.run(file)
    assert play.arm().outcome == "SUCCESS", play.arm().runs
    assert 5.0 < float(play.leaf("move_until_contact").metrics["touch_force_n"]) < 40.0


@pytest.mark.parametrize(
    ("robot", "gripper"), some(product(["panda", "xarm7"], ["panda_hand", "suction_cup"]), 3)
)
def test_contact_just_after_the_start_is_not_compensated(
    robot: str, gripper: str, stage: Stage
) -> None:
    """The motion is too short to learn from: the compensation from before the motion counts."""
    file = above(robot, "ideal", plate=True)
    down = {"move_until_contact": {"distance": 0.2, "force": 5, "speed": 0.02}}
    up = {"move_linear": {"offset": {"xyz": [0, 0, 0.001]}}}
    quick = {"move_until_contact": {"distance": 0.2, "speed": 0.1}}
    still = {"hold_still": {"duration": 1.0}}
    file["arms"]["arm1"]["tree"] = {"sequence": [down, up, quick, still]}
    file["arms"]["arm1"] |= {"gripper": gripper, "base": {"xyz": [0, 0, 0.5]}}
    play = stage.run(file)
    assert play.arm().outcome == "SUCCESS", play.arm().runs


@pytest.mark.parametrize(("robot", "reality"), [("ur5", "lab"), ("panda", "rough")])
def test_no_contact_is_detected_in_free_space(robot: str, reality: str, stage: Stage) -> None:
    leaf = stage.run(above(robot, reality, plate=False), seed=1).leaf("move_until_contact")
    assert leaf.code == "NO_CONTACT", leaf.metrics


def test_guarded_move_waits_for_the_braking_of_a_halted_leaf(stage: Stage) -> None:
    """It began from a set-point that moved: the gate clipped 100 of its own set-points."""
    fast: Tree = {"move_joints": {"by": [30, 0, 0, 0, 0, 60], "speed": 1.0}}
    halted: Tree = {"force_success": {"child": {"timeout": {"seconds": 0.25, "child": fast}}}}
    file = above("ur5", "ideal", plate=False)
    file["arms"]["arm1"]["tree"] = {"sequence": [halted, DOWN]}
    play = stage.run(file)
    assert play.leaf("move_until_contact").code == "NO_CONTACT"
    assert play.arm().clipped_setpoints == 0


@pytest.mark.parametrize(("gripper", "speed"), [("panda_hand", 0.01), ("robotiq_2f85", 0.03)])
def test_held_object_does_not_slide_when_pressed_on_the_floor(
    gripper: str, speed: float, stage: Stage
) -> None:
    """The arm moves up first: reversal of friction is not taken for contact; the estimated and true
    poses agree."""
    cube: Tree = {"shape": "box", "size": [0.05, 0.05, 0.05], "mass": 0.1}
    leaves: list[Tree] = [
        {"grasp": {"object": "cube", "speed": 1.0}},
        {"move_linear": {"offset": {"xyz": [0, 0, 0.04]}, "speed": 1.0}},
        {"move_until_contact": {"distance": 0.2, "speed": speed}},
    ]
    play = stage.run(
        {
            "world": {"scene": "empty", "time_limit": 60, "reality": "lab"},
            "objects": {"cube": cube | {"pose": {"xyz": [0.65, 0.1, 0.0255]}}},
            "arms": {"arm1": {"robot": "ur10", "gripper": gripper, "tree": {"sequence": leaves}}},
        },
        seed=3,
    )
    leaf = play.leaf("move_until_contact")
    world = play.world
    assert leaf.status == "SUCCESS", leaf.reason
    cube_now = world.object_pose("cube")
    held = world.attachments.find("arm1", "cube")
    assert held is not None
    assert cube_now.position[2] == pytest.approx(0.025, abs=1e-3), "it must not stop in the air"
    estimated = world.arms["arm1"].tool_link_pose @ held.relative
    assert estimated.distance(cube_now) < 1e-3


def test_second_guarded_move_does_not_press_harder() -> None:
    """A UR10 kept 130 N after the first contact, and pressed with 280 N in the second motion."""
    leaves = play(700171, 2, "lab").leaves
    assert [status for _, status, _, _ in leaves] == ["SUCCESS", "SUCCESS"], leaves


@pytest.mark.parametrize(
    ("robot", "reality", "speed"),
    [("so100", "lab", 0.1), ("so100", "rough", 0.1), ("so101", "ideal", 0.01)],
)
def test_an_arm_that_cannot_press_with_the_default_force_feels_the_contact(
    robot: str, reality: str, speed: float, stage: Stage
) -> None:
    """Its shoulder applied its whole torque, and it left its path: `TRACKING_ERROR`."""
    file = above(robot, reality, plate=True)
    file["objects"]["plate"]["size"] = [0.1, 0.1, 0.04]
    guarded = {"move_until_contact": DOWN["move_until_contact"] | {"speed": speed}}
    up: Tree = {"move_linear": {"offset": {"xyz": [0, 0, 0.02]}, "free": ["rx", "ry", "rz"]}}
    file["arms"]["arm1"]["tree"] = {"sequence": [guarded, up]}
    play = stage.run(file, seed=1)
    leaf = play.leaf("move_until_contact")
    assert leaf.status == "SUCCESS", leaf.reason
    assert leaf.metrics["contact_after_m"] == pytest.approx(GAP_M, abs=8e-3)  # a jaw touches first
    assert play.leaf("move_linear").status == "SUCCESS", play.leaf("move_linear").reason
