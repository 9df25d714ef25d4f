"""A small world for each skill in which its example does its job."""

from __future__ import annotations

import copy
from dataclasses import dataclass, field
from typing import Any, TypeAlias

import yaml

Tree: TypeAlias = dict[str, Any]

ABOVE = {"xyz": [0, 0, 0.40]}
CUBE = {"shape": "box", "size": [0.05, 0.05, 0.05], "mass": 0.1, "color": "yellow"}
WALL = {"shape": "box", "mass": 50, "fixed": True, "spawned": False}


@dataclass(frozen=True)
class Scenario:
    """A world with one arm, and what the arm does before it is the skill's turn.

    Attributes:
        objects: As in a tree file.
        arm: Fields of the arm but its tree.
        before: Leaves that bring about what the skill needs.
        scene: Of the world.
        again: How a second run of the same leaf ends after a success.
    """

    objects: dict[str, Any] = field(default_factory=dict)
    arm: dict[str, Any] = field(default_factory=lambda: {"robot": "ur5", "base": ABOVE})
    before: tuple[Tree, ...] = ()
    scene: str = "empty"
    again: str = "SUCCESS"

    def file(self, *leaves: Tree) -> dict[str, Any]:
        """The content of a tree file with these leaves after those that come before."""
        tree = {"sequence": [*copy.deepcopy(self.before), *leaves]}
        return {
            "world": {"scene": self.scene, "time_limit": 30.0},
            "objects": copy.deepcopy(self.objects),
            "arms": {"arm1": {**self.arm, "tree": tree}},
        }


ON_TABLE = {"cube": CUBE | {"pose": {"xyz": [0.40, -0.45, 0.425]}}}
PICK: Tree = {"approach_and_attach": {"object": "cube"}}
PRESENTING = {"robot": "ur5", "base": ABOVE, "posture": "present"}
LOOKING = {
    "robot": "panda",
    "base": {"xyz": [1.60, 0.11, 0.28], "rpy": [0, 0, 180]},
    "posture": "look_out",
    "camera": {"mount": "wrist", "resolution": [320, 240], "fov": 50, "fps": 30},
}
TARGET = {"cube": CUBE | {"pose": {"xyz": [0.68, 0.11, 0.70]}, "fixed": True}}
ON_FLOOR = CUBE | {"pose": {"xyz": [0.6, 0, 0.025]}}

SCENARIOS = {
    "approach_and_attach": Scenario(ON_TABLE, scene="table"),
    "transport": Scenario(ON_TABLE, before=(PICK,), scene="table"),
    "detach": Scenario(ON_TABLE, before=(PICK,), scene="table"),
    "circle": Scenario(arm=PRESENTING),
    "lissajous": Scenario(arm=PRESENTING),
    "reach_to_pose": Scenario(),
    "go_home": Scenario(arm=PRESENTING),
    "move_joints": Scenario(),
    "move_linear": Scenario(arm=PRESENTING),
    "move_through": Scenario(),
    "rotate_tool": Scenario(arm=PRESENTING),
    "stop": Scenario(),
    "spawn": Scenario({"cube": ON_FLOOR | {"spawned": False}}, again="FAILURE"),
    "remove": Scenario({"cube": ON_FLOOR}, again="FAILURE"),
    "track": Scenario(TARGET, arm=LOOKING),
}
"""By skill. A new skill needs one: the conformance tests say so."""


def node_of(example: str) -> Tree:
    """The node that a skill's example writes."""
    node: Tree = yaml.safe_load(example)
    return node


def after(seconds: float, node: Tree) -> Tree:
    """Halt a node after so many seconds, and succeed whatever it did."""
    return {"force_success": {"child": {"timeout": {"seconds": seconds, "child": node}}}}
