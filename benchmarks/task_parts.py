"""What random tasks are made of: a tree with goals, its objects and arms."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np

from benchmarks.random_programs import Dice
from benchmarks.why_mistake import Tree, box

REACH: Final[Mapping[str, float]] = {
    "ur3e": 0.50,
    "ur5": 0.85,
    "ur5e": 0.85,
    "ur10": 1.30,
    "ur10e": 1.30,
    "panda": 0.80,
    "fr3": 0.80,
    "xarm7": 0.70,
    "jaco2": 0.65,
    "tiago": 0.75,
}
"""Robots of the family, and how far from its base each can grasp from above, m."""

DOWN: Final = (180, 0, 0)

SCENE_FILE: Final = "cell.xml"
"""Name of the scene of a task that has one of its own, beside its tree."""


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
        goals: Goals of the file, which a referee judges.
        halted: Names of other arms and of subtrees whose leaves can be halted, too.
        scene: Text of `SCENE_FILE`, in MJCF; empty if there is none.
    """

    tree: Tree
    leaves: list[Tree]
    arm: str = "arm1"
    partner: str = ""
    object: str = ""
    goal: Sequence[float] = (0.0, 0.0, 0.0)
    reach: float = 0.8
    duration: float = 40.0
    goals: Tree = field(default_factory=dict)
    halted: Sequence[str] = ()
    scene: str = ""

    def ports(self, skill: str) -> Tree:
        """Ports of the first leaf of a skill."""
        return next(leaf[skill] for leaf in self.leaves if skill in leaf)

    def index(self, skill: str) -> int:
        """Position of the first leaf of a skill."""
        return next(i for i, leaf in enumerate(self.leaves) if skill in leaf)

    def has(self, skill: str) -> bool:
        """Whether the failing arm has a leaf of a skill."""
        return any(skill in leaf for leaf in self.leaves)

    def finish(self) -> Tree:
        """The tree with its leaves."""
        self.tree["arms"][self.arm]["tree"] = {"sequence": self.leaves}
        return self.tree

    def add_arm(self, name: str, robot: str, xyz: Sequence[float], *leaves: Tree) -> None:
        """Add an arm with a sequence of leaves."""
        base = {"xyz": [*xyz]}
        self.tree["arms"][name] = {"robot": robot, "base": base, "tree": {"sequence": [*leaves]}}


def file_of(dice: Dice, objects: Tree, arms: Tree) -> Tree:
    """A file with objects and arms in a random reality."""
    world = {"scene": "empty", "reality": dice.one(["ideal", "lab", "rough"])}
    return {"bt_dualarm": 1, "name": "generated", "world": world, "objects": objects, "arms": arms}


def gripper_of(robot: str) -> str:
    """The hand with fingers that a robot usually has."""
    return "panda_hand" if robot in ("panda", "fr3") else "robotiq_2f85"


def armed(dice: Dice, robots: Sequence[str], **more: Any) -> tuple[Tree, float]:
    """An arm with fingers, and how far from its base it can grasp, m."""
    robot = dice.one(robots)
    arm = {"robot": robot, "gripper": gripper_of(robot), "base": {"xyz": [0, 0, 0]}}
    return arm | more, REACH[robot]


def around(radius: float, angle: float, z: float) -> list[float]:
    """A position around the first base, by its angle in radians."""
    x, y = radius * np.cos(angle), radius * np.sin(angle)
    return [round(float(x), 3), round(float(y), 3), round(z, 4)]


def stand(at: Sequence[float], size: float = 0.12) -> Tree:
    """A fixed stand below a position."""
    height = round(at[2], 4)
    return box((size, size, height), (at[0], at[1], round(height / 2, 4)))


def fixture(at: Sequence[float], yaw: float, parts: Tree, joint: Tree) -> Tree:
    """A fixed object with a joint ``axle``; the yaw is in degrees."""
    return {
        "shape": "compound",
        "mass": 5,
        "fixed": True,
        "color": "white",
        "pose": {"xyz": at, "rpy": [0, 0, yaw]},
        "parts": parts,
        "joints": {"axle": joint},
    }


def stands(name: str, at: Sequence[float], within: float = 0.01) -> Tree:
    """A goal: an object stands at a position, and nobody holds it."""
    return {name: {"object": name, "at": {"xyz": [*at]}, "within": within, "held": False}}
