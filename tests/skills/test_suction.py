"""Suction cups on flat, light, tall or hollow objects."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import bt_dualarm as bt
from bt_dualarm.runtime.arm_runtime import IdleObserver
from bt_dualarm.sim.world import World
from tests.plays import Stage

Tree = dict[str, Any]

TOP = 0.30
"""Height of the table, which the bases stand on, too, m."""


def file_of(robot: str, obj: Tree, leaves: list[Tree | str], reality: str) -> Tree:
    """A file with an arm with a suction cup at a table with one object."""
    table = {"shape": "box", "size": [2.4, 2.4, TOP], "fixed": True, "color": "gray"}
    arm = {"robot": robot, "gripper": "suction_cup", "base": {"xyz": [0, 0, TOP]}}
    return {
        "name": "suction",
        "world": {"scene": "empty", "reality": reality, "time_limit": 60},
        "objects": {
            "table": table | {"pose": {"xyz": [0, 0, 0.5 * TOP]}},
            "thing": obj | {"color": "red"},
        },
        "arms": {"arm1": arm | {"tree": {"sequence": leaves}}},
    }


class Fastest(IdleObserver):
    """Largest speed of any joint of the arm as a fraction of its limit."""

    def __init__(self, world: World) -> None:
        self._world = world
        self.fraction = 0.0

    def after_step(self, time: float) -> None:
        arm = self._world.arms["arm1"]
        limits = self._world.nominal["arm1"].robot.limits.velocity
        self.fraction = max(self.fraction, float((np.abs(arm.v) / limits).max()))


def test_release_of_a_tray_held_by_its_floor_leaves_the_wrist_at_rest() -> None:
    """The tray's inertia at the last wrist joint is thirty times that of the joint."""
    tray = {"shape": "tray", "size": [0.1753, 0.1227, 0.03], "wall": 0.0038, "mass": 0.789}
    tray["pose"] = {"xyz": [0.274, 0.11, TOP + 0.016], "rpy": [0, 0, -84.4]}
    leaves: list[Tree | str] = [{"grasp": {"object": "thing"}}, {"regrasp": {"object": "thing"}}]
    with bt.open({"bt_dualarm": 1} | file_of("ur3e", tray, leaves, "ideal"), seed=1028) as run:
        fastest = Fastest(run.world)
        run.watch(fastest)
        result = run.finish()
    assert result.outcome == "SUCCESS", result.arms["arm1"].runs[-1].reason
    assert fastest.fraction < 1.05


def test_suction_force_does_not_use_up_joint_torque(stage: Stage) -> None:
    """Held from the side, 60 N of suction would be 18 N m of the third joint's 30 N m.

    MuJoCo's limit on the actuator forces of a joint would count them.
    """
    box = {"shape": "box", "size": [0.0581, 0.0129, 0.1342], "mass": 0.107}
    box["pose"] = {"xyz": [0.36, 0.312, TOP + 0.0681], "rpy": [0, 0, 15.0]}
    up = {"transport": {"object": "thing", "to": {"xyz": [0.473, 0.068, TOP + 0.25]}}}
    play = stage.run(file_of("xarm7", box, [{"grasp": {"object": "thing"}}, up], "lab"), seed=1036)
    assert play.leaf("transport").status == "SUCCESS", play.leaf("transport").reason
    assert not play.world.model.jnt_actfrclimited.any()


@pytest.mark.parametrize(
    ("robot", "size", "at"),
    [
        ("fr3", (0.0317, 0.0519, 0.1525), (0.489, 0.088, 68.4)),
        ("xarm7", (0.0338, 0.068, 0.1274), (0.254, -0.362, 62.8)),
    ],
)
def test_tall_object_does_not_tip_over(
    robot: str, size: tuple[float, ...], at: tuple[float, float, float], stage: Stage
) -> None:
    """Only its sides are wide enough for the cup."""
    x, y, yaw = at
    box = {"shape": "box", "size": [*size], "mass": 0.23}
    box["pose"] = {"xyz": [x, y, TOP + 0.5 * size[2] + 0.001], "rpy": [0, 0, yaw]}
    play = stage.run(file_of(robot, box, [{"grasp": {"object": "thing"}}], "lab"))
    assert play.leaf("grasp").status == "SUCCESS", play.leaf("grasp").reason


def test_lift_waits_for_a_hand_that_comes_near_as_the_cup_takes_hold() -> None:
    """Another hand slowly descends toward the far end of a board, until it returns home.

    From the moment in which the cup holds it, the board is a part of its arm: the other hand, which
    may come as near as it likes to an object, is then too near for any motion.
    """
    board = {"shape": "box", "size": [0.5, 0.06, 0.02], "mass": 0.2}
    board["pose"] = {"xyz": [0.4, -0.3, TOP + 0.01]}
    grasp = {"grasp": {"object": "thing", "point": [-0.15, 0, 0.01]}}
    file: Tree = {"bt_dualarm": 1} | file_of("ur5", board, [grasp], "ideal")
    above = {"xyz": [0.62, -0.3, TOP + 0.1], "rpy": [180, 0, 90]}
    down = {"move_linear": {"offset": {"xyz": [0, 0, -0.065]}, "speed": 0.02}}
    leaves = [
        {"reach_to_pose": {"to": above}},
        {"wait": 1.0},
        {"force_success": {"child": {"timeout": {"seconds": 6, "child": down}}}},
        "go_home",
    ]
    base = {"xyz": [1.15, -0.3, TOP], "rpy": [0, 0, 180]}
    other = {"robot": "panda", "gripper": "panda_hand", "base": base}
    file["arms"]["arm2"] = other | {"tree": {"sequence": leaves}}
    result = bt.run(file)
    assert result.outcome == "SUCCESS", result.arms["arm1"].runs[-1].reason


@pytest.mark.parametrize(("robot", "mass"), [("fr3", 0.0074), ("xarm7", 0.0061), ("ur5", 0.015)])
@pytest.mark.parametrize("reality", ["ideal", "lab", "rough"])
def test_light_object_does_not_come_along_with_a_cup(robot: str, mass: float, reality: str) -> None:
    """The last hundredth of a vacuum holds 60 g: it lifted a prism of 7 g."""
    prism = {"shape": "prism", "size": [0.028, 0.06], "mass": mass}
    prism["pose"] = {"xyz": [0.42, 0.18, TOP + 0.0304]}
    goal = {"xyz": [0.42, -0.18, TOP + 0.0304], "rpy": [0, 0, 0]}
    leaves: list[Tree | str] = [{"grasp": {"object": "thing"}}, {"place": {"at": goal}}, "go_home"]
    result = bt.run({"bt_dualarm": 1} | file_of(robot, prism, leaves, reality))
    assert result.outcome == "SUCCESS", result.arms["arm1"].runs[-1].reason
