"""Mistakes of a generated family: random tasks of random robots, with one random fault each.

The tasks are those of `benchmarks.random_tasks`. A fault is a function that changes such a task,
and states which causes are right for it. Both are drawn from a seed: the rules of ``bt-why`` cannot
know them. About a third of the leaves are within a retry, a timeout or a selector. A fault counts
only if the task succeeds without it.
"""

from __future__ import annotations

import copy
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Final

import numpy as np

from benchmarks.random_programs import Dice
from benchmarks.random_tasks import FIRST_TASKS as TASKS
from benchmarks.task_parts import DOWN, Task
from benchmarks.why_mistake import Mistake, Tree, box
from bt_dualarm.robots.robot_description import load_robot


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
    robots = "+".join(str(arm["robot"]) for arm in task.tree["arms"].values())
    kind, *also = fault.kinds
    return Mistake(
        f"{task_name} {robots}: {fault.name}",
        task.finish(),
        kind,
        names,
        task.duration,
        tuple(also),
        original.finish(),
    )


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


def _too_heavy(task: Task, dice: Dice, name: str = "") -> tuple[str, ...]:
    name = name or task.object
    mass = dice.number(15, 40, 1)
    task.tree["objects"][name]["mass"] = mass
    return (name, f"{mass:g}")


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
    at = task.index("grasp")
    taken = task.leaves.pop(at)["grasp"]["object"]
    return (taken,) if taken in str(task.leaves[at]) else ()


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


def _fixed(task: Task, dice: Dice, name: str = "") -> tuple[str, ...]:
    del dice
    name = name or task.object
    task.tree["objects"][name]["fixed"] = True
    return (name,)


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
    if isinstance(leaf, str):
        return (leaf,)
    name, ports = next(iter(leaf.items()))
    return (ports["use"] if name == "subtree" else name,)


def _unwritten(task: Task, dice: Dice) -> tuple[str, ...]:
    skill, port = dice.one(
        [
            pair
            for pair in (("place", "at"), ("transport", "to"), ("reach_to_pose", "to"))
            if task.has(pair[0])
        ]
    )
    task.ports(skill)[port] = "{where}"
    written = {"set": {"key": "where", "value": {"xyz": [*task.goal], "rpy": [*DOWN]}}}
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
    pose = {"xyz": [round(v, 3) for v in (x, y, max(z, 0.15))], "rpy": [*DOWN]}
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


def _never_built(task: Task, dice: Dice) -> tuple[str, ...] | None:
    """A box of the tower is put on one that is not there yet."""
    places = [i for i, leaf in enumerate(task.leaves) if "place" in leaf]
    if len(places) < 2:
        return None
    on = task.leaves[places[1]]["place"]["at"]["on"]
    del task.leaves[places[0] - 1 : places[0] + 1]
    task.tree["objects"][on]["spawned"] = False
    del dice
    return (on,)


def _stiff_door(task: Task, dice: Dice) -> tuple[str, ...]:
    joint = task.tree["objects"]["chest"]["joints"]["axle"]
    joint["friction"] = dice.number(200, 400, 0)
    return ("chest",)


def _too_short_a_way(task: Task, dice: Dice) -> tuple[str, ...]:
    """The joint ends before the position that is asked for."""
    joint = task.tree["objects"]["chest"]["joints"]["axle"]
    wanted = task.ports("operate")["to"]
    joint["range"] = sorted([0, round(wanted * dice.number(0.3, 0.6), 3)])
    return ("axle",)


def _other_part(task: Task, dice: Dice) -> tuple[str, ...]:
    """It holds the body of the furniture, which no joint moves."""
    del dice
    task.leaves.pop(0)
    return ("chest",)


def _no_board(task: Task, dice: Dice) -> tuple[str, ...]:
    """The surface is too far below."""
    board = task.tree["objects"]["board"]
    lower = round(board["size"][2] - dice.number(0.2, 0.25), 3)
    if lower <= 0.0:
        del task.tree["objects"]["board"]
    else:
        board["size"][2] = lower
        board["pose"]["xyz"][2] = round(lower / 2, 4)
    task.ports("move_until_contact")["distance"] = 0.06
    return ()


def _plate_in_front(task: Task, dice: Dice) -> tuple[str, ...] | None:
    """A plate beside the tool, into which the curve leads."""
    if not (task.has("follow_path") or task.has("circle")):
        return None
    x, y, z = task.goal
    at = (x + dice.number(0.045, 0.05), y, z - 0.02)
    task.tree["objects"]["plate"] = box((0.01, 0.2, 0.05), at)
    return ("plate",)


def _small_crate(task: Task, dice: Dice) -> tuple[str, ...]:
    """The cube is wider than the bin."""
    width = dice.number(0.064, 0.07)
    cube = task.tree["objects"]["cube"]
    task.tree["objects"]["crate"]["size"][:2] = [0.06, 0.06]
    cube["pose"]["xyz"][2] += (width - cube["size"][2]) / 2
    cube["size"] = [width] * 3
    return ("crate",)


def _scanned_elsewhere(task: Task, dice: Dice) -> tuple[str, ...]:
    """The subtree searches an area beside the objects."""
    scan = task.tree["subtrees"]["put"]["tree"]["sequence"][0]["scan"]
    x, y, z = scan["center"]
    away = dice.one([-1, 1]) * dice.number(0.5, 0.6)
    scan["center"] = [round(x - y * away / np.hypot(x, y), 3), round(y + x * away, 3), z]
    scan |= {"width": 0.05, "depth": 0.05}
    return (task.object,)


def _painted(task: Task, dice: Dice) -> tuple[str, ...]:
    """The object has another color than the one that is looked for."""
    del dice
    put = task.tree["subtrees"]["put"]["tree"]["sequence"]
    for leaf in put[:2]:
        next(iter(leaf.values()))["color"] = "yellow"
    return ("yellow",)


def _goal_of_subtree_far_away(task: Task, dice: Dice) -> tuple[str, ...]:
    far = round(task.reach * dice.number(1.3, 2.0), 3)
    task.leaves[0]["subtree"]["params"]["to"][:2] = [far, 0.1]
    return (task.tree["arms"][task.arm]["robot"],)


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
    "tower": (
        Fault("too heavy", _too_heavy, ("OVERLOADED", "TOO_HEAVY")),
        Fault("too wide", _too_wide, ("TOO_WIDE",)),
        Fault("a box that is not there", _never_built, ("NOT_SPAWNED_YET",)),
        Fault("an object that nobody spawns", _never_spawned, ("NOT_SPAWNED_YET",)),
        Fault("no grasp", _no_grasp, ("NEVER_ATTACHED",)),
        Fault("let go before", _let_go_before, ("LET_GO", "FELL")),
        Fault("a fixed object", _fixed, ("FIXED",)),
        Fault("a roof over the object", _lid_over_object, ("IN_THE_WAY", "NO_ROOM")),
        Fault("removed by a fault", _removed_by_fault, ("INJECTED",)),
        Fault("removed by another arm", _taken_away, ("TAKEN_AWAY",)),
        Fault("a timeout", _timeout, ("TOO_LITTLE_TIME",)),
        *_HARDWARE,
    ),
    "turn": (
        Fault("too heavy", _too_heavy, ("OVERLOADED", "TOO_HEAVY")),
        Fault("an object that nobody spawns", _never_spawned, ("NOT_SPAWNED_YET",)),
        Fault("no grasp", _no_grasp, ("NEVER_ATTACHED",)),
        Fault("let go before", _let_go_before, ("LET_GO", "FELL")),
        Fault("a fixed object", _fixed, ("FIXED",)),
        Fault("a cover over the goal", _cover_over_goal, ("IN_THE_WAY", "NO_ROOM")),
        Fault("removed by a fault", _removed_by_fault, ("INJECTED",)),
        Fault("removed by another arm", _taken_away, ("TAKEN_AWAY",)),
        Fault("a timeout", _timeout, ("TOO_LITTLE_TIME",)),
        *_HARDWARE,
    ),
    "door": (
        Fault("a stiff joint", _stiff_door, ("TOO_STIFF", "HANDLE_SLIPPED", "BLOCKED")),
        Fault("a joint that ends before", _too_short_a_way, ("OUT_OF_RANGE", "AT_ITS_END")),
        Fault("a handle that was let go", _handle_let_go, ("LET_GO",)),
        Fault("no grasp", _other_part, ("NEVER_ATTACHED",)),
        Fault("removed by a fault", _removed_by_fault, ("INJECTED",)),
        Fault("removed by another arm", _taken_away, ("TAKEN_AWAY",)),
        Fault("a timeout", _timeout, ("TOO_LITTLE_TIME",)),
        *_HARDWARE,
    ),
    "contact": (
        Fault("no surface", _no_board, ("NOTHING_THERE",)),
        Fault("a plate in the path", _plate_in_front, ("IN_THE_WAY", "NO_ROOM", "RAN_INTO")),
        Fault("a goal far away", _goal_far_away, ("OUT_OF_REACH",)),
        Fault("a goal in centimeters", _goal_in_centimeters, ("OUT_OF_REACH",)),
        Fault("two motions at once", _two_at_once, ("BUSY",)),
        Fault("a key that is not written", _unwritten, ("NEVER_WRITTEN",)),
        Fault("a timeout", _timeout, ("TOO_LITTLE_TIME",)),
        *_HARDWARE,
    ),
    "tray": (
        Fault("too heavy", _too_heavy, ("OVERLOADED", "TOO_HEAVY")),
        Fault("a heavy bin", partial(_too_heavy, name="crate"), ("OVERLOADED", "TOO_HEAVY")),
        Fault("a fixed bin", partial(_fixed, name="crate"), ("FIXED",)),
        Fault("a small bin", _small_crate, ("IN_THE_WAY", "TOO_NARROW", "NOT_SUPPORTED")),
        Fault("no grasp", _no_grasp, ("NEVER_ATTACHED",)),
        Fault("let go before", _let_go_before, ("LET_GO", "FELL")),
        Fault("removed by a fault", _removed_by_fault, ("INJECTED",)),
        Fault("removed by another arm", _taken_away, ("TAKEN_AWAY",)),
        Fault("a timeout", _timeout, ("TOO_LITTLE_TIME",)),
        *_HARDWARE,
    ),
    "sort": (
        Fault("another color", _painted, ("WRONG_COLOR",)),
        Fault("the wrong place", _scanned_elsewhere, ("OUT_OF_VIEW", "OUT_OF_REACH")),
        Fault("too heavy", _too_heavy, ("OVERLOADED", "TOO_HEAVY")),
        Fault("a goal far away", _goal_of_subtree_far_away, ("OUT_OF_REACH",)),
        Fault("an object that nobody spawns", _never_spawned, ("NOT_SPAWNED_YET",)),
        Fault("a fixed object", _fixed, ("FIXED",)),
        Fault("a fault of the camera", _camera_fault, ("INJECTED",)),
        Fault("removed by a fault", _removed_by_fault, ("INJECTED",)),
        Fault("removed by another arm", _taken_away, ("TAKEN_AWAY",)),
        Fault("a timeout", _timeout, ("TOO_LITTLE_TIME",)),
        *_HARDWARE,
    ),
}
