"""A small world for a skill in which its example does its job."""

from __future__ import annotations

import copy
from dataclasses import dataclass, field
from typing import TypeAlias

import yaml

from bt_dualarm.spec.source import Data

Tree: TypeAlias = dict[str, Data]
"""A node, or another part of a tree file, as it is read from YAML."""


@dataclass(frozen=True)
class Scenario:
    """A world with one arm, and what the arm does before it is the skill's turn.

    Attributes:
        objects: Section ``objects`` of a tree file.
        arm: Fields of the arm but its tree.
        before: Leaves that bring about what the skill needs.
        scene: Name of the scene.
        again: Status with which a second run of the same leaf ends after a success.
    """

    objects: Tree = field(default_factory=dict)
    arm: Tree = field(default_factory=lambda: {"robot": "ur5", "base": {"xyz": [0, 0, 0.40]}})
    before: tuple[Tree, ...] = ()
    scene: str = "empty"
    again: str = "SUCCESS"

    def file(self, *leaves: Tree) -> Tree:
        """The content of a tree file with these leaves after those that come before."""
        tree = {"sequence": [*copy.deepcopy(self.before), *leaves]}
        return {
            "world": {"scene": self.scene, "time_limit": 30.0},
            "objects": copy.deepcopy(self.objects),
            "arms": {"arm1": {**self.arm, "tree": tree}},
        }


def node_of(example: str) -> Tree:
    """The node that a skill's example writes; a bare word is a node, too."""
    node: Tree | str = yaml.safe_load(example)
    return {node: {}} if isinstance(node, str) else node


def after(seconds: float, node: Tree) -> Tree:
    """Halt a node after so many seconds, and succeed whatever it did."""
    return {"force_success": {"child": {"timeout": {"seconds": seconds, "child": node}}}}


def twice(node: Tree, name: str) -> Tree:
    """Run a node, and after a success once more, below a node of this name."""
    return {"repeat": {"times": 2, "name": name, "child": node}}
