"""Graphs of the trees of a file, for programs that lay them out: Graphviz DOT, Mermaid."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Final

import yaml

from bt_dualarm.behaviors.language import LANGUAGE
from bt_dualarm.spec.cell import AWAIT, CLAIM, MEET, SIGNAL, claimed
from bt_dualarm.spec.document import TreeFile
from bt_dualarm.spec.node_types import NodeSpec, NodeType

COLORS: Final[Mapping[str, str]] = {
    "arm": "#e7e7e7",
    "composite": "#cfe2f3",
    "decorator": "#fde6c8",
    "leaf": "#f2f2f2",
    "skill": "#d5ecd4",
}
"""Fill color of each family of nodes."""

_MOST_LETTERS = 46
_EDGE = "#777777"
_WAITS = "#b45f06"


@dataclass(frozen=True)
class Item:
    """One node of the graph.

    Attributes:
        number: Number from 0 in the order of the file.
        parent: Number of the node above it; -1 for an arm.
        title: Name, with the kind where it differs.
        detail: Ports with their values.
        family: A key of `COLORS`.
        waits_for: Numbers of the nodes of other arms that it may wait for.
    """

    number: int
    parent: int
    title: str
    detail: str
    family: str
    waits_for: tuple[int, ...] = ()


def items(file: TreeFile, kinds: Mapping[str, NodeType]) -> list[Item]:
    """Returns every arm of a file with the nodes of its tree from the root down.

    Args:
        file: A file without errors.
        kinds: Node types of the skills by name.
    """
    found: list[Item] = []
    shared: dict[str, list[_Use]] = {}
    for name, arm in file.arms.items():
        found.append(Item(len(found), -1, name, arm.robot, "arm"))
        root = len(found)
        _add(found, arm.tree, found[-1].number, {**kinds, **LANGUAGE})
        for number, node in enumerate(arm.tree.walk(), root):
            for subject in _shared_by(name, node, kinds):
                shared.setdefault(subject, []).append(_Use(number, name, node.kind))
    for uses in shared.values():
        for use in uses:
            if use.kind != SIGNAL:
                others = [other.number for other in uses if _waits(use, other)]
                item = found[use.number]
                found[use.number] = replace(item, waits_for=(*item.waits_for, *others))
    return found


@dataclass(frozen=True)
class _Use:
    """A node that uses something of the cell."""

    number: int
    arm: str
    kind: str


def _shared_by(arm: str, node: NodeSpec, kinds: Mapping[str, NodeType]) -> list[str]:
    """Returns what a node shares with other trees: what it uses of the cell, a joint action."""
    joint = None if node.kind not in kinds else kinds[node.kind].counterpart
    if joint is not None:
        arms = sorted((arm, *joint.partners(node.ports)))
        return [f"joint {[node.ports.get(name) for name in joint.same]} of {arms}"]
    if node.kind in (SIGNAL, AWAIT):
        return [f"signal {node.ports.get('signal')}"]
    if node.kind == MEET:
        return [f"rendezvous {node.ports.get('at')}"]
    return claimed(node.ports) if node.kind == CLAIM else []


def _waits(use: _Use, other: _Use) -> bool:
    """Returns whether one use may wait for another: a value, a partner, or a release."""
    if use.kind == AWAIT:
        return other.kind == SIGNAL
    return use.arm != other.arm


def _add(found: list[Item], node: NodeSpec, parent: int, kinds: Mapping[str, NodeType]) -> None:
    title = node.kind if node.name == node.kind else f"{node.name} ({node.kind})"
    given = ", ".join(f"{name}: {_in_yaml(value)}" for name, value in node.ports.items())
    detail = given if len(given) <= _MOST_LETTERS else given[: _MOST_LETTERS - 1] + "…"
    item = Item(len(found), parent, title, detail, _family(node, kinds))
    found.append(item)
    for child in node.children:
        _add(found, child, item.number, kinds)


def _family(node: NodeSpec, kinds: Mapping[str, NodeType]) -> str:
    if node.kind not in LANGUAGE:
        return "skill"
    kind = kinds[node.kind]
    if kind.is_leaf:
        return "leaf"
    return "composite" if kind.many or kind.cases or len(kind.slots) > 2 else "decorator"


def _in_yaml(value: object) -> str:
    """Returns a value in YAML on one line."""
    flow = yaml.safe_dump(value, default_flow_style=True, width=10**6, allow_unicode=True)
    return flow.removesuffix("\n").removesuffix("\n...")


def dot(drawn: list[Item]) -> str:
    """Returns a graph in Graphviz' language."""
    lines = [
        "digraph trees {",
        "  rankdir=TB;",
        '  node [shape=box, style="rounded,filled", fontname="Helvetica", color="#777777"];',
    ]
    for item in drawn:
        label = json.dumps(item.title + ("\n" + item.detail if item.detail else ""))
        color = COLORS[item.family]
        lines.append(f'  n{item.number} [label={label}, fillcolor="{color}"];')
    lines += [f"  n{item.parent} -> n{item.number};" for item in drawn if item.parent >= 0]
    lines += [
        f'  n{item.number} -> n{other} [style=dashed, constraint=false, color="{_WAITS}"];'
        for item in drawn
        for other in item.waits_for
    ]
    return "\n".join([*lines, "}", ""])


def mermaid(drawn: list[Item]) -> str:
    """Returns a Mermaid flowchart, as GitHub draws it in Markdown."""
    lines = ["flowchart TD"]
    for item in drawn:
        label = "<br>".join(_escaped(text) for text in (item.title, item.detail) if text)
        lines.append(f'  n{item.number}("{label}"):::{item.family}')
    lines += [f"  n{item.parent} --> n{item.number}" for item in drawn if item.parent >= 0]
    lines += [f"  n{item.number} -.-> n{other}" for item in drawn for other in item.waits_for]
    lines += [
        f"  classDef {family} fill:{color},stroke:{_EDGE}" for family, color in COLORS.items()
    ]
    return "\n".join([*lines, ""])


def _escaped(text: str) -> str:
    """Escapes text for Mermaid, which writes HTML entities with ``#``."""
    signs = {"#": "#35;", '"': "#quot;", "<": "#lt;", ">": "#gt;"}
    return "".join(signs.get(sign, sign) for sign in text)


FORMATS: Final[Mapping[str, Callable[[list[Item]], str]]] = {"dot": dot, "mmd": mermaid}
"""Functions that write a graph, by file extension."""
