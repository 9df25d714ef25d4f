"""The trees of a file as drawings: SVG, Graphviz' DOT, Mermaid."""

from __future__ import annotations

import io
import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING, Final

import yaml

from bt_dualarm.spec.document import TreeFile
from bt_dualarm.spec.kind import Kind
from bt_dualarm.spec.language import LANGUAGE
from bt_dualarm.spec.node import NodeSpec

if TYPE_CHECKING:
    from matplotlib.patches import Patch

FORMATS: Final = ("svg", "dot", "mmd")
"""Endings of the files that can be drawn to."""

COLORS: Final[Mapping[str, str]] = {
    "arm": "#e7e7e7",
    "composite": "#cfe2f3",
    "decorator": "#fde6c8",
    "leaf": "#f2f2f2",
    "skill": "#d5ecd4",
}
"""What each family of nodes is filled with."""

_MOST_LETTERS = 46
_ROW, _INDENT, _BOX = 0.46, 0.55, 0.34  # inches: from row to row, from level to level, height
_TITLE_POINTS, _DETAIL_POINTS = 9, 8
_PAD = 0.1  # inches beside a text
_EDGE = "#777777"


@dataclass(frozen=True)
class Item:
    """One node of the drawing.

    Attributes:
        number: Counted from 0 in the order of the file.
        parent: Number of the node above it; -1 for an arm.
        depth: Levels below the arm.
        title: Name, with the kind where it differs.
        detail: What its ports are given.
        family: A key of `COLORS`.
    """

    number: int
    parent: int
    depth: int
    title: str
    detail: str
    family: str


def items(file: TreeFile, kinds: Mapping[str, Kind]) -> list[Item]:
    """Every arm of a file with the nodes of its tree, top down.

    Args:
        file: Checked.
        kinds: Of the installed skills.
    """
    found: list[Item] = []
    for name, arm in file.arms.items():
        found.append(Item(len(found), -1, 0, name, arm.robot, "arm"))
        _add(found, arm.tree, found[-1].number, 1, {**kinds, **LANGUAGE})
    return found


def _add(
    found: list[Item], node: NodeSpec, parent: int, depth: int, kinds: Mapping[str, Kind]
) -> None:
    title = node.kind if node.name == node.kind else f"{node.name} ({node.kind})"
    item = Item(len(found), parent, depth, title, _detail(node), _family(node, kinds))
    found.append(item)
    for child in node.children:
        _add(found, child, item.number, depth + 1, kinds)


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
    """Graphviz' DOT."""
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
    """A Mermaid flowchart."""
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


def svg(drawn: list[Item]) -> str:
    """A drawing with a row for each node, drawn by Matplotlib; equal items, equal bytes."""
    import matplotlib as mpl
    from matplotlib.figure import Figure

    width = max(_INDENT * item.depth + _width(item) for item in drawn) + 0.4
    height = _ROW * len(drawn) + 0.3
    figure = Figure(figsize=(width, height))
    axes = figure.add_axes((0, 0, 1, 1))
    axes.set(xlim=(0, width), ylim=(height, 0))
    axes.axis("off")
    for patch in _patches(drawn):
        axes.add_patch(patch)
    for item in drawn:
        x, y = _corner(item)
        middle = y + _BOX / 2
        axes.text(x + _PAD, middle, item.title, fontsize=_TITLE_POINTS, weight="bold", va="center")
        x += 2 * _PAD + _measured(item.title, _TITLE_POINTS, "bold")
        axes.text(x, middle, item.detail, fontsize=_DETAIL_POINTS, color="#444444", va="center")
    drawing = io.StringIO()
    with mpl.rc_context({"svg.hashsalt": "bt_dualarm", "svg.fonttype": "none"}):
        figure.savefig(drawing, format="svg", metadata={"Date": None})
    return drawing.getvalue()


def _patches(drawn: list[Item]) -> Iterator[Patch]:
    """Elbows from parents to children, then the boxes above them."""
    from matplotlib.patches import FancyBboxPatch, PathPatch
    from matplotlib.path import Path

    for item in drawn:
        if item.parent >= 0:
            x, y = _corner(item)
            start, above = _corner(drawn[item.parent])
            elbow = [(start + 0.18, above + _BOX), (start + 0.18, y + _BOX / 2), (x, y + _BOX / 2)]
            yield PathPatch(Path(elbow), fill=False, edgecolor=_EDGE, linewidth=1.0)
    for item in drawn:
        yield FancyBboxPatch(
            _corner(item),
            _width(item),
            _BOX,
            boxstyle="round,pad=0,rounding_size=0.08",
            facecolor=COLORS[item.family],
            edgecolor=_EDGE,
            linewidth=0.8,
        )


def _corner(item: Item) -> tuple[float, float]:
    return 0.2 + _INDENT * item.depth, 0.2 + _ROW * item.number


def _width(item: Item) -> float:
    width = 2 * _PAD + _measured(item.title, _TITLE_POINTS, "bold")
    return width + _PAD + _measured(item.detail, _DETAIL_POINTS) if item.detail else width


@lru_cache(maxsize=4096)
def _measured(text: str, points: float, weight: str = "normal") -> float:
    """Inches that a text takes."""
    from matplotlib.font_manager import FontProperties
    from matplotlib.textpath import TextPath

    font = FontProperties(weight=weight)
    return float(TextPath((0, 0), text, size=points, prop=font).get_extents().x1) / 72
