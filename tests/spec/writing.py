"""Files that tests write, and the problems that the check reports of them."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from textwrap import dedent, indent

from bt_dualarm.behaviors.load import check_file, load_tree_file
from bt_dualarm.spec.node_types import NodeSpec, NodeType, PortModel, port
from bt_dualarm.spec.path_keep import Keep
from bt_dualarm.spec.problems import Problem
from bt_dualarm.spec.relative_pose import CarriedPose
from bt_dualarm.spec.values import ArmName, Duration, ObjectName, PoseSpec


class Look(PortModel):
    object: ObjectName | None = port(None, "What to look at")


class Seen(PortModel):
    where: PoseSpec = port(..., "Where it is")
    size: float = port(..., "How large", unit="m")
    color: str = port(..., "Its color")


class Go(PortModel):
    to: PoseSpec = port(..., "Where to")
    time: Duration = port(1.0, "In which time", le=10)
    near: float = port(0.1, "How near", unit="m")


class Carry(PortModel):
    to: CarriedPose = port(..., "Where to")


class Kept(PortModel):
    keep: Keep = port(..., "What to keep")


class Bring(PortModel):
    exactly_one_of = ("object", "arm")

    object: ObjectName | None = port(None, "Which object")
    arm: ArmName | None = port(None, "Which arm")


SKILLS: Mapping[str, NodeType] = {
    "look": NodeType("look", "Looks.", Look, Seen),
    "go": NodeType("go", "Goes.", Go),
    "carry": NodeType("carry", "Carries.", Kept),
    "bring": NodeType("bring", "Brings.", Carry),
    "spawn": NodeType("spawn", "Spawns.", Bring, brings_in=frozenset({"object", "arm"})),
    "remove": NodeType("remove", "Removes.", Bring, takes_out=frozenset({"object", "arm"})),
}


def write(folder: Path, text: str, name: str = "task.yaml") -> Path:
    """Write a file with this text, without its common indentation."""
    path = folder / name
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(dedent(text).lstrip("\n"))
    return path


def task(folder: Path, tree: str, before: str = "") -> Path:
    """Write a file with one arm and this tree; its line 1 is the first line after ``tree:``."""
    head = "bt_dualarm: 1\n" + dedent(before).lstrip("\n")
    body = "arms:\n  arm1:\n    robot: ur5\n    tree:\n"
    path = folder / "task.yaml"
    path.write_text(head + body + indent(dedent(tree).strip("\n"), "      ") + "\n")
    return path


def tree_of(path: Path) -> NodeSpec:
    return load_tree_file(path, SKILLS).arms["arm1"].tree


def messages_of(path: Path) -> list[str]:
    """Severity's first letter and message of each problem, in the file's order."""
    return [f"{problem.severity[0]}: {problem.message}" for problem in problems_of(path)]


def problems_of(path: Path) -> tuple[Problem, ...]:
    return check_file(path, SKILLS)
