"""Random tasks that succeed, and what may happen to them.

    python -m benchmarks.random_tasks {plain,halts,faults} [--tasks 60] [--seed 0] [--kinds ...]

Picks, paths, searches by sight, tracking, handovers and carries of two arms, drawers, insertions,
arms that share a zone and meet, towers, boxes that are turned over, doors and lids, contacts, bins
that are filled and carried, and sorting by color, with random robots, objects, places and
realities. `benchmarks.further_tasks` has more: pins that go into a hole which another arm holds,
regrasps, relays of three or four arms, joints with springs, inspections by loops and conditions,
and paths of all kinds. `benchmarks.more_tasks` has arms that act together: takers that are not
told where an object goes, boxes with lids that another arm opens, cups that pick, pass on and
stack, loaded trays, arms that follow or move in step, loads that are tracked and handed over, and
cells written in MJCF. ``--kinds`` chooses among them, and ``--write N`` prints the tree of one.

``plain`` runs them as they are: some are out of reach.

``halts``: each leaf is halted once or twice after a random time, and then started again. All tasks
that succeed without that still have to, with everything where it belongs.

``faults``: one random fault of hardware or world at a random time. A task may fail then, but must
not claim a success that is none. What is moved after an arm has placed it, no sensor shows: such
false successes are printed with their fault.

Prints a line for each task, and the counts.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Final

import numpy as np
import yaml

import bt_dualarm
from benchmarks.campaign import Campaign, add_options
from benchmarks.further_tasks import FURTHER_TASKS
from benchmarks.more_tasks import MORE_TASKS
from benchmarks.random_programs import Dice
from benchmarks.task_parts import (
    DOWN,
    REACH,
    SCENE_FILE,
    Task,
    armed,
    around,
    file_of,
    fixture,
    gripper_of,
    stand,
    stands,
)
from benchmarks.why_mistake import Tree, shipped
from bt_dualarm.core.errors import DualArmError
from bt_dualarm.robots.robot_description import load_robot
from bt_dualarm.sweeps.calls import SKIPPED


def _picks(dice: Dice) -> Task:
    """An arm picks a box or a cylinder from a stand, and places it on another one."""
    arm, reach = armed(dice, list(REACH))
    angle = dice.number(-1.2, 1.2)
    width = dice.number(0.03, 0.05)
    height = dice.number(0.04, 0.08)
    top = dice.number(0.15, 0.3)
    begin = around(dice.number(0.6, 0.75) * reach, angle, top)
    goal = around(dice.number(0.6, 0.75) * reach, angle + dice.number(0.6, 1.2), top)
    upright = dice.one(["box", "cylinder"])
    size = [width, width, height] if upright == "box" else [width / 2, height]
    name = dice.one(["part", "can", "brick", "workpiece"])
    mass = dice.number(0.1, 0.4)
    lifted = round(top + height / 2 + 0.0005, 4)
    thing = {"shape": upright, "size": size, "mass": mass, "color": dice.one(["red", "blue"])}
    thing["pose"] = {"xyz": [*begin[:2], lifted]}
    objects = {"from": stand(begin), "onto": stand(goal), name: thing}
    place = [*goal[:2], lifted]
    above = [*goal[:2], lifted + 0.12]
    tree = file_of(dice, objects, {"arm1": arm})
    leaves: list[Tree] = [
        {"grasp": {"object": name}},
        {"transport": {"object": name, "to": {"xyz": above}}},
        {"place": {"object": name, "at": {"xyz": place}}},
        {"go_home": {}},
    ]
    goals = stands(name, place)
    return Task(tree, leaves, object=name, goal=place, reach=reach, goals=goals)


def _paths(dice: Dice) -> Task:
    """An arm moves to a pose and along a curve."""
    robot = dice.one(list(REACH))
    reach = REACH[robot]
    angle = dice.number(-1.2, 1.2)
    goal = around(dice.number(0.55, 0.7) * reach, angle, dice.number(0.4, 0.6) * reach)
    plane = dice.one(["xy", "xz", "yz"])
    curve = dice.one(
        [
            {"circle": {"plane": plane, "radius": dice.number(0.03, 0.07)}},
            {"lissajous": {"plane": plane, "amplitudes": [0.06, 0.04], "frequencies": [1, 2]}},
            {"move_linear": {"offset": {"xyz": [0, 0, 0.1], "frame": "world"}}},
        ]
    )
    pose = {"xyz": goal, "rpy": [*DOWN]}
    arm = {"robot": robot, "base": {"xyz": [0, 0, 0]}}
    leaves: list[Tree] = [{"reach_to_pose": {"to": pose}}, curve, {"go_home": {}}]
    return Task(file_of(dice, {}, {"arm1": arm}), leaves, goal=goal, reach=reach, duration=30.0)


def _tracks(dice: Dice) -> Task:
    """A Panda follows the cube that another arm moves."""
    tree = shipped("visual_tracking")
    tree["world"]["reality"] = dice.one(["ideal", "lab"])
    color = dice.one(["yellow", "green", "red"])
    tree["objects"]["cube"]["color"] = color
    leader = tree["arms"]["arm1"]["tree"]["sequence"]
    leader[2] = dice.one(
        [
            {"circle": {"plane": "yz", "radius": dice.number(0.06, 0.1), "turns": 2, "speed": 0.4}},
            {
                "lissajous": {
                    "plane": "yz",
                    "amplitudes": [0.08, 0.06],
                    "frequencies": [1, 2],
                    "speed": 0.3,
                }
            },
        ]
    )
    track = tree["arms"]["arm2"]["tree"]["track"]
    track |= {"color": color, "lost_timeout": 2.0}
    leaves = [{"track": track}]
    return Task(tree, leaves, arm="arm2", partner="arm1", object="cube", goal=(0.68, 0.11, 0.70))


def _handovers(dice: Dice) -> Task:
    """An arm takes a bar and hands it to another one."""
    tree = shipped("handover")
    tree["world"]["reality"] = dice.one(["ideal", "lab"])
    giver = dice.one(["ur5", "ur5e", "fr3", "panda"])
    taker = dice.one(["panda", "fr3", "xarm7", "ur5e"])
    for name, robot in (("arm1", giver), ("arm2", taker)):
        tree["arms"][name]["robot"] = robot
        tree["arms"][name]["gripper"] = gripper_of(robot)
    leaves: list[Tree] = [
        {"grasp": {"object": "bar"}},
        {"hand_over": {"object": "bar", "to": "arm2"}},
        {"go_home": {}},
    ]
    tree["arms"]["arm2"]["tree"] = {
        "sequence": [{"take_over": {"object": "bar", "from": "arm1"}}, {"go_home": {}}]
    }
    goals = {"taken": {"object": "bar", "held_by": "arm2"}}
    return Task(
        tree,
        leaves,
        partner="arm2",
        object="bar",
        goal=(0.5, 0, 0.4),
        duration=60.0,
        goals=goals,
    )


def _carries(dice: Dice) -> Task:
    """Two arms carry a beam."""
    tree = shipped("carry_together")
    tree["world"]["reality"] = dice.one(["ideal", "lab"])
    tree["objects"]["beam"]["mass"] = dice.number(1.5, 4.0, 1)
    tree["arms"]["arm1"]["robot"] = dice.one(["ur5", "ur5e"])
    leaves = list(tree["arms"]["arm1"]["tree"]["sequence"])
    return Task(tree, leaves, partner="arm2", object="beam", goal=(0.03, -0.4, 0.53), duration=60.0)


def _searches(dice: Dice) -> Task:
    """An arm looks for a cube and picks it."""
    tree = shipped("pick_by_sight")
    tree["world"]["reality"] = dice.one(["ideal", "lab"])
    robot = dice.one(["panda", "fr3", "ur5e", "xarm7"])
    tree["arms"]["arm1"]["robot"] = robot
    if robot in ("ur5e", "xarm7"):
        tree["arms"]["arm1"]["gripper"] = "robotiq_2f85"
    at = [dice.number(0.25, 0.45), dice.number(-0.55, -0.42), 0.425]
    tree["objects"]["cube"] |= {"pose": {"xyz": at}, "noise": {}}
    leaves = list(tree["arms"]["arm1"]["tree"]["sequence"])
    for i, leaf in enumerate(leaves):
        if "retry" in leaf:
            leaves[i] = leaf["retry"]["child"]
    goals = stands("cube", (0.20, -0.40, 0.425))
    return Task(tree, leaves, object="cube", goal=at, duration=60.0, goals=goals)


def _drawers(dice: Dice) -> Task:
    """An arm opens a drawer and puts a cube into it."""
    tree = shipped("drawer")
    tree["world"]["reality"] = dice.one(["ideal", "lab"])
    tree["arms"]["arm1"]["robot"] = dice.one(["ur5", "ur5e"])
    goals = tree.pop("goal")
    leaves = list(tree["arms"]["arm1"]["tree"]["sequence"])
    return Task(tree, leaves, object="cube", goal=(0.45, -0.42, 0.5), duration=60.0, goals=goals)


def _insertions(dice: Dice) -> Task:
    """An arm inserts a peg into a hole."""
    tree = shipped("peg_in_hole")
    tree["world"]["reality"] = dice.one(["ideal", "lab"])
    tree["arms"]["arm1"]["robot"] = dice.one(["ur5", "ur5e"])
    leaves = list(tree["arms"]["arm1"]["tree"]["sequence"])
    at = (0.30, -0.48, 0.44)
    goals = stands("peg", at, within=0.004)
    return Task(tree, leaves, object="peg", goal=at, duration=260.0, goals=goals)


def _meetings(dice: Dice) -> Task:
    """Two arms put their cubes on one tray, one at a time, and then meet."""
    tree = shipped("shared_bin")
    tree["world"]["reality"] = dice.one(["ideal", "lab"])
    del tree["arms"]["arm3"], tree["objects"]["blue"], tree["objects"]["shelf3"]
    tree["cell"]["rendezvous"]["all_placed"] = ["arm1", "arm2"]
    tree.pop("subtrees")

    def fill(cube: str, spot: list[float]) -> list[Tree]:
        place = [{"place": {"object": cube, "at": {"xyz": spot}}}, {"go_home": {}}]
        return [
            {"grasp": {"object": cube}},
            {"claim": {"zone": "tray", "child": {"sequence": place}}},
            {"meet": "all_placed"},
            {"go_home": {}},
        ]

    leaves = fill("red", [0.40, 0.05, 0.24])
    tree["arms"]["arm2"]["tree"] = {"sequence": fill("green", [0.58, 0.05, 0.24])}
    at = (0.4, 0.05, 0.24)
    goals = stands("red", at, 0.012) | stands("green", (0.58, 0.05, 0.24), 0.012)
    return Task(tree, leaves, partner="arm2", object="red", goal=at, duration=60.0, goals=goals)


def _towers(dice: Dice) -> Task:
    """An arm builds a tower of three boxes, each where the one below stands."""
    arm, reach = armed(dice, list(REACH))
    angle = dice.number(-1.2, 1.2)
    top = dice.number(0.1, 0.25)
    width = dice.number(0.035, 0.05)
    site = around(dice.number(0.6, 0.7) * reach, angle, top)
    objects: Tree = {"site": stand(site, 0.16)}
    leaves: list[Tree] = []
    below = "site"
    goals: Tree = {}
    for i, name in enumerate(("first", "second", "third")[: dice.count(2, 3)]):
        at = around(dice.number(0.6, 0.75) * reach, angle + 0.55 * (i + 1), top)
        height = dice.number(0.03, 0.05)
        objects[f"stand{i}"] = stand(at, 0.1)
        objects[name] = {
            "shape": "box",
            "size": [width, width, height],
            "mass": dice.number(0.05, 0.3),
            "color": dice.one(["red", "blue", "green"]),
            "pose": {"xyz": [*at[:2], round(top + height / 2 + 0.0005, 4)]},
        }
        if dice.happens(0.5):
            objects[name]["pose"]["rpy"] = [0, 0, dice.number(-45, 45, 0)]
        leaves.append({"grasp": {"object": name}})
        leaves.append({"place": {"at": {"on": below, "rpy": [0, 0, dice.one([0, 90])]}}})
        goals[name] = {"object": name, "on": below, "tilt": 3, "held": False, "lasting": 0.5}
        below = name
    leaves.append({"go_home": {}})
    tree = file_of(dice, objects, {"arm1": arm})
    return Task(tree, leaves, object="first", goal=site, reach=reach, duration=120.0, goals=goals)


def _regrasps(dice: Dice) -> Task:
    """An arm turns a box over: it stands on another side at the end."""
    arm, reach = armed(dice, list(REACH))
    angle = dice.number(-1.0, 1.0)
    top = dice.number(0.15, 0.25)
    size = [dice.number(0.03, 0.045), dice.number(0.03, 0.045), dice.number(0.07, 0.1)]
    begin = around(dice.number(0.6, 0.7) * reach, angle, top)
    goal = around(dice.number(0.6, 0.7) * reach, angle + 0.8, top)
    turned = dice.one([[90, 0, 0], [0, 90, 0], [-90, 0, 0], [0, -90, 0], [180, 0, 0]])
    height = {90: size[1], -90: size[1]}.get(turned[0], size[0] if turned[1] else size[2])
    objects: Tree = {"from": stand(begin, 0.2), "onto": stand(goal, 0.2)}
    lifted = round(top + size[2] / 2 + 0.0005, 4)
    objects["block"] = {
        "shape": "box",
        "size": size,
        "mass": dice.number(0.05, 0.3),
        "color": "red",
        "pose": {"xyz": [*begin[:2], lifted]},
    }
    place = [*goal[:2], round(top + height / 2, 4)]
    then = {"xyz": place, "rpy": turned}
    leaves: list[Tree] = [
        {"grasp": {"object": "block", "then_at": then}},
        {"place": {"object": "block", "at": then}},
        {"go_home": {}},
    ]
    if turned[0] == 180:
        side = {"xyz": [*begin[:2], round(top + size[1] / 2, 4)], "rpy": [90, 0, 0]}
        leaves = [
            {"grasp": {"object": "block", "then_at": side}},
            {"place": {"object": "block", "at": side}},
            *leaves,
        ]
    goals = {"turned": {"object": "block", "at": then, "within": 0.01, "angle": 5, "held": False}}
    tree = file_of(dice, objects, {"arm1": arm})
    return Task(tree, leaves, object="block", goal=place, reach=reach, duration=90.0, goals=goals)


def _doors(dice: Dice) -> Task:
    """An arm opens a door, lid or drawer by its handle, and shuts it."""
    arm, reach = armed(dice, ["ur5", "ur5e", "ur10", "ur10e", "panda", "fr3", "xarm7"])
    angle = dice.number(-1.0, 1.0)
    kind = dice.one(["door", "lid", "drawer"])
    at = around(dice.number(0.75, 0.9) * reach, angle, dice.number(0.3, 0.5))
    yaw = round(float(np.degrees(angle)) + dice.number(-20, 20), 1)
    side = dice.one([1, -1])
    parts: Tree = {"body": {"shape": "box", "size": [0.1, 0.26, 0.2]}}
    joint: Tree = {"mass": dice.number(0.2, 1.0), "damping": dice.number(0.1, 0.6)}
    if kind == "door":
        # Its front is at -x, where the arm is; the hinge is at one of its sides.
        parts["panel"] = {
            "shape": "box",
            "size": [0.012, 0.24, 0.18],
            "pose": {"xyz": [-0.058, 0, 0]},
        }
        parts["bar"] = {
            "shape": "box",
            "size": [0.03, 0.012, 0.08],
            "pose": {"xyz": [-0.08, -side * 0.09, 0]},
        }
        joint |= {
            "type": "hinge",
            "axis": [0, 0, 1],
            "anchor": [-0.058, side * 0.12, 0],
            "range": sorted([0, side * -80]),
            "parts": ["panel", "bar"],
            "friction": dice.number(0.05, 0.4),
        }
        there: float = side * -dice.number(30, 60, 0)
        tolerance = 4.0
    elif kind == "lid":
        parts["panel"] = {
            "shape": "box",
            "size": [0.12, 0.26, 0.012],
            "pose": {"xyz": [0, 0, 0.107]},
        }
        parts["bar"] = {
            "shape": "box",
            "size": [0.03, 0.08, 0.012],
            "pose": {"xyz": [-0.074, 0, 0.107]},
        }
        joint |= {
            "type": "hinge",
            "axis": [0, 1, 0],
            "anchor": [0.06, 0, 0.107],
            "range": [0, 90],
            "parts": ["panel", "bar"],
            "friction": dice.number(0.3, 0.8),
        }
        there = dice.number(30, 60, 0)
        tolerance = 4.0
    else:
        parts["panel"] = {
            "shape": "box",
            "size": [0.012, 0.2, 0.1],
            "pose": {"xyz": [-0.058, 0, 0]},
        }
        parts["bar"] = {
            "shape": "box",
            "size": [0.04, 0.1, 0.012],
            "pose": {"xyz": [-0.083, 0, 0]},
        }
        joint |= {
            "type": "slide",
            "axis": [-1, 0, 0],
            "range": [0, 0.2],
            "parts": ["panel", "bar"],
            "damping": dice.number(2, 15),
            "friction": dice.number(0.5, 5),
        }
        there = dice.number(0.06, 0.12)
        tolerance = 0.006
    of: Tree = {"object": "chest", "joint": "axle"}
    leaves: list[Tree] = [
        {"grasp": {"object": "chest", "part": "bar", "then_to": there}},
        {"operate": of | {"to": there}},
        {"operate": of | {"to": 0}},
        {"release": {}},
        {"go_home": {}},
    ]
    tree = file_of(dice, {"chest": fixture(at, yaw, parts, joint)}, {"arm1": arm})
    goals = {"shut": of | {"between": [-tolerance, tolerance]}}
    return Task(tree, leaves, object="chest", goal=at, reach=reach, duration=90.0, goals=goals)


def _contacts(dice: Dice) -> Task:
    """An arm finds a surface by touch and follows a path above it."""
    robot = dice.one(list(REACH))
    reach = REACH[robot]
    angle = dice.number(-1.2, 1.2)
    top = dice.number(0.1, 0.3)
    board = around(dice.number(0.55, 0.7) * reach, angle, top)
    above = [*board[:2], round(top + dice.number(0.05, 0.1), 3)]
    size = dice.number(30, 60, 0)
    path: Tree = dice.one(
        [
            {
                "follow_path": {
                    "points": [[0, 0], [size, 0], [size, size]],
                    "plane": "xy",
                    "tool_speed": 0.03,
                }
            },
            {"draw": {"points": [[0.03, 0], [0, 0.03], [-0.03, 0]], "plane": "xy"}},
            {"circle": {"plane": "xy", "radius": dice.number(0.02, 0.04)}},
        ]
    )
    leaves: list[Tree] = [
        {"reach_to_pose": {"to": {"xyz": above, "rpy": [*DOWN]}}},
        {"move_until_contact": {"distance": 0.15, "force": dice.number(8, 30, 0)}},
        {"move_linear": {"offset": {"xyz": [0, 0, 0.03]}}},
        path,
        {"go_home": {}},
    ]
    tree = file_of(dice, {"board": stand(board, 0.25)}, {"arm1": {"robot": robot}})
    return Task(tree, leaves, goal=above, reach=reach, duration=60.0)


def _trays(dice: Dice) -> Task:
    """An arm puts a cube into a bin, and carries the bin away."""
    arm, reach = armed(dice, list(REACH))
    angle = dice.number(-1.0, 1.0)
    top = dice.number(0.1, 0.25)
    size = [dice.number(0.09, 0.12), dice.number(0.06, 0.075), 0.04]
    begin = around(dice.number(0.6, 0.7) * reach, angle, top)
    middle = around(dice.number(0.6, 0.7) * reach, angle + 0.7, top)
    goal = around(dice.number(0.6, 0.7) * reach, angle + 1.4, top)
    cube = dice.number(0.025, 0.035)
    objects: Tree = {
        "from": stand(begin, 0.1),
        "site": stand(middle, 0.16),
        "onto": stand(goal, 0.16),
        "cube": {
            "shape": "box",
            "size": [cube] * 3,
            "mass": dice.number(0.02, 0.1),
            "color": "red",
            "pose": {"xyz": [*begin[:2], round(top + cube / 2 + 0.0005, 4)]},
        },
        "crate": {
            "shape": "bin",
            "size": size,
            "wall": 0.004,
            "mass": dice.number(0.1, 0.3),
            "color": "blue",
            "pose": {"xyz": [*middle[:2], round(top + 0.02 + 0.0005, 4)]},
        },
    }
    at = [*goal[:2], round(top + 0.0205, 4)]
    leaves: list[Tree] = [
        {"grasp": {"object": "cube"}},
        {"place": {"at": {"on": "crate"}}},
        {"grasp": {"object": "crate"}},
        {"place": {"at": {"xyz": at}}},
        {"go_home": {}},
    ]
    goals = stands("crate", at) | {"inside": {"object": "cube", "on": "crate"}}
    tree = file_of(dice, objects, {"arm1": arm})
    return Task(tree, leaves, object="cube", goal=at, reach=reach, duration=90.0, goals=goals)


def _sorts(dice: Dice) -> Task:
    """An arm finds objects by their color and puts each beside a mark, in a loop over a subtree."""
    arm, reach = armed(dice, ["ur5", "ur5e", "panda", "fr3", "xarm7", "ur10e"], camera={})
    angle = dice.number(-0.8, 0.8)
    top = dice.number(0.15, 0.25)
    middle = around(0.65 * reach, angle, top)
    objects: Tree = {"bench": stand(middle, 0.5)}
    colors = dice.order(["red", "green", "blue", "orange"])[: dice.count(1, 3)]
    cube = dice.number(0.03, 0.045)
    z = round(top + cube / 2 + 0.0005, 4)
    goals: Tree = {}
    spots: list[list[float]] = []
    for i, color in enumerate(colors):
        x, y = middle[0] + 0.09 * (i - 1), middle[1] - 0.06
        objects[color] = {
            "shape": "box",
            "size": [cube] * 3,
            "mass": 0.1,
            "color": color,
            "pose": {"xyz": [round(x, 3), round(y, 3), z]},
            "noise": {"xyz": [0.015, 0.02, 0], "yaw": 45},
        }
        spots.append([round(x, 3), round(middle[1] + 0.12, 3), z])
        goals |= stands(color, spots[-1], 0.012)
    look = {"center": [*middle[:2], z], "width": 0.25, "depth": 0.15}
    body: list[Tree] = [
        {"scan": {"object": "{thing}", **look}},
        {"locate": {"object": "{thing}", "pose": "{where}"}},
        {"grasp": {"object": "{thing}", "at": "{where}"}},
        {"place": {"at": {"xyz": "{to}"}}},
    ]
    tree = file_of(dice, objects, {"arm1": arm})
    tree["subtrees"] = {
        "put": {
            "params": {"thing": {"type": "object"}, "to": {"type": "vector"}},
            "tree": {"sequence": body},
        }
    }
    leaves: list[Tree] = [
        {"subtree": {"use": "put", "params": {"thing": color, "to": spot}}}
        for color, spot in zip(colors, spots, strict=True)
    ]
    leaves.append({"go_home": {}})
    return Task(
        tree, leaves, object=colors[0], goal=middle, reach=reach, duration=120.0, goals=goals
    )


FIRST_TASKS: Final[Mapping[str, Callable[[Dice], Task]]] = {
    "pick": _picks,
    "path": _paths,
    "track": _tracks,
    "handover": _handovers,
    "carry": _carries,
    "sight": _searches,
    "drawer": _drawers,
    "insert": _insertions,
    "meeting": _meetings,
    "tower": _towers,
    "turn": _regrasps,
    "door": _doors,
    "contact": _contacts,
    "tray": _trays,
    "sort": _sorts,
}
TASKS: Final[Mapping[str, Callable[[Dice], Task]]] = {**FIRST_TASKS, **FURTHER_TASKS, **MORE_TASKS}


# What may happen to them: halts and faults.


NOT_HALTED: Final = frozenset(
    {"meet", "claim", "signal", "await", "parallel", "for_each", "while", "repeat", "set"}
)
"""Nodes that are not halted: others count on them, or they would begin to count anew."""

JOINT_SKILLS: Final = ("hand_over", "take_over", "carry_together", "in_step")


def halted(task: Task, dice: Dice) -> None:
    """Halt each leaf once or twice after a random time, and start it again."""
    is_joint = any(task.has(skill) for skill in JOINT_SKILLS)
    _halt(task.leaves, dice, is_joint=is_joint)
    for name in task.halted:
        parent = task.tree["arms"].get(name) or task.tree["subtrees"][name]
        _halt(parent["tree"]["sequence"], dice, is_joint=is_joint)
    for name, arm in task.tree["arms"].items():
        if is_joint and name not in (task.arm, *task.halted):
            arm["tree"] = {
                "sequence": [
                    {"retry": {"times": 6, "child": leaf}} for leaf in arm["tree"]["sequence"]
                ]
            }


def _halt(leaves: list[Tree], dice: Dice, *, is_joint: bool) -> None:
    for i, given in enumerate(leaves):
        leaf = {given: {}} if isinstance(given, str) else given
        inner = leaf.get("claim", {}).get("child", {}).get("sequence")
        if inner and "zone" in leaf["claim"] and leaf["claim"]["zone"] != "tray":
            _halt(inner, dice, is_joint=is_joint)
        if set(leaf) & NOT_HALTED:
            continue
        halts = [
            {"timeout": {"seconds": dice.number(0.05, 3.0, 2), "child": leaf}}
            for _ in range(dice.count(1, 2))
        ]
        # The partner may still be giving up what was halted.
        times = 2 if set(leaf) & {"grasp", "hand_over", "carry_together"} else 6
        last = {"retry": {"times": times, "child": leaf}} if is_joint else leaf
        leaves[i] = {"selector": [*halts, last]}


JOINT_FAULTS: Final = (
    "weak_joint",
    "frozen_joint",
    "saturated_drive",
    "loose_joint",
    "stuck_encoder",
)
CAMERA_FAULTS: Final = ("frozen_camera", "dark_camera", "late_camera", "shaking_camera")
OBJECT_FAULTS: Final = ("pushed_object", "removed_object", "reduced_friction", "swapped_object")


def disturbed(task: Task, dice: Dice) -> None:
    """Add one random fault of hardware or world."""
    tree = task.tree
    arm = dice.one(list(tree["arms"]))
    objects = [name for name, one in tree["objects"].items() if not one.get("fixed")]
    kinds = [*JOINT_FAULTS, *(CAMERA_FAULTS if "camera" in tree["arms"][arm] else ())]
    kind = dice.one([*kinds, *(OBJECT_FAULTS if objects else ())])
    begin = dice.number(0.2, 9, 2)
    fault: Tree = {"kind": kind, "begin": f"{begin} s"}
    if dice.happens(0.6) or kind == "pushed_object":
        fault["until"] = f"{begin + dice.number(0.1, 2.0, 2):.2f} s"
    if kind in JOINT_FAULTS:
        robot = load_robot(tree["arms"][arm]["robot"])
        fault |= {"arm": arm, "joint": dice.one(robot.joints)}
        of_joint: Tree = {
            "weak_joint": {"strength": dice.number(0.02, 0.6, 2)},
            "saturated_drive": {"limit": dice.number(0.02, 0.5, 2)},
            "loose_joint": {"play": f"{dice.number(0.1, 3, 1)} deg"},
        }
        fault |= of_joint.get(kind, {})
    elif kind in CAMERA_FAULTS:
        fault["arm"] = arm
    else:
        fault["object"] = dice.one(objects)
        others = [name for name in objects if name != fault["object"]]
        if kind == "swapped_object" and not others:
            fault["kind"] = "removed_object"
        of_object: Tree = {
            "pushed_object": {"force": [dice.number(-6, 6, 1) for _ in range(2)] + [0]},
            "reduced_friction": {"friction": dice.number(0.02, 0.3, 2)},
            "swapped_object": {"other": others[0]} if others else {},
        }
        fault |= of_object.get(kind, {})
    tree["faults"] = {"fault": fault}


def unchanged(task: Task, dice: Dice) -> None:
    """Leave a task as it is."""


CHANGES: Final[Mapping[str, Callable[[Task, Dice], None]]] = {
    "plain": unchanged,
    "halts": halted,
    "faults": disturbed,
}


def written(change: str, number: int, seed: int, kinds: Sequence[str]) -> tuple[Task, Tree, str]:
    """A task that was changed, its tree, and what to call it."""
    dice = Dice(100_000 * seed + number)
    name = dice.one(kinds)
    task = TASKS[name](dice)
    robots = "+".join(str(arm["robot"]) for arm in task.tree["arms"].values())
    what = f"{number} {name} {robots} {task.tree['world']['reality']}"
    CHANGES[change](task, dice)
    tree = task.finish()
    tree["goal"] = task.goals or None
    tree = {key: value for key, value in tree.items() if value}
    tree["world"]["time_limit"] = 240
    copied: Tree = json.loads(json.dumps(tree))  # else YAML would name what is used twice
    return task, copied, what


def evaluate(change: str, number: int, seed: int, kinds: Sequence[str]) -> dict[str, Any]:
    """Run a task that was changed, and judge it."""
    task, tree, what = written(change, number, seed, kinds)
    try:
        if task.scene:
            with TemporaryDirectory() as folder:
                Path(folder, SCENE_FILE).write_text(task.scene, encoding="utf-8")
                file = Path(folder, "tree.yaml")
                file.write_text(yaml.safe_dump(tree, sort_keys=False), encoding="utf-8")
                result = bt_dualarm.run(file)
        else:
            result = bt_dualarm.run(tree)
    except DualArmError as error:
        return {"outcome": SKIPPED, "line": f"--  {what}: {' '.join(str(error).split())[:150]}"}
    is_false = result.outcome == "SUCCESS" and bool(task.goals) and not result.goals_met
    is_good = result.outcome == "SUCCESS" and not is_false and result.at_rest
    if change == "faults":
        what += f" {tree['faults']['fault']}"
        is_good = not is_false
    failed = [
        f"{arm}: {leaf.path}: {leaf.code}: {leaf.reason}"
        for arm, one in result.arms.items()
        for leaf in one.runs
        if leaf.status == "FAILURE"
    ]
    missed = [goal.reason for goal in result.goals.values() if not goal.met]
    why = "" if is_good else "; ".join([*failed[-2:], *missed])
    is_halted = change == "halts" and not is_good
    if is_halted and evaluate("plain", number, seed, kinds)["outcome"] != "SUCCESS":
        return {"outcome": SKIPPED, "line": f"--  {what}: fails without halts: {why}"}
    line = f"{'yes' if is_good else 'NO '} {what}: {result.outcome} {why}".rstrip()
    code = "FALSE_SUCCESS" if is_false else "" if is_good else "FAILED"
    return {"outcome": "SUCCESS" if is_good else "FAILURE", "code": code, "line": line}


def main() -> None:
    """Run the tasks and print the counts."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("change", choices=list(CHANGES))
    parser.add_argument("--tasks", type=int, default=60)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--kinds", nargs="+", choices=list(TASKS), default=list(TASKS))
    parser.add_argument("--write", type=int, help="print the tree of one task; run nothing")
    add_options(parser)
    options = parser.parse_args()
    if options.write is not None:
        task, tree, _ = written(options.change, options.write, options.seed, options.kinds)
        print(yaml.safe_dump(tree, sort_keys=False, default_flow_style=None))
        if task.scene:
            print("".join(f"# {line}\n" for line in [SCENE_FILE, *task.scene.splitlines()]))
        return
    good = counted = 0
    with Campaign(options) as campaign:
        cases = [
            {
                "change": options.change,
                "number": number,
                "seed": options.seed,
                "kinds": options.kinds,
            }
            for number in range(options.tasks)
        ]
        for _, found in campaign.run(evaluate, cases):
            good += found["outcome"] == "SUCCESS"
            counted += found["outcome"] != SKIPPED
            print(found["line"], flush=True)
    is_false = "claimed no success that was none"
    what = is_false if options.change == "faults" else "succeeded"
    print(f"{good} of {counted} tasks {what}")


if __name__ == "__main__":
    main()
