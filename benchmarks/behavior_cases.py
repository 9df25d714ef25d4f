"""The runs that `same_behavior` compares: shipped trees and generated files.

Generated files cover every robot with every gripper, every skill (its own example in the scenario
of the conformance suite) and every node type of the language. They come from the current checkout:
both compared states get the same texts.
"""

from __future__ import annotations

import json
import random
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import yaml

from bt_dualarm.behaviors.language import LANGUAGE
from bt_dualarm.runtime.api import registry_of
from tests.skills.scenarios import ABOVE, SCENARIOS, Scenario, node_of

ROOT = Path(__file__).resolve().parent.parent

ROBOTS = tuple(sorted(path.stem for path in (ROOT / "assets/robots").glob("*.yaml")))
GRIPPERS = ("none", *sorted(path.stem for path in (ROOT / "assets/grippers").glob("*.yaml")))
REALITIES = ("ideal", "lab", "rough")
SEEDS = (0, 7)

PARAMS: dict[str, tuple[dict[str, object], ...]] = {
    "pick_and_track": ({}, {"grasp": "attach"}),
}
"""Sets of parameters of a shipped tree; by default only its own."""


class Case(NamedTuple):
    """One run.

    Attributes:
        name: Unique name, such as ``circle lab seed 7``.
        tree: Name of a shipped tree, or the content of a tree file as JSON.
        seed: Random seed.
        reality: ``ideal``, ``lab`` or ``rough``; None for the file's own.
        params: Parameters of the tree.
    """

    name: str
    tree: str
    seed: int
    reality: str | None
    params: dict[str, object]


def shipped() -> Iterator[Case]:
    """Every shipped tree in every reality with two seeds."""
    for path in sorted((ROOT / "trees").glob("*.yaml")):
        for params in PARAMS.get(path.stem, ({},)):
            for reality in REALITIES:
                for seed in SEEDS:
                    text = "".join(f" {key}={value}" for key, value in params.items())
                    name = f"{path.stem}{text} {reality} seed {seed}"
                    yield Case(name, path.stem, seed, reality, params)


def generated() -> Iterator[Case]:
    """Files over robots, grippers, skills and node types."""
    yield from _mounted()
    yield from _skills()
    yield from _node_types()


def _mounted() -> Iterator[Case]:
    """Every robot with every gripper: motions, and commands of the gripper."""
    rng = random.Random(25)  # noqa: S311 - no secret
    for robot in ROBOTS:
        for gripper in GRIPPERS:
            offset = [round(rng.uniform(-0.06, 0.06), 3) for _ in range(3)]
            leaves: list[dict[str, object] | str] = [
                {"reach_to_pose": {"offset": {"xyz": offset}, "speed": 0.6}},
                {"circle": {"plane": rng.choice(("xy", "yz")), "radius": 0.03, "speed": 0.4}},
            ]
            arm: dict[str, object] = {"robot": robot, "base": ABOVE}
            if gripper != "none":
                arm["gripper"] = gripper
                leaves += [{"close_gripper": {}}, "open_gripper"]
                leaves = [{"force_success": {"child": leaf}} for leaf in leaves]
            yield _file(
                f"{robot} with {gripper}",
                {"arms": {"arm1": {**arm, "tree": {"sequence": leaves}}}},
                rng.choice(REALITIES),
            )


def _skills() -> Iterator[Case]:
    """Every skill's example in its scenario of the conformance suite."""
    registry = registry_of()
    for name, skill in sorted(registry.skills.items()):
        content = SCENARIOS.get(name, Scenario()).file(node_of(skill.example))
        yield _file(f"skill {name}", content, REALITIES[len(name) % 3])


_CABINET: dict[str, Any] = {
    "shape": "compound",
    "fixed": True,
    "pose": {"xyz": [0.2, -0.9, 0.2]},
    "parts": {
        "body": {"shape": "box", "size": [0.3, 0.3, 0.02]},
        "drawer": {"shape": "box", "size": [0.2, 0.2, 0.1], "pose": {"xyz": [0, 0, 0.1]}},
    },
    "joints": {
        "slide": {
            "type": "slide",
            "parts": ["drawer"],
            "axis": [0, 1, 0],
            "range": [0, 0.2],
            "mass": 1,
        }
    },
}

_CELL: dict[str, Any] = {
    "signals": {"ready": {"type": "boolean", "written_by": ["arm1", "arm2"]}},
    "rendezvous": {"handover": ["arm1", "arm2"]},
    "zones": {"bin": {"size": [0.2, 0.2, 0.2], "pose": {"xyz": [0, -0.6, 0.5]}}},
}

_PARTNERS: dict[str, object] = {
    "await": {"signal": {"signal": "ready", "value": True}},
    "in_step": {"in_step": {"with": "arm1", "child": {"wait": 0.3}}},
    "meet": {"meet": {"at": "handover"}},
}
"""Leaf of the other arm, for nodes that need a partner."""


def _node_types() -> Iterator[Case]:
    """Every node type's example, between two short waits."""
    cube = {"shape": "box", "size": [0.05] * 3, "mass": 0.1, "color": "red"}
    for name, node_type in sorted(LANGUAGE.items()):
        if name == "subtree":
            node: object = {"subtree": {"use": "part", "params": {"n": 0.1}}}
        else:
            node = yaml.safe_load(node_type.example)
        partner = [{"wait": 0.2}, _PARTNERS.get(name, {"wait": 0.1})]
        content: dict[str, Any] = {
            "params": {"speed": {"type": "number", "default": 0.5}},
            "subtrees": {
                "part": {"params": {"n": {"type": "number"}}, "tree": {"wait": {"seconds": "{n}"}}}
            },
            "world": {"scene": "table", "time_limit": 6.0},
            "objects": {"cube": cube | {"pose": {"xyz": [0.4, -0.4, 0.425]}}, "cabinet": _CABINET},
            "cell": _CELL,
            "arms": {
                "arm1": {
                    "robot": "ur3",
                    "base": ABOVE,
                    "camera": {"mount": "wrist"},
                    "tree": {"sequence": [{"wait": 0.1}, {"force_success": {"child": node}}]},
                },
                "arm2": {
                    "robot": "ur3",
                    "base": {"xyz": [1.5, 0, 0.4]},
                    "tree": {"sequence": partner},
                },
            },
        }
        yield _file(f"node {name}", content, "ideal")


def _file(name: str, content: dict[str, Any], reality: str) -> Case:
    return Case(
        name,
        json.dumps({"bt_dualarm": 1, "name": "case", **content}),
        len(name),
        reality,
        {},
    )
