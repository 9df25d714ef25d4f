"""A mistake planted in a shipped tree, and functions to edit such trees."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

TREES = Path(__file__).parents[1] / "trees"

Tree = dict[str, Any]


@dataclass(frozen=True)
class Mistake:
    """A tree with one mistake.

    Attributes:
        name: Name of the mistake.
        tree: The tree, as Python data.
        kind: Kind of the cause that was planted.
        names: Texts that the sentence on the cause must contain: the object, the leaf, the key.
        duration: Simulated seconds of the run.
        also: Other kinds of cause that are right as well.
        original: The tree without the mistake, if it is not known to succeed.
    """

    name: str
    tree: Tree
    kind: str
    names: tuple[str, ...] = ()
    duration: float = 25.0
    also: tuple[str, ...] = ()
    original: Tree | None = None


def shipped(name: str) -> Tree:
    """A shipped tree as Python data, in `ideal` so that runs are short."""
    text = (TREES / f"{name}.yaml").read_text(encoding="utf-8")
    # Called 67 times while tests are collected. YAML 1.1 reads the key `on` as true.
    tree: Tree = yaml.load(re.sub(r"\bon:", "'on':", text), yaml.CSafeLoader)
    tree["world"] = {**tree.get("world", {}), "reality": "ideal"}
    return tree


def steps(tree: Tree, arm: str = "arm1") -> list[Tree]:
    """The children of the sequence at the root of an arm's tree."""
    found: list[Tree] = tree["arms"][arm]["tree"]["sequence"]
    return found


def box(size: tuple[float, ...], at: tuple[float, ...], color: str = "gray", **more: Any) -> Tree:
    """A fixed box."""
    fields = {"shape": "box", "size": [*size], "mass": 5, "color": color, "fixed": True}
    return {**fields, "pose": {"xyz": [*at]}, **more}
