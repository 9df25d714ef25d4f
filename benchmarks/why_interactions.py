"""Thirty mistakes in which two features interact, planted before the rules were checked for them.

Arms and objects that are removed or spawned while others work, repeated motions, recovery branches
with their own ``fail``, held objects, keys that some branches write.
"""

from __future__ import annotations

from collections.abc import Iterator

from benchmarks.why_mistake import Mistake, Tree, box, shipped, steps

_CUBE = {"shape": "box", "size": [0.05, 0.05, 0.05], "mass": 0.1, "color": "red"}
_STAND = box((0.1, 0.1, 0.3), (0.55, -0.3, 0.15))
_ON_STAND = {**_CUBE, "pose": {"xyz": [0.55, -0.3, 0.325]}}
_TAKE = {"approach_and_attach": {"object": "cube"}}
_LIFT = {"reach_to_pose": {"offset": {"xyz": [0, 0, 0.15]}}}
_DOWN = [180, 0, 0]


def interactions() -> list[Mistake]:
    """All mistakes of this module."""
    return [
        *_of_removed(),
        *_of_trackers(),
        *_of_repeated(),
        *_of_recoveries(),
        *_of_held(),
        *_of_others(),
        *_of_keys(),
    ]


def _cell(*leaves: Tree, objects: Tree | None = None, **others: list[Tree]) -> Tree:
    """A tree file with a UR5 beside a stand with a cube, and other UR5s that face it."""
    arms = {"arm1": {"robot": "ur5", "tree": {"sequence": [*leaves]}}}
    for name, sequence in others.items():
        base = {"xyz": [1.1, 0.1, 0], "rpy": [0, 0, 180]}
        arms[name] = {"robot": "ur5", "base": base, "tree": {"sequence": sequence}}
    world_objects = {"stand": _STAND, "cube": _ON_STAND} if objects is None else objects
    world = {"scene": "empty", "reality": "ideal"}
    return {"bt_dualarm": 1, "name": "cell", "world": world, "objects": world_objects, "arms": arms}


def _wait(seconds: float) -> Tree:
    return {"wait": {"seconds": seconds}}


def _reach(*xyz: float, **more: object) -> Tree:
    return {"reach_to_pose": {"to": {"xyz": [*xyz], "rpy": _DOWN}, **more}}


def _of_removed() -> Iterator[Mistake]:
    """Arms and objects that are removed or spawned while others need them."""
    tree = _cell({"remove": {"arm": "arm2"}}, _wait(2), arm2=[_wait(20)])
    yield Mistake("an arm is removed while it waits", tree, "TAKEN_AWAY", ("arm2", "remove"))
    away = [{"remove": {"arm": "arm2"}}, _wait(2)]
    late = {"approach_and_attach": {"object": "cube", "at": {"xyz": [0.55, -0.3, 0.475]}}}
    tree = _cell(_wait(10), *away, late, arm2=[_TAKE, _LIFT, _wait(100)])
    tree["arms"]["arm2"]["removable"] = True
    yield Mistake("the removed arm let fall what it held", tree, "FELL", ("cube", "arm2"), 40.0)
    tree = _cell(_TAKE, _wait(2), {"transport": {"to": {"xyz": [0.4, 0.3, 0.4]}}})
    tree["arms"]["arm1"]["tree"]["sequence"][2]["transport"]["object"] = "cube"
    tree["arms"]["arm2"] = {
        "robot": "ur3",
        "base": {"xyz": [0, 2, 0]},
        "tree": {"sequence": [_wait(8), {"remove": {"object": "cube"}}]},
    }
    steps(tree)[1] = _wait(10)
    yield Mistake("what is held is removed", tree, "TAKEN_AWAY", ("cube", "remove"), 40.0)
    tree = _cell({"retry": {"times": 2, "child": _TAKE}}, arm2=[_wait(15)])
    tree["objects"]["cube"] = {**_ON_STAND, "spawned": False}
    steps(tree, "arm2").append({"spawn": {"object": "cube"}})
    yield Mistake("tried twice before another arm spawns it", tree, "NOT_SPAWNED_YET", ("cube",))
    tree = shipped("visual_tracking")
    first = steps(tree)
    first[0], first[1] = first[1], first[0]
    first.insert(1, _wait(2))
    first.insert(0, _wait(0.5))
    del tree["arms"]["arm2"]
    yield Mistake("its stand is removed first", tree, "FELL", ("cube", "stand"), 30.0)


def _of_trackers() -> Iterator[Mistake]:
    """Trackers, and causes that prevent tracking."""
    tree = shipped("visual_tracking")
    slow = {"velocity": 0.01, "acceleration": 0.05, "jerk": 0.05}
    tree["arms"]["arm2"]["limits"] = slow
    yield Mistake("an arm too slow for its target", tree, "TOO_SLOW", ("arm2",), 30.0)
    tree = shipped("visual_tracking")
    gains = {"controller": "proportional", "gain_u": 0.001, "gain_v": 0.001}
    tree["arms"]["arm2"]["tree"]["track"] |= gains
    yield Mistake("gains too small to follow", tree, "TOO_SLOW", ("gain",), 30.0)
    tree = shipped("visual_tracking")
    steps(tree)[2:] = [_wait(3), {"remove": {"object": "cube"}}]
    yield Mistake("the followed cube is removed", tree, "TAKEN_AWAY", ("cube", "remove"), 30.0)
    tree = shipped("visual_tracking")
    screen = box((0.02, 0.8, 0.8), (0.85, 0.11, 0.7), "white", spawned=False)
    tree["objects"]["screen"] = screen
    spawn = {"sequence": [_wait(2), {"spawn": {"object": "screen"}}, _wait(20)]}
    both = {"parallel": {"children": [steps(tree)[2], spawn]}}
    steps(tree)[2] = both
    yield Mistake("a screen is spawned before a camera", tree, "OCCLUDED", ("screen",), 30.0)


def _of_repeated() -> Iterator[Mistake]:
    """Relative motions that are repeated from where they have ended."""
    circle = {"circle": {"plane": "yz", "radius": 0.12, "end": "rim", "speed": 1.0}}
    tree = _cell({"repeat": {"times": 20, "child": circle}}, objects={})
    yield Mistake("a circle that ends on its rim, repeated", tree, "DRIFT", ("circle",), 60.0)
    higher = {"reach_to_pose": {"offset": {"xyz": [0, 0, 0.1]}, "speed": 1.0}}
    tree = _cell({"repeat": {"times": 20, "child": higher}}, objects={})
    yield Mistake("an offset that adds up in a loop", tree, "DRIFT", ("reach_to_pose",), 60.0)
    put = [{"transport": {"object": "cube", "to": {"xyz": [0.55, -0.3, 0.326]}}}]
    put += [{"detach": {"object": "cube"}}, _wait(0.5)]
    tree = _cell(_TAKE, {"repeat": {"times": 2, "child": {"sequence": put}}})
    yield Mistake("let go in a loop, taken before it", tree, "LET_GO", ("cube", "detach"), 40.0)


def _of_recoveries() -> Iterator[Mistake]:
    """Recovery branches that give up after the actual failure."""
    gave_up = {"fail": {"code": "GAVE_UP", "reason": "no more attempts"}}
    far = _reach(1.6, 0.2, 0.4)
    tree = _cell({"selector": [far, {"sequence": ["go_home", gave_up]}]}, objects={})
    yield Mistake("home and fail after a far target", tree, "OUT_OF_REACH", ("ur5",))
    stuck = {**_ON_STAND, "fixed": True}
    tries = {"retry": {"times": 2, "child": _TAKE}}
    carry = {"sequence": [tries, _LIFT]}
    tree = _cell(
        {"selector": [carry, {"sequence": [{"log": "giving up"}, gave_up]}]},
        objects={"stand": _STAND, "cube": stuck},
    )
    yield Mistake("fail after two tries at what is fixed", tree, "FIXED", ("cube",), 40.0)
    wall = box((0.6, 0.02, 1.2), (0.55, 0.3, 0.6))
    target = _reach(0.45, 0.3, 0.4)
    tree = _cell({"subtree": {"use": "attempt"}}, objects={"wall": wall})
    tree["subtrees"] = {"attempt": {"tree": {"selector": [target, gave_up]}}}
    yield Mistake("fail of a subtree after a wall", tree, "IN_THE_WAY", ("wall",))
    slow = {"circle": {"plane": "yz", "radius": 0.1, "speed": 0.05}}
    timed = {"timeout": {"seconds": 1, "child": slow}}
    tree = _cell({"selector": [timed, gave_up]}, objects={})
    yield Mistake("fail after a timeout", tree, "TOO_LITTLE_TIME", ("circle",))
    forced = {"force_success": {"child": {"timeout": {"seconds": 0.5, "child": _TAKE}}}}
    tree = _cell(forced, {"transport": {"object": "cube", "to": {"xyz": [0.4, 0.3, 0.5]}}})
    names = ("cube", "approach_and_attach")
    yield Mistake("a failed pick that counts as success", tree, "NEVER_ATTACHED", names)


def _of_held() -> Iterator[Mistake]:
    """Held objects, and collisions with them."""
    rod = {**_CUBE, "size": [0.03, 0.03, 0.3], "pose": {"xyz": [0.55, -0.3, 0.3]}}
    stand = box((0.1, 0.1, 0.1495), (0.55, -0.3, 0.07475))
    block = box((0.2, 0.2, 0.3), (0.45, 0.35, 0.15))
    low = _reach(0.45, 0.35, 0.45)
    world_objects = {"rod": rod, "stand": stand, "block": block}
    take = {"approach_and_attach": {"object": "rod"}}
    tree = _cell(take, _LIFT, low, objects=world_objects)
    yield Mistake("a held rod and a block at the goal", tree, "IN_THE_WAY", ("block", "rod"), 40.0)
    wall = box((0.3, 0.3, 0.4), (0.4, 0.45, 0.2))
    carry = {"transport": {"object": "rod", "to": {"xyz": [0.4, 0.45, 0.5]}}}
    world_objects = {"rod": rod, "stand": stand, "wall": wall}
    tree = _cell(take, _LIFT, carry, objects=world_objects)
    yield Mistake("carried into a wall", tree, "IN_THE_WAY", ("wall", "rod"), 40.0)
    long = {**rod, "size": [0.03, 0.03, 0.36], "pose": {"xyz": [0.55, -0.3, 0.33]}}
    fold = {"move_joints": {"by": {"wrist_1_joint": 120}}}
    rise = {"reach_to_pose": {"offset": {"xyz": [0, 0, 0.05]}}}
    tree = _cell(take, rise, fold, objects={"rod": long, "stand": stand})
    yield Mistake("a held rod folded into its arm", tree, "SELF_COLLISION", ("rod",), 40.0)
    drop = {"sequence": [_wait(1), {"detach": {"object": "cube"}}]}
    slowly: Tree = {"object": "cube", "to": {"xyz": [0.4, 0.4, 0.5]}, "speed": 0.05}
    carry = {"transport": slowly}
    tree = _cell(_TAKE, {"parallel": {"children": [carry, drop]}})
    yield Mistake("detached while it is carried", tree, "LET_GO", ("cube", "detach"), 40.0)


def _of_others() -> Iterator[Mistake]:
    """Two arms, one of which holds, spawns or takes an object."""
    reach = [_wait(8), _reach(0.55, 0.0, 0.5, patience=2.0)]
    hold = [_TAKE, _reach(0.55, 0.0, 0.6), _wait(100)]
    tree = _cell(*reach, arm2=hold)
    yield Mistake("another arm stands at the goal with a cube", tree, "OTHER_ARM", ("arm2",), 40.0)
    timed = {"timeout": {"seconds": 3, "child": _reach(0.55, 0.0, 0.5, patience=30.0)}}
    tree = _cell(_wait(8), timed, arm2=hold)
    yield Mistake("a timeout while another arm is there", tree, "OTHER_ARM", ("arm2",), 40.0)
    wall = box((0.8, 0.02, 1.0), (0.5, 0.25, 0.5), spawned=False)
    sweep = [_reach(0.45, -0.3, 0.4), _reach(0.45, 0.45, 0.4, speed=0.1)]
    tree = _cell(*sweep, objects={"wall": wall})
    tree["arms"]["arm2"] = {
        "robot": "ur3",
        "base": {"xyz": [0, 2, 0]},
        "tree": {"sequence": [_wait(5), {"spawn": {"object": "wall"}}, _wait(100)]},
    }
    yield Mistake("a wall is spawned into a motion", tree, "IN_THE_WAY", ("wall",), 40.0)
    late = {"approach_and_attach": {"object": "cube", "at": {"xyz": [0.55, -0.3, 0.325]}}}
    aside = {"transport": {"object": "cube", "to": {"xyz": [0.8, 0.5, 0.4]}}}
    tree = _cell(_wait(12), late, arm2=[_TAKE, _LIFT, aside, _wait(100)])
    yield Mistake("carried away before it is taken", tree, "HELD", ("cube", "arm2"), 60.0)
    inside = box((0.3, 0.3, 0.3), (0.0, 0.0, 0.4), spawned=False)
    tree = _cell(objects={"block": inside}, arm2=[{"spawn": {"object": "block"}}])
    tree["arms"]["arm1"]["tree"] = _wait(3)
    yield Mistake("spawned into another arm", tree, "NO_ROOM", ("block", "arm1"))
    both = [{"circle": {"plane": "yz", "radius": 0.1}}, {"subtree": {"use": "aside"}}]
    tree = _cell({"parallel": {"children": both}}, objects={})
    tree["subtrees"] = {"aside": {"tree": {"sequence": [_wait(1), _LIFT]}}}
    yield Mistake("a subtree moves what a circle moves", tree, "BUSY", ("circle",))


def _of_keys() -> Iterator[Mistake]:
    """Keys of the blackboard that a branch does not write, or that another branch writes."""
    there = {"set": {"key": "there", "value": {"xyz": [0.4, 0.2, 0.4], "rpy": _DOWN}}}
    differs = {"compare": {"value": 1, "to": 2}}
    chosen = {"if": {"condition": differs, "then": there, "else": "succeed"}}
    tree = _cell(chosen, {"reach_to_pose": {"to": "{there}"}}, objects={})
    yield Mistake("a key of the branch not taken", tree, "NEVER_WRITTEN", ("there",))
    start = {"set": {"key": "ok", "value": 1}}
    stop = {"sequence": [_wait(1), {"set": {"key": "ok", "value": 0}}, _wait(20)]}
    watched = {
        "guard": {
            "condition": {"compare": {"value": "{ok}", "to": 1}},
            "child": {"circle": {"plane": "yz", "radius": 0.1, "speed": 0.1}},
        }
    }
    tree = _cell(start, {"parallel": {"children": [watched, stop]}}, objects={})
    yield Mistake("a guard's key changed by a branch beside", tree, "CONDITION", ("ok", "set"))
    count = {"set": {"key": "n", "value": 0}}
    again = {"sequence": [{"set": {"key": "n", "value": 1}}, _wait(0.1)]}
    three = {"compare": {"value": "{n}", "relation": "equal", "to": 3}}
    tree = _cell(count, {"repeat": {"times": 3, "child": again}}, three, objects={})
    yield Mistake("a counter that does not count", tree, "CONDITION", ("n", "set"))
