"""A tree as lines of text: signs, guides, progress, time in the state, reasons."""

from __future__ import annotations

import textwrap
from collections.abc import Iterator
from dataclasses import dataclass

from rich.cells import cell_len
from rich.text import Text

from bt_dualarm.runtime.symbols import STYLES, Symbols
from bt_dualarm.tree.report import NodeView

_BAR_COLUMNS = 10
_WIDE = 46
"""From so many columns on there is room for a bar beside the percentage."""


@dataclass(frozen=True)
class _Row:
    """One node, with what stands left of it and left of the lines below it."""

    node: NodeView
    guide: str
    below: str


def draw_tree(root: NodeView, time: float, width: int, height: int, symbols: Symbols) -> list[Text]:
    """Lines of at most ``width`` columns, as many as ``height`` if that can be.

    Where the tree is too high, branches in which nothing runs, failed or was halted are folded;
    if that is not enough, the rows around what happens now are shown.

    Args:
        root: The tree as it stands.
        time: Simulated time in seconds.
        width: Columns.
        height: Lines.
        symbols: The alphabet.
    """
    lines: list[Text] = []
    for folded in (False, True):
        lines, focus = _draw(list(_rows(root, symbols, folded=folded)), time, width, symbols)
        if len(lines) <= height:
            return lines
    return _window(lines, focus, max(height, 1), symbols)


def _rows(
    node: NodeView, symbols: Symbols, *, folded: bool, guide: str = "", below: str = ""
) -> Iterator[_Row]:
    """The node and all below it, top to bottom."""
    children = () if folded and not _eventful(node) else node.children
    yield _Row(node, guide, below + (symbols.through if children else "  "))
    for child in children:
        is_last = child is children[-1]
        yield from _rows(
            child,
            symbols,
            folded=folded,
            guide=below + (symbols.last if is_last else symbols.branch) + " ",
            below=below + ("   " if is_last else symbols.through + " "),
        )


def _eventful(node: NodeView) -> bool:
    eventful = node.halted or node.status in ("RUNNING", "FAILURE")
    return eventful or any(_eventful(c) for c in node.children)


def _draw(rows: list[_Row], time: float, width: int, symbols: Symbols) -> tuple[list[Text], int]:
    """The lines, and which of them is about what happens now."""
    lines: list[Text] = []
    starts: dict[str, int] = {}
    for row in rows:
        starts[row.node.status] = len(lines)
        lines += _lines(row, time, width, symbols)
    return lines, starts.get("RUNNING", starts.get("FAILURE", 0))


def _lines(row: _Row, time: float, width: int, symbols: Symbols) -> list[Text]:
    """A node's own line, and those of its reason where it does not fit beside the name."""
    node = row.node
    left = Text(no_wrap=True)
    left.append(row.guide, style="dim")
    sign = "HALTED" if node.halted else node.status
    left.append(symbols.status[sign], style=STYLES[sign])
    left.append(f" {node.name}", style="dim" if sign == "INVALID" else "")
    right = _state(node, time, width, symbols)
    if node.name != node.kind and left.cell_len + len(node.kind) + right.cell_len + 4 <= width:
        left.append(f" ({node.kind})", style="dim")
    beside = cell_len(node.reason) + 3 <= width - left.cell_len - right.cell_len
    if node.reason and beside:
        left.append(f"  {node.reason}", style="red")
    below = _wrapped(node.reason, row.below, width) if node.reason and not beside else []
    return [_spread(left, right, width, symbols), *below]


def _spread(left: Text, right: Text, width: int, symbols: Symbols) -> Text:
    """Left and right at the ends of one line; the left one is shortened where it must be."""
    room = max(1, width - right.cell_len - (1 if right else 0))
    if left.cell_len > room:
        left = left[: max(0, room - 1)].append(symbols.more)
    left.append(" " * (width - left.cell_len - right.cell_len))
    return left.append_text(right)


def _wrapped(reason: str, below: str, width: int) -> list[Text]:
    """The reason on lines of its own, behind the guides of the tree."""
    room = max(8, width - cell_len(below))
    return [
        Text(below, style="dim", no_wrap=True).append(line, style="red not dim")
        for line in textwrap.wrap(reason, room)
    ]


def _state(node: NodeView, time: float, width: int, symbols: Symbols) -> Text:
    """Progress, and seconds in the state; a state that is over says how long ago that was."""
    text = Text(no_wrap=True)
    if node.status == "INVALID" and not node.halted:
        return text
    seconds = max(0.0, time - node.since)
    wide = width >= _WIDE
    if node.status != "RUNNING":
        return text.append(f"{seconds:.1f} s ago" if wide else f"{seconds:.0f}s ago", style="dim")
    if node.progress is not None:
        text.append_text(_progress(node.progress, symbols, bar=wide))
    return text.append(f"{seconds:.1f} s    " if wide else f"{seconds:.0f}s    ")


def _progress(share: float, symbols: Symbols, *, bar: bool) -> Text:
    share = min(1.0, max(0.0, share))
    text = Text()
    if bar:
        done = round(share * _BAR_COLUMNS)
        text.append(symbols.full * done, style="cyan")
        text.append(symbols.empty * (_BAR_COLUMNS - done), style="dim")
    return text.append(f"{share:5.0%}  ", style="cyan")


def _window(lines: list[Text], focus: int, height: int, symbols: Symbols) -> list[Text]:
    """``height`` lines around line ``focus``, saying how many are left out."""
    first = min(max(0, focus - height // 2), len(lines) - height)
    shown = list(lines[first : first + height])
    if height >= 3:
        if first > 0:
            shown[0] = Text(f"{symbols.more} {first + 1} lines above", style="dim")
        after = len(lines) - first - height
        if after > 0:
            shown[-1] = Text(f"{symbols.more} {after + 1} lines below", style="dim")
    return shown
