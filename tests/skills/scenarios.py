"""A small world for each skill in which its example does its job."""

from __future__ import annotations

from bt_dualarm.testing.laws import Scenario as Scenario
from bt_dualarm.testing.laws import Tree as Tree
from bt_dualarm.testing.laws import after as after
from bt_dualarm.testing.laws import node_of as node_of

ABOVE = {"xyz": [0, 0, 0.40]}
CUBE = {"shape": "box", "size": [0.05, 0.05, 0.05], "mass": 0.1, "color": "yellow"}
WALL = {"shape": "box", "mass": 50, "fixed": True, "spawned": False}
ON_TABLE = {"cube": CUBE | {"pose": {"xyz": [0.40, -0.45, 0.425]}}}
GRASP: Tree = {"grasp": {"object": "cube"}}
PICK: Tree = {"approach_and_attach": {"object": "cube"}}
PRESENTING = {"robot": "ur5", "base": ABOVE, "posture": "present"}
LOOKING = {
    "robot": "panda",
    "base": {"xyz": [1.60, 0.11, 0.28], "rpy": [0, 0, 180]},
    "posture": "look_out",
    "camera": {"mount": "wrist", "resolution": [320, 240], "fov": 50, "fps": 30},
}
TARGET = {"cube": CUBE | {"pose": {"xyz": [0.68, 0.11, 0.70]}, "fixed": True}}
IN_FRONT = WALL | {"spawned": True, "size": [0.1, 0.4, 0.4], "pose": {"xyz": [0.74, 0.11, 0.7]}}
MARK = {"shape": "sphere", "size": [0.03], "mass": 0.1, "fixed": True, "color": "yellow"} | {
    "pose": {"xyz": [0.68, 0.11, 0.70]}
}
ABOVE_TABLE = {"robot": "ur5", "base": ABOVE, "camera": {}}
ON_FLOOR = CUBE | {"pose": {"xyz": [0.6, 0, 0.025]}}

GRIPPING = {"robot": "ur5", "gripper": "robotiq_2f85", "base": ABOVE}
BETWEEN_PADS = {"cube": CUBE | {"pose": {"xyz": [0.487, 0.109, 0.682]}, "fixed": True}}

HOLE: Tree = {
    name: WALL
    | {"spawned": True, "size": [*size, 0.012], "pose": {"xyz": [0.25 + x, y - 0.45, 0.406]}}
    for name, x, y, size in (
        ("left", -0.036, 0.0, (0.02, 0.092)),
        ("right", 0.036, 0.0, (0.02, 0.092)),
        ("front", 0.0, -0.036, (0.052, 0.02)),
        ("back", 0.0, 0.036, (0.052, 0.02)),
    )
}
"""Four walls, 12 mm high, around a place 1 mm wider on each side than the cube."""

SCENARIOS = {
    "approach_and_attach": Scenario(ON_TABLE, scene="table"),
    "close_gripper": Scenario(BETWEEN_PADS, arm=GRIPPING),
    "holding": Scenario(BETWEEN_PADS, arm=GRIPPING, before=({"close_gripper": {"force": 40}},)),
    "release": Scenario(BETWEEN_PADS, arm=GRIPPING, before=({"close_gripper": {"force": 40}},)),
    "insert": Scenario(
        ON_TABLE | HOLE, arm=GRIPPING, before=(GRASP,), scene="table", again="SUCCESS"
    ),
    "open_gripper": Scenario(arm=GRIPPING),
    "grasp": Scenario(ON_TABLE, arm=GRIPPING, scene="table"),
    "place": Scenario(ON_TABLE, arm=GRIPPING, before=(GRASP,), scene="table", again="FAILURE"),
    "regrasp": Scenario(ON_TABLE, arm=GRIPPING, before=(GRASP,), scene="table"),
    "transport": Scenario(ON_TABLE, before=(PICK,), scene="table"),
    "detach": Scenario(ON_TABLE, before=(PICK,), scene="table"),
    "circle": Scenario(arm=PRESENTING),
    "lissajous": Scenario(arm=PRESENTING),
    "draw": Scenario(arm=PRESENTING),
    "reach_to_pose": Scenario(),
    "go_home": Scenario(arm=PRESENTING),
    "move_joints": Scenario(),
    "move_until_contact": Scenario({"wall": IN_FRONT}, arm=PRESENTING),
    "move_linear": Scenario(arm=PRESENTING),
    "move_through": Scenario(),
    "rotate_tool": Scenario(arm=PRESENTING),
    "stop": Scenario(),
    "spawn": Scenario({"cube": ON_FLOOR | {"spawned": False}}, again="FAILURE"),
    "remove": Scenario({"cube": ON_FLOOR}, again="FAILURE"),
    "calibrate": Scenario({"mark": MARK}, arm=LOOKING),
    "track": Scenario(TARGET, arm=LOOKING),
    "locate": Scenario(TARGET, arm=LOOKING),
    "look_at": Scenario(TARGET, arm=LOOKING),
    "wait_for": Scenario(TARGET, arm=LOOKING),
    "count": Scenario(TARGET, arm=LOOKING),
    "scan": Scenario(ON_TABLE, arm=ABOVE_TABLE, scene="table"),
}
"""By skill. A new skill needs one: the conformance tests say so."""
