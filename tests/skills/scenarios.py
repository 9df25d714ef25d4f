"""A small world for each skill in which its example succeeds."""

from __future__ import annotations

from bt_dualarm.testing import Scenario as Scenario
from bt_dualarm.testing import Tree as Tree
from bt_dualarm.testing import after as after
from bt_dualarm.testing import node_of as node_of

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
"""Four walls, 12 mm high, around a gap 1 mm wider on each side than the cube."""

CABINET: Tree = {
    "cabinet": {
        "shape": "compound",
        "mass": 5,
        "fixed": True,
        "pose": {"xyz": [0.45, -0.65, 0.5]},
        "parts": {
            "top": {"shape": "box", "size": [0.3, 0.24, 0.01], "pose": {"xyz": [0, 0, 0.085]}},
            "box": {"shape": "bin", "size": [0.27, 0.22, 0.12], "wall": 0.006},
            "stem": {
                "shape": "box",
                "size": [0.012, 0.04, 0.012],
                "pose": {"xyz": [-0.05, 0.13, 0]},
            },
            "handle": {"shape": "box", "size": [0.12, 0.014, 0.014]}
            | {"pose": {"xyz": [0, 0.155, 0]}, "color": "red"},
        },
        "joints": {
            "slide": {"type": "slide", "axis": [0, 1, 0], "range": [0, 0.18], "mass": 0.8}
            | {"parts": ["box", "stem", "handle"], "friction": 3, "damping": 10},
        },
    }
}
"""A drawer with a handle."""
CHEST: Tree = {
    "chest": {
        "shape": "compound",
        "mass": 0.5,
        "friction": 0.8,
        "pose": {"xyz": [0.40, -0.40, 0.44]},
        "parts": {
            "body": {"shape": "bin", "size": [0.12, 0.07, 0.08], "wall": 0.005},
            "lid": {"shape": "box", "size": [0.12, 0.07, 0.006], "pose": {"xyz": [0, 0, 0.0435]}},
            "knob": {
                "shape": "box",
                "size": [0.02, 0.014, 0.03],
                "pose": {"xyz": [0.045, 0, 0.0615]},
            },
        },
        "joints": {
            "hinge": {
                "type": "hinge",
                "parts": ["lid", "knob"],
                "axis": [0, -1, 0],
                "anchor": [-0.06, 0, 0.0405],
                "range": [0, 100],
                "mass": 0.1,
                "friction": 0.05,
                "damping": 0.05,
            }
        },
    }
}
"""A box with a lid that an arm can carry."""

KNOB: Tree = {"grasp": {"object": "chest", "part": "knob", "then_to": 60}}

PULLS: Tree = {"grasp": {"object": "cabinet", "part": "handle", "then_to": 0.15}}

BEAM: Tree = {
    "beam": {"shape": "box", "size": [1.2, 0.05, 0.05], "mass": 4.0}
    | {"pose": {"xyz": [0, -0.45, 0.525]}},
    "stand": WALL | {"spawned": True, "size": [0.5, 0.3, 0.5], "pose": {"xyz": [0, -0.45, 0.25]}},
}
CARRIER = GRIPPING | {"base": {"xyz": [-0.55, 0, 0.40]}}
CARRIES: Tree = {"carry_together": {"object": "beam", "with": ["arm1"]}}
"""Leaf of the partner, which follows; it retries if the other arm does."""
PARTNER = GRIPPING | {
    "base": {"xyz": [0.55, 0, 0.40]},
    "tree": {"force_success": {"child": {"retry": {"times": 3, "child": CARRIES}}}},
}
STANDING = {"robot": "ur5", "base": {"xyz": [1.3, 0, 0.40], "rpy": [0, 0, 180]}}
BESIDE_ANOTHER: Tree = {
    "arm2": STANDING | {"removable": True, "tree": {"sequence": [{"wait": {"seconds": 25}}]}}
}
"""Another, idle arm on the opposite side."""

ON_SHELF: Tree = {
    "shelf": WALL | {"spawned": True, "size": [0.2, 0.2, 0.2], "pose": {"xyz": [0.35, -0.4, 0.1]}},
    "cube": CUBE
    | {"size": [0.16, 0.035, 0.035], "mass": 0.3, "pose": {"xyz": [0.35, -0.4, 0.2175]}},
}
"""A bar that is long enough for two hands."""

GIVER: Tree = {"robot": "ur5", "gripper": "robotiq_2f85", "base": {"xyz": [0, 0, 0]}}
TAKER: Tree = {
    "robot": "panda",
    "gripper": "panda_hand",
    "base": {"xyz": [1.05, 0, 0], "rpy": [0, 0, 180]},
}
GIVES: Tree = {"sequence": [GRASP, {"hand_over": {"object": "cube", "to": "arm1"}}]}
TAKES: Tree = {"take_over": {"object": "cube", "from": "arm1"}}

SCENARIOS = {
    "carry_together": Scenario(BEAM, arm=CARRIER, again="FAILURE", others={"arm2": PARTNER}),
    "hand_over": Scenario(
        ON_SHELF,
        arm=GIVER,
        before=(GRASP,),
        again="FAILURE",
        others={"arm2": TAKER | {"tree": TAKES}},
    ),
    "take_over": Scenario(
        ON_SHELF, arm=TAKER, again="FAILURE", others={"arm2": GIVER | {"tree": GIVES}}
    ),
    "approach_and_attach": Scenario(ON_TABLE, scene="table"),
    "close_gripper": Scenario(BETWEEN_PADS, arm=GRIPPING),
    "holding": Scenario(BETWEEN_PADS, arm=GRIPPING, before=({"close_gripper": {"force": 40}},)),
    "release": Scenario(BETWEEN_PADS, arm=GRIPPING, before=({"close_gripper": {"force": 40}},)),
    "insert": Scenario(
        ON_TABLE | HOLE, arm=GRIPPING, before=(GRASP,), scene="table", again="SUCCESS"
    ),
    "open_gripper": Scenario(arm=GRIPPING),
    "operate": Scenario(CABINET, arm=GRIPPING, before=(PULLS,), scene="table"),
    "grasp": Scenario(ON_TABLE, arm=GRIPPING, scene="table"),
    "place": Scenario(ON_TABLE, arm=GRIPPING, before=(GRASP,), scene="table", again="FAILURE"),
    "regrasp": Scenario(ON_TABLE, arm=GRIPPING, before=(GRASP,), scene="table"),
    "transport": Scenario(ON_TABLE, before=(PICK,), scene="table"),
    "detach": Scenario(ON_TABLE, before=(PICK,), scene="table"),
    "circle": Scenario(arm=PRESENTING),
    "lissajous": Scenario(arm=PRESENTING),
    "draw": Scenario(arm=PRESENTING),
    "follow_path": Scenario(arm=PRESENTING),
    "reach_to_pose": Scenario(),
    "go_home": Scenario(arm=PRESENTING),
    "follow_tool": Scenario(others=BESIDE_ANOTHER),
    "hold_still": Scenario(),
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
"""Scenario of each skill. A new skill needs one: the conformance tests fail without it."""
