"""Mistakes planted in the shipped trees, each with the cause that should be found for it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

TREES = Path(__file__).parents[1] / "trees"

Tree = dict[str, Any]


@dataclass(frozen=True)
class Mistake:
    """A shipped tree with one thing wrong.

    Attributes:
        name: Name of the mistake.
        tree: The tree, as Python data.
        kind: Kind of the cause that was planted.
        names: Words that its sentence must have: the object, the leaf, the key.
        duration: Simulated seconds of the run.
    """

    name: str
    tree: Tree
    kind: str
    names: tuple[str, ...] = ()
    duration: float = 25.0


def shipped(name: str) -> Tree:
    """A shipped tree as Python data, ideal so that runs are short."""
    tree: Tree = yaml.safe_load((TREES / f"{name}.yaml").read_text(encoding="utf-8"))
    tree["world"] = {**tree.get("world", {}), "reality": "ideal"}
    return tree


def steps(tree: Tree, arm: str = "arm1") -> list[Tree]:
    """The children of the sequence at the root of an arm's tree."""
    found: list[Tree] = tree["arms"][arm]["tree"]["sequence"]
    return found


def box(size: tuple[float, ...], at: tuple[float, ...], color: str = "grey", **more: Any) -> Tree:
    """A fixed box."""
    said = {"shape": "box", "size": [*size], "mass": 5, "color": color, "fixed": True}
    return {**said, "pose": {"xyz": [*at]}, **more}


def mistakes() -> Iterator[Mistake]:
    """All of them."""
    yield from _out_of_reach()
    yield from _in_the_way()
    yield from _sight()
    yield from _grasp()
    yield from _board()
    yield from _time()
    yield from _others()


def _out_of_reach() -> Iterator[Mistake]:
    for robot, far in (("ur5", 1.4), ("panda", 1.2), ("xarm7", 1.1), ("ur10", 2.0)):
        tree = shipped("reach_to_pose")
        tree["arms"]["arm1"]["robot"] = robot
        pose = {"xyz": [far, 0.2, 0.4], "rpy": [180, 0, 0]}
        tree["arms"]["arm1"]["tree"] = {"sequence": [{"reach_to_pose": {"to": pose}}]}
        yield Mistake(f"a pose too far for a {robot}", tree, "OUT_OF_REACH", (robot,))
    tree = shipped("reach_to_pose")
    steps(tree)[2]["reach_to_pose"]["offset"]["xyz"] = [0.9, 0, 0]
    yield Mistake("an offset too long", tree, "OUT_OF_REACH", ("ur5",))
    tree = shipped("pick_and_transport")
    tree["objects"]["cube"]["pose"]["xyz"] = [0.62, -0.72, 0.425]
    tree["arms"]["arm1"]["base"]["xyz"] = [-0.5, 0, 0.4]
    yield Mistake("the cube too far from the base", tree, "OUT_OF_REACH", ("cube",))
    tree = shipped("pick_and_transport")
    steps(tree)[1]["transport"]["to"]["xyz"] = [0.30, -1.45, 0.65]
    yield Mistake("carried too far", tree, "OUT_OF_REACH", ("ur5",))
    tree = shipped("circle")
    tree["params"] = {}
    tree["arms"]["arm1"]["tree"] = {"circle": {"plane": "yz", "radius": 0.7}}
    yield Mistake("a circle too wide", tree, "OUT_OF_REACH", ("ur5",))
    tree = shipped("circle")
    tree["params"] = {}
    lissajous = {"plane": "yz", "amplitudes": [0.8, 0.5], "frequencies": [1, 2]}
    tree["arms"]["arm1"]["tree"] = {"lissajous": lissajous}
    yield Mistake("a Lissajous curve too wide", tree, "OUT_OF_REACH", ("ur5",))
    tree = shipped("motions")
    tree["arms"] = {"arm1": {"robot": "ur5", "tree": {"move_joints": {"to": {"elbow_joint": 179}}}}}
    tree["arms"]["arm1"]["limits"] = {"velocity": 1.0}
    tree["arms"]["arm1"]["robot"] = "panda"
    tree["arms"]["arm1"]["tree"] = {"move_joints": {"to": {"panda_joint4": 60}}}
    yield Mistake("an angle beyond its joint", tree, "JOINT_LIMIT", ("panda_joint4",))


def _in_the_way() -> Iterator[Mistake]:
    tree = shipped("reach_to_pose")
    tree["objects"] = {"post": box((0.1, 0.1, 0.7), (0.45, 0.25, 0.35))}
    steps(tree).pop(0)
    yield Mistake("a post where the tool is to be", tree, "IN_THE_WAY", ("post",))
    tree = shipped("circle")
    tree["params"] = {}
    tree["objects"] = {"shelf": box((0.4, 0.05, 0.4), (0.75, 0.25, 1.0))}
    tree["arms"]["arm1"]["tree"] = {"circle": {"plane": "yz", "radius": 0.12}}
    yield Mistake("a shelf in a circle", tree, "IN_THE_WAY", ("shelf",))
    tree = shipped("pick_and_transport")
    steps(tree)[2]["transport"]["to"]["xyz"] = [0.20, -0.50, 0.38]
    yield Mistake("put down into the table", tree, "IN_THE_WAY", ("table",))
    tree = shipped("pick_and_transport")
    tree["objects"]["lid"] = box((0.3, 0.3, 0.02), (0.45, -0.40, 0.50))
    yield Mistake("a lid above the cube", tree, "IN_THE_WAY", ("lid",))


def _sight() -> Iterator[Mistake]:
    for name in ("visual_tracking", "pick_and_track"):
        tree = shipped(name)
        tracker = tree["arms"]["arm2"]["tree"]
        track = tracker["track"] if "track" in tracker else tracker["sequence"][1]["track"]
        track["color"] = "green"
        yield Mistake(f"another colour asked for in {name}", tree, "WRONG_COLOR", ("cube",))
    tree = shipped("visual_tracking")
    tree["objects"]["cube"]["color"] = "blue"
    yield Mistake("a cube of another colour", tree, "WRONG_COLOR", ("cube",))
    tree = shipped("visual_tracking")
    tree["objects"]["screen"] = box((0.01, 0.5, 0.5), (0.86, 0.11, 0.75), "white")
    yield Mistake("a screen before the camera", tree, "OCCLUDED", ("screen",))
    tree = shipped("visual_tracking")
    tree["arms"]["arm2"]["base"]["rpy"] = [0, 0, 90]
    yield Mistake("a camera that looks along the plane", tree, "NO_CAMERA", ("90°", "plane"))
    tree = shipped("visual_tracking")
    tree["arms"]["arm2"]["base"]["xyz"] = [1.6, 1.2, 0.28]
    yield Mistake("a camera beside the scene", tree, "OUT_OF_VIEW", ("cube",))
    tree = shipped("visual_tracking")
    aside = {"transport": {"object": "cube", "to": {"xyz": [0.45, 0.65, 0.70]}}}
    steps(tree)[2] = {"sequence": [{"wait": {"seconds": 1}}, aside]}
    tree["arms"]["arm2"]["tree"]["track"]["lost_timeout"] = 1.0
    yield Mistake("the cube is carried too far away", tree, "LEFT_REACH", ("0.30 m",))
    tree = shipped("visual_tracking")
    steps(tree)[2:] = [{"detach": {"object": "cube"}}, {"remove": {"object": "cube"}}]
    tree["arms"]["arm1"]["tree"] = {
        "sequence": [{"wait": {"seconds": 1}}, {"remove": {"object": "cube"}}]
    }
    tree["arms"]["arm2"]["tree"]["track"]["lost_timeout"] = 1.0
    yield Mistake("the cube is taken away", tree, "TAKEN_AWAY", ("cube", "remove"))


def _grasp() -> Iterator[Mistake]:
    tree = shipped("pick_and_transport")
    tree["objects"]["cube"]["mass"] = 30
    yield Mistake("a cube too heavy", tree, "OVERLOADED", ("cube", "30"))
    tree = shipped("pick_and_transport")
    steps(tree).pop(0)
    yield Mistake("nobody picks the cube", tree, "NEVER_ATTACHED", ("cube",))
    tree = shipped("pick_and_transport")
    steps(tree).insert(1, {"detach": {"object": "cube"}})
    yield Mistake("let go too early", tree, "LET_GO", ("cube", "detach"))
    tree = shipped("pick_and_transport")
    tree["objects"]["cube"]["spawned"] = False
    steps(tree)[0] = {"approach_and_attach": {"object": "cube"}}
    yield Mistake("a cube that nobody spawned", tree, "NOT_SPAWNED_YET", ("cube",))
    tree = shipped("pick_and_transport")
    tree["objects"]["cube"]["fixed"] = True
    yield Mistake("a cube that is fixed", tree, "FIXED", ("cube",))
    tree = shipped("pick_and_transport")
    steps(tree)[2]["transport"]["to"]["xyz"] = [0.20, -0.50, 0.60]
    yield Mistake("let go in the air", tree, "FELL", ("cube",))
    tree = shipped("spawn_and_command")
    tree["objects"]["block"] = box((0.4, 0.4, 0.4), (0, 1.5, 0.2))
    yield Mistake("something where an arm is to come", tree, "NO_ROOM", ("block",))


def _board() -> Iterator[Mistake]:
    tree = shipped("reach_to_pose")
    steps(tree)[0]["reach_to_pose"] = {"offset": "{step}"}
    steps(tree).insert(0, {"selector": [{"succeed": {}}, _set("step", {"xyz": [0, 0, 0.1]})]})
    yield Mistake("a key that was never written", tree, "NEVER_WRITTEN", ("step",))
    tree = shipped("reach_to_pose")
    late = {"sequence": [{"wait": {"seconds": 1}}, _set("step", {"xyz": [0, 0, 0.1]})]}
    both = [{"reach_to_pose": {"offset": "{step}"}}, late]
    tree["arms"]["arm1"]["tree"] = {"parallel": {"children": both}}
    yield Mistake("a key that is written too late", tree, "NEVER_WRITTEN", ("step", "set"))
    tree = shipped("reach_to_pose")
    compare = {"value": "{mode}", "relation": "equal", "to": "fast"}
    steps(tree).insert(0, _set("mode", "slow"))
    steps(tree).insert(1, {"compare": compare})
    yield Mistake("a comparison that does not hold", tree, "CONDITION", ("mode", "set"))


def _set(key: str, value: object) -> Tree:
    return {"set": {"key": key, "value": value}}


def _time() -> Iterator[Mistake]:
    for seconds in (0.2, 0.6):
        tree = shipped("reach_to_pose")
        child = steps(tree)[1]
        steps(tree)[1] = {"timeout": {"seconds": seconds, "child": child}}
        yield Mistake(f"a timeout of {seconds} s", tree, "TOO_LITTLE_TIME", ("reach_to_pose",))
    tree = shipped("reach_to_pose")
    tree["world"]["time_limit"] = 2.0
    yield Mistake("a time limit too short", tree, "TOO_LITTLE_TIME", ("reach_to_pose",))
    tree = shipped("pick_and_track")
    steps(tree).insert(0, {"wait": {"seconds": 500}})
    yield Mistake("an arm that waits too long", tree, "TOO_LITTLE_TIME", ("wait",), 8.0)
    for gap in (0.0, 0.05, 0.1):
        yield Mistake(f"arms that block each other, {gap} m", _crossing(gap), "OTHER_ARM", ())


def _crossing(gap: float) -> Tree:
    """Two arms that are to end where the other one stays."""
    arms = {}
    for name, side in (("left", 1), ("right", -1)):
        pose = {"xyz": [0.45, -side * (0.05 + gap) * 0.2, 0.3], "rpy": [180, 0, 0]}
        base = {"xyz": [0, side * 0.45, 0]}
        tree = {"sequence": [{"reach_to_pose": {"to": pose}}, {"wait": {"seconds": 100}}]}
        arms[name] = {"robot": "ur5", "base": base, "tree": tree}
    return {"bt_dualarm": 1, "name": "crossing", "world": {"scene": "empty"}, "arms": arms}


def _others() -> Iterator[Mistake]:
    tree = shipped("circle")
    tree["params"] = {}
    both = [{"circle": {"plane": "yz", "radius": 0.05}}, {"go_home": {}}]
    tree["arms"]["arm1"]["tree"] = {"parallel": {"children": both}}
    yield Mistake("two leaves move one arm", tree, "BUSY", ("circle", "go_home"))
    tree = shipped("circle")
    tree["params"] = {}
    down = {"direction": [0, 0, 1], "distance": 0.05}
    tree["arms"]["arm1"]["tree"] = {"move_until_contact": down}
    yield Mistake("nothing to touch there", tree, "NOTHING_THERE", ("50 mm",))
    tree = shipped("pick_and_transport")
    steps(tree)[0] = {"approach_and_attach": {"object": "cube", "direction": [0, 0, 0]}}
    yield Mistake("a direction without length", tree, "INVALID_TARGET", ("no length",))
    tree = shipped("circle")
    tree["params"] = {}
    tree["objects"] = {"floor_plate": box((0.6, 0.6, 0.02), (0.8, 0.1, 0.50))}
    tree["arms"]["arm1"]["force_limit"] = 10
    press = {"direction": [0, 0, -1], "distance": 0.3, "force": 40}
    tree["arms"]["arm1"]["tree"] = {"move_until_contact": press}
    yield Mistake("a force limit too low", tree, "LOW_FORCE_LIMIT", ("10 N",))
    tree = shipped("circle")
    tree["params"] = {}
    fail = {"fail": {"code": "NO_WORK", "reason": "nothing to do today"}}
    tree["arms"]["arm1"]["tree"] = {"sequence": [{"go_home": {}}, fail]}
    yield Mistake("the author says so", tree, "SAID_SO", ("nothing to do today",))
    tree = shipped("pick_and_transport")
    bad = {"transport": {"object": "cube", "to": {"xyz": [0.3, -0.45, 0.65]}}}
    tree["arms"]["arm1"]["tree"] = {"selector": [bad, {"fail": {"code": "A", "reason": "no way"}}]}
    yield Mistake("a last word after the cause", tree, "NEVER_ATTACHED", ("cube",))
    tree = shipped("pick_and_transport")
    steps(tree)[0] = {"retry": {"times": 3, "child": {"detach": {"object": "cube"}}}}
    tree["objects"]["cube"]["spawned"] = False
    yield Mistake("a cube that is not there to be let go", tree, "NOT_SPAWNED_YET", ("cube",))
    tree = shipped("pick_and_track")
    steps(tree)[0]["approach_and_attach"]["object"] = "cube"
    tree["objects"]["cube"]["pose"]["xyz"] = [0.60, -0.70, 0.425]
    tree["arms"]["arm1"]["base"]["xyz"] = [-0.45, 0, 0.4]
    tree["arms"]["arm2"]["tree"]["sequence"][1]["track"]["lost_timeout"] = 4
    yield Mistake("the other arm's pick failed first", tree, "OUT_OF_REACH", ("cube",), 15.0)
    tree = shipped("circle")
    tree["params"] = {}
    tree["objects"] = {"wall": box((0.02, 1.0, 0.8), (0.80, 0.1, 0.8), "white")}
    line = {"move_linear": {"offset": {"xyz": [0.20, 0, 0], "frame": "world"}}}
    tree["arms"]["arm1"]["tree"] = {"sequence": [line]}
    yield Mistake("a wall at the end of a line", tree, "IN_THE_WAY", ("wall",))
