"""More random tasks: arms that act together, cups, carried joints, tracked loads, MJCF scenes."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Final

import numpy as np

from benchmarks.further_tasks import FINGERS, STRONG
from benchmarks.random_programs import Dice
from benchmarks.task_parts import (
    REACH,
    SCENE_FILE,
    Task,
    armed,
    around,
    file_of,
    gripper_of,
    stand,
    stands,
)
from benchmarks.why_mistake import Tree, box


def _gap(side: float, top: float) -> float:
    """Height of the center of an object of a height that has just been put on a stand."""
    return round(top + side / 2 + 0.0005, 4)


def _facing(dice: Dice, hands: Sequence[str], share: float) -> tuple[Tree, list[float]]:
    """Two arms that face each other along x, and how far each can grasp.

    The bases are a share of what both arms reach together apart.
    """
    robots = [dice.one(STRONG) for _ in range(2)]
    reaches = [REACH[robot] for robot in robots]
    apart = round(share * sum(reaches), 3)
    arms: Tree = {}
    for i, robot in enumerate(robots):
        base: Tree = {"xyz": [i * apart, 0, 0]}
        if i:
            base["rpy"] = [0, 0, 180]
        hand = dice.one(hands)
        arms[f"arm{i + 1}"] = {"robot": robot, "gripper": hand, "base": base}
    return arms, reaches


def _beside(arms: Tree, name: str, radius: float, angle: float, z: float) -> list[float]:
    """A position around the base of one of two arms that face each other."""
    x, y, _ = around(radius, angle, z)
    if name == "arm1":
        return [x, y, round(z, 4)]
    apart = arms[name]["base"]["xyz"][0]
    return [round(apart - x, 3), -y, round(z, 4)]


def _takings(dice: Dice) -> Task:
    """An arm takes an object over, not knowing where it goes, and places or regrasps it."""
    arms, reaches = _facing(dice, FINGERS, dice.number(0.65, 0.75))
    top = dice.number(0.1, 0.3)
    begin = _beside(arms, "arm1", dice.number(0.55, 0.7) * reaches[0], dice.number(-1, 1), top)
    angle = dice.one([-1, 1]) * dice.number(0.5, 1.1)
    goal = _beside(arms, "arm2", dice.number(0.55, 0.7) * reaches[1], angle, top)
    between = _beside(arms, "arm2", 0.62 * reaches[1], angle * 0.1 - 0.9 * angle, top)
    width = dice.number(0.03, 0.04)
    length = dice.number(0.15, 0.2)
    kind = dice.one(["bar", "post", "can"])
    shape, size = {
        "bar": ("box", [length, width, width]),
        "post": ("box", [width, width, length]),
        "can": ("cylinder", [width / 2, length]),
    }[kind]
    z = _gap(width if kind == "bar" else length, top)
    objects: Tree = {"from": stand(begin, 0.14), "onto": stand(goal, 0.16)}
    objects["part"] = {
        "shape": shape,
        "size": size,
        "mass": dice.number(0.05, 0.3),
        "color": "red",
        "pose": {"xyz": [*begin[:2], z], "rpy": [0, 0, dice.number(-90, 90, 0)]},
    }
    # A post may be handed over lying; of a bar, any heading will do.
    turned: Tree = {} if kind == "bar" else {"rpy": [0, 0, 0]}
    place: Tree = {"xyz": [*goal[:2], z]} | turned
    then = dice.one(["place", "regrasp", "both"])
    last: list[Tree] = [{"place": {"object": "part", "at": place}}]
    if then != "place":
        objects["table"] = stand(between, 0.16)
        laid: Tree = {"xyz": [*between[:2], z]} | turned
        last = [{"regrasp": {"object": "part", "at": laid}}, *last]
    if then == "both":
        last = [{"place": {"object": "part", "at": laid}}, {"regrasp": {"object": "part"}}, last[1]]
    tree = file_of(dice, objects, arms)
    arms["arm1"]["tree"] = {
        "sequence": [
            {"grasp": {"object": "part"}},
            {"hand_over": {"object": "part", "to": "arm2"}},
            {"go_home": {}},
        ]
    }
    leaves: list[Tree] = [
        {"take_over": {"object": "part", "from": "arm1"}},
        *last,
        {"go_home": {}},
    ]
    return Task(
        tree,
        leaves,
        arm="arm2",
        partner="arm1",
        object="part",
        goal=place["xyz"],
        reach=reaches[1],
        duration=120.0,
        goals=stands("part", place["xyz"]),
        halted=("arm1",),
    )


def _chests(dice: Dice) -> Task:
    """An arm carries a box with a lid, or a drawer unit, to where another arm opens it."""
    arms, reaches = _facing(dice, FINGERS, dice.number(0.58, 0.66))
    top = dice.number(0.15, 0.3)
    begin = _beside(arms, "arm1", 0.62 * reaches[0], dice.one([-1, 1]) * dice.number(0.7, 1.2), top)
    apart = arms["arm2"]["base"]["xyz"][0]
    # Beside the line between the bases, where the first arm is at home.
    beside = dice.one([-1, 1]) * dice.number(0.22, 0.3)
    middle = [round(apart * reaches[0] / sum(reaches), 3), beside, top]
    arms["arm1"]["gripper"] = "robotiq_2f85"  # the thin wall of a bin asks for much force
    kind = dice.one(["lid", "drawer"])
    mass = dice.number(1.2, 1.6)  # what is lighter slides or tips when its lid is turned
    if kind == "lid":
        height = 0.08
        parts: Tree = {
            "body": {"shape": "bin", "size": [0.12, 0.07, height], "wall": 0.005},
            "lid": {"shape": "box", "size": [0.12, 0.07, 0.006], "pose": {"xyz": [0, 0, 0.0435]}},
            "knob": {
                "shape": "box",
                "size": [0.02, 0.014, 0.03],
                "pose": {"xyz": [0.045, 0, 0.0615]},
            },
        }
        joint: Tree = {
            "type": "hinge",
            "parts": ["lid", "knob"],
            "axis": [0, -1, 0],
            "anchor": [-0.06, 0, 0.0405],
            "range": [0, 100],
            "mass": 0.1,
            "friction": dice.number(0.02, 0.05),
            "damping": 0.05,
        }
        there = dice.number(30, 60, 0)
        near = [there - 5, there + 5]
        handle = "body"
    else:
        height = 0.1
        parts = {
            "floor": {"shape": "box", "size": [0.14, 0.1, 0.01], "pose": {"xyz": [0, 0, -0.045]}},
            "roof": {"shape": "box", "size": [0.14, 0.1, 0.01], "pose": {"xyz": [0, 0, 0.045]}},
            "back": {"shape": "box", "size": [0.01, 0.1, 0.08], "pose": {"xyz": [-0.065, 0, 0]}},
            "grip": {"shape": "box", "size": [0.03, 0.03, 0.05], "pose": {"xyz": [0, 0, 0.075]}},
            "tray": {"shape": "bin", "size": [0.12, 0.09, 0.06], "wall": 0.005},
            "stem": {"shape": "box", "size": [0.03, 0.012, 0.012], "pose": {"xyz": [0.074, 0, 0]}},
            "knob": {"shape": "box", "size": [0.014, 0.05, 0.03], "pose": {"xyz": [0.095, 0, 0]}},
        }
        joint = {
            "type": "slide",
            "parts": ["tray", "stem", "knob"],
            "axis": [1, 0, 0],
            "range": [0, 0.08],
            "mass": 0.2,
            "friction": dice.number(0.3, 1.0),
            "damping": dice.number(1, 5),
        }
        there = dice.number(0.03, 0.06)
        near = [round(there - 0.008, 4), round(there + 0.008, 4)]
        handle = "grip"
    z = _gap(height, top)
    objects: Tree = {"from": stand(begin, 0.18), "onto": stand(middle, 0.2)}
    objects["chest"] = {
        "shape": "compound",
        "mass": mass,
        "friction": 0.9,
        "color": "blue",
        "pose": {"xyz": [*begin[:2], z], "rpy": [0, 0, dice.number(-60, 60, 0)]},
        "parts": parts,
        "joints": {"axle": joint},
    }
    # The knob is on the side of the arm that opens it, or to either side of it.
    place: Tree = {"xyz": [*middle[:2], z], "rpy": [0, 0, dice.number(-50, 50, 0)]}
    tree = file_of(dice, objects, arms)
    tree["cell"] = {"signals": {"there": {"type": "boolean", "written_by": ["arm1"]}}}
    arms["arm1"]["tree"] = {
        "sequence": [
            {"grasp": {"object": "chest", "part": handle, "then_at": place}},
            {"place": {"object": "chest", "at": place}},
            {"go_home": {}},
            {"signal": "there"},
        ]
    }
    leaves: list[Tree] = [
        {"await": "there"},
        {"grasp": {"object": "chest", "part": "knob", "at": place, "then_to": there}},
        {"operate": {"object": "chest", "joint": "axle", "to": there}},
        {"release": {}},
        {"go_home": {}},
    ]
    # Lids fall shut or fully open where their friction does not hold them.
    if kind == "lid":
        leaves.insert(3, {"joint_at": {"object": "chest", "joint": "axle", "between": near}})
    goals: Tree = {"there": {"object": "chest", "at": place, "within": 0.02, "held": False}}
    if kind == "drawer":
        goals["open"] = {"object": "chest", "joint": "axle", "between": near}
    return Task(
        tree,
        leaves,
        arm="arm2",
        partner="arm1",
        object="chest",
        goal=place["xyz"],
        reach=reaches[1],
        duration=120.0,
        goals=goals,
        halted=("arm1",),
    )


def _cups(dice: Dice) -> Task:
    """Arms with cups pick boxes, pass them on, and stack them."""
    arms, reaches = _facing(dice, ["suction_cup"], dice.number(0.62, 0.72))
    if dice.happens(0.3):
        arms["arm2"]["gripper"] = dice.one(FINGERS)
    top = dice.number(0.1, 0.25)
    by_hand = dice.happens(0.5)
    count = 1 if by_hand else dice.count(2, 4)
    size = [dice.number(0.06, 0.075), dice.number(0.06, 0.075), dice.number(0.045, 0.06)]
    if by_hand:
        size = [dice.number(0.12, 0.16), 0.07, 0.11]
    objects: Tree = {}
    goals: Tree = {}
    leaves: list[Tree] = []
    side = dice.one([-1, 1])
    names = [f"box{i + 1}" for i in range(count)]
    for i, name in enumerate(names):
        at = _beside(arms, "arm1", 0.6 * reaches[0], side * (0.1 + 0.45 * i), top)
        objects[f"stand{i}"] = stand(at, 0.14)
        objects[name] = {
            "shape": "box",
            "size": size,
            "mass": dice.number(0.05, 0.4),
            "friction": 0.8,
            "color": "red",
            "pose": {"xyz": [*at[:2], _gap(size[2], top)], "rpy": [0, 0, dice.number(-45, 45, 0)]},
        }
    if by_hand:
        site = _beside(arms, "arm2", 0.62 * reaches[1], side * 0.8, top)
        objects["site"] = stand(site, 0.2)
        last: Tree = {"xyz": [*site[:2], _gap(size[2], top)]}
        first: list[Tree] = [
            {"grasp": {"object": "box1", "point": [-0.035, 0, 0.055], "mass": 0.4}},
            {"hand_over": {"object": "box1", "to": "arm2"}},
            {"go_home": {}},
        ]
        then = {"then_at": last | {"rpy": [0, 0, 0]}} if dice.happens(0.5) else {}
        leaves = [
            {"take_over": {"object": "box1", "from": "arm1"} | then},
            {"place": {"object": "box1", "at": last}},
            {"go_home": {}},
        ]
        goals = {"box1": {"object": "box1", "on": "site", "tilt": 3, "held": False}}
        goals |= stands("box1", last["xyz"])
    else:
        # The second arm takes the tower down again, onto a stand of its own.
        site = _beside(arms, "arm1", 0.62 * reaches[0], side * -0.45, top)
        objects["site"] = stand(site, 0.16)
        below = "site"
        first = []
        for name in names:
            first += [{"grasp": {"object": name}}, {"place": {"at": {"on": below}}}]
            goals[name] = {"object": name, "on": below, "tilt": 3, "held": False, "lasting": 0.5}
            below = name
        first += [{"go_home": {}}]
        other = _beside(arms, "arm2", 0.6 * reaches[1], side * 0.3, top)
        objects["shelf"] = stand(other, 0.14)
        objects["own"] = objects["box1"] | {
            "color": "blue",
            "pose": {"xyz": [*other[:2], _gap(size[2], top)]},
        }
        put = _beside(arms, "arm2", 0.6 * reaches[1], side * 0.95, top)
        objects["rest"] = stand(put, 0.14)
        last = {"xyz": [*put[:2], _gap(size[2], top)]}
        leaves = [
            {"grasp": {"object": "own"}},
            {"place": {"object": "own", "at": last}},
            {"go_home": {}},
        ]
        goals |= stands("own", last["xyz"])
    tree = file_of(dice, objects, arms)
    arms["arm1"]["tree"] = {"sequence": first}
    return Task(
        tree,
        leaves,
        arm="arm2",
        partner="arm1",
        object="box1" if by_hand else "own",
        goal=last["xyz"],
        reach=reaches[1],
        duration=150.0,
        goals=goals,
        halted=("arm1",),
    )


def _rides(dice: Dice) -> Task:
    """Arms of different robots carry a tray or bar with objects on it together, and turn it."""
    first, second = dice.order(STRONG)[:2]
    robots = [first, second]
    y = -dice.number(0.42, 0.48, 2)
    high = 0.5
    length, width = dice.number(0.5, 0.62), dice.number(0.2, 0.28)
    kind = dice.one(["tray", "bar", "handles"])
    if kind == "tray":
        carrier: Tree = {"shape": "tray", "size": [length, width, 0.03], "wall": 0.004}
        carrier["mass"] = dice.number(0.5, 1.2)
        middle, floor = 0.015, 0.004
    elif kind == "bar":
        carrier = {"shape": "box", "size": [length + 0.1, 0.07, 0.03]}
        carrier["mass"] = dice.number(0.5, 2.0)
        middle, floor = 0.015, 0.03
    else:
        end = round(length / 2 - 0.03, 4)
        grip: Tree = {"shape": "box", "size": [0.02, 0.1, 0.06]}
        parts: Tree = {
            "plate": {
                "shape": "box",
                "size": [length, width, 0.02],
                "pose": {"xyz": [0, 0, -0.025]},
            },
            "left": grip | {"pose": {"xyz": [-end, 0, 0.015]}},
            "right": grip | {"pose": {"xyz": [end, 0, 0.015]}},
        }
        carrier = {"shape": "compound", "mass": dice.number(0.8, 1.5), "parts": parts}
        middle, floor = 0.035, 0.02
    low = round(high + middle + 0.0005, 4)
    carrier |= {"friction": 0.8, "color": "blue", "pose": {"xyz": [0, y, low]}}
    objects: Tree = {"stand": box((0.34, 0.3, high), (0, y, high / 2)), "carrier": carrier}
    goals: Tree = {}
    count = dice.count(1, 3)
    for i in range(count):
        name = f"rider{i + 1}"
        shape = dice.one(["box", "cylinder"])
        size = [0.035, 0.035, 0.04] if shape == "box" else [0.02, 0.05]
        z = round(high + floor + 0.0008 + size[-1] / 2, 4)
        objects[name] = {
            "shape": shape,
            "size": size,
            "mass": dice.number(0.03, 0.15),
            "friction": 0.7,
            "color": "red",
            "pose": {"xyz": [round(0.12 * (i - (count - 1) / 2), 3), y, z]},
        }
        goals[name] = {"object": name, "on": "carrier", "tilt": 5, "held": False}
    turn = dice.one([-1, 1]) * dice.number(10, 30, 0)
    last: Tree = {
        "xyz": [dice.number(-0.04, 0.04), round(y + dice.number(-0.03, 0.03), 3), low],
        "rpy": [0, 0, dice.one([0, 1, 1]) * turn],
    }
    raised = [dice.number(-0.06, 0.06), y, round(low + dice.number(0.1, 0.22), 3)]
    path: list[Tree] = [{"xyz": raised, "rpy": [0, 0, turn]}, last]
    goals["carrier"] = {"object": "carrier", "at": last, "within": 0.012, "angle": 6, "held": False}
    arms: Tree = {}
    for i, robot in enumerate(robots):
        yaw = 0 if robot.startswith("ur") else -90
        out = dice.number(0.55, 0.65)
        arms[f"arm{i + 1}"] = {
            "robot": robot,
            "gripper": dice.one(FINGERS),
            "base": {"xyz": [(-out, out)[i], 0, 0.4], "rpy": [0, 0, yaw]},
        }
    tree = file_of(dice, objects, arms)
    arms["arm2"]["tree"] = {
        "sequence": [{"carry_together": {"object": "carrier", "with": ["arm1"]}}, {"go_home": {}}]
    }
    carry: Tree = {"object": "carrier", "with": ["arm2"], "path": path}
    leaves: list[Tree] = [
        {"carry_together": carry | {"speed": dice.one([0.3, 0.5, 1.0])}},
        {"go_home": {}},
    ]
    return Task(
        tree,
        leaves,
        partner="arm2",
        object="carrier",
        goal=last["xyz"],
        duration=120.0,
        goals=goals,
    )


def _steps(dice: Dice) -> Task:
    """An arm follows the tool of another one, or both move in step, and one or both hold a part."""
    arms, reaches = _facing(dice, FINGERS, dice.number(0.75, 0.85))
    top = dice.number(0.1, 0.25)
    apart = arms["arm2"]["base"]["xyz"][0]
    way = dice.one(["follow", "step"])
    holding = [["arm1"], ["arm2"], ["arm1", "arm2"]][dice.count(0, 2)]
    side = dice.one([-1, 1])
    objects: Tree = {}
    goals: Tree = {}
    begin: dict[str, list[Tree]] = {"arm1": [], "arm2": []}
    end: dict[str, list[Tree]] = {"arm1": [], "arm2": []}
    for i, name in enumerate(("arm1", "arm2")):
        if name not in holding:
            continue
        at = _beside(arms, name, 0.55 * reaches[i], side * dice.number(0.7, 1.2), top)
        to = _beside(arms, name, 0.55 * reaches[i], -side * dice.number(0.7, 1.2), top)
        height = dice.number(0.05, 0.1)
        size = [dice.number(0.03, 0.045), dice.number(0.03, 0.045), height]
        part = f"part{i + 1}"
        objects |= {f"from{i + 1}": stand(at), f"onto{i + 1}": stand(to, 0.14)}
        objects[part] = {
            "shape": "box",
            "size": size,
            "mass": dice.number(0.05, 0.4),
            "color": "red",
            "pose": {"xyz": [*at[:2], _gap(height, top)]},
        }
        place: Tree = {"xyz": [*to[:2], _gap(height, top)]}
        begin[name] = [{"grasp": {"object": part}}]
        end[name] = [{"place": {"object": part, "at": place}}]
        goals |= stands(part, place["xyz"])
    z = round(top + dice.number(0.2, 0.26), 3)
    split = apart * reaches[0] / sum(reaches)
    poses: dict[str, Tree] = {
        "arm1": {"xyz": [round(split - 0.18, 3), 0, z], "rpy": [180, 0, dice.number(-30, 30, 0)]},
        "arm2": {"xyz": [round(split + 0.18, 3), 0, z], "rpy": [180, 0, dice.number(-30, 30, 0)]},
    }

    def moves(name: str) -> list[Tree]:
        """Motions near the middle, back to where they begin."""
        pose = poses[name]
        found: list[Tree] = []
        for _ in range(dice.count(1, 3) if way == "follow" else 2):
            shift = [dice.number(-0.04, 0.04), dice.number(-0.07, 0.07), dice.number(-0.05, 0.05)]
            near = [round(a + b, 3) for a, b in zip(pose["xyz"], shift, strict=True)]
            kind = dice.one(["reach_to_pose", "move_linear"])
            speed = dice.number(0.2, 1.0, 1)
            found.append({kind: {"to": {"xyz": near, "rpy": pose["rpy"]}, "speed": speed}})
        return [*found, {"move_linear": {"to": pose}}]

    tree = file_of(dice, objects, arms)
    for name in ("arm1", "arm2"):
        begin[name].append({"reach_to_pose": {"to": poses[name]}})
    if way == "follow":
        tree["cell"] = {
            "signals": {
                "ready": {"type": "boolean", "written_by": ["arm1"]},
                "follows": {"type": "boolean", "written_by": ["arm2"]},
                "done": {"type": "boolean", "written_by": ["arm1"]},
            }
        }
        until = {"sequence": [{"wait": 2}, {"signal": "follows"}, {"await": "done"}]}
        follow: Tree = {"follow_tool": {"arm": "arm1"}}
        middle: dict[str, list[Tree]] = {
            "arm1": [{"signal": "ready"}, {"await": "follows"}, *moves("arm1"), {"signal": "done"}],
            "arm2": [
                {"await": "ready"},
                {"parallel": {"policy": "any", "children": [follow, until]}},
            ],
        }
    else:
        middle = {
            name: [{"in_step": {"with": other, "child": {"sequence": moves(name)}}}]
            for name, other in (("arm1", "arm2"), ("arm2", "arm1"))
        }
    home: Tree = {"go_home": {}}
    leaves = {name: [*begin[name], *middle[name], *end[name], home] for name in begin}
    arms["arm2"]["tree"] = {"sequence": leaves["arm2"]}
    name = holding[0]
    return Task(
        tree,
        leaves["arm1"],
        partner="arm2",
        object="part1" if name == "arm1" else "part2",
        goal=poses["arm1"]["xyz"],
        reach=reaches[0],
        duration=120.0,
        goals=goals,
        halted=("arm2",),
    )


def _watched(dice: Dice) -> Task:
    """An arm carries a block along a curve, another one tracks it, and takes it or lets it go."""
    hands_over = dice.happens(0.5)
    carrier = dice.one(["ur10", "ur10e"] if hands_over else ["ur5", "ur5e", "ur10", "ur10e"])
    watcher = dice.one(["panda", "fr3", "ur5e", "xarm7", "ur10e"])
    center = [dice.number(0.6, 0.7), dice.number(-0.05, 0.15), dice.number(0.6, 0.72)]
    view = dice.one([0, 0, 90, -90, 45, -45])
    plane: object = {0: "yz", 90: "xz", -90: "xz"}.get(view, {"normal": [1, view // 45, 0]})
    angle = float(np.radians(view))
    back = dice.number(0.88, 0.95)
    base: Tree = {
        "xyz": [
            round(center[0] + back * float(np.cos(angle)), 3),
            round(center[1] + back * float(np.sin(angle)), 3),
            round(center[2] - 0.42, 3),
        ],
        "rpy": [0, 0, 180 + view],
    }
    sight = [-round(float(np.cos(angle)), 6), -round(float(np.sin(angle)), 6), 0]
    width = 0.05
    length = 0.12 if hands_over else 0.05
    top = 0.4
    begin = around(0.6, -0.9, top)
    z = _gap(length, top)
    color = dice.one(["yellow", "green", "red"])
    objects: Tree = {"from": stand(begin, 0.16)}
    objects["block"] = {
        "shape": "box",
        "size": [width, width, length],
        "mass": dice.number(0.05, 0.2),
        "color": color,
        "pose": {"xyz": [*begin[:2], z]},
    }
    shown: Tree = {"xyz": center, "rpy": [0, -90, view]}
    how = dice.one(["plane", "plane", "free", "facing"])
    curve_plane = plane
    if how != "plane" and dice.happens(0.4):
        curve_plane = dice.one(["xy", "xz", "yz"])
    speed = {"speed": dice.number(0.1, 0.4, 1)}
    size = dice.number(0.04, 0.08)
    curve: Tree = dice.one(
        [
            {"circle": {"plane": curve_plane, "radius": size, "turns": 2} | speed},
            {
                "lissajous": {
                    "plane": curve_plane,
                    "amplitudes": [size, round(0.7 * size, 3)],
                    "frequencies": [1, 2],
                }
                | speed
            },
            {
                "draw": {
                    "plane": curve_plane,
                    "points": [[dice.number(-size, size), dice.number(-size, size)] for _ in "abc"],
                    "end": "center",
                }
                | speed
            },
        ]
    )
    track: Tree = {"color": color, "until_still": 2.0, "score": "block"}
    if how == "plane":
        track["plane"] = plane
        if dice.happens(0.5):
            track["target_size"] = width
    else:
        track |= {"plane": "free", "target_size": width}
    if how == "facing":
        track |= {"orientation": "facing"}
    arms: Tree = {
        "arm1": {"robot": carrier, "gripper": dice.one(FINGERS), "base": {"xyz": [0, 0, 0.4]}},
        "arm2": {
            "robot": watcher,
            "gripper": gripper_of(watcher),
            "base": base,
            "camera": {"mount": "wrist", "resolution": [320, 240], "fov": 50, "fps": 30},
        },
    }
    tree = file_of(dice, objects, arms)
    tree["cell"] = {
        "signals": {
            "shown": {"type": "boolean", "written_by": ["arm1"]},
            "sees": {"type": "boolean", "written_by": ["arm2"]},
            "watched": {"type": "boolean", "written_by": ["arm2"]},
        }
    }
    grasp: Tree = {"object": "block"}
    if hands_over:
        grasp["point"] = [0, 0, 0.04]
    first: list[Tree] = [
        {"grasp": grasp},
        {"transport": {"object": "block", "to": shown}},
        # A path may begin with a swing into another branch: not before the camera.
        curve,
        {"transport": {"object": "block", "to": shown}},
        {"signal": "shown"},
        {"await": "sees"},
        {"wait": 2},
        curve,
        {"await": "watched"},
    ]
    look: Tree = {"at": {"xyz": center}, "distance": 0.35, "direction": sight, "lean": 0}
    tracks: Tree = {"sequence": [{"signal": "sees"}, {"track": track}]}
    leaves: list[Tree] = [
        {"await": "shown"},
        {"look_at": look},
        {"parallel": {"policy": "all", "children": [tracks]}},
        {"signal": "watched"},
    ]
    if hands_over:
        far = [0.55 * REACH[watcher], 0, top]
        turn = angle + np.pi + dice.one([-1, 1]) * dice.number(0.8, 1.2)
        put = [
            round(base["xyz"][0] + far[0] * float(np.cos(turn)), 3),
            round(base["xyz"][1] + far[0] * float(np.sin(turn)), 3),
            top,
        ]
        objects["onto"] = stand(put, 0.16)
        last: Tree = {"xyz": [*put[:2], z], "rpy": [0, 0, 0]}
        first.append({"hand_over": {"object": "block", "to": "arm2"}})
        leaves += [
            {"take_over": {"object": "block", "from": "arm1"}},
            {"place": {"object": "block", "at": last}},
        ]
    else:
        put = around(0.6, -1.4, top)
        objects["onto"] = stand(put, 0.16)
        last = {"xyz": [*put[:2], z], "rpy": [0, 0, 0]}
        grasp["then_at"] = last
        first.append({"place": {"object": "block", "at": last}})
    first.append({"go_home": {}})
    leaves.append({"go_home": {}})
    arms["arm1"]["tree"] = {"sequence": first}
    return Task(
        tree,
        leaves,
        arm="arm2",
        partner="arm1",
        object="block",
        goal=last["xyz"],
        reach=REACH[watcher],
        duration=120.0,
        goals=stands("block", last["xyz"]),
    )


def _scenes(dice: Dice) -> Task:
    """An arm works in a cell that is written in MJCF: it opens a drawer and moves a part."""
    arm, reach = armed(dice, STRONG)
    angle = dice.one([-1, 1]) * dice.number(0.6, 1.0)  # beside where the arm is at home
    top = dice.number(0.1, 0.25)
    begin = around(dice.number(0.55, 0.68) * reach, angle + 0.9, top)
    goal = around(dice.number(0.55, 0.68) * reach, angle - 0.9, top + dice.number(0, 0.1))
    at = around(dice.number(0.78, 0.88) * reach, angle, dice.number(0.35, 0.5))
    yaw = round(float(np.degrees(angle)) + dice.number(-15, 15), 1)
    height = dice.number(0.05, 0.09)
    shape = dice.one(["box", "cylinder"])
    half = dice.number(0.016, 0.02, 4)
    extent = f"{half} {half} {height / 2:.4f}" if shape == "box" else f"{half} {height / 2:.4f}"
    radians = dice.happens(0.5)

    def turned(degrees: float) -> str:
        way = dice.one(["euler", "axisangle", "quat"])
        angle = float(np.radians(degrees))
        value = f"{angle:.6f}" if radians else f"{degrees}"
        if way == "euler":
            return f'euler="0 0 {value}"'
        if way == "axisangle":
            return f'axisangle="0 0 1 {value}"'
        return f'quat="{np.cos(angle / 2):.7f} 0 0 {np.sin(angle / 2):.7f}"'

    def geom(name: str, size: Sequence[float], xyz: Sequence[float], more: str = "") -> str:
        halves = " ".join(f"{x / 2:.4f}" for x in size)
        position = " ".join(f"{x:.4f}" for x in xyz)
        return f'<geom name="{name}" type="box" size="{halves}" pos="{position}"{more}/>'

    def column(name: str, at: Sequence[float], size: float) -> str:
        text = geom(name, (size, size, at[2]), (at[0], at[1], at[2] / 2))
        if dice.happens(0.5):
            return text
        center = f"{at[0]:.4f} {at[1]:.4f} 0"
        inner = geom("", (size, size, at[2]), (0, 0, at[2] / 2)).replace(' name=""', "")
        return f'<body name="{name}" pos="{center}">{inner}</body>'

    x, y, z = at
    there = dice.number(0.06, 0.12)
    slide = "0 0.2"
    friction = dice.number(0.5, 4)
    lifted = _gap(height, top)
    post = around(dice.number(0.3, 0.4) * reach, angle + dice.one([-2.0, 2.0]), 0.4)
    scene = "\n".join(
        [
            '<mujoco model="cell">',
            f'  <compiler angle="{"radian" if radians else "degree"}"/>',
            '  <default><geom rgba="0.6 0.6 0.6 1"/>',
            f'    <default class="moving"><joint damping="{dice.number(2, 12)}"/></default>',
            "  </default>",
            "  <worldbody>",
            '    <geom type="plane" size="4 4 0.1"/>',
            "    " + column("bench", begin, 0.14),
            "    " + column("shelf", goal, 0.16),
            f'    <geom name="post" type="capsule" size="0.02" fromto="{post[0]} {post[1]} 0.02 '
            f'{post[0]} {post[1]} {post[2]}"/>',
            f'    <body name="chest" pos="{x} {y} {z}" {turned(yaw)}>',
            "      " + geom("body", (0.1, 0.26, 0.2), (0, 0, 0)),
            '      <body name="tray" pos="-0.058 0 0" childclass="moving">',
            f'        <joint name="axle" type="slide" axis="-1 0 0" range="{slide}" '
            f'frictionloss="{friction}"/>',
            "        " + geom("panel", (0.012, 0.2, 0.1), (0, 0, 0), ' mass="0.3"'),
            "        " + geom("bar", (0.04, 0.1, 0.012), (-0.025, 0, 0), ' mass="0.1"'),
            "      </body>",
            "    </body>",
            f'    <body name="part" pos="{begin[0]} {begin[1]} {lifted}" '
            f"{turned(dice.number(-40, 40, 0))}>",
            "      <freejoint/>",
            f'      <geom type="{shape}" size="{extent}" mass="{dice.number(0.05, 0.3)}" '
            'rgba="0.8 0.1 0.1 1"/>',
            "    </body>",
            "  </worldbody>",
            "</mujoco>",
        ]
    )
    place = [*goal[:2], _gap(height, goal[2])]
    axle: Tree = {"object": "chest", "joint": "axle"}
    opens: list[Tree] = [
        {"grasp": {"object": "chest", "part": "bar", "then_to": there}},
        {"operate": axle | {"to": there}},
        {"release": {}},
        {"go_home": {}},
    ]
    moves: list[Tree] = [
        {"grasp": {"object": "part"}},
        {"place": {"object": "part", "at": {"xyz": place}}},
        {"go_home": {}},
    ]
    leaves = opens + moves if dice.happens(0.5) else moves + opens
    tree = file_of(dice, {}, {"arm1": arm})
    tree["world"]["scene"] = SCENE_FILE
    goals = stands("part", place)
    goals["open"] = axle | {"between": [round(there - 0.008, 4), round(there + 0.008, 4)]}
    return Task(
        tree,
        leaves,
        object="part",
        goal=place,
        reach=reach,
        duration=120.0,
        goals=goals,
        scene=scene,
    )


MORE_TASKS: Final[Mapping[str, Callable[[Dice], Task]]] = {
    "taking": _takings,
    "chest": _chests,
    "cups": _cups,
    "ride": _rides,
    "step": _steps,
    "watch": _watched,
    "scene": _scenes,
}
