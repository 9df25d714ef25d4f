"""Mistakes of a generated family: random tasks of random robots, with one random fault each.

The tasks are picks, paths, searches by sight, tracking, handovers and carries of two arms, drawers,
insertions, and arms that share a zone and meet. A fault is a function that changes such a task, and
states which causes are right for it. Both are drawn from a seed: the rules of ``bt-why`` cannot
know them. About a third of the leaves are within a retry, a timeout or a selector. A fault counts
only if the task succeeds without it.
"""

from __future__ import annotations

import copy
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from benchmarks.random_programs import Dice
from benchmarks.why_mistake import Mistake, Tree, box, shipped
from bt_dualarm.robots.robot_description import load_robot

_REACH: Final[Mapping[str, float]] = {
    "ur3e": 0.50,
    "ur5": 0.85,
    "ur5e": 0.85,
    "ur10": 1.30,
    "ur10e": 1.30,
    "panda": 0.80,
    "fr3": 0.80,
    "xarm7": 0.70,
}
"""Robots of the family, and how far from its base each can grasp from above, m."""

_DOWN: Final = (180, 0, 0)


@dataclass
class Task:
    """A tree that succeeds, and what a fault may change in it.

    Attributes:
        tree: The tree.
        leaves: Leaves of the arm that fails, in order, each a mapping from the name of its skill.
        arm: Name of that arm.
        partner: Name of the other arm; empty if there is none.
        object: Name of the object that it works with; empty if there is none.
        goal: Where the object or the tool is to be at the end, m.
        reach: How far from the base the arm can grasp, m.
        duration: Longest simulated time of a run, s.
    """

    tree: Tree
    leaves: list[Tree]
    arm: str = "arm1"
    partner: str = ""
    object: str = ""
    goal: Sequence[float] = (0.0, 0.0, 0.0)
    reach: float = 0.8
    duration: float = 40.0

    def ports(self, skill: str) -> Tree:
        """Ports of the first leaf of a skill."""
        return next(leaf[skill] for leaf in self.leaves if skill in leaf)

    def index(self, skill: str) -> int:
        """Position of the first leaf of a skill."""
        return next(i for i, leaf in enumerate(self.leaves) if skill in leaf)

    def has(self, skill: str) -> bool:
        """Whether the failing arm has a leaf of a skill."""
        return any(skill in leaf for leaf in self.leaves)

    def add_arm(self, name: str, robot: str, xyz: Sequence[float], *leaves: Tree) -> None:
        """Add an arm with a sequence of leaves."""
        base = {"xyz": [*xyz]}
        self.tree["arms"][name] = {"robot": robot, "base": base, "tree": {"sequence": [*leaves]}}


@dataclass(frozen=True)
class Fault:
    """A change of a task, and the causes that are right for it.

    Attributes:
        name: Name of the fault.
        plant: Changes the task; returns texts that the cause must contain, or None if the task does
            not allow this fault.
        kinds: Kinds of cause that are right.
    """

    name: str
    plant: Callable[[Task, Dice], tuple[str, ...] | None]
    kinds: tuple[str, ...]


def generated(seed: int = 0, count: int = 60) -> Iterator[Mistake]:
    """Random tasks with one random fault each.

    Args:
        seed: Seed of all choices.
        count: Number of mistakes.
    """
    number = 0
    for made in range(20 * count):
        dice = Dice(1000 * seed + made)
        task = dice.one(list(TASKS))
        fault = dice.one(FAULTS[task])
        mistake = planted(task, fault.name, dice)
        if mistake is None:
            continue
        yield replace(mistake, name=f"{seed}.{number} {mistake.name}")
        number += 1
        if number == count:
            return


def planted(task_name: str, fault_name: str, dice: Dice) -> Mistake | None:
    """A random task with a fault.

    Args:
        task_name: Name of the kind of task, one of `TASKS`.
        fault_name: Name of one of its faults.
        dice: Random choices.

    Returns:
        None if this task does not allow the fault.
    """
    fault = next(one for one in FAULTS[task_name] if one.name == fault_name)
    task = TASKS[task_name](dice)
    original = copy.deepcopy(task)
    names = fault.plant(task, dice)
    if names is None:
        return None
    _wrap(task, dice)
    _finish(task)
    _finish(original)
    robots = "+".join(str(arm["robot"]) for arm in task.tree["arms"].values())
    kind, *also = fault.kinds
    return Mistake(
        f"{task_name} {robots}: {fault.name}",
        task.tree,
        kind,
        names,
        task.duration,
        tuple(also),
        original.tree,
    )


def _finish(task: Task) -> None:
    """Put the leaves into the tree of their arm."""
    task.tree["arms"][task.arm]["tree"] = {"sequence": task.leaves}


def _wrap(task: Task, dice: Dice) -> None:
    """Put some leaves into other nodes, which do not change what happens to them."""
    for i, leaf in enumerate(task.leaves):
        if set(leaf) & {"retry", "timeout", "selector", "parallel", "sequence", "repeat"}:
            continue
        match dice.count(0, 8):
            case 0:
                task.leaves[i] = {"retry": {"times": 2, "child": leaf}}
            case 1:
                task.leaves[i] = {"timeout": {"seconds": 200, "child": leaf}}
            case 2:
                fail = {"fail": {"code": "GAVE_UP", "reason": "the cell needs a person"}}
                task.leaves[i] = {"selector": [leaf, fail]}


# ---------------------------------------------------------------- tasks


def _file(dice: Dice, objects: Tree, arms: Tree) -> Tree:
    world = {"scene": "empty", "reality": dice.one(["ideal", "lab", "rough"])}
    return {"bt_dualarm": 1, "name": "generated", "world": world, "objects": objects, "arms": arms}


def _around(radius: float, angle: float, z: float) -> list[float]:
    x, y = radius * np.cos(angle), radius * np.sin(angle)
    return [round(float(x), 3), round(float(y), 3), round(z, 4)]


def _stand(at: Sequence[float], size: float = 0.12) -> Tree:
    """A fixed stand below a position."""
    height = round(at[2], 4)
    return box((size, size, height), (at[0], at[1], round(height / 2, 4)))


def _picks(dice: Dice) -> Task:
    """An arm picks a box or a cylinder from a stand, and places it on another one."""
    robot = dice.one(list(_REACH))
    reach = _REACH[robot]
    angle = dice.number(-1.2, 1.2)
    width = dice.number(0.03, 0.05)
    height = dice.number(0.04, 0.08)
    top = dice.number(0.15, 0.3)
    begin = _around(dice.number(0.6, 0.75) * reach, angle, top)
    goal = _around(dice.number(0.6, 0.75) * reach, angle + dice.number(0.6, 1.2), top)
    upright = dice.one(["box", "cylinder"])
    size = [width, width, height] if upright == "box" else [width / 2, height]
    name = dice.one(["part", "can", "brick", "workpiece"])
    mass = dice.number(0.1, 0.4)
    lifted = round(top + height / 2 + 0.0005, 4)
    thing = {"shape": upright, "size": size, "mass": mass, "color": dice.one(["red", "blue"])}
    thing["pose"] = {"xyz": [*begin[:2], lifted]}
    objects = {"from": _stand(begin), "onto": _stand(goal), name: thing}
    place = [*goal[:2], lifted]
    above = [*goal[:2], lifted + 0.12]
    gripper = "panda_hand" if robot in ("panda", "fr3") else "robotiq_2f85"
    arm = {"robot": robot, "gripper": gripper, "base": {"xyz": [0, 0, 0]}}
    tree = _file(dice, objects, {"arm1": arm})
    leaves: list[Tree] = [
        {"grasp": {"object": name}},
        {"transport": {"object": name, "to": {"xyz": above}}},
        {"place": {"object": name, "at": {"xyz": place}}},
        {"go_home": {}},
    ]
    return Task(tree, leaves, object=name, goal=place, reach=reach)


def _paths(dice: Dice) -> Task:
    """An arm moves to a pose and along a curve."""
    robot = dice.one(list(_REACH))
    reach = _REACH[robot]
    angle = dice.number(-1.2, 1.2)
    goal = _around(dice.number(0.55, 0.7) * reach, angle, dice.number(0.4, 0.6) * reach)
    plane = dice.one(["xy", "xz", "yz"])
    curve = dice.one(
        [
            {"circle": {"plane": plane, "radius": dice.number(0.03, 0.07)}},
            {"lissajous": {"plane": plane, "amplitudes": [0.06, 0.04], "frequencies": [1, 2]}},
            {"move_linear": {"offset": {"xyz": [0, 0, 0.1], "frame": "world"}}},
        ]
    )
    pose = {"xyz": goal, "rpy": [*_DOWN]}
    arm = {"robot": robot, "base": {"xyz": [0, 0, 0]}}
    leaves: list[Tree] = [{"reach_to_pose": {"to": pose}}, curve, {"go_home": {}}]
    return Task(_file(dice, {}, {"arm1": arm}), leaves, goal=goal, reach=reach, duration=30.0)


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
        tree["arms"][name]["gripper"] = (
            "panda_hand" if robot in ("panda", "fr3") else "robotiq_2f85"
        )
    leaves: list[Tree] = [
        {"grasp": {"object": "bar"}},
        {"hand_over": {"object": "bar", "to": "arm2"}},
        {"go_home": {}},
    ]
    tree["arms"]["arm2"]["tree"] = {
        "sequence": [{"take_over": {"object": "bar", "from": "arm1"}}, {"go_home": {}}]
    }
    return Task(tree, leaves, partner="arm2", object="bar", goal=(0.5, 0, 0.4), duration=60.0)


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
    return Task(tree, leaves, object="cube", goal=at, duration=60.0)


def _drawers(dice: Dice) -> Task:
    """An arm opens a drawer and puts a cube into it."""
    tree = shipped("drawer")
    tree["world"]["reality"] = dice.one(["ideal", "lab"])
    tree["arms"]["arm1"]["robot"] = dice.one(["ur5", "ur5e"])
    tree.pop("goal")
    leaves = list(tree["arms"]["arm1"]["tree"]["sequence"])
    return Task(tree, leaves, object="cube", goal=(0.45, -0.42, 0.5), duration=60.0)


def _insertions(dice: Dice) -> Task:
    """An arm inserts a peg into a hole."""
    tree = shipped("peg_in_hole")
    tree["world"]["reality"] = dice.one(["ideal", "lab"])
    tree["arms"]["arm1"]["robot"] = dice.one(["ur5", "ur5e"])
    leaves = list(tree["arms"]["arm1"]["tree"]["sequence"])
    return Task(tree, leaves, object="peg", goal=(0.30, -0.48, 0.44), duration=150.0)


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
    return Task(tree, leaves, partner="arm2", object="red", goal=(0.4, 0.05, 0.24), duration=60.0)


TASKS: Final[Mapping[str, Callable[[Dice], Task]]] = {
    "pick": _picks,
    "path": _paths,
    "track": _tracks,
    "handover": _handovers,
    "carry": _carries,
    "sight": _searches,
    "drawer": _drawers,
    "insert": _insertions,
    "meeting": _meetings,
}


# ---------------------------------------------------------------- faults


def _too_heavy(task: Task, dice: Dice) -> tuple[str, ...]:
    mass = dice.number(15, 40, 1)
    task.tree["objects"][task.object]["mass"] = mass
    return (task.object, f"{mass:g}")


def _too_wide(task: Task, dice: Dice) -> tuple[str, ...] | None:
    thing = task.tree["objects"][task.object]
    width = dice.number(0.1, 0.14)
    if task.object == "bar":
        thing["size"] = [0.16, width, width]
        thing["pose"]["xyz"][2] = round(0.2005 + width / 2, 4)
    elif thing["shape"] == "box":
        thing["size"][:2] = [width, width]
    else:
        thing["size"][0] = width / 2
    return (task.object,)


def _cover_over_goal(task: Task, dice: Dice) -> tuple[str, ...]:
    x, y, z = task.goal
    at = (x, y, z + dice.number(0.1, 0.16))
    task.tree["objects"]["cover"] = box((0.2, 0.2, 0.02), at)
    return ("cover",)


def _lid_over_object(task: Task, dice: Dice) -> tuple[str, ...]:
    x, y, z = task.tree["objects"][task.object]["pose"]["xyz"]
    at = (x, y, z + dice.number(0.07, 0.12))
    task.tree["objects"]["roof"] = box((0.4, 0.4, 0.01), at)
    return ("roof",)


def _fence_around_object(task: Task, dice: Dice) -> tuple[str, ...]:
    x, y, z = task.tree["objects"][task.object]["pose"]["xyz"]
    d = dice.number(0.042, 0.047)
    for name, dx, dy, size in (
        ("fence_left", -d, 0, (0.02, 0.14, 0.16)),
        ("fence_right", d, 0, (0.02, 0.14, 0.16)),
        ("fence_front", 0, -d, (0.07, 0.02, 0.16)),
        ("fence_back", 0, d, (0.07, 0.02, 0.16)),
    ):
        task.tree["objects"][name] = box(size, (x + dx, y + dy, z + 0.06))
    task.tree["objects"]["from"]["size"][:2] = [0.05, 0.05]
    return ("fence",)


def _goal_far_away(task: Task, dice: Dice) -> tuple[str, ...] | None:
    far = task.reach * dice.number(1.8, 3.0)
    if task.has("place"):
        skill = dice.one(["transport", "place"] if task.has("transport") else ["place"])
        port = "to" if skill == "transport" else "at"
        task.ports(skill)[port]["xyz"][:2] = [round(far * 0.7, 3), round(far * 0.7, 3)]
    elif task.has("reach_to_pose"):
        task.ports("reach_to_pose")["to"]["xyz"][:2] = [round(far, 3), 0.1]
    else:
        task.ports("carry_together")["path"][-1]["xyz"][1] = -1.9
        return (task.object,)
    return (task.tree["arms"][task.arm]["robot"],)


def _goal_in_centimeters(task: Task, dice: Dice) -> tuple[str, ...] | None:
    skill, port = dice.one(
        [pair for pair in (("transport", "to"), ("reach_to_pose", "to")) if task.has(pair[0])]
    )
    pose = task.ports(skill)[port]
    pose["xyz"] = [round(100 * x, 1) for x in pose["xyz"]]
    return ("centimeters",)


def _never_spawned(task: Task, dice: Dice) -> tuple[str, ...]:
    del dice
    task.tree["objects"][task.object]["spawned"] = False
    return (task.object,)


def _no_grasp(task: Task, dice: Dice) -> tuple[str, ...]:
    del dice
    leaf = task.leaves.pop(task.index("grasp"))
    return (leaf["grasp"]["object"],)


def _let_go_before(task: Task, dice: Dice) -> tuple[str, ...]:
    skill = next(one for one in ("place", "hand_over", "insert") if task.has(one))
    release: Tree = {"release": {}}
    waits = {"sequence": [{"wait": {"seconds": dice.number(0.2, 1.0, 1)}}, release]}
    task.leaves.insert(task.index(skill), dice.one([release, waits]))
    return ("release",)


def _placed_twice(task: Task, dice: Dice) -> tuple[str, ...]:
    del dice
    at = task.index("place")
    task.leaves.insert(at + 1, copy.deepcopy(task.leaves[at]))
    return (task.object,)


def _grasped_twice(task: Task, dice: Dice) -> tuple[str, ...]:
    x, y, z = task.tree["objects"][task.object]["pose"]["xyz"]
    thing = copy.deepcopy(task.tree["objects"][task.object])
    thing["pose"]["xyz"] = [round(0.8 * x, 3), round(0.8 * y + 0.1, 3), thing["size"][-1] / 2]
    task.tree["objects"]["second"] = thing
    task.leaves.insert(task.index("grasp") + 1, {"grasp": {"object": "second"}})
    del z, dice
    return (task.object,)


def _fixed(task: Task, dice: Dice) -> tuple[str, ...]:
    del dice
    task.tree["objects"][task.object]["fixed"] = True
    return (task.object,)


def _on_its_edge(task: Task, dice: Dice) -> tuple[str, ...] | None:
    if task.tree["objects"][task.object]["shape"] != "box":
        return None
    task.ports("place")["at"]["rpy"] = [dice.number(25, 40, 0), 0, 0]
    return (task.object,)


def _beside_its_stand(task: Task, dice: Dice) -> tuple[str, ...]:
    """The goal is in the air beside the stand."""
    at = task.ports("place")["at"]["xyz"]
    away = np.array(at[:2]) * (0.14 / np.hypot(*at[:2]))
    at[:2] = [round(float(x), 3) for x in np.array(at[:2]) - away]
    if dice.count(0, 1):
        at[2] += 0.05
    return (task.object,)


def _timeout(task: Task, dice: Dice) -> tuple[str, ...]:
    at = dice.count(0, len(task.leaves) - 2)
    leaf = task.leaves[at]
    task.leaves[at] = {"timeout": {"seconds": dice.number(0.2, 0.6, 2), "child": leaf}}
    return (next(iter(leaf)),)


def _unwritten(task: Task, dice: Dice) -> tuple[str, ...]:
    skill, port = dice.one(
        [
            pair
            for pair in (("place", "at"), ("transport", "to"), ("reach_to_pose", "to"))
            if task.has(pair[0])
        ]
    )
    task.ports(skill)[port] = "{where}"
    written = {"set": {"key": "where", "value": {"xyz": [*task.goal], "rpy": [*_DOWN]}}}
    task.leaves.insert(0, {"selector": [{"succeed": {}}, written]})
    return ("where",)


def _weak_joint(task: Task, dice: Dice) -> tuple[str, ...]:
    return _hardware(task, dice, {"kind": "weak_joint", "strength": 0.05})


def _frozen_joint(task: Task, dice: Dice) -> tuple[str, ...]:
    return _hardware(task, dice, {"kind": "frozen_joint"})


def _stuck_encoder(task: Task, dice: Dice) -> tuple[str, ...]:
    return _hardware(task, dice, {"kind": "stuck_encoder"})


def _hardware(task: Task, dice: Dice, fault: Tree) -> tuple[str, ...]:
    robot = str(task.tree["arms"][task.arm]["robot"])
    joint = load_robot(robot).joints[dice.count(0, 2)]
    begin = dice.number(0.5, 2.5, 2)
    task.tree["faults"] = {
        "defect": {**fault, "arm": task.arm, "joint": joint, "begin": f"{begin} s"}
    }
    return ("defect",)


def _pushed(task: Task, dice: Dice) -> tuple[str, ...]:
    """The object is pushed off its stand before it is grasped."""
    force = [dice.number(6, 9, 1), dice.number(-3, 3, 1), 0]
    task.tree["objects"][task.object]["mass"] = 0.3
    task.tree["faults"] = {
        "nudge": {
            "kind": "pushed_object", "object": task.object, "force": force, "begin": "0.2 s",
            "until": "0.8 s",
        }
    }  # fmt: skip
    return ("nudge",)


def _removed_by_fault(task: Task, dice: Dice) -> tuple[str, ...]:
    begin = dice.number(0.5, 3.0, 2)
    task.tree["faults"] = {
        "theft": {"kind": "removed_object", "object": task.object, "begin": f"{begin} s"}
    }
    return ("theft",)


def _taken_away(task: Task, dice: Dice) -> tuple[str, ...]:
    """Another arm's tree removes the object."""
    leaves: list[Tree] = [
        {"wait": {"seconds": dice.number(0.3, 2.0, 1)}},
        {"remove": {"object": task.object}},
    ]
    task.add_arm("porter", "ur3", (0, 4.0, 0), *leaves)
    return (task.object, "porter")


def _wall_in_path(task: Task, dice: Dice) -> tuple[str, ...]:
    """A plate through the goal of the motion."""
    x, y, z = task.goal
    thickness = dice.number(0.01, 0.04)
    task.tree["objects"]["plate"] = box((0.3, 0.3, thickness), (x, y, z - 0.01))
    return ("plate",)


def _arm_in_path(task: Task, dice: Dice) -> tuple[str, ...]:
    """Another arm reaches to the goal first, and stays there."""
    x, y, z = task.goal
    side = np.arctan2(y, x)
    pose = {"xyz": [round(v, 3) for v in (x, y, max(z, 0.15))], "rpy": [*_DOWN]}
    blocker: list[Tree] = [
        {"reach_to_pose": {"to": pose, "speed": 1.0}},
        {"wait": {"seconds": 300}},
    ]
    beyond = np.array((x, y)) + 0.45 * np.array((np.cos(side), np.sin(side)))
    task.add_arm("blocker", "ur5", [*np.round(beyond, 3).tolist(), 0.0], *blocker)
    task.leaves.insert(0, {"wait": {"seconds": 8}})
    del dice
    return ("blocker",)


def _too_wide_a_curve(task: Task, dice: Dice) -> tuple[str, ...] | None:
    if not task.has("circle"):
        return None
    task.ports("circle")["radius"] = round(task.reach * dice.number(0.9, 1.5), 3)
    return (task.tree["arms"][task.arm]["robot"],)


def _two_at_once(task: Task, dice: Dice) -> tuple[str, ...]:
    del dice
    curve = task.leaves[1]
    task.leaves[1] = {"parallel": {"children": [curve, {"go_home": {}}]}}
    return (next(iter(curve)), "go_home")


def _another_color(task: Task, dice: Dice) -> tuple[str, ...]:
    skill = "track" if task.has("track") else "scan"
    colors = {"yellow", "green", "red", "blue"} - {task.tree["objects"][task.object]["color"]}
    color = dice.one(sorted(colors))
    if skill == "track":
        task.ports("track")["color"] = color
    else:
        task.tree["objects"][task.object]["color"] = color
        ports = task.ports("scan")
        ports.pop("object")
        ports |= {"color": "red", "shape": "box", "size": [0.05, 0.05, 0.05]}
    return (task.object,)


def _screen(task: Task, dice: Dice) -> tuple[str, ...]:
    x, y, z = task.goal
    if task.has("track"):
        at, size = (x + dice.number(0.14, 0.2), y, z), (0.01, 0.6, 0.6)
    else:
        at, size = (x, y, z + dice.number(0.06, 0.09)), (0.3, 0.3, 0.01)
    task.tree["objects"]["screen"] = box(size, at, "white")
    return ("screen",)


def _camera_fault(task: Task, dice: Dice) -> tuple[str, ...]:
    kind = dice.one(["dark_camera", "frozen_camera"])
    task.tree["faults"] = {
        "glitch": {"kind": kind, "arm": task.arm, "begin": f"{dice.number(0.0, 2.0, 1)} s"}
    }
    return ("glitch",)


def _slow_follower(task: Task, dice: Dice) -> tuple[str, ...]:
    share = dice.number(0.01, 0.02)
    task.tree["arms"][task.arm]["limits"] = {
        "velocity": share, "acceleration": 0.05, "jerk": 0.05
    }  # fmt: skip
    return (task.arm,)


def _target_let_go(task: Task, dice: Dice) -> tuple[str, ...]:
    leader = task.tree["arms"]["arm1"]["tree"]["sequence"]
    leader.insert(2, {"wait": {"seconds": dice.number(1.0, 2.0, 1)}})
    leader.insert(3, {"detach": {"object": "cube"}})
    del leader[4:]
    return ("cube",)


def _looked_elsewhere(task: Task, dice: Dice) -> tuple[str, ...]:
    """The searched area is beside the object."""
    ports = task.ports("scan")
    center = [dice.number(0.28, 0.36), dice.number(-0.46, -0.42), 0.40]
    ports |= {"center": center, "width": 0.08, "depth": 0.05}
    task.tree["objects"][task.object]["pose"]["xyz"] = [-0.35, dice.number(-0.5, -0.3), 0.425]
    return (task.object,)


def _nobody_takes(task: Task, dice: Dice) -> tuple[str, ...]:
    """The partner does something else."""
    task.tree["arms"][task.partner]["tree"] = dice.one(
        [{"sequence": [{"go_home": {}}]}, {"sequence": [{"wait": {"seconds": 2}}]}]
    )
    return (task.partner,)


def _partner_waits(task: Task, dice: Dice) -> tuple[str, ...]:
    """The partner comes much too late."""
    sequence = task.tree["arms"][task.partner]["tree"]["sequence"]
    sequence.insert(0, {"wait": {"seconds": 1000}})
    del dice
    return (task.partner,)


def _partner_far_away(task: Task, dice: Dice) -> tuple[str, ...]:
    base = task.tree["arms"][task.partner]["base"]
    base["xyz"][0] += dice.number(1.5, 2.5)
    return (task.partner,)


def _partner_fails(task: Task, dice: Dice) -> tuple[str, ...]:
    """The partner's tree fails before."""
    fail = {"fail": {"code": "NO_AIR", "reason": "no compressed air"}}
    sequence = task.tree["arms"][task.partner]["tree"]["sequence"]
    sequence[:] = [{"wait": {"seconds": dice.number(0.5, 3.0, 1)}}, fail, *sequence]
    return ("no compressed air",)


def _partner_removed(task: Task, dice: Dice) -> tuple[str, ...]:
    task.tree["arms"][task.partner]["removable"] = True
    leaves: list[Tree] = [
        {"wait": {"seconds": dice.number(1, 3, 1)}},
        {"remove": {"arm": task.partner}},
    ]
    task.add_arm("porter", "ur3", (0, 4.0, 0), *leaves)
    return (task.partner,)


def _stiff_goal_box(task: Task, dice: Dice) -> tuple[str, ...]:
    """A box where the beam is carried."""
    x, y, _ = task.ports("carry_together")["path"][0]["xyz"]
    task.tree["objects"]["crate"] = box((0.3, 0.2, 0.2), (x, y, dice.number(0.72, 0.78)))
    return ("crate",)


def _stiff_drawer(task: Task, dice: Dice) -> tuple[str, ...]:
    task.tree["objects"]["cabinet"]["joints"]["slide"]["friction"] = dice.number(300, 600, 0)
    return ("cabinet",)


def _crate_before_drawer(task: Task, dice: Dice) -> tuple[str, ...]:
    at = (0.45 + dice.number(-0.1, 0.1), -0.40 + dice.number(-0.02, 0.02), 0.44)
    task.tree["objects"]["crate"] = box((0.05, 0.03, 0.08), at)
    return ("crate",)


def _handle_let_go(task: Task, dice: Dice) -> tuple[str, ...]:
    del dice
    task.leaves.insert(task.index("operate"), {"release": {}})
    return ("release",)


def _thick_peg(task: Task, dice: Dice) -> tuple[str, ...]:
    task.tree["objects"]["peg"]["size"][0] = dice.number(0.0108, 0.013, 4)
    return ()


def _plugged_hole(task: Task, dice: Dice) -> tuple[str, ...]:
    height = dice.number(0.008, 0.015)
    task.tree["objects"]["plug"] = box((0.02, 0.02, height), (0.30, -0.48, 0.40 + height / 2))
    return ("plug",)


def _hole_elsewhere(task: Task, dice: Dice) -> tuple[str, ...]:
    at = task.ports("insert")["at"]["xyz"]
    at[0] += dice.number(0.02, 0.03)
    return ()


def _never_freed(task: Task, dice: Dice) -> tuple[str, ...]:
    """The partner keeps the zone."""
    task.tree["arms"][task.partner]["tree"] = {
        "sequence": [
            {"claim": {"zone": "tray", "child": {"wait": {"seconds": 1000}}}},
            {"meet": "all_placed"},
        ]
    }
    task.leaves[0] = {"sequence": [{"wait": {"seconds": dice.number(1, 2, 1)}}, task.leaves[0]]}
    return (task.partner,)


def _does_not_meet(task: Task, dice: Dice) -> tuple[str, ...]:
    """The partner waits before the meeting."""
    sequence = task.tree["arms"][task.partner]["tree"]["sequence"]
    sequence.insert(2, {"wait": {"seconds": 1000}})
    del dice
    return (task.partner,)


_HARDWARE: Final = (
    Fault("a weak joint", _weak_joint, ("INJECTED",)),
    Fault("a frozen joint", _frozen_joint, ("INJECTED",)),
    Fault("a stuck encoder", _stuck_encoder, ("INJECTED",)),
)

FAULTS: Final[Mapping[str, Sequence[Fault]]] = {
    "pick": (
        Fault("too heavy", _too_heavy, ("OVERLOADED", "TOO_HEAVY")),
        Fault("too wide", _too_wide, ("TOO_WIDE",)),
        Fault("a cover over the goal", _cover_over_goal, ("IN_THE_WAY", "NO_ROOM")),
        Fault("a roof over the object", _lid_over_object, ("IN_THE_WAY", "NO_ROOM")),
        Fault("a fence around the object", _fence_around_object, ("IN_THE_WAY", "NO_ROOM")),
        Fault("a goal far away", _goal_far_away, ("OUT_OF_REACH",)),
        Fault("a goal in centimeters", _goal_in_centimeters, ("OUT_OF_REACH",)),
        Fault("an object that nobody spawns", _never_spawned, ("NOT_SPAWNED_YET",)),
        Fault("no grasp", _no_grasp, ("NEVER_ATTACHED",)),
        Fault("let go before", _let_go_before, ("LET_GO", "FELL")),
        Fault("placed twice", _placed_twice, ("LET_GO",)),
        Fault("a second grasp", _grasped_twice, ("HAND_FULL", "GRIPPER_FULL", "HELD")),
        Fault("a fixed object", _fixed, ("FIXED",)),
        Fault("placed on its edge", _on_its_edge, ("NOT_SUPPORTED",)),
        Fault("placed in the air", _beside_its_stand, ("NOTHING_THERE", "NOT_SUPPORTED", "FELL")),
        Fault("a timeout", _timeout, ("TOO_LITTLE_TIME",)),
        Fault("a key that is not written", _unwritten, ("NEVER_WRITTEN",)),
        Fault("pushed away", _pushed, ("INJECTED",)),
        Fault("removed by a fault", _removed_by_fault, ("INJECTED",)),
        Fault("removed by another arm", _taken_away, ("TAKEN_AWAY",)),
        Fault("an arm at the goal", _arm_in_path, ("OTHER_ARM",)),
        *_HARDWARE,
    ),
    "path": (
        Fault("a plate at the goal", _wall_in_path, ("IN_THE_WAY", "NO_ROOM")),
        Fault("an arm at the goal", _arm_in_path, ("OTHER_ARM",)),
        Fault("a goal far away", _goal_far_away, ("OUT_OF_REACH",)),
        Fault("a goal in centimeters", _goal_in_centimeters, ("OUT_OF_REACH",)),
        Fault("a circle too wide", _too_wide_a_curve, ("OUT_OF_REACH",)),
        Fault("two motions at once", _two_at_once, ("BUSY",)),
        Fault("a timeout", _timeout, ("TOO_LITTLE_TIME",)),
        Fault("a key that is not written", _unwritten, ("NEVER_WRITTEN",)),
        *_HARDWARE,
    ),
    "track": (
        Fault("another color", _another_color, ("WRONG_COLOR",)),
        Fault("a screen", _screen, ("OCCLUDED",)),
        Fault("a fault of the camera", _camera_fault, ("INJECTED",)),
        Fault("a slow follower", _slow_follower, ("TOO_SLOW",)),
        Fault("the target is let go", _target_let_go, ("LET_GO", "FELL")),
        Fault("removed by another arm", _taken_away, ("TAKEN_AWAY",)),
        Fault("removed by a fault", _removed_by_fault, ("INJECTED",)),
        *_HARDWARE,
    ),
    "handover": (
        Fault("too heavy", _too_heavy, ("OVERLOADED", "TOO_HEAVY")),
        Fault("too wide", _too_wide, ("TOO_WIDE",)),
        Fault("a partner that does not take", _nobody_takes, ("PARTNER_GONE", "OTHER_ARM")),
        Fault("a partner far away", _partner_far_away, ("OUT_OF_REACH",)),
        Fault("a partner that fails", _partner_fails, ("SAID_SO", "PARTNER_GONE")),
        Fault("a partner that is removed", _partner_removed, ("PARTNER_GONE", "TAKEN_AWAY")),
        Fault("let go before", _let_go_before, ("LET_GO", "FELL")),
        Fault("no grasp", _no_grasp, ("NEVER_ATTACHED",)),
        Fault("removed by a fault", _removed_by_fault, ("INJECTED",)),
        Fault("removed by another arm", _taken_away, ("TAKEN_AWAY",)),
        *_HARDWARE,
    ),
    "carry": (
        Fault("too heavy", _too_heavy, ("OVERLOADED", "TOO_HEAVY")),
        Fault("a goal far away", _goal_far_away, ("OUT_OF_REACH",)),
        Fault("a crate in the path", _stiff_goal_box, ("IN_THE_WAY", "NO_ROOM")),
        Fault("a partner that does not come", _nobody_takes, ("PARTNER_GONE", "OTHER_ARM")),
        Fault("a partner that comes too late", _partner_waits, ("PARTNER_GONE", "OTHER_ARM")),
        Fault("a partner far away", _partner_far_away, ("OUT_OF_REACH",)),
        Fault("a partner that fails", _partner_fails, ("SAID_SO", "PARTNER_GONE")),
        Fault("removed by a fault", _removed_by_fault, ("INJECTED",)),
        *_HARDWARE,
    ),
    "sight": (
        Fault("another color", _another_color, ("WRONG_COLOR",)),
        Fault("a screen", _screen, ("OCCLUDED",)),
        Fault("a fault of the camera", _camera_fault, ("INJECTED",)),
        Fault("the wrong place", _looked_elsewhere, ("OUT_OF_VIEW",)),
        Fault("too heavy", _too_heavy, ("OVERLOADED", "TOO_HEAVY")),
        Fault("a goal far away", _goal_far_away, ("OUT_OF_REACH",)),
        Fault("removed by another arm", _taken_away, ("TAKEN_AWAY",)),
        Fault("a timeout", _timeout, ("TOO_LITTLE_TIME",)),
        *_HARDWARE,
    ),
    "drawer": (
        Fault("a stiff drawer", _stiff_drawer, ("TOO_STIFF", "HANDLE_SLIPPED", "BLOCKED")),
        Fault("a crate before it", _crate_before_drawer, ("IN_THE_WAY", "BLOCKED", "RAN_INTO")),
        Fault("a handle that was let go", _handle_let_go, ("LET_GO",)),
        Fault("no grasp", _no_grasp, ("NEVER_ATTACHED",)),
        Fault("too wide", _too_wide, ("TOO_WIDE",)),
        Fault("removed by a fault", _removed_by_fault, ("INJECTED",)),
        Fault("removed by another arm", _taken_away, ("TAKEN_AWAY",)),
        Fault("a timeout", _timeout, ("TOO_LITTLE_TIME",)),
        *_HARDWARE,
    ),
    "insert": (
        Fault("a thick peg", _thick_peg, ("JAMMED", "NOT_FOUND", "NOT_INSERTED")),
        Fault("a plugged hole", _plugged_hole, ("JAMMED", "NOT_INSERTED", "IN_THE_WAY")),
        Fault("a hole elsewhere", _hole_elsewhere, ("NOT_FOUND", "IN_THE_WAY", "JAMMED")),
        Fault("let go before", _let_go_before, ("LET_GO", "FELL")),
        Fault("no grasp", _no_grasp, ("NEVER_ATTACHED",)),
        Fault("removed by a fault", _removed_by_fault, ("INJECTED",)),
        Fault("a timeout", _timeout, ("TOO_LITTLE_TIME",)),
        *_HARDWARE,
    ),
    "meeting": (
        Fault("a zone that is never freed", _never_freed, ("OTHER_ARM",)),
        Fault("a partner that does not meet", _does_not_meet, ("OTHER_ARM",)),
        Fault("a partner that fails", _partner_fails, ("SAID_SO", "PARTNER_GONE")),
        Fault("a partner that is removed", _partner_removed, ("PARTNER_GONE", "TAKEN_AWAY")),
        Fault("too heavy", _too_heavy, ("OVERLOADED", "TOO_HEAVY")),
        Fault("removed by another arm", _taken_away, ("TAKEN_AWAY",)),
        Fault("no grasp", _no_grasp, ("NEVER_ATTACHED",)),
        *_HARDWARE,
    ),
}
