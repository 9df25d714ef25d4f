"""Mistakes planted in shipped trees, each with its expected cause."""

from __future__ import annotations

from collections.abc import Iterator

from benchmarks import why_mistakes_of_trees as trees
from benchmarks.why_mistake import Mistake, box, shipped, steps


def mistakes() -> Iterator[Mistake]:
    """All mistakes of this module and of `why_mistakes_of_trees`."""
    yield from _out_of_reach()
    yield from _in_the_way()
    yield from _sight()
    yield from _grasp()
    yield from trees.of_blackboard()
    yield from trees.of_time()
    yield from trees.of_leaves()
    yield from trees.of_messages()


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
        yield Mistake(f"another color asked for in {name}", tree, "WRONG_COLOR", ("cube",))
    tree = shipped("visual_tracking")
    tree["objects"]["cube"]["color"] = "blue"
    yield Mistake("a cube of another color", tree, "WRONG_COLOR", ("cube",))
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
    tree["arms"]["arm2"]["tree"]["track"] |= {"lost_timeout": 1.0, "reach_timeout": 1.0}
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
