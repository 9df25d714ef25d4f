"""Tasks of public two-arm benchmarks, rebuilt from their published facts.

    python -m benchmarks.two_arm_tasks [--trials 5] [--robots fr3 panda ur5e xarm7] [--seed 0]
                                       [--reality lab] [--only TASK ...] [--speed 0.5] [--verbose]

Fifteen tasks after DuoBench and robosuite: poses, sizes, masses and joints are those of the
benchmarks as far as they are known, except for what docs/benchmarks.md lists; each trial has its
own random start. Each arm has its own tree, and the goals of the file are checked in the true
world. Unlike in the benchmarks, trees know the objects by their declarations, and no policy is
learned: the figures show whether arms of this framework can do these tasks, not how they compare
with learning from images.

Sources: RobotControlStack/duobench, `src/duobench/tasks`; ARISE-Initiative/robosuite,
`robosuite/environments/manipulation/two_arm_*.py`. Steps of DuoBench (at 30 Hz) are those quoted
from Table 4 of arXiv 2606.11901. Exits with code 1 if less than 90 % succeed.
"""

from __future__ import annotations

import argparse
import json
import math
import statistics
import sys
from collections import Counter, defaultdict
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Final

import numpy as np

from benchmarks.campaign import Campaign, add_options, registry
from bt_dualarm.behaviors.load import load_tree_file
from bt_dualarm.core.errors import DualArmError
from bt_dualarm.core.pose import Pose
from bt_dualarm.runtime.options import RunOptions
from bt_dualarm.runtime.run import Run

Tree = dict[str, Any]

ROBOTS: Final = ("fr3", "panda", "ur5e", "xarm7")
SHARE: Final = 0.9
_UP: Final = 0.8095
"""Height of the frame of DuoBench's positions, m."""

_TOP: Final = 0.0125
"""Height of the table's top in that frame, m."""

_LYING: Final = [0.6830127, 0.1830127, 0.6830127, 0.1830127]
"""Orientation of a hexagonal prism that lies on a side, along x."""

_ATTEMPTS: Final = 20
LIMIT_S: Final = 150.0


def _xyz(x: float, y: float, z: float) -> list[float]:
    """Position in the world, m, from one in the frame of DuoBench."""
    return [round(float(one), 4) for one in (x, y, z + _UP)]


def _on_table(x: float, y: float, height: float) -> list[float]:
    """Position of the center of an object of this height on the table, m."""
    return _xyz(x, y, _TOP + height / 2)


def _box(size: list[float], mass: float, xyz: list[float], yaw: float = 0.0, **more: Any) -> Tree:
    pose = {"xyz": xyz, "rpy": [0, 0, round(float(yaw), 1)]}
    return {"shape": "box", "size": size, "mass": mass, "pose": pose, **more}


def _fixed(size: list[float], xyz: list[float], **more: Any) -> Tree:
    return {"shape": "box", "size": size, "fixed": True, "pose": {"xyz": xyz}, **more}


def _between(x: list[float], y: list[float], z: list[float]) -> Tree:
    """Part of a compound that is a box between these coordinates."""
    spans = np.array([x, y, z])
    size, xyz = np.diff(spans)[:, 0], spans.mean(axis=1)
    return {"shape": "box", "size": size.round(5).tolist(), "pose": {"xyz": xyz.round(5).tolist()}}


def arms(robot: str, left: Tree, right: Tree, *, opposed: bool = False) -> Tree:
    """Both arms with their trees, placed as in DuoBench, or side by side for other robots.

    Args:
        robot: Name of both robots.
        left: Tree of the left arm.
        right: Tree of the right arm.
        opposed: Whether they stand face to face at the ends of the table, as in robosuite.
    """
    placed: Tree = {}
    for name, tree, side in (("left", left, 1.0), ("right", right, -1.0)):
        if opposed:
            base = {"xyz": _xyz(0.45, 0.6 * side, _TOP), "rpy": [0, 0, -90 * side]}
        elif robot in ("fr3", "panda"):
            roll, yaw = -51.2 * side, -26.6 * side
            base = {"xyz": _xyz(0.0, 0.05018 * side, 0.342), "rpy": [roll, -10, yaw]}
        else:
            base = {"xyz": _xyz(-0.05, 0.3 * side, 0.05)}
        placed[name] = {"robot": robot, "gripper": "robotiq_2f85", "base": base, "tree": tree}
    return placed


def _file(
    robot: str,
    objects: Tree,
    left: list[Any],
    right: list[Any],
    goal: Tree,
    *,
    opposed: bool = False,
) -> Tree:
    table = _fixed([0.78, 1.392, 0.04], _xyz(0.495, 0.0, _TOP - 0.02), color="white")
    return {
        "world": {"scene": "empty", "time_limit": LIMIT_S},
        "objects": {"table": table, **objects},
        "arms": arms(robot, {"sequence": left}, {"sequence": right}, opposed=opposed),
        "goal": goal,
    }


def _offset(rng: np.random.Generator, x: float, y: float) -> tuple[float, float]:
    """Random offset within half-widths, m."""
    return float(rng.uniform(-x, x)), float(rng.uniform(-y, y))


def _long_box(rng: np.random.Generator, y: float) -> Tree:
    """Upright box of 32 by 32 by 96 mm at a random pose."""
    dx, dy = _offset(rng, 0.175, 0.175)
    at = _on_table(0.5 + dx, y + dy, 0.096)
    return _box([0.032, 0.032, 0.096], 0.0049, at, rng.uniform(-180, 180), friction=1.5)


def transfer_gate(rng: np.random.Generator, robot: str) -> Tree:
    """One arm hands a box through a ring to the other one, which sets it on a mat."""
    ring: Tree = {"shape": "compound", "fixed": True, "pose": {"xyz": _xyz(0.4, 0.0, 0.02)}}
    parts: Tree = {
        "post": {"shape": "cylinder", "size": [0.01, 0.25], "pose": {"xyz": [0, 0, 0.125]}},
        "foot": {"shape": "cylinder", "size": [0.08, 0.02], "pose": {"xyz": [0, 0, 0.01]}},
    }
    for number in range(8):
        angle = np.radians(45.0 * number)
        at = [round(0.12 * float(np.sin(angle)), 4), 0, round(0.375 + 0.12 * np.cos(angle), 4)]
        pose = {"xyz": [float(one) for one in at], "rpy": [0, 45.0 * number, 0]}
        parts[f"bar{number}"] = {"shape": "box", "size": [0.1, 0.01, 0.01], "pose": pose}
    objects = {
        "ring": ring | {"parts": parts},
        "mat": _fixed([0.24, 0.24, 0.02], _xyz(0.5, 0.3, _TOP + 0.01), color="green"),
        "box": _long_box(rng, -0.3),
    }
    mat = {"on": "mat", "rpy": [0, 0, 0]}
    through = {"xyz": _xyz(0.4, 0.0, 0.395)}
    # Along the box, so that both hands fit around it in the ring.
    upper: Tree = {"object": "box", "point": [0, 0, 0.03]}
    right = [
        {"selector": [{"grasp": upper | {"approach": [0, 0, -1]}}, {"grasp": upper}]},
        {"hand_over": {"object": "box", "to": "left", "at": through}},
        "go_home",
    ]
    left = [
        {"take_over": {"object": "box", "from": "right", "then_at": mat}},
        {"place": {"at": mat}},
        "go_home",
    ]
    return _file(robot, objects, left, right, {"done": {"object": "box", "on": "mat"}})


def _opened_and_filled(
    robot: str,
    objects: Tree,
    inside: Tree,
    operate: Tree,
    opened: float,
    shut: float,
    opens: str,
    **grasp: Any,
) -> Tree:
    """File in which one arm holds an object open while the other one puts a cube in.

    Args:
        robot: Name of both robots.
        objects: The objects; the joint is that of the first one, whose part ``handle`` is grasped.
        inside: Pose of the cube in it.
        operate: Ports of `operate` except the position.
        opened: Position in which it is held, degrees.
        shut: Position in which it is left, degrees.
        opens: Name of the arm that holds it open.
        grasp: Further ports of its `grasp`.
    """
    fills = "left" if opens == "right" else "right"
    handle = {"object": operate["object"], "part": "handle", "then_to": opened}
    opening = [
        {"grasp": handle | grasp},
        {"operate": operate | {"to": opened}},
        {"signal": "opened"},
        {"await": "filled"},
        {"operate": operate | {"to": shut}},
        "release",
        "go_home",
    ]
    filling = [
        {"await": "opened"},
        {"grasp": {"object": "cube", "then_at": inside}},
        {"place": {"at": inside}},
        "go_home",
        {"signal": "filled"},
    ]
    goal = {"done": {"object": "cube", "at": inside, "held": False}}
    trees = {opens: opening, fills: filling}
    file = _file(robot, objects, trees["left"], trees["right"], goal)
    written = {"opened": opens, "filled": fills}
    file["cell"] = {
        "signals": {name: {"type": "boolean", "written_by": [arm]} for name, arm in written.items()}
    }
    return file


def spring_door(rng: np.random.Generator, robot: str) -> Tree:
    """One arm holds the door of an oven open against a spring, the other one fills it."""
    wall = {"shape": "box"}
    oven: Tree = {
        "shape": "compound",
        "mass": 10,
        "fixed": True,
        "pose": {"xyz": _xyz(0.7, 0.0, _TOP), "rpy": [0, 0, -90]},
        # In the frame of the oven x is to the right, -y to the front.
        "parts": {
            "floor": wall | {"size": [0.552, 0.35, 0.038], "pose": {"xyz": [0, 0, 0.019]}},
            "top": wall | {"size": [0.552, 0.35, 0.031], "pose": {"xyz": [0, 0, 0.2835]}},
            "back": wall | {"size": [0.552, 0.02, 0.23], "pose": {"xyz": [0, 0.165, 0.153]}},
            "left": wall | {"size": [0.04, 0.33, 0.23], "pose": {"xyz": [-0.256, -0.01, 0.153]}},
            "right": wall | {"size": [0.181, 0.33, 0.23], "pose": {"xyz": [0.1855, -0.01, 0.153]}},
            "door": wall | {"size": [0.414, 0.038, 0.296], "pose": {"xyz": [-0.069, -0.2, 0.15]}},
            "handle": {
                "shape": "cylinder",
                "size": [0.016, 0.208],
                "pose": {"xyz": [0.104, -0.265, 0.164]},
                "color": "red",
            },
            "stem1": wall | {"size": [0.01, 0.05, 0.012], "pose": {"xyz": [0.104, -0.235, 0.255]}},
            "stem2": wall | {"size": [0.01, 0.05, 0.012], "pose": {"xyz": [0.104, -0.235, 0.073]}},
        },
        "joints": {
            "hinge": {
                "type": "hinge",
                "parts": ["door", "handle", "stem1", "stem2"],
                "axis": [0, 0, -1],
                "anchor": [-0.276, -0.181, 0.15],
                "range": [0, 120],
                "mass": 0.3,
                "spring": 4.0,
                "damping": 2.0,
                "friction": 2.0,
            }
        },
    }
    dx, dy = _offset(rng, 0.05, 0.10)
    cube = _box([0.032] * 3, 0.0016, _on_table(0.4 + dx, -0.35 + dy, 0.032), rng.uniform(-180, 180))
    inside = {"xyz": _xyz(0.625, 0.064, _TOP + 0.038 + 0.016), "rpy": [0, 0, 0]}
    pull = {"object": "oven", "joint": "hinge", "force": 80}
    file = _opened_and_filled(
        robot, {"oven": oven, "cube": cube | {"friction": 1.5}}, inside, pull, 70, 4, "left"
    )
    file["goal"]["done"]["within"] = 0.05
    return file


def carry_pot(rng: np.random.Generator, robot: str) -> Tree:
    """Both arms lift a pot by its handles and set it on a stove."""
    dx, dy = _offset(rng, 0.1, 0.1)
    handle = {"shape": "box", "size": [0.008, 0.07, 0.018]}
    stem = {"shape": "box", "size": [0.042, 0.01, 0.018]}
    parts: Tree = {"body": {"shape": "cup", "size": [0.15, 0.165], "wall": 0.0045}}
    for name, side in (("first", 1.0), ("second", -1.0)):
        parts[name] = handle | {"pose": {"xyz": [0.188 * side, 0, 0.0635]}}
        for number, y in enumerate((-0.03, 0.03)):
            pose = {"xyz": [0.168 * side, y, 0.0635]}
            parts[f"{name}{number}"] = stem | {"pose": pose}
    pose = {"xyz": _on_table(0.5 + dx, -0.1 + dy, 0.165), "rpy": [0, 0, 90]}
    pot = {"shape": "compound", "mass": 0.6, "parts": parts, "pose": pose, "friction": 1.0}
    at = _on_table(0.53, 0.3, 0.165 + 0.04)
    stove = _fixed([0.35, 0.28, 0.02], _xyz(0.5, 0.3, _TOP + 0.01), color="black")
    goal_pose = {"xyz": [*at[:2], round(at[2], 4)], "rpy": [0, 0, 90]}
    left = [{"carry_together": {"object": "pot", "with": ["right"], "to": goal_pose}}, "go_home"]
    right = [{"carry_together": {"object": "pot", "with": ["left"]}}, "go_home"]
    goal = {"done": {"object": "pot", "on": "stove", "tilt": 5, "held": False}}
    return _file(robot, {"pot": pot, "stove": stove}, left, right, goal)


def transfer_cube(rng: np.random.Generator, robot: str) -> Tree:
    """One arm hands a box to the other one in the air, which puts it into a bowl."""
    dx, dy = _offset(rng, 0.05, 0.05)
    bowl = {"shape": "bowl", "size": [0.09, 0.03], "wall": 0.004, "mass": 0.05}
    bowl["pose"] = {"xyz": _on_table(0.6 + dx, 0.3 + dy, 0.03)}
    objects = {"box": _long_box(rng, -0.2), "bowl": bowl}
    upright = {"on": "bowl", "rpy": [0, 0, 0]}
    right = [
        {"grasp": {"object": "box", "point": [0, 0, 0.03]}},
        {"hand_over": {"object": "box", "to": "left"}},
        "go_home",
    ]
    left = [
        {"take_over": {"object": "box", "from": "right", "then_at": upright}},
        {"place": {"at": upright}},
        "go_home",
    ]
    goal = {"done": {"object": "box", "on": "bowl", "held": False}}
    return _file(robot, objects, left, right, goal)


def bin_sort(rng: np.random.Generator, robot: str) -> Tree:
    """Each arm puts the cube of its side into the bowl of its color."""
    objects: Tree = {}
    trees: dict[str, list[Any]] = {}
    goal: Tree = {}
    for side, y, color in (("left", 0.2, "white"), ("right", -0.2, "black")):
        bx, by = _offset(rng, 0.05, 0.05)
        bowl_at = _on_table(0.6 + bx, 2.0 * y + by, 0.03)
        while True:
            dx, dy = _offset(rng, 0.175, 0.125)
            cube_at = _on_table(0.5 + dx, y + dy, 0.032)
            if np.hypot(cube_at[0] - bowl_at[0], cube_at[1] - bowl_at[1]) >= 0.125:
                break
        bowl = {"shape": "bowl", "size": [0.09, 0.03], "wall": 0.004, "mass": 0.05}
        objects[f"{color}_bowl"] = bowl | {"color": color, "pose": {"xyz": bowl_at}}
        cube = _box([0.032] * 3, 0.0016, cube_at, rng.uniform(-180, 180), color=color)
        objects[f"{color}_cube"] = cube | {"friction": 1.5}
        trees[side] = [
            {"grasp": {"object": f"{color}_cube"}},
            {"place": {"at": {"on": f"{color}_bowl"}}},
            "go_home",
        ]
        goal[color] = {"object": f"{color}_cube", "on": f"{color}_bowl", "held": False}
    return _file(robot, objects, trees["left"], trees["right"], goal)


def block_balance(rng: np.random.Generator, robot: str) -> Tree:
    """A beam is laid on a cube, and loaded with two blocks at the same moment."""
    places: list[tuple[float, float]] = []
    while len(places) < 4:
        # The original benchmark allows overlaps; here all objects start apart.
        x, y = float(rng.uniform(0.38, 0.6)), float(rng.uniform(-0.3, 0.3))
        clearance = 0.17 if len(places) < 2 else 0.12
        if all(math.hypot(x - other[0], y - other[1]) > clearance for other in places):
            places.append((x, y))
    cube, beam, first, second = places
    if first[1] < second[1]:
        first, second = second, first
    objects = {
        "cube": _box([0.04] * 3, 0.2, _on_table(*cube, height=0.04), friction=3.0),
        "beam": _box([0.2, 0.04, 0.02], 0.2, _on_table(*beam, height=0.02), 90, friction=3.0),
        "block1": _box([0.03, 0.03, 0.09], 0.8, _on_table(*first, height=0.09), friction=3.0),
        "block2": _box([0.03, 0.03, 0.09], 0.8, _on_table(*second, height=0.09), friction=3.0),
    }
    carrier = "left" if beam[1] > 0 else "right"
    trees: dict[str, list[Any]] = {}
    for side, block, end in (("left", "block1", 0.07), ("right", "block2", -0.07)):
        leaves: list[Any] = []
        if side == carrier:
            leaves += [
                {"grasp": {"object": "beam"}},
                {"place": {"at": {"on": "cube", "rpy": [0, 0, 90]}}},
                "go_home",
            ]
        above, on = (
            {"xyz": _on_table(cube[0], cube[1] + end, 0.06 + up + 0.15), "rpy": [0, 0, 0]}
            for up in (0.1, 0.0)
        )
        partner = "right" if side == "left" else "left"
        # From above, the hands of two arms side by side would touch each other.
        outward = [0, -1.0 if side == "left" else 1.0, -1.0]
        leaves += [
            {"meet": "laid"},
            {"grasp": {"object": block, "approach": outward}},
            {"transport": {"to": above}},
            {"in_step": {"with": partner, "child": {"place": {"at": on}}}},
            "go_home",
        ]
        trees[side] = leaves
    goal = {
        "beam": {"object": "beam", "on": "cube", "tilt": 12, "speed": 0.08},
        "block1": {"object": "block1", "on": "beam", "held": False},
        "block2": {"object": "block2", "on": "beam", "held": False},
    }
    file = _file(robot, objects, trees["left"], trees["right"], goal)
    file["cell"] = {"rendezvous": {"laid": ["left", "right"]}}
    return file


def transfer_reorient(rng: np.random.Generator, robot: str) -> Tree:
    """A lying peg is handed over and set upright into its socket."""
    dy = float(rng.uniform(-0.15, 0.15))
    sx, sy = _offset(rng, 0.1, 0.1)
    peg: Tree = {"shape": "prism", "size": [0.0196, 0.1], "sides": 6, "mass": 0.21}
    peg["pose"] = {"xyz": _xyz(0.52, -0.2 + dy, _TOP + 0.0171), "quat": _LYING}
    socket: Tree = {"shape": "tube", "size": [0.034, 0.05], "wall": 0.013, "mass": 0.5}
    socket["pose"] = {"xyz": _on_table(0.5 + sx, 0.3 + sy, 0.05)}
    inserted = {"xyz": _on_table(0.5 + sx, 0.3 + sy, 0.1), "rpy": [0, 0, 0]}
    right = [
        {"grasp": {"object": "peg"}},
        {"hand_over": {"object": "peg", "to": "left"}},
        "go_home",
    ]
    left = [
        {"take_over": {"object": "peg", "from": "right", "then_at": inserted}},
        {"insert": {"object": "peg", "at": inserted, "depth": 0.05}},
        "release",
        "go_home",
    ]
    goal = {"done": {"object": "peg", "at": inserted, "within": 0.038, "tilt": 20, "held": False}}
    objects = {"peg": peg, "socket": socket | {"fixed": True}}
    return _file(robot, objects, left, right, goal)


def hinge_chest(rng: np.random.Generator, robot: str) -> Tree:
    """The right arm holds the lid of a chest open while the left one puts a cube in."""
    bar = {"shape": "cylinder", "size": [0.008, 0.06], "color": "red"}
    stem = {"shape": "box", "size": [0.03, 0.02, 0.01]}
    chest: Tree = {
        "shape": "compound",
        "mass": 3,
        "fixed": True,
        "pose": {"xyz": _xyz(0.6, -0.2, _TOP)},
        "parts": {
            "body": {
                "shape": "bin",
                "size": [0.2, 0.244, 0.08],
                "wall": 0.008,
                "pose": {"xyz": [0, 0, 0.04]},
            },
            "lid": {"shape": "box", "size": [0.2, 0.244, 0.01], "pose": {"xyz": [0, 0, 0.086]}},
            "handle": bar | {"pose": {"xyz": [-0.135, -0.085, 0.086], "rpy": [90, 0, 0]}},
            "stem": stem | {"pose": {"xyz": [-0.113, -0.085, 0.086]}},
        },
        "joints": {
            "hinge": {
                "type": "hinge",
                "parts": ["lid", "handle", "stem"],
                "axis": [0, 1, 0],
                "anchor": [0.08, 0, 0.086],
                "range": [0, 88.8],
                "mass": 0.5,
                "spring": 0.5,
                "damping": 0.05,
                "friction": 0.05,
            }
        },
    }
    dx, dy = _offset(rng, 0.175, 0.175)
    cube = _box([0.032] * 3, 0.0016, _on_table(0.5 + dx, 0.2 + dy, 0.032), rng.uniform(-180, 180))
    inside = {"xyz": _xyz(0.56, -0.16, _TOP + 0.008 + 0.016), "rpy": [0, 0, 0]}
    lift = {"object": "chest", "joint": "hinge"}
    objects = {"chest": chest, "cube": cube | {"friction": 1.5}}
    # Held from its side, the lid leaves the other side of the chest to the arm that fills.
    file = _opened_and_filled(robot, objects, inside, lift, 80, 0, "right", approach=[0, 1, 0])
    file["goal"]["done"]["within"] = 0.1
    return file


def two_arm_lift(rng: np.random.Generator, robot: str) -> Tree:
    """Both arms lift a pot by its handles, and keep it level (robosuite TwoArmLift)."""
    parts: Tree = {"body": {"shape": "bin", "size": [0.14, 0.14, 0.14], "wall": 0.01}}
    for name, side in (("first", 1.0), ("second", -1.0)):
        bar = {"shape": "box", "size": [0.02, 0.11, 0.02]}
        parts[name] = bar | {"pose": {"xyz": [0.16 * side, 0, 0.06]}}
        for number, y in enumerate((-0.045, 0.045)):
            stem = {"shape": "box", "size": [0.085, 0.015, 0.015]}
            parts[f"{name}{number}"] = stem | {"pose": {"xyz": [0.11 * side, y, 0.06]}}
    dx, dy = _offset(rng, 0.03, 0.03)
    pose = {"xyz": _on_table(0.45 + dx, dy, 0.14), "rpy": [0, 0, 90 + float(rng.uniform(-60, 60))]}
    pot = {"shape": "compound", "mass": 1.2, "parts": parts, "pose": pose, "friction": 1.0}
    to = {"xyz": [*pose["xyz"][:2], round(pose["xyz"][2] + 0.15, 4)]}
    carry: Tree = {"object": "pot", "with": ["right"], "to": to, "set_down": False}
    left = [{"carry_together": carry}]
    right = [{"carry_together": {"object": "pot", "with": ["left"]}}]
    goal = {"done": {"object": "pot", "tilt": 30, "height": [to["xyz"][2] - 0.05, 3.0]}}
    return _file(robot, {"pot": pot}, left, right, goal, opposed=True)


def two_arm_handover(rng: np.random.Generator, robot: str) -> Tree:
    """One arm picks a hammer and hands it over by its handle (robosuite TwoArmHandover)."""
    thick = float(rng.uniform(0.03, 0.04))
    length = float(rng.uniform(0.14, 0.25))
    head = thick * float(rng.uniform(1.0, 1.2))
    density = float(rng.uniform(100, 250))
    mass = round(density * (thick**2 * length + 2.0 * head**3), 4)
    size = [round(one, 4) for one in (length, thick, thick)]
    reach = round((length + head) / 2, 4)
    parts = {
        "handle": {"shape": "box", "size": size},
        "head": {
            "shape": "box",
            "size": [round(head, 4), round(1.9 * head, 4), round(head, 4)],
            "pose": {"xyz": [reach, 0, 0]},
            "color": "black",
        },
    }
    dx, dy = _offset(rng, 0.1, 0.05)
    pose = {
        "xyz": _on_table(0.45 + dx, -0.3 + dy, head),
        "rpy": [0, 0, float(rng.uniform(-180, 180))],
    }
    hammer = {"shape": "compound", "mass": mass, "parts": parts, "pose": pose, "friction": 3.0}
    right = [
        {"grasp": {"object": "hammer"}},
        {"hand_over": {"object": "hammer", "to": "left"}},
        "go_home",
    ]
    left = [{"take_over": {"object": "hammer", "from": "right"}}]
    goal = {"done": {"object": "hammer", "held_by": "left", "height": [_UP + _TOP + 0.1, 3.0]}}
    return _file(robot, {"hammer": hammer}, left, right, goal, opposed=True)


def two_arm_transport(rng: np.random.Generator, robot: str) -> Tree:
    """A hammer moves from a lidded bin to another arm's bin, trash out of that one (robosuite)."""
    wall = {"shape": "bin", "size": [0.3, 0.3, 0.1], "wall": 0.01, "fixed": True}
    start, target, trash = (0.3, -0.33), (0.28, 0.28), (0.66, 0.28)
    objects: Tree = {
        name: wall | {"pose": {"xyz": _on_table(*at, 0.1)}, "color": color}
        for name, at, color in (
            ("start", start, "gray"),
            ("target", target, "green"),
            ("trash_bin", trash, "red"),
        )
    }
    lid_parts = {
        "plate": {"shape": "box", "size": [0.3, 0.3, 0.01], "pose": {"xyz": [0, 0, 0.005]}},
        "grip": {"shape": "box", "size": [0.02, 0.08, 0.03], "pose": {"xyz": [0, 0, 0.025]}},
    }
    lid: Tree = {"shape": "compound", "mass": 0.25, "parts": lid_parts, "friction": 1.0}
    lid["pose"] = {"xyz": _xyz(*start, _TOP + 0.1002)}
    inner = _TOP + 0.01
    hammer = {
        "shape": "compound",
        "mass": 0.15,
        "friction": 3.0,
        "parts": {
            "handle": {"shape": "box", "size": [0.12, 0.03, 0.03]},
            "head": {"shape": "box", "size": [0.03, 0.05, 0.03], "pose": {"xyz": [0.075, 0, 0]}},
        },
        "pose": {
            "xyz": _xyz(start[0] - 0.01, start[1], inner + 0.0152),
            "rpy": [0, 0, 90 + float(rng.uniform(-30, 30))],
        },
    }
    cube_at = _xyz(*target, inner + 0.0202)
    objects |= {
        "lid": lid,
        "hammer": hammer,
        "cube": _box([0.04] * 3, 0.05, cube_at, rng.uniform(-54, 54), color="black"),
    }
    right = [
        {"grasp": {"object": "lid", "part": "grip"}},
        {"place": {"at": {"xyz": _xyz(0.68, -0.27, _TOP)}}},
        {"grasp": {"object": "hammer"}},
        {"hand_over": {"object": "hammer", "to": "left"}},
        "go_home",
    ]
    in_target = {"on": "target", "rpy": [0, 0, 0]}
    left = [
        {"grasp": {"object": "cube"}},
        {"place": {"at": {"on": "trash_bin"}}},
        {"take_over": {"object": "hammer", "from": "right", "then_at": in_target}},
        {"place": {"at": in_target}},
        "go_home",
    ]
    goal = {
        "hammer": {"object": "hammer", "on": "target", "held": False},
        "trash": {"object": "cube", "on": "trash_bin", "held": False},
    }
    return _file(robot, objects, left, right, goal, opposed=True)


def pour_marbles(rng: np.random.Generator, robot: str) -> Tree:
    """Both arms lift a cup; marbles are poured from one into the other; both are set down."""
    objects: Tree = {}
    trees: dict[str, list[Any]] = {}
    targets = {
        side: {"xyz": _on_table(0.5, 0.3 * sign, 0.0725), "rpy": [0, 0, 0]}
        for side, sign in (("left", 1.0), ("right", -1.0))
    }
    for side, sign in (("left", 1.0), ("right", -1.0)):
        dx, dy = _offset(rng, 0.05, 0.05)
        cup: Tree = {"shape": "cup", "size": [0.034, 0.0725], "wall": 0.004, "mass": 0.088}
        cup["friction"] = 0.3
        cup["pose"] = {"xyz": _on_table(0.5 + dx, 0.3 * sign + dy, 0.0725)}
        objects[f"{side}_cup"] = cup
    x, y, z = objects["right_cup"]["pose"]["xyz"]
    marbles = {"shape": "sphere", "size": [0.005], "mass": 0.00052, "friction": 0.2}
    pile = {"pile": 20, "area": [0.036, 0.036], "gap": 0.001}
    objects["marble"] = marbles | {"pose": {"xyz": [x, y, round(z + 0.01, 4)]}, "many": pile}
    # Plans keep 45 mm from another arm: the lip is that high above the other mouth, and about
    # 28 mm beside its middle, as marbles leave it with 0.3 m/s.
    below = {"xyz": _xyz(0.5, 0.035, 0.17), "rpy": [0, 0, 0]}
    above = {"xyz": _xyz(0.5, -0.01, 0.305), "rpy": [0, 0, 0]}
    tilt: Tree = {"axis": [1, 0, 0], "frame": "world", "speed": 0.3}
    # The wrist of an xArm7 turns far enough about the hand only, those of the others sideways.
    approach = [1, 0, 0] if robot == "xarm7" else [0, 1, 0]
    trees["left"] = [
        {"grasp": {"object": "left_cup", "approach": [0, -1, 0], "then_at": targets["left"]}},
        {"transport": {"to": below}},
        {"meet": "ready"},
        {
            "parallel": {
                "policy": "any",
                "children": ["hold_still", {"meet": "poured"}],
            }
        },
        {"place": {"at": targets["left"]}},
        "go_home",
    ]
    trees["right"] = [
        {"grasp": {"object": "right_cup", "approach": approach, "then_at": targets["right"]}},
        {"meet": "ready"},
        {"transport": {"to": above}},
        {"rotate_tool": {"angle": -125, **tilt}},
        {"wait": 1},
        {"rotate_tool": {"angle": 125, **tilt}},
        {"meet": "poured"},
        {"place": {"at": targets["right"]}},
        "go_home",
    ]
    goal: Tree = {
        f"marble{number}": {"object": f"marble{number}", "in_zone": "mouth"}
        for number in range(1, 21)
    }
    for side, at in targets.items():
        goal[side] = {"object": f"{side}_cup", "at": {"xyz": at["xyz"]}, "within": 0.05}
        goal[side] |= {"tilt": 20, "held": False}
    file = _file(robot, objects, trees["left"], trees["right"], goal)
    meeting = ["left", "right"]
    zone = {"size": [0.064, 0.064, 0.105], "pose": {"xyz": [0, 0, 0.0163]}, "around": "left_cup"}
    file["cell"] = {
        "rendezvous": {"ready": meeting, "poured": meeting},
        "zones": {"mouth": zone},
    }
    return file


def two_arm_peg_in_hole(rng: np.random.Generator, robot: str) -> Tree:
    """One arm puts a peg into the hole of a plate that the other one holds (robosuite)."""
    radius = float(rng.uniform(0.015, 0.03))
    frame = {
        "left": ([0.12, 0.02, 0.34], [-0.11, 0, 0]),
        "right": ([0.12, 0.02, 0.34], [0.11, 0, 0]),
        "top": ([0.1, 0.02, 0.12], [0, 0, 0.11]),
        "bottom": ([0.1, 0.02, 0.12], [0, 0, -0.11]),
    }
    parts = {
        name: {"shape": "box", "size": size, "pose": {"xyz": xyz}}
        for name, (size, xyz) in frame.items()
    }
    dx, dy = _offset(rng, 0.03, 0.03)
    plate: Tree = {"shape": "compound", "mass": 0.2, "parts": parts, "friction": 1.0}
    yaw = round(float(rng.uniform(-10, 10)), 1)
    plate["pose"] = {"xyz": _on_table(0.45 + dx, 0.2 + dy, 0.34), "rpy": [0, 0, yaw]}
    dx, dy = _offset(rng, 0.03, 0.03)
    lying = {"rpy": [90, 0, round(float(rng.uniform(-10, 10)), 1)]}
    peg: Tree = {"shape": "cylinder", "size": [round(radius, 4), 0.26], "mass": 0.2}
    peg["pose"] = {"xyz": _on_table(0.45 + dx, -0.2 + dy, 2.0 * peg["size"][0])} | lying
    held = {"xyz": _xyz(0.45, 0.1, 0.4), "rpy": [0, 0, 0]}
    # Along y, with its middle 90 mm before the plate, its end is 40 mm beyond.
    inserted = {"xyz": _xyz(0.45, 0.01, 0.4), "rpy": [90, 0, 0]}
    before = {"xyz": _xyz(0.45, -0.13, 0.4), "rpy": [90, 0, 0]}
    left: list[Any] = [
        {"grasp": {"object": "plate", "part": "top", "approach": [0, 0, -1]}},
        {"transport": {"to": held}},
        {"meet": "ready"},
        {
            "parallel": {
                "policy": "any",
                "children": [{"hold_still": {"partner": "right"}}, {"meet": "inserted"}],
            }
        },
    ]
    right: list[Any] = [
        {"grasp": {"object": "peg", "point": [0, 0, 0.1], "approach": [0, 0, -1]}},
        {"transport": {"to": before}},
        {"meet": "ready"},
        {"move_linear": {"offset": {"xyz": [0, 0.14, 0]}, "speed": 0.2, "into": "plate"}},
        {"meet": "inserted"},
    ]
    goal = {
        "plate": {"object": "plate", "at": held, "within": 0.01, "held_by": "left"},
        "peg": {"object": "peg", "at": inserted, "within": 0.03, "angle": 18, "held_by": "right"},
    }
    file = _file(robot, {"plate": plate, "peg": peg}, left, right, goal, opposed=True)
    meeting = ["left", "right"]
    file["cell"] = {"rendezvous": {"ready": meeting, "inserted": meeting}}
    return file


def join_blocks(rng: np.random.Generator, robot: str) -> Tree:
    """A block is put onto a peg of a wall, and the peg of another block into it in the air."""
    bottom, top, wall_peg = [-0.02, -0.01], [0.01, 0.02], 0.12
    hole, peg = [-0.01, 0.01], [-0.008, 0.008]
    # Two sockets of 20 by 20 mm: that for the other block is open to +y, that for the wall to +x.
    h_parts = {
        "bar": _between([-0.0928, -0.0178], [-0.058, -0.028], [-0.02, 0.005]),
        "floor": _between([-0.0178, 0.07], [-0.058, 0.045], bottom),
        "roof": _between([-0.0178, 0.07], [-0.058, 0.045], top),
        "back": _between([-0.0178, 0.01], [-0.058, 0.045], hole),
        "front": _between([0.03, 0.07], [-0.024, 0.045], hole),
        "side": _between([0.01, 0.07], [-0.058, -0.044], hole),
        "middle": _between([0.01, 0.03], [-0.024, -0.01], hole),
    }
    p_parts = {
        "bar": _between([-0.013, 0.017], [0.0551, 0.1301], [-0.02, 0.005]),
        "shoulder": _between([-0.028, 0.032], [0.02, 0.0551], [-0.02, 0.02]),
        "peg": _between(peg, [-0.03, 0.02], peg),
    }
    dx, dy = _offset(rng, 0.05, 0.075)
    h_block: Tree = {"shape": "compound", "mass": 0.1, "parts": h_parts, "friction": 3.0}
    h_block["pose"] = {"xyz": _on_table(0.5 + dx, -0.2 + dy, 0.04)}
    dx, dy = _offset(rng, 0.075, 0.05)
    p_block: Tree = {"shape": "compound", "mass": 0.05, "parts": p_parts, "friction": 3.0}
    p_block["pose"] = {"xyz": _on_table(0.5 + dx, 0.2 + dy, 0.04)}
    wall: Tree = {"shape": "compound", "fixed": True, "pose": {"xyz": _xyz(0.7, 0.0, _TOP)}}
    wall["parts"] = {
        "plate": _between([0.0, 0.02], [-0.06, 0.06], [0.0, 0.2]),
        "peg": _between([-0.05, 0.0], peg, [wall_peg - 0.008, wall_peg + 0.008]),
    }

    def at_peg(x: float, y: float) -> Tree:
        return {"xyz": _xyz(x, y, _TOP + wall_peg), "rpy": [0, 0, 0]}

    # 3 mm from the wall, and from each other.
    on_wall, joined = at_peg(0.627, 0.034), at_peg(0.647, 0.062)
    # The wall comes first: arms whose held objects are joined cannot move together.
    h_grasp = {"object": "h_block", "point": [-0.065, -0.043, -0.0075], "approach": [0, 0, -1]}
    p_grasp = {"object": "p_block", "point": [0.002, 0.105, -0.0075], "approach": [0, 0, -1]}
    right: list[Any] = [
        {"grasp": h_grasp},
        {"transport": {"to": at_peg(0.547, 0.034)}},
        {"move_linear": {"offset": {"xyz": [0.08, 0, 0]}, "speed": 0.1}},
        {"meet": "ready"},
        {
            "parallel": {
                "policy": "any",
                "children": [{"hold_still": {"partner": "left"}}, {"meet": "joined"}],
            }
        },
    ]
    left: list[Any] = [
        {"grasp": p_grasp},
        {"meet": "ready"},
        {"transport": {"to": at_peg(0.647, 0.162)}},
        {"move_linear": {"offset": {"xyz": [0, -0.1, 0]}, "speed": 0.1, "into": "h_block"}},
        {"meet": "joined"},
    ]
    goal = {
        "on_wall": {"object": "h_block", "at": on_wall, "within": 0.01, "held_by": "right"},
        "joined": {"object": "p_block", "at": joined, "within": 0.01, "held_by": "left"},
    }
    objects = {"h_block": h_block, "p_block": p_block, "wall": wall}
    # Side by side, the forearm of one UR5e would come to the wrist of the other one.
    file = _file(robot, objects, left, right, goal, opposed=robot == "ur5e")
    meeting = ["left", "right"]
    file["cell"] = {"rendezvous": {"ready": meeting, "joined": meeting}}
    return file


def ball_maze(rng: np.random.Generator, robot: str) -> Tree:
    """Both arms lift a maze, and tilt it until a ball has rolled into its other corner."""
    yaw = round(float(rng.uniform(-180, 180)), 1)
    parts = {"floor": _between([-0.116, 0.116], [-0.116, 0.116], [0.0, 0.003])}
    # Of two pairs of handles that are equally far apart, arms carry it by the first one.
    sides = [(1.0, 0.0), (-1.0, 0.0), (0.0, 1.0), (0.0, -1.0)]
    for number, (x, y) in enumerate(sides if round(yaw / 90.0) % 2 else sides[2:] + sides[:2]):
        for name, away, thick, wide in (("hold", 0.136, 0.04, 0.02), ("rim", 0.108, 0.016, 0.232)):
            parts[f"{name}{number}"] = {
                "shape": "box",
                "size": [thick, wide, 0.034] if x else [wide, thick, 0.034],
                "pose": {"xyz": [away * x, away * y, 0.02]},
            }
    # The walls of its maze 2, between x and y of their middles.
    for number, (x1, y1, x2, y2) in enumerate(
        (
            (-0.07, -0.06, -0.07, 0.1),
            (-0.03, -0.1, -0.03, -0.02),
            (-0.07, 0.03, 0.04, 0.03),
            (-0.04, -0.01, 0.0, -0.01),
            (0.01, -0.1, 0.01, -0.02),
            (0.05, -0.06, 0.05, 0.02),
            (0.05, -0.05, 0.1, -0.05),
        )
    ):
        half_x, half_y = (0.0, 0.0015) if x2 > x1 else (0.0015, 0.0)
        parts[f"wall{number}"] = _between(
            [x1 - half_x, x2 + half_x], [y1 - half_y, y2 + half_y], [0.003, 0.023]
        )
    dx, dy = _offset(rng, 0.15, 0.15)
    at = _xyz(0.5 + dx, dy, _TOP)
    board: Tree = {"shape": "compound", "mass": 0.4, "parts": parts, "friction": 0.05}
    board["pose"] = {"xyz": at, "rpy": [0, 0, yaw]}
    ball: Tree = {"shape": "sphere", "size": [0.01], "mass": 0.01, "friction": 0.05}
    start = Pose.from_rpy(at, (0.0, 0.0, math.radians(yaw))).apply(np.array([-0.09, 0.09, 0.0131]))
    ball["pose"] = {"xyz": start.round(4).tolist()}

    def tilted(x: float, y: float) -> Tree:
        """Pose in which the ball rolls in this direction of the board."""
        return {"xyz": _xyz(0.45, 0.0, _TOP + 0.15), "rpy": [-12.0 * y, 12.0 * x, yaw]}

    left: list[Any] = []
    right: list[Any] = []
    # Each time it rolls as far as the next wall.
    for x, y in ((0, 0), (0, -1), (1, 0), (0, 1), (-1, 0), (-0.5, 1), (1, 0), (0.5, -1), (1, 0)):
        carry: Tree = {"object": "board", "with": ["right"], "to": tilted(x, y), "set_down": False}
        left += [{"carry_together": carry}, {"wait": 1.0}]
        right.append({"carry_together": {"object": "board", "with": ["left"]}})
    goal: Tree = {"done": {"object": "ball", "in_zone": "red_square"}}
    goal |= {arm: {"object": "board", "held_by": arm} for arm in ("left", "right")}
    file = _file(robot, {"board": board, "ball": ball}, left, right, goal)
    zone: Tree = {"shape": "cylinder", "size": [0.011, 0.04], "around": "board"}
    file["cell"] = {"zones": {"red_square": zone | {"pose": {"xyz": [0.09, -0.09, 0.013]}}}}
    return file


TASKS: Final = {
    one.__name__: (one, steps)
    for one, steps in (
        (transfer_gate, 523),
        (spring_door, 807),
        (carry_pot, 450),
        (transfer_cube, 441),
        (bin_sort, 216),
        (block_balance, 766),
        (transfer_reorient, 505),
        (hinge_chest, 441),
        (two_arm_lift, 0),
        (two_arm_handover, 0),
        (two_arm_transport, 0),
        (pour_marbles, 442),
        (two_arm_peg_in_hole, 0),
        (join_blocks, 829),
        (ball_maze, 350),
    )
}
"""Tasks by name, with the length of an episode of DuoBench in steps of 1/30 s."""


_MOVING: Final = frozenset(
    {"grasp", "place", "insert", "transport", "hand_over", "take_over", "carry_together"}
)


def at_speed(tree: Any, speed: float) -> Any:  # Any: a part of a tree file
    """The tree with a speed for each free motion, as a fraction of the arms' limits."""
    if isinstance(tree, list):
        return [at_speed(one, speed) for one in tree]
    if tree == "go_home":
        return {"go_home": {"speed": speed}}
    if isinstance(tree, dict):
        return {
            key: value | {"speed": speed} if key in _MOVING else at_speed(value, speed)
            for key, value in tree.items()
        }
    return tree


def task(
    name: str, robot: str, seed: int, reality: str, speed: float = 0.5, attempt: int = 0
) -> Tree:
    """The tree file of one trial; a further attempt draws another start."""
    make, _ = TASKS[name]
    rng = np.random.default_rng([seed, list(TASKS).index(name), attempt])
    file = make(rng, robot)
    file["world"]["reality"] = reality
    for arm in file["arms"].values():
        arm["tree"] = at_speed(arm["tree"], speed)
    return {"bt_dualarm": 1, "name": name, **file}


def played(name: str, robot: str, seed: int, reality: str, speed: float) -> dict[str, Any]:
    """Outcome of one trial, its simulated time in s, and what failed."""
    for attempt in range(_ATTEMPTS):
        with TemporaryDirectory() as folder:
            path = Path(folder) / f"{name}.yaml"
            path.write_text(json.dumps(task(name, robot, seed, reality, speed, attempt)))
            try:
                file = load_tree_file(path, registry().kinds)
                run = Run(file, registry(), RunOptions(seed=seed, renderer="ray"))
            except DualArmError:  # objects would overlap at the start
                if attempt == _ATTEMPTS - 1:
                    raise
                continue
            with run:
                result = run.finish()
            break
    failed = [
        f"{arm}: {one.skill} {one.code} {one.reason}"
        for arm, found in result.arms.items()
        for one in found.leaves.values()
        if one.status == "FAILURE" and one.skill not in ("sequence", "in_step")
    ]
    missed = [f"goal {name}: {one.reason}" for name, one in result.goals.items() if not one.met]
    done = str(result.outcome) == "SUCCESS" and not missed
    outcome = "SUCCESS" if done else "FAILURE"
    why = "; ".join([*failed, *missed]) or str(result.ending)
    return {
        "outcome": outcome,
        "code": "" if done else name,
        "why": "" if done else why,
        "false_success": result.is_false_success,
        "seconds": result.sim_time_s,
    }


def main() -> int:
    """Play all trials and print the figures."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--trials", type=int, default=5)
    parser.add_argument("--robots", nargs="+", default=list(ROBOTS), choices=ROBOTS)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--reality", default="lab")
    parser.add_argument("--only", nargs="+", default=list(TASKS), choices=TASKS)
    parser.add_argument("--speed", type=float, default=0.5, help="share of the arms' limits")
    parser.add_argument("--verbose", action="store_true")
    add_options(parser)
    options = parser.parse_args()
    cases = [
        {
            "name": name,
            "robot": robot,
            "seed": options.seed + number,
            "reality": options.reality,
            "speed": options.speed,
        }
        for name in options.only
        for robot in options.robots
        for number in range(options.trials)
    ]
    done: Counter[tuple[str, str]] = Counter()
    seconds: dict[str, list[float]] = defaultdict(list)
    false = 0
    with Campaign(options) as campaign:
        for case, found in campaign.run(played, cases):
            name, robot = str(case["name"]), str(case["robot"])
            false += found["false_success"]
            if found["outcome"] == "SUCCESS":
                done[name, robot] += 1
                seconds[name].append(found["seconds"])
            if found["why"] or options.verbose:
                label = f"{name} {robot} {case['seed']} ({found['seconds']:.1f} s)"
                print(f"{label}: {found['why'] or 'ok'}", flush=True)
        columns = "".join(f"{robot:>9}" for robot in options.robots)
        print(f"{'':18}{columns}   median s   episode s")
        for name in options.only:
            counts = "".join(f"{done[name, robot]:>6}/{options.trials}" for robot in options.robots)
            time = statistics.median(seconds[name]) if seconds[name] else float("nan")
            steps = TASKS[name][1]
            print(f"{name:18} {counts} {time:>9.1f}   {f'{steps / 30:.1f}' if steps else '-':>9}")
        total = sum(done.values())
        print(f"{options.reality}: {total} of {len(cases)} done, false successes {false}")
        return int(total < SHARE * len(cases))


if __name__ == "__main__":
    sys.exit(main())
