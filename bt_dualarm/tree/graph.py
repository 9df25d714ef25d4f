"""The trees of a file as drawings, for programs that lay them out: Graphviz' DOT, Mermaid."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Final

import yaml

from bt_dualarm.spec.document import TreeFile
from bt_dualarm.spec.kind import Kind
from bt_dualarm.spec.language import LANGUAGE
from bt_dualarm.spec.node import NodeSpec

COLORS: Final[Mapping[str, str]] = {
    "arm": "#e7e7e7",
    "composite": "#cfe2f3",
    "decorator": "#fde6c8",
    "leaf": "#f2f2f2",
    "skill": "#d5ecd4",
}
"""What each family of nodes is filled with."""

_MOST_LETTERS = 46
_EDGE = "#777777"


@dataclass(frozen=True)
class Item:
    """One node of the drawing.

    Attributes:
        number: Counted from 0 in the order of the file.
        parent: Number of the node above it; -1 for an arm.
        title: Name, with the kind where it differs.
        detail: Ports with what they are given.
        family: A key of `COLORS`.
    """

    number: int
    parent: int
    title: str
    detail: str
    family: str


def items(file: TreeFile, kinds: Mapping[str, Kind]) -> list[Item]:
    """Every arm of a file with the nodes of its tree, top down.

    Args:
        file: A file without errors.
        kinds: Installed skills by name.
    """
    found: list[Item] = []
    for name, arm in file.arms.items():
        found.append(Item(len(found), -1, name, arm.robot, "arm"))
        _add(found, arm.tree, found[-1].number, {**kinds, **LANGUAGE})
    return found


def _add(found: list[Item], node: NodeSpec, parent: int, kinds: Mapping[str, Kind]) -> None:
    title = node.kind if node.name == node.kind else f"{node.name} ({node.kind})"
    item = Item(len(found), parent, title, _detail(node), _family(node, kinds))
    found.append(item)
    for child in node.children:
        _add(found, child, item.number, kinds)


def _family(node: NodeSpec, kinds: Mapping[str, Kind]) -> str:
    if node.kind not in LANGUAGE:
        return "skill"
    kind = kinds[node.kind]
    if kind.is_leaf:
        return "leaf"
    return "composite" if kind.many or kind.cases or len(kind.slots) > 2 else "decorator"


def _detail(node: NodeSpec) -> str:
    given = ", ".join(f"{name}: {_short(value)}" for name, value in node.ports.items())
    return given if len(given) <= _MOST_LETTERS else given[: _MOST_LETTERS - 1] + "…"


def _short(value: object) -> str:
    """In YAML on one line."""
    flow = yaml.safe_dump(value, default_flow_style=True, width=10**6, allow_unicode=True)
    return flow.removesuffix("\n").removesuffix("\n...")


def dot(drawn: list[Item]) -> str:
    """Text in Graphviz' language."""
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
    return "\n".join([*lines, "}", ""])


def mermaid(drawn: list[Item]) -> str:
    """Text of a Mermaid flowchart, as GitHub draws it in Markdown."""
    lines = ["flowchart TD"]
    for item in drawn:
        words = [_escaped(item.title), *([_escaped(item.detail)] if item.detail else [])]
        lines.append(f'  n{item.number}("{"<br>".join(words)}"):::{item.family}')
    lines += [f"  n{item.parent} --> n{item.number}" for item in drawn if item.parent >= 0]
    lines += [
        f"  classDef {family} fill:{color},stroke:{_EDGE}" for family, color in COLORS.items()
    ]
    return "\n".join([*lines, ""])


def _escaped(text: str) -> str:
    """For Mermaid, which reads HTML entities written with ``#``."""
    signs = {"#": "#35;", '"': "#quot;", "<": "#lt;", ">": "#gt;"}
    return "".join(signs.get(sign, sign) for sign in text)


FORMATS: Final[Mapping[str, Callable[[list[Item]], str]]] = {"dot": dot, "mmd": mermaid}
"""How items are drawn, by the ending of the file."""
