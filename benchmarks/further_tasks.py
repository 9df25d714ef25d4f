"""Further random tasks: those of `benchmarks.random_tasks` that one skill alone does not make."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Final

import numpy as np

from benchmarks.random_programs import Dice
from benchmarks.task_parts import REACH, Task, armed, around, file_of, fixture, stand, stands
from benchmarks.why_mistake import Tree, box
from bt_dualarm.core.pose import Pose

STRONG: Final = ("ur5", "ur5e", "ur10", "ur10e", "panda", "fr3", "xarm7")
"""Robots that bear any hand with fingers and what it holds."""

FINGERS: Final = ("panda_hand", "robotiq_2f85")


def _moved(pose: Pose, z: float) -> list[float]:
    """The position that is some meters farther along the z axis of a pose."""
    at = pose.position + z * pose.rotation_matrix[:, 2]
    return [round(float(x), 4) for x in at]


def _plugs(dice: Dice) -> Task:
    """An arm puts a pin into a hole that another arm holds, in any direction."""
    robots = {name: dice.one(STRONG) for name in ("holder", "plugger")}
    reaches = [REACH[robot] for robot in robots.values()]
    apart = round(dice.number(0.6, 0.72) * sum(reaches), 3)
    middle = round(apart * reaches[0] / sum(reaches), 3)
    top = dice.number(0.15, 0.3)
    length = dice.number(0.08, 0.12, 2)
    room = dice.number(0.0003, 0.001, 4)  # between the pin and the sides of its hole, together
    turned = dice.one(["down", "across", "toward", "slanted"])
    yaw = dice.number(-25, 25, 0)
    rpy = {
        "down": [0, 0, yaw],
        "across": [dice.one([-90, 90]), 0, yaw],
        "toward": [0, 90, yaw],
        "slanted": [0, dice.number(15, 75, 0), yaw],
    }[turned]
    at = [middle, dice.number(-0.1, 0.1), round(top + dice.number(0.2, 0.35), 3)]
    held = Pose.from_rpy(at, [float(np.radians(x)) for x in rpy])
    pin: Tree = {"xyz": _moved(held, length / 2), "rpy": rpy}
    out = [round(float(x), 4) for x in held.rotation_matrix[:, 2]]
    begins = {
        "socket": around(0.6 * reaches[0], dice.one([-1, 1]) * dice.number(0.6, 1.0), top),
        "pin": around(0.55 * reaches[1], dice.one([-1, 1]) * dice.number(0.6, 1.0), top),
    }
    begins["pin"][0] = round(apart - begins["pin"][0], 3)
    wide = 0.02 + room
    side = (0.0795 - wide) / 2
    parts: Tree = {}
    for name, sign in (("right", 1), ("left", -1)):
        x, y = sign * (wide + side) / 2, sign * (wide / 2 + 0.0125)
        parts[name] = {
            "shape": "box",
            "size": [round(side, 5), 0.0705, 0.02],
            "pose": {"xyz": [round(x, 5), 0, 0.01]},
        }
        parts["front" if sign > 0 else "rear"] = {
            "shape": "box",
            "size": [round(wide, 5), 0.025, 0.02],
            "pose": {"xyz": [0, round(y, 5), 0.01]},
        }
    parts["back"] = {"shape": "box", "size": [0.0795, 0.0705, 0.02], "pose": {"xyz": [0, 0, -0.01]}}
    parts["handle"] = {"shape": "box", "size": [0.04, 0.04, 0.07], "pose": {"xyz": [0, 0, -0.055]}}
    x, y, z = begins["socket"]
    socket = {
        "shape": "compound",
        "mass": dice.number(0.15, 0.4),
        "friction": 0.9,
        "color": "blue",
        "pose": {"xyz": [x, y, round(z + 0.0905, 4)]},
        "parts": parts,
    }
    x, y, z = begins["pin"]
    peg = {
        "shape": "cylinder",
        "size": [0.01, length],
        "mass": dice.number(0.04, 0.15),
        "friction": 0.8,
        "color": "orange",
        "pose": {"xyz": [x, y, round(z + length / 2 + 0.0005, 4)]},
    }
    objects = {
        "rest": stand(begins["socket"], 0.2),
        "pins": stand(begins["pin"]),
        "socket": socket,
        "pin": peg,
    }
    there: Tree = {"xyz": at, "rpy": rpy}
    waits = {"sequence": [{"signal": "ready"}, {"await": "done"}]}
    hold = {"hold_still": {"partner": "plugger"}}
    arms: Tree = {
        "holder": {
            "robot": robots["holder"],
            "gripper": dice.one(FINGERS),
            "base": {"xyz": [0, 0, 0]},
            "tree": {
                "sequence": [
                    {"grasp": {"object": "socket", "part": "handle", "then_at": there}},
                    {"transport": {"to": there, "speed": 0.4}},
                    {"parallel": {"policy": "any", "children": [hold, waits]}},
                ]
            },
        },
        "plugger": {
            "robot": robots["plugger"],
            "gripper": dice.one(FINGERS),
            "base": {"xyz": [apart, 0, 0], "rpy": [0, 0, 180]},
        },
    }
    tree = file_of(dice, objects, arms)
    tree["cell"] = {
        "signals": {
            "ready": {"type": "boolean", "written_by": ["holder"]},
            "done": {"type": "boolean", "written_by": ["plugger"]},
        }
    }
    direction = [round(-x, 4) for x in out]
    depth = {"object": "pin", "at": pin, "direction": direction, "depth": 0.02, "into": "socket"}
    away = {"xyz": [round(0.05 * x, 4) for x in out]}
    leaves: list[Tree] = [
        {"grasp": {"object": "pin", "then_at": pin}},
        {"await": "ready"},
        {"insert": depth},
        {"release": {}},
        {"move_linear": {"offset": away, "speed": 0.3, "into": "socket"}},
        {"signal": "done"},
    ]
    goals = {"plugged": {"object": "pin", "at": pin, "within": 0.01, "held": False}}
    return Task(
        tree,
        leaves,
        arm="plugger",
        partner="holder",
        object="pin",
        goal=pin["xyz"],
        reach=reaches[1],
        duration=180.0,
        goals=goals,
        halted=("holder",),
    )


def _regrips(dice: Dice) -> Task:
    """An arm sets an object down to take it another way, so that it can be placed."""
    arm, reach = armed(dice, list(REACH))
    if arm["robot"] in STRONG:
        arm["gripper"] = dice.one(FINGERS)
    angle = dice.number(-1.0, 1.0)
    top = dice.number(0.2, 0.35)
    begin = around(dice.number(0.6, 0.7) * reach, angle, top)
    goal = around(dice.number(0.65, 0.75) * reach, angle + 0.8, top)
    shape = dice.one(["box", "cylinder"])
    width = dice.number(0.03, 0.045)
    height = dice.number(0.1, 0.14)
    size = [width, dice.number(0.03, 0.045), height] if shape == "box" else [width / 2, height]
    lifted = round(top + height / 2 + 0.0005, 4)
    objects: Tree = {"from": stand(begin, 0.16), "onto": stand(goal, 0.16)}
    objects["jar"] = {
        "shape": shape,
        "size": size,
        "mass": dice.number(0.05, 0.3),
        "color": "red",
        "pose": {"xyz": [*begin[:2], lifted]},
    }
    place: Tree = {"xyz": [*goal[:2], lifted]}
    if dice.happens(0.6):
        if shape == "box":
            objects["jar"]["pose"]["rpy"] = [0, 0, round(float(np.degrees(angle)), 1)]
        # A roof, under which no hand fits from above.
        roof = (goal[0], goal[1], round(top + height + dice.number(0.05, 0.08), 4))
        objects["roof"] = box((0.16, 0.16, 0.02), roof)
        from_above = {"object": "jar", "approach": [0, 0, -1]}
        out = around(1.0, angle, 0)
        leaves: list[Tree] = [
            {"grasp": from_above},
            {"regrasp": {"object": "jar", "approach": out}},
            {"place": {"at": place}},
            {"go_home": {}},
        ]
    else:
        # It lies at the end; it is turned where it is set down in between.
        turned = dice.one([[90, 0, 0], [-90, 0, 0], [0, 90, 0], [0, -90, 0]])
        half = width / 2 if shape == "cylinder" else size[1 if turned[0] else 0] / 2
        low = round(top + half, 4)
        place = {"xyz": [*goal[:2], low], "rpy": turned}
        lies: Tree = {"xyz": [*begin[:2], low], "rpy": turned}
        leaves = [
            {"grasp": {"object": "jar", "then_at": lies}},
            {"regrasp": {"object": "jar", "at": lies}},
            {"place": {"at": place}},
            {"go_home": {}},
        ]
    goals = {"there": {"object": "jar", "at": place, "within": 0.01, "angle": 5, "held": False}}
    tree = file_of(dice, objects, {"arm1": arm})
    return Task(
        tree, leaves, object="jar", goal=place["xyz"], reach=reach, duration=120.0, goals=goals
    )


def _relays(dice: Dice) -> Task:
    """Three or four arms in a row pass objects on, over stands or from hand to hand."""
    robots = [dice.one(STRONG) for _ in range(dice.count(3, 4))]
    by_hand = dice.happens(0.35)
    names = [f"arm{i}" for i in range(1, len(robots) + 1)]
    top = dice.number(0.05, 0.2)
    side = 1
    alternates = dice.happens(0.6)
    far = 0.42 if by_hand else 0.55
    x = 0.0
    stations = [[0.0, 0.0, top]]
    bases: list[tuple[list[float], float]] = []
    for robot in robots:
        reach = REACH[robot]
        base = [round(x + 0.36 * reach, 3), round(-side * far * reach, 3), 0]
        bases.append((base, 90.0 * side))
        x = round(x + 0.72 * reach, 3)
        stations.append([x, 0.0, top])
        side = -side if alternates else side
    objects: Tree = {}
    things: list[str] = []
    count = 1 if by_hand else dice.count(1, 2)
    shape = dice.one(["box", "cylinder"])
    width = dice.number(0.03, 0.045)
    height = dice.number(0.15, 0.19) if by_hand else dice.number(0.05, 0.09)
    spots = [[0.0, 0.0]] if count == 1 else [[0.0, -0.07], [0.0, 0.07]]
    z = round(top + height / 2 + 0.0005, 4)

    def spot(station: int, thing: int) -> Tree:
        x, y = stations[station][:2]
        return {
            "xyz": [round(x + spots[thing][0], 3), round(y + spots[thing][1], 3), z],
            "rpy": [0, 0, 0],
        }

    for i in range(count):
        things.append(f"can{i + 1}")
        objects[things[i]] = {
            "shape": shape,
            "size": [width, width, height] if shape == "box" else [width / 2, height],
            "mass": dice.number(0.05, 0.25),
            "color": ["red", "blue"][i],
            "pose": spot(0, i),
        }
    used = [0, len(robots)] if by_hand else range(len(stations))
    for i in used:
        objects[f"stand{i}"] = box((0.14, 0.26, top), (*stations[i][:2], round(top / 2, 4)))
    arms: Tree = {}
    for name, robot, (base, yaw) in zip(names, robots, bases, strict=True):
        arms[name] = {
            "robot": robot,
            "gripper": dice.one(FINGERS),
            "base": {"xyz": base, "rpy": [0, 0, yaw]},
        }
    tree = file_of(dice, objects, arms)
    last = {thing: spot(len(robots), i) for i, thing in enumerate(things)}
    leaves: list[Tree] = []
    if by_hand:
        for i, name in enumerate(names):
            leaves = []
            if i == 0:
                leaves.append({"grasp": {"object": "can1"}})
            else:
                take: Tree = {"object": "can1", "from": names[i - 1]}
                then = {"then_at": last["can1"]} if name == names[-1] else {}
                leaves.append({"take_over": take | then})
            if name == names[-1]:
                leaves.append({"place": {"object": "can1", "at": last["can1"]}})
            else:
                leaves.append({"hand_over": {"object": "can1", "to": names[i + 1]}})
            leaves.append({"go_home": {}})
            tree["arms"][name]["tree"] = {"sequence": leaves}
    else:
        claims = dice.happens(0.5)
        early = dice.happens(0.5)
        size = [0.3, 0.4, 0.4]
        tree["cell"] = {
            "signals": {
                f"by_{name}": {"type": "integer", "written_by": [name], "initial": 0}
                for name in names
            },
            "zones": {
                f"at{i}": {"size": size, "pose": {"xyz": [*at[:2], round(top + 0.2, 3)]}}
                for i, at in enumerate(stations)
            },
            "rendezvous": {"end": names},
        }

        def claimed(station: int, *body: Tree) -> list[Tree]:
            if not claims:
                return [*body]
            inner = {"sequence": [*body]}
            return [{"claim": {"zone": f"at{station}", "child": inner}}]

        for i, name in enumerate(names):
            leaves = []
            for number, thing in enumerate(things):
                if i > 0:
                    given = {"signal": f"by_{names[i - 1]}", "to": number + 1}
                    leaves.append({"await": given | {"relation": "greater_or_equal"}})
                up = {"reach_to_pose": {"offset": {"xyz": [0, 0, 0.12]}}}
                leaves += claimed(i, {"grasp": {"object": thing}}, up)
                put: Tree = {"place": {"object": thing, "at": spot(i + 1, number)}}
                leaves += claimed(i + 1, put, {"go_home": {}})
                told: Tree = {"signal": {"signal": f"by_{name}", "value": number + 1}}
                leaves.append(told)
                if early and not claims:
                    leaves[-2:] = [leaves[-1], leaves[-2]]
            leaves += [{"meet": "end"}, {"go_home": {}}]
            tree["arms"][name]["tree"] = {"sequence": leaves}
    goals = {
        thing: {"object": thing, "at": at, "within": 0.012, "tilt": 5, "held": False}
        for thing, at in last.items()
    }
    return Task(
        tree,
        leaves,
        arm=names[-1],
        partner=names[-2],
        object="can1",
        goal=last["can1"]["xyz"],
        reach=REACH[robots[-1]],
        duration=240.0,
        goals=goals,
        halted=names[:-1],
    )


def _springs(dice: Dice) -> Task:
    """An arm moves a joint with a spring, holds it for a while, and lets it go."""
    arm, reach = armed(dice, ["ur5", "ur5e", "ur10", "ur10e", "panda", "fr3", "xarm7"])
    if arm["robot"] in STRONG:
        arm["gripper"] = dice.one(FINGERS)
    angle = dice.number(-1.0, 1.0)
    at = around(dice.number(0.72, 0.85) * reach, angle, dice.number(0.3, 0.5))
    yaw = round(float(np.degrees(angle)) + dice.number(-20, 20), 1)
    kind = dice.one(["door", "lever", "button", "flap"])
    parts: Tree = {"body": {"shape": "box", "size": [0.1, 0.26, 0.2]}}
    joint: Tree = {"mass": dice.number(0.2, 0.8), "parts": ["panel", "bar"]}
    side = dice.one([1, -1])
    if kind == "door":
        parts["panel"] = _box([0.012, 0.24, 0.18], [-0.058, 0, 0])
        parts["bar"] = _box([0.03, 0.012, 0.08], [-0.08, -side * 0.09, 0])
        joint |= {
            "type": "hinge",
            "axis": [0, 0, 1],
            "anchor": [-0.058, side * 0.12, 0],
            "range": sorted([0, side * -80]),
            "damping": dice.number(0.1, 0.8),
            "friction": dice.number(0.0, 0.3),
            "spring": dice.number(0.1, 1.5),
        }
        there: float = side * -dice.number(25, 55, 0)
    elif kind == "lever":
        parts["panel"] = _box([0.02, 0.03, 0.16], [-0.07, 0, 0])
        parts["bar"] = _box([0.04, 0.02, 0.03], [-0.1, 0, 0.07])
        joint |= {
            "type": "hinge",
            "axis": [1, 0, 0],
            "anchor": [-0.06, 0, -0.06],
            "range": [-70, 70],
            "damping": dice.number(0.1, 0.5),
            "friction": dice.number(0.2, 0.6),
            "spring": dice.number(0.2, 1.2),
        }
        there = side * dice.number(20, 50, 0)
    elif kind == "button":
        parts["panel"] = _box([0.03, 0.06, 0.06], [-0.065, 0, 0])
        parts["bar"] = _box([0.04, 0.012, 0.05], [-0.1, 0, 0])
        joint |= {
            "type": "slide",
            "axis": [-1, 0, 0],
            "range": [0, 0.1],
            "damping": dice.number(2, 20),
            "friction": dice.number(0.2, 3),
            "spring": dice.number(20, 200, 0),
        }
        there = dice.number(0.03, 0.08)
    else:
        # A flap that hangs down and is raised against its weight and its spring.
        parts["panel"] = _box([0.012, 0.24, 0.16], [-0.06, 0, 0])
        parts["bar"] = _box([0.03, 0.08, 0.012], [-0.08, 0, -0.06])
        joint |= {
            "type": "hinge",
            "axis": [0, 1, 0],
            "anchor": [-0.06, 0, 0.08],
            "range": [0, 80],
            "damping": dice.number(0.2, 0.8),
            "friction": dice.number(0.0, 0.3),
            "spring": dice.number(0.0, 0.8),
        }
        there = dice.number(20, 45, 0)
    loose = 0.012 if kind == "button" else 8.0
    if joint["spring"] == 0:
        del joint["spring"]
    of: Tree = {"object": "device", "joint": "axle"}
    near = [round(there - loose, 4), round(there + loose, 4)]
    leaves: list[Tree] = [
        {"grasp": {"object": "device", "part": "bar", "then_to": there}},
        {"operate": of | {"to": there}},
        {"joint_at": of | {"between": near}},
        {"wait": dice.number(0.5, 3.0, 1)},
        {"joint_at": of | {"between": near}},
    ]
    if dice.happens(0.5):
        leaves.append({"operate": of | {"to": 0}})
        goals: Tree = {"back": of | {"between": [-loose, loose]}}
    else:
        goals = {}
    leaves += [{"release": {}}, {"go_home": {}}]
    tree = file_of(dice, {"device": fixture(at, yaw, parts, joint)}, {"arm1": arm})
    return Task(tree, leaves, object="device", goal=at, reach=reach, duration=90.0, goals=goals)


def _box(size: Sequence[float], xyz: Sequence[float]) -> Tree:
    return {"shape": "box", "size": [*size], "pose": {"xyz": [*xyz]}}


def _inspections(dice: Dice) -> Task:
    """An arm counts cubes by sight, carries them off one by one, and counts again."""
    robots = ["ur5", "ur5e", "panda", "fr3", "xarm7", "ur10e"]
    arm, reach = armed(dice, robots, camera={})
    angle = dice.number(-0.6, 0.6)
    top = dice.number(0.1, 0.2)
    middle = around(0.62 * reach, angle, top)
    tray = around(0.62 * reach, angle + dice.one([-1, 1]) * dice.number(0.9, 1.2), top)
    cube = dice.number(0.03, 0.042)
    z = round(top + cube / 2 + 0.0005, 4)
    number = dice.count(1, 3)
    color = dice.one(["red", "green", "blue", "orange"])
    names = [f"cube{i + 1}" for i in range(number)]
    objects: Tree = {"mat": stand(middle, 0.36), "tray": stand(tray, 0.3)}
    for i, name in enumerate(names):
        x, y = middle[0] + 0.1 * (i - 1), middle[1] + dice.number(-0.06, 0.06)
        objects[name] = {
            "shape": "box",
            "size": [cube] * 3,
            "mass": 0.08,
            "color": color,
            "pose": {"xyz": [round(x, 3), round(y, 3), z], "rpy": [0, 0, dice.number(-45, 45, 0)]},
        }
    located = {"object": "cube1", "region": "mat_zone", "pose": "{where}"}
    look = {"look_at": {"at": {"xyz": middle}, "distance": dice.number(0.32, 0.42)}}
    subtrees: Tree = {
        "watch": {"tree": look},
        "fetch": {
            "params": {"place": {"type": "integer"}, "from": {"type": "string"}},
            "tree": {
                "sequence": [
                    # A search that was halted may look away from the mat.
                    {"sequence": [{"subtree": {"use": "watch"}}, {"locate": located}]},
                    {"selector": [{"grasp": {"object": name, "at": "{where}"}} for name in names]},
                    {
                        "place": {
                            "at": {
                                "xyz": [
                                    f"{tray[0]} + ({{place}} - 1) * 8 cm",
                                    round(tray[1] - 0.02, 3),
                                    z,
                                ]
                            }
                        }
                    },
                ]
            },
        },
    }
    del subtrees["fetch"]["params"]["from"]
    counted = {"object": "cube1", "region": "mat_zone", "count": "{left}"}
    leaves: list[Tree] = [
        {"subtree": {"use": "watch"}},
        {"wait_for": {"object": "cube1", "region": "mat_zone", "least": number, "wait": 5}},
        {"retry": {"times": 3, "child": {"count": counted}}},
        {"test": f"{{left}} == {number}"},
    ]
    way = dice.one(["for_each", "while", "repeat"])
    body: list[Tree] = [
        {"subtree": {"use": "fetch", "params": {"place": "{i}"}}},
        {"subtree": {"use": "watch"}},
    ]
    if way == "for_each":
        loop: Tree = {
            "for_each": {
                "items": list(range(number)),
                "item": "i",
                "child": {"sequence": body},
            }
        }
        leaves.append(loop)
    else:
        leaves.append({"set": {"key": "i", "value": 0}})
        body.append({"set": {"key": "i", "value": "{i} + 1"}})
        if way == "while":
            sees = {"sees": {"object": "cube1", "region": "mat_zone"}}
            leaves.append({"while": {"condition": sees, "child": {"sequence": body}}})
        else:
            leaves.append({"repeat": {"times": "{left}", "child": {"sequence": body}}})
        leaves.append({"test": f"{{i}} == {number}"})
    none_left = {"not": {"sees": {"object": "cube1", "region": "mat_zone"}}}
    over_tray = {"look_at": {"at": {"xyz": tray}, "distance": 0.4}}
    again = {"object": "cube1", "region": "tray_zone", "count": "{moved}"}
    leaves += [
        none_left,
        over_tray,
        {"retry": {"times": 3, "child": {"count": again}}},
        {"test": f"{{moved}} == {number}"},
        {"go_home": {}},
    ]
    tree = file_of(dice, objects, {"arm1": arm})
    tree["subtrees"] = subtrees
    tree["cell"] = {
        "zones": {
            name: {"size": [0.4, 0.4, 0.12], "pose": {"xyz": [*at[:2], round(top + 0.03, 3)]}}
            for name, at in (("mat_zone", middle), ("tray_zone", tray))
        }
    }
    goals = {
        name: {"object": name, "on": "tray", "tilt": 3, "held": False, "lasting": 0.3}
        for name in names
    }
    return Task(
        tree,
        leaves,
        object="cube1",
        goal=middle,
        reach=reach,
        duration=180.0,
        goals=goals,
        halted=("fetch",),
    )


_PLANES: Final = (
    "xy",
    "xz",
    "yz",
    {"normal": [1, 1, 0]},
    {"normal": [0, -1, 1]},
    {"normal": [1, 0, 2]},
    {"normal": [-1, 1, 1]},
)


def _motions(dice: Dice) -> Task:
    """An arm follows paths of all kinds between a ceiling and walls, perhaps with an object."""
    robot = dice.one([*REACH, "z1", "ur3", "baxter_left"])
    reach = REACH.get(robot, {"z1": 0.6, "ur3": 0.5, "baxter_left": 0.8}.get(robot, 0.6))
    hand = dice.one(["panda_hand", "robotiq_2f85", "suction_cup"])
    if robot in ("z1", "ur3", "ur3e", "jaco2", "tiago") and hand == "panda_hand":
        hand = "robotiq_2f85"
    arm: Tree = {"robot": robot, "gripper": hand, "base": {"xyz": [0, 0, 0]}}
    angle = dice.number(-1.2, 1.2)
    top = dice.number(0.1, 0.25)
    begin = around(dice.number(0.6, 0.7) * reach, angle, top)
    center = around(dice.number(0.5, 0.65) * reach, angle + dice.one([0, 0.6, -0.6]), 0)
    center[2] = round(dice.number(0.45, 0.65) * reach, 3)
    objects: Tree = {}
    leaves: list[Tree] = []
    carries = dice.happens(0.5)
    if carries:
        size = [dice.number(0.045, 0.06), dice.number(0.045, 0.06), dice.number(0.03, 0.06)]
        at = [*begin[:2], round(top + size[2] / 2 + 0.0005, 4)]
        objects["stand"] = stand(begin)
        objects["load"] = {
            "shape": "box",
            "size": size,
            "mass": dice.number(0.05, 0.6),
            "color": "red",
            "pose": {"xyz": at},
        }
        leaves.append({"grasp": {"object": "load", "approach": [0, 0, -1]}})
    if dice.happens(0.6):
        high = round(center[2] + dice.number(0.25, 0.5), 3)
        objects["ceiling"] = box((0.3, 0.5, 0.02), (*center[:2], high))
    if dice.happens(0.6):
        out = around(1.0, angle + dice.number(-1, 1), 0)
        away = dice.number(0.3, 0.5)
        wall = [round(center[i] + away * out[i], 3) for i in range(2)]
        turn = round(float(np.degrees(np.arctan2(out[1], out[0]))), 1)
        objects["wall"] = box((0.02, 0.5, 0.6), (*wall, 0.3))
        objects["wall"]["pose"]["rpy"] = [0, 0, turn]
    tilt = dice.one([[180, 0, 0], [180, 0, 0], [90, 0, 90], [150, 0, 0], [180, 30, 0]])
    pose: Tree = {"xyz": center, "rpy": tilt}
    leaves.append({"reach_to_pose": {"to": pose}})
    here: Tree = {"arm_at": {"at": pose, "within": 0.004, "angle": 1.5}}
    leaves.append(here)
    for _ in range(dice.count(2, 4)):
        # A path that was halted begins anew where it was to begin.
        path, *back = _motion(dice, pose)
        leaves.append({"sequence": [{"reach_to_pose": {"to": pose}}, path]})
        leaves += [*back, here]
    if carries:
        leaves.append({"place": {"at": {"xyz": at, "rpy": [0, 0, 0]}}})
    leaves.append({"go_home": {}})
    goals = stands("load", at) if carries else {}
    tree = file_of(dice, objects, {"arm1": arm})
    return Task(
        tree,
        leaves,
        object="load" if carries else "",
        goal=center,
        reach=reach,
        duration=90.0,
        goals=goals,
    )


def _motion(dice: Dice, pose: Tree) -> list[Tree]:
    """Leaves that move the tool from a pose along a path, and back to the pose."""
    plane = dice.one(_PLANES)
    speed = {"speed": dice.number(0.1, 1.0, 1)}
    back: Tree = {"move_linear": {"to": pose}}
    x, y, z = pose["xyz"]

    def near() -> Tree:
        spread = [dice.number(-0.07, 0.07) for _ in range(3)]
        return {"xyz": [round(a + b, 3) for a, b in zip((x, y, z), spread, strict=True)]}

    kind = dice.one(
        ["through", "path", "turn", "linear", "draw", "lissajous", "circle", "keep", "offset"]
    )
    if kind == "through":
        poses = [near() for _ in range(dice.count(1, 4))] + [pose]
        return [{"move_through": {"poses": poses, "blend": dice.number(0.005, 0.05)} | speed}]
    if kind == "path":
        size = dice.number(20, 80, 0)
        points = [[0, 0], [size, 0], [size, size], [0, size / 2]]
        slow = {"tool_speed": dice.number(0.01, 0.04)}
        path = {"points": points, "plane": plane, "closed": True}
        return [{"follow_path": path | slow | {"blend": dice.number(0.008, 0.02)}}]
    if kind == "turn":
        axis = dice.one(["x", "y", "z", [1, 1, 0]])
        turn = {"axis": axis, "angle": dice.number(10, 60, 0), "frame": dice.one(["tool", "world"])}
        if turn["frame"] == "tool":
            turn["point"] = [0, 0, dice.number(0, 0.1)]
        return [{"rotate_tool": turn | speed}, back]
    if kind == "linear":
        offset = [dice.number(-0.08, 0.08) for _ in range(3)]
        return [{"move_linear": {"offset": {"xyz": offset}} | speed}, back]
    if kind == "draw":
        points = [[dice.number(-0.06, 0.06), dice.number(-0.06, 0.06)] for _ in range(4)]
        return [{"draw": {"points": points, "plane": plane, "end": "center"} | speed}]
    if kind == "lissajous":
        curve: Tree = {
            "plane": plane,
            "amplitudes": [dice.number(0.02, 0.08), dice.number(0.02, 0.08)],
            "frequencies": dice.one([[1, 2], [3, 2], [1, 1]]),
            "phase": dice.one([0, 90]),
            "end": "center",
        }
        return [{"lissajous": curve | speed}]
    if kind == "circle":
        circle: Tree = {"plane": plane, "radius": dice.number(0.02, 0.07)}
        return [{"circle": circle | speed}, back]
    if kind == "keep":
        away = near() | {"rpy": pose["rpy"]}
        upright = {"keep": {"upright": dice.number(3, 20, 0)}}
        return [{"reach_to_pose": {"to": away} | upright | speed}, {"reach_to_pose": {"to": pose}}]
    pitched = {"xyz": [0, 0, dice.number(0.02, 0.06)], "frame": dice.one(["tool", "world"])}
    return [{"reach_to_pose": {"offset": pitched} | speed}, {"reach_to_pose": {"to": pose}}]


FURTHER_TASKS: Final[Mapping[str, Callable[[Dice], Task]]] = {
    "plug": _plugs,
    "regrip": _regrips,
    "relay": _relays,
    "springs": _springs,
    "inspect": _inspections,
    "motion": _motions,
}
