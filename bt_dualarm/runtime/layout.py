"""The whole picture: a header, and every arm's tree side by side or one below the other."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from rich.box import ASCII2, ROUNDED
from rich.console import Console, ConsoleOptions, Group, RenderableType, RenderResult
from rich.panel import Panel
from rich.table import Table
from rich.text import Text

from bt_dualarm.runtime.drawing import draw_tree
from bt_dualarm.runtime.parts import ArmView
from bt_dualarm.runtime.symbols import ASCII, STYLES, Symbols

_COLUMN = 48
"""A tree is drawn beside another one only where each has so many columns."""

_FRAMED = 48
"""Narrower than this, columns are too dear for a frame."""

_UNLIMITED = 10**6


@dataclass(frozen=True)
class Picture:
    """A run at one moment, to be printed by rich.

    Attributes:
        title: Name of the tree file.
        time: Simulated time in seconds.
        pace: Simulated seconds a second on the wall, None before that is known.
        renderer: What draws the cameras' pictures, empty where there is no camera.
        arms: Arms in the order of the file.
        symbols: The alphabet.
    """

    title: str
    time: float
    pace: float | None
    renderer: str
    arms: Sequence[ArmView]
    symbols: Symbols

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        """Fill the width, and stay below the height of the terminal."""
        yield self._header(options.max_width)
        columns = max(1, min(len(self.arms), options.max_width // _COLUMN))
        width = options.max_width // columns
        rows = [self.arms[first : first + columns] for first in range(0, len(self.arms), columns)]
        needs = [max(self._need(arm, width) for arm in row) for row in rows]
        # One line is the header's, and the cursor stands on the last one.
        heights = shared_heights(needs, console.height - 2)
        for row, height in zip(rows, heights, strict=True):
            drawn = [self._arm(arm, width, height) for arm in row]
            yield drawn[0] if columns == 1 else _side_by_side(drawn, columns)

    def _header(self, width: int) -> Text:
        """As many facts as fit, the least important ones left out first."""
        facts = [f"{self.time:.1f} s"]
        if self.pace is not None:
            facts.append(f"{self.pace:.1f}{self.symbols.times} real time")
        if self.renderer:
            facts.append(f"{self.renderer} renderer")
        head = Text(self.title, style="bold", no_wrap=True)
        gap = "  " if len("     ".join([self.title, *facts])) <= width else " "
        separator = f"{gap}{self.symbols.dot}{gap}"
        for fact in facts:
            if head.cell_len + len(separator) + len(fact) > width:
                break
            head.append(separator, style="dim").append(fact, style="not bold")
        head.truncate(width, overflow="ellipsis")
        return head

    def _need(self, arm: ArmView, width: int) -> int:
        """Lines that the arm would fill if there were enough of them."""
        frame = 2 if width >= _FRAMED else 1
        return frame + len(self._body(arm, _inside(width), _UNLIMITED))

    def _arm(self, arm: ArmView, width: int, height: int) -> RenderableType:
        if width < _FRAMED:
            return Group(self._rule(arm, width), *self._body(arm, width, height - 1))
        return Panel(
            Group(*self._body(arm, _inside(width), height - 2)),
            title=self._name(arm),
            title_align="left",
            box=ASCII2 if self.symbols is ASCII else ROUNDED,
            border_style=_border(arm),
            width=width,
        )

    def _body(self, arm: ArmView, width: int, height: int) -> list[Text]:
        if arm.tree is None:
            return [Text("not in the world yet", style="dim")]
        fault = [Text(arm.fault, style="bold red")] if arm.fault else []
        return [
            *draw_tree(arm.tree, self.time, width, height - len(fault), self.symbols),
            *fault,
        ]

    def _rule(self, arm: ArmView, width: int) -> Text:
        line = self.symbols.line
        rule = Text(no_wrap=True).append(f"{line}{line} ", style=_border(arm))
        rule.append_text(self._name(arm))
        rule.append(" " + line * max(0, width - rule.cell_len - 1), style=_border(arm))
        rule.truncate(width)
        return rule

    def _name(self, arm: ArmView) -> Text:
        name = Text(no_wrap=True)
        if arm.outcome is not None:
            name.append(f"{self.symbols.status[arm.outcome]} ", style=STYLES[arm.outcome])
        name.append(arm.name, style="bold not dim")
        return name.append(f" {self.symbols.dot} {arm.robot}")


def shared_heights(needs: Sequence[int], available: int) -> list[int]:
    """Lines for each of several things one below the other: small ones get all they need.

    Args:
        needs: Lines that each would fill.
        available: Lines that there are; each gets three at least, whatever there is.
    """
    heights = [0] * len(needs)
    left = max(available, 3 * len(needs))
    by_need = sorted(range(len(needs)), key=needs.__getitem__)
    for place, index in enumerate(by_need):
        heights[index] = min(needs[index], left // (len(needs) - place))
        left -= heights[index]
    return heights


def _side_by_side(drawn: Sequence[RenderableType], columns: int) -> Table:
    grid = Table.grid(expand=True)
    for _ in range(columns):
        grid.add_column(ratio=1)
    grid.add_row(*drawn)
    return grid


def _inside(width: int) -> int:
    """Columns that a frame and its padding leave."""
    return width - 4 if width >= _FRAMED else width


def _border(arm: ArmView) -> str:
    return "dim" if arm.outcome is None else STYLES[arm.outcome].removeprefix("bold ")
