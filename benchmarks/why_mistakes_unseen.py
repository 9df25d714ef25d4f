"""More mistakes, planted before the rules of ``bt-why`` were checked for them.

Other robots, grippers, sight alone, perturbed realities, parameters of subtrees, wrong units.
"""

from __future__ import annotations

from collections.abc import Iterator

from benchmarks.why_mistake import TREES, Mistake, Tree, box, shipped, steps


def unseen() -> list[Mistake]:
    """All mistakes of this module."""
    return [*_of_units(), *_of_sight(), *_of_cameras(), *_of_grips(), *_of_two_arms()]


def _reaching(robot: str, *leaves: Tree, **world: object) -> Tree:
    """A tree file with one arm of a given robot, in `rough`."""
    arms = {"arm1": {"robot": robot, "tree": {"sequence": [*leaves]}}}
    world_fields = {"scene": "empty", "reality": "rough", **world}
    return {"bt_dualarm": 1, "name": "reaching", "world": world_fields, "arms": arms}


def _real(name: str, reality: str = "lab") -> Tree:
    tree = shipped(name)
    tree["world"]["reality"] = reality
    return tree


def _of_units() -> Iterator[Mistake]:
    """Centimeters instead of meters, and a value from the parameters of a subtree."""
    pose = {"xyz": [45, 25, 35], "rpy": [180, 0, 0]}
    tree = _reaching("xarm7", {"reach_to_pose": {"to": pose}})
    yield Mistake("a pose in centimeters", tree, "OUT_OF_REACH", ("centimeters",))
    tree = _real("pick_and_transport")
    steps(tree)[1]["transport"]["to"]["xyz"] = [30, -45, 65]
    yield Mistake("carried to centimeters", tree, "OUT_OF_REACH", ("centimeters",))
    tree = _reaching("ur10", {"subtree": {"use": "aside", "params": {"by": [0, 2.4, 0]}}})
    aside = {"reach_to_pose": {"offset": {"xyz": "{by}"}}}
    tree["subtrees"] = {"aside": {"params": {"by": {"type": "vector"}}, "tree": aside}}
    yield Mistake("a parameter of a subtree out of reach", tree, "OUT_OF_REACH", ("ur10",))
    wall = box((0.02, 1.0, 0.8), (0.6, 0, 0.5), "white")
    tree = _reaching("xarm7", {"lissajous": {"plane": "xy", "amplitudes": [0.3, 0.1]}})
    tree["objects"] = {"wall": wall}
    yield Mistake("a wall in a curve of an xArm", tree, "IN_THE_WAY", ("wall",))


def _of_sight() -> Iterator[Mistake]:
    """Objects that are searched by sight alone."""
    tree = _real("pick_by_sight")
    tree["objects"]["lid"] = box((0.8, 0.6, 0.01), (0.35, -0.48, 0.52), "white")
    yield Mistake("a lid over what is looked for", tree, "OCCLUDED", ("lid",), 40.0)
    tree = _real("pick_by_sight")
    tree["objects"]["cube"] |= {"pose": {"xyz": [-0.35, -0.3, 0.425]}, "noise": {}}
    yield Mistake("a cube beside the searched area", tree, "OUT_OF_VIEW", ("cube",), 60.0)
    tree = _real("pick_by_sight", "rough")
    steps(tree)[1:3] = [{"locate": {"object": "cube", "pose": "{cube}"}}]
    steps(tree)[0]["look_at"]["at"] = {"xyz": [0.75, -0.2, 0.40]}
    tree["objects"]["cube"] |= {"pose": {"xyz": [0.05, -0.55, 0.425]}, "noise": {}}
    yield Mistake("a look at the wrong place", tree, "OUT_OF_VIEW", ("cube",), 40.0)
    tree = _real("pick_by_sight")
    other = {"marker": {"id": 6, "size": 0.03}, "pose": "{cube}"}
    steps(tree)[1:3] = [{"locate": other}]  # its marker hides the color that `scan` looks for
    steps(tree)[0]["look_at"]["at"] = {"xyz": [0.35, -0.48, 0.40]}
    tree["objects"]["cube"]["noise"] = {}
    tree["objects"]["cube"]["marker"] = {"id": 5, "size": 0.03}
    yield Mistake("the number of another marker", tree, "NOT_RECOGNISED", ("6", "5"), 60.0)
    tree = _real("pick_by_sight")
    kind = {"shape": "box", "size": [0.1, 0.1, 0.1], "color": "red"}
    steps(tree)[2] = {"locate": {**kind, "pose": "{cube}"}}
    yield Mistake("the size of another box", tree, "NOT_RECOGNISED", ("cube",), 60.0)
    tree = _real("sort_by_color")
    arm = tree["arms"]["arm1"]["tree"]["sequence"]
    arm[0] = {"look_at": {"at": {"xyz": [0.36, -0.42, 0.42]}, "distance": 0.4}}
    arm[1] = {"count": {"color": "red", "shape": "box", "size": [0.04, 0.04, 0.04], "count": "{n}"}}
    arm[2] = {"compare": {"value": "{n}", "relation": "equal", "to": 3}}
    del tree["subtrees"]
    yield Mistake("more cubes expected than there are", tree, "CONDITION", ("n", "count"))


def _of_cameras() -> Iterator[Mistake]:
    """Cameras that are late or lose frames, and a range of another color."""
    tree = _real("visual_tracking")
    tree["arms"]["arm2"]["camera"]["latency"] = 5.0
    yield Mistake("pictures that come 5 s late", tree, "LATE_PICTURES", ("latency", "5"), 20.0)
    tree = _real("visual_tracking")
    tree["arms"]["arm2"]["camera"] |= {"drop": 0.9, "fps": 2}
    steps(tree)[2]["circle"]["speed"] = 1.0
    yield Mistake("pictures that get lost", tree, "LOST_PICTURES", ("arm2",))
    tree = _real("visual_tracking", "rough")
    ranges = [{"hue": [190, 215], "saturation": [0.6, 1.0]}]
    tree["arms"]["arm2"]["tree"]["track"] |= {"color": ranges, "wait": 5}
    yield Mistake("a range of hues beside the cube's", tree, "WRONG_COLOR", ("cube",))


def _of_grips() -> Iterator[Mistake]:
    """Objects that fingers cannot hold, and faults of grasps."""
    if not (TREES / "grasp_and_place.yaml").exists():
        return
    tree = _real("grasp_and_place")
    tree["objects"]["cube"]["mass"] = 12
    yield Mistake("a cube too heavy for the fingers", tree, "OVERLOADED", ("cube", "12"))
    tree = _real("grasp_and_place")
    tree["objects"]["cube"] |= {"size": [0.12, 0.12, 0.05]}
    yield Mistake("a box wider than the fingers open", tree, "TOO_WIDE", ("cube",))
    tree = _real("grasp_and_place")
    del steps(tree)[0]
    yield Mistake("nobody took the cube with fingers", tree, "NEVER_ATTACHED", ("cube",))
    tree = _real("grasp_and_place")
    tree["objects"]["lid"] = tree["objects"]["cube"] | {"pose": {"xyz": [0.2, -0.55, 0.425]}}
    steps(tree)[2:] = [{"grasp": {"object": "lid"}}]
    yield Mistake("the fingers still hold the cube", tree, "HAND_FULL", ("cube", "grasp"))
    tree = _real("grasp_and_place")
    base = {"xyz": [0, 2, 0]}
    thief = {"sequence": [{"wait": {"seconds": 2.2}}, {"remove": {"object": "cube"}}]}
    tree["arms"]["arm2"] = {"robot": "ur3", "base": base, "tree": thief}
    steps(tree)[:] = [{"grasp": {"object": "cube", "speed": 0.2}}]
    yield Mistake("removed between the fingers", tree, "TAKEN_AWAY", ("cube", "arm2"))


def _of_two_arms() -> Iterator[Mistake]:
    """Arms that obstruct each other or need the same object, and a timeout of a scan."""
    arms = {}
    for name, robot, side in (("left", "panda", 1), ("right", "xarm7", -1)):
        pose = {"xyz": [0.45, -side * 0.02, 0.3], "rpy": [180, 0, 0]}
        leaves = [{"reach_to_pose": {"to": pose}}, {"wait": {"seconds": 100}}]
        base = {"xyz": [0, side * 0.45, 0]}
        arms[name] = {"robot": robot, "base": base, "tree": {"sequence": leaves}}
    world = {"scene": "empty", "reality": "rough"}
    tree: Tree = {"bt_dualarm": 1, "name": "deadlock", "world": world, "arms": arms}
    yield Mistake("two other robots wait for one another", tree, "OTHER_ARM", ())
    tree = _real("pick_and_transport")
    other = [{"wait": {"seconds": 1}}, {"approach_and_attach": {"object": "cube"}}]
    tree["arms"]["arm2"] = {
        "robot": "panda",
        "base": {"xyz": [0.9, -0.4, 0.4], "rpy": [0, 0, 180]},
        "tree": {"sequence": [*other, {"wait": {"seconds": 100}}]},
    }
    tree["arms"]["arm1"]["tree"]["sequence"].insert(0, {"wait": {"seconds": 8}})
    yield Mistake("the other arm holds the cube already", tree, "HELD", ("cube", "arm2"), 20.0)
    tree = _real("pick_by_sight")
    scan = steps(tree)[1]
    steps(tree)[1] = {"timeout": {"seconds": 0.5, "child": scan}}
    yield Mistake("too little time to look around", tree, "TOO_LITTLE_TIME", ("scan",), 40.0)
