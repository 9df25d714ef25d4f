"""Contacts of an arm with objects are among the metrics of the leaf that moved it."""

from __future__ import annotations

import numpy as np
import pytest

from bt_dualarm.core.errors import OverlapError
from bt_dualarm.core.pose import Pose
from bt_dualarm.sim.world import World
from tests.families import some
from tests.plays import Stage
from tests.skills.scenarios import CABINET, GRIPPING, PULLS, Tree

BALL: Tree = {"shape": "sphere", "size": [0.04], "mass": 0.1, "spawned": False}


def drop(world: World) -> None:
    """Spawn the ball 0.35 m above the tool."""
    x, y, z = world.arms["arm1"].tool_pose.position.tolist()
    world.spawn_object("ball", Pose.from_rpy((x, y, z + 0.35)))


@pytest.mark.parametrize(
    ("robot", "node"),
    [
        ("ur5", {"circle": {"plane": "yz", "radius": 0.05, "speed": 0.2}}),
        ("panda", {"move_joints": {"by": {"panda_joint1": 20}, "speed": 0.1}}),
        ("xarm7", {"move_linear": {"offset": {"xyz": [0, 0.15, 0]}, "speed": 0.1}}),
    ],
)
def test_ball_that_falls_on_the_arm_is_in_the_metrics(robot: str, node: Tree, stage: Stage) -> None:
    """Whether the motion continues or is aborted; without the ball no contact is reported."""
    file: Tree = {
        "world": {"scene": "empty", "time_limit": 20},
        "objects": {"ball": BALL},
        "arms": {"arm1": {"robot": robot, "base": {"xyz": [0, 0, 0.4]}, "tree": node}},
    }
    (name,) = node
    leaf = stage.run(file, interventions=[(0.6, drop)]).leaf(name)
    assert leaf.metrics["touched"] == "ball"
    assert 0.0 < float(leaf.metrics["touch_force_n"]) < 1e4
    clear = stage.run(file).leaf(name)
    assert clear.status == "SUCCESS", clear.reason
    assert "touched" not in clear.metrics


def test_an_object_that_was_held_does_not_count_as_touched(stage: Stage) -> None:
    """A cup still touches the box that it has released; `place` need not name it."""
    box: Tree = {"shape": "box", "size": [0.12, 0.08, 0.07], "mass": 0.3}
    place: Tree = {"place": {"at": {"xyz": [0.45, 0.1, 0.035]}}}
    arm: Tree = {
        "robot": "xarm7",
        "gripper": "suction_cup",
        "tree": {"sequence": [{"grasp": {"object": "box"}}, place]},
    }
    file: Tree = {
        "world": {"scene": "empty", "reality": "lab", "time_limit": 30},
        "objects": {"box": {**box, "pose": {"xyz": [0.45, 0, 0.035]}}},
        "arms": {"arm1": arm},
    }
    leaf = stage.run(file).leaf("place")
    assert leaf.status == "SUCCESS", leaf.reason
    assert "touched" not in leaf.metrics


def test_what_moves_on_a_joint_of_the_named_object_does_not_count_as_touched(stage: Stage) -> None:
    """The handle of a named cabinet belongs to the object that the joint moves."""
    file: Tree = {
        "world": {"scene": "table", "reality": "lab", "time_limit": 30},
        "objects": CABINET,
        "arms": {"arm1": GRIPPING | {"tree": PULLS}},
    }
    leaf = stage.run(file).leaf("grasp")
    assert leaf.status == "SUCCESS", leaf.reason
    assert "touched" not in leaf.metrics, leaf.metrics


def put_wall(world: World) -> None:
    """Spawn the wall in the direction of motion, as near to the tool as there is room."""
    x, y, z = world.arms["arm1"].tool_pose.position.tolist()
    for gap in np.arange(0.04, 0.2, 0.004).tolist():
        try:
            world.spawn_object("wall", Pose.from_rpy((x, y + gap, z)))
        except OverlapError:
            continue
        return


@pytest.mark.parametrize("robot", ["ur5", "xarm7", "panda"])
def test_collision_beyond_the_force_limit_is_a_failure(robot: str, stage: Stage) -> None:
    """A wall appears right in front of the moving tool."""
    node: Tree = {"move_linear": {"offset": {"xyz": [0, 0.12, 0]}, "speed": 1.0}}
    wall: Tree = {"shape": "box", "size": [0.06, 0.06, 0.06], "mass": 100, "spawned": False}
    arm: Tree = {"robot": robot, "base": {"xyz": [0, 0, 0.4]}, "force_limit": 20, "tree": node}
    file: Tree = {
        "world": {"scene": "empty", "time_limit": 20},
        "objects": {"wall": wall},
        "arms": {"arm1": arm},
    }
    leaf = stage.run(file, interventions=[(0.25, put_wall)]).leaf("move_linear")
    assert (leaf.status, leaf.code) == ("FAILURE", "FORCE_LIMIT")
    assert leaf.metrics["second"] == leaf.metrics["touched"] == "wall"
    assert leaf.metrics["force_limit_n"] == 20
    assert float(leaf.metrics["force_n"]) > 20


@pytest.mark.parametrize(
    ("robot", "mass", "reality"),
    some([("ur10", 8.0, "rough"), ("ur10", 8.0, "lab"), ("ur5", 4.0, "lab")], 2),
)
def test_heavy_object_can_be_carried(robot: str, mass: float, reality: str, stage: Stage) -> None:
    """The tool presses on it until it is attached; then its weight, known or not, is no contact."""
    take: Tree = {"approach_and_attach": {"object": "box"}}
    lift: Tree = {"transport": {"object": "box", "to": {"xyz": [0.45, -0.2, 0.15]}}}
    pose: Tree = {"xyz": [0.45, -0.3, 0.03]}
    box: Tree = {"shape": "box", "size": [0.06, 0.06, 0.06], "mass": mass, "pose": pose}
    file: Tree = {
        "world": {"scene": "empty", "time_limit": 30, "reality": reality},
        "objects": {"box": box},
        "arms": {"arm1": {"robot": robot, "tree": {"sequence": [take, lift]}}},
    }
    play = stage.run(file)
    assert [(leaf.skill, leaf.code) for leaf in play.arm().runs] == [
        ("approach_and_attach", ""),
        ("transport", ""),
    ]
