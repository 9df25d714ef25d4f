"""The terminal display of running trees."""

from __future__ import annotations

import textwrap
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, ExitStack
from dataclasses import dataclass
from typing import Literal, Protocol, TypeAlias

from rich.box import ASCII2, ROUNDED
from rich.cells import cell_len
from rich.console import Console, ConsoleOptions, Group, RenderableType, RenderResult
from rich.live import Live
from rich.panel import Panel
from rich.table import Table
from rich.text import Text

from bt_dualarm.behaviors.report import NodeView, StatusChange
from bt_dualarm.runtime.arm_runtime import ArmView, IdleObserver, Observer, RunView
from bt_dualarm.runtime.report import ASCII, STYLES, UNICODE, Symbols
from bt_dualarm.spec.faults import FaultEvent

_BAR_COLUMNS = 10
_WIDE = 46
"""Columns from which on there is room for a progress bar and full units."""


@dataclass(frozen=True)
class _Row:
    """One node with the tree guides left of its line and left of the lines below it."""

    node: NodeView
    guide: str
    below: str


def draw_tree(root: NodeView, time: float, width: int, height: int, symbols: Symbols) -> list[Text]:
    """A tree as lines of at most ``width`` columns, at most ``height`` lines if possible.

    If the tree is too high, branches in which no node runs, failed or was halted are folded; if
    that is not enough, only the lines around the running node are shown.

    Args:
        root: Current state of the tree.
        time: Simulated time in seconds.
        width: Columns.
        height: Lines.
        symbols: Characters to draw with.
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
    """Yields the rows of a node and its descendants, top to bottom."""
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
    """The lines, and the index of the line of the running node, otherwise of the failed one."""
    lines: list[Text] = []
    starts: dict[str, int] = {}
    for row in rows:
        starts[row.node.status] = len(lines)
        lines += _lines(row, time, width, symbols)
    return lines, starts.get("RUNNING", starts.get("FAILURE", 0))


def _lines(row: _Row, time: float, width: int, symbols: Symbols) -> list[Text]:
    """Line of a node, and lines of its reason if that does not fit next to the name."""
    node = row.node
    left = Text(no_wrap=True)
    left.append(row.guide, style="dim")
    sign = "HALTED" if node.halted else node.status
    left.append(symbols.status[sign], style=STYLES[sign])
    left.append(f" {node.name}", style="dim" if sign == "INVALID" else "")
    right = _state(node, time, width, symbols)
    if node.name != node.kind and left.cell_len + len(node.kind) + right.cell_len + 4 <= width:
        left.append(f" ({node.kind})", style="dim")
    text = node.reason or node.waiting
    style = "red" if node.reason else "yellow"
    beside = cell_len(text) + 3 <= width - left.cell_len - right.cell_len
    if text and beside:
        left.append(f"  {text}", style=style)
    below = _wrapped(text, row.below, width, style) if text and not beside else []
    return [_aligned(left, right, width, symbols), *below]


def _aligned(left: Text, right: Text, width: int, symbols: Symbols) -> Text:
    """One line with left- and right-aligned texts; the left one is shortened if necessary."""
    room = max(1, width - right.cell_len - (1 if right else 0))
    if left.cell_len > room:
        left = left[: max(0, room - 1)].append(symbols.more)
    left.append(" " * (width - left.cell_len - right.cell_len))
    return left.append_text(right)


def _wrapped(text: str, below: str, width: int, style: str) -> list[Text]:
    """Lines of the reason of a failure or a wait, behind the guides of the tree."""
    room = max(8, width - cell_len(below))
    return [
        Text(below, style="dim", no_wrap=True).append(line, style=f"{style} not dim")
        for line in textwrap.wrap(text, room)
    ]


def _state(node: NodeView, time: float, width: int, symbols: Symbols) -> Text:
    """Progress and seconds in the running state, or how long ago the node ended."""
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
    """``height`` lines around line ``focus``, with the number of omitted lines."""
    first = min(max(0, focus - height // 2), len(lines) - height)
    shown = list(lines[first : first + height])
    if height >= 3:
        if first > 0:
            shown[0] = Text(f"{symbols.more} {first + 1} lines above", style="dim")
        after = len(lines) - first - height
        if after > 0:
            shown[-1] = Text(f"{symbols.more} {after + 1} lines below", style="dim")
    return shown


_COLUMN = 48
"""Fewest columns of each tree for drawing trees side by side."""

_FRAMED = 48
"""Fewest columns for drawing a frame around a tree."""

_UNLIMITED = 10**6

_MOST_FAULTS = 4
"""Injected faults that are shown above the trees."""


@dataclass(frozen=True)
class Picture:
    """State of a run at one time, printable by rich: a header and the arms' trees.

    Attributes:
        title: Name of the tree file.
        time: Simulated time in seconds.
        pace: Simulated seconds per wall-clock second, None before that is known.
        renderer: Name of the cameras' renderer, empty without a camera.
        arms: Arms in the order of the file.
        symbols: Characters to draw with.
        faults: Sentences on the injected faults that are active.
    """

    title: str
    time: float
    pace: float | None
    renderer: str
    arms: Sequence[ArmView]
    symbols: Symbols
    faults: Sequence[str] = ()

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        """Fill the width of the terminal, and stay within its height if possible."""
        yield self._header(options.max_width)
        for sentence in self.faults:
            line = Text(f"{self.symbols.fault} {sentence}", style="magenta", no_wrap=True)
            line.truncate(options.max_width, overflow="ellipsis")
            yield line
        columns = max(1, min(len(self.arms), options.max_width // _COLUMN))
        width = options.max_width // columns
        rows = [self.arms[first : first + columns] for first in range(0, len(self.arms), columns)]
        needs = [max(self._need(arm, width) for arm in row) for row in rows]
        # Without the line of the header and the line of the cursor.
        heights = shared_heights(needs, console.height - 2 - len(self.faults))
        for row, height in zip(rows, heights, strict=True):
            drawn = [self._arm(arm, width, height) for arm in row]
            yield drawn[0] if columns == 1 else _side_by_side(drawn, columns)

    def _header(self, width: int) -> Text:
        """Title and as many facts as fit, in the order of importance."""
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
        """Lines that the arm needs if height is not limited."""
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
    """Distribution of the available lines; small needs are met in full first.

    Args:
        needs: Lines that each element needs.
        available: Lines available; each element gets at least three, even if that exceeds them.
    """
    heights = [0] * len(needs)
    left = max(available, 3 * len(needs))
    by_need = sorted(range(len(needs)), key=needs.__getitem__)
    for rank, index in enumerate(by_need):
        heights[index] = min(needs[index], left // (len(needs) - rank))
        left -= heights[index]
    return heights


def _side_by_side(drawn: Sequence[RenderableType], columns: int) -> Table:
    grid = Table.grid(expand=True)
    for _ in range(columns):
        grid.add_column(ratio=1)
    grid.add_row(*drawn)
    return grid


def _inside(width: int) -> int:
    """Columns inside of a frame and its padding."""
    return width - 4 if width >= _FRAMED else width


def _border(arm: ArmView) -> str:
    return "dim" if arm.outcome is None else STYLES[arm.outcome].removeprefix("bold ")


Mode: TypeAlias = Literal["live", "log", "quiet"]

_DRAW_EVERY_S = 0.1
"""Wall-clock seconds between two redraws."""


class Display(Observer, Protocol):
    """Observer that uses the terminal within a ``with`` block."""

    def __enter__(self) -> Display:
        """Prepare the terminal."""

    def __exit__(self, *error: object) -> None:
        """Restore the terminal."""


@dataclass(frozen=True)
class Caption:
    """Header above the trees.

    Attributes:
        title: Name of the tree file.
        renderer: Name of the cameras' renderer, empty without a camera.
    """

    title: str
    renderer: str = ""


def suited_mode(console: Console, wish: Mode | None) -> Mode:
    """The requested mode, or ``log`` if the terminal cannot redraw lines; ``live`` by default."""
    can_redraw = console.is_terminal and not console.is_dumb_terminal
    if wish in (None, "live"):
        return "live" if can_redraw else "log"
    return wish or "log"


def suited_symbols(console: Console, *, ascii_only: bool) -> Symbols:
    """Unicode symbols if the terminal's encoding has them, unless only ASCII is requested."""
    return UNICODE if not ascii_only and console.encoding.startswith("utf") else ASCII


def open_display(
    mode: Mode, console: Console, symbols: Symbols, caption: Caption, clock: Callable[[], float]
) -> Display:
    """Returns the display of a mode.

    Args:
        mode: Mode from `suited_mode`.
        console: Console to draw on.
        symbols: Symbols from `suited_symbols`.
        caption: Header above the trees.
        clock: Wall clock in seconds.
    """
    if mode == "live":
        return LiveDisplay(console, symbols, caption, clock)
    return LogDisplay(console, symbols) if mode == "log" else QuietDisplay()


class QuietDisplay(IdleObserver, AbstractContextManager["QuietDisplay"]):
    """Display that shows nothing."""

    def __exit__(self, *error: object) -> None:
        """Do nothing."""


class LogDisplay(QuietDisplay):
    """Display with one line per status change, for files, pipes and plain terminals.

    The reset of a node that had ended, before it starts again, is not shown.

    Args:
        console: Console to write to.
        symbols: Characters to draw with.
    """

    def __init__(self, console: Console, symbols: Symbols) -> None:
        self._console = console
        self._symbols = symbols

    def on_event(self, change: StatusChange) -> None:
        """Write the line."""
        halted = change.new == "INVALID"
        if halted and change.old != "RUNNING":
            return
        sign = "HALTED" if halted else change.new
        line = Text.assemble(
            (f"{change.time:9.3f} s", "dim"),
            f"  {change.arm}  ",
            (f"{self._symbols.status[sign]} {sign:<7}", STYLES[sign]),
            f"  {change.path}",
        )
        if change.reason:
            line.append(f"  {change.code}: {change.reason}", style="red")
        elif change.code and not halted:
            line.append(f"  {change.code}", style="dim")
        self._console.print(line, soft_wrap=True)

    def on_fault(self, event: FaultEvent) -> None:
        """Write the start or the end of an injected fault."""
        self._console.print(fault_line(event, self._symbols), soft_wrap=True)


def fault_line(event: FaultEvent, symbols: Symbols) -> Text:
    """Line on the start or the end of an injected fault."""
    return Text.assemble(
        (f"{event.time:9.3f} s", "dim"),
        f"  {event.arm or 'world'}  ",
        (f"{symbols.fault} {'FAULT' if event.is_active else 'OVER':<7}", "bold magenta"),
        f"  {event.text}",
    )


class LiveDisplay(QuietDisplay):
    """Display of all trees, redrawn in place at most ten times per second.

    Args:
        console: A terminal.
        symbols: Characters to draw with.
        caption: Header above the trees.
        clock: Wall clock in seconds.
    """

    def __init__(
        self, console: Console, symbols: Symbols, caption: Caption, clock: Callable[[], float]
    ) -> None:
        self._console = console
        self._symbols = symbols
        self._caption = caption
        self._clock = clock
        self._began: float | None = None
        self._drawn = float("-inf")
        self._run: RunView | None = None
        self._faults: dict[str, str] = {}
        self._stack = ExitStack()
        self._live = Live(console=console, auto_refresh=False, vertical_overflow="crop")

    def __enter__(self) -> LiveDisplay:
        """Hide the cursor and begin to draw."""
        self._stack.enter_context(self._live)
        return self

    def __exit__(self, *error: object) -> None:
        """Draw the last state, leave it above the cursor, and show the cursor again.

        The rate is left out: the report states that of the whole run.
        """
        with self._stack:
            if self._run is not None:
                self._draw(self._run, None)

    def on_fault(self, event: FaultEvent) -> None:
        """Show a fault while it is active; one of a leaf until the end."""
        if event.is_active:
            self._faults[event.name] = event.text
        else:
            self._faults.pop(event.name, None)

    def after_ticks(self, run: RunView) -> None:
        """Draw if the last redraw is old enough."""
        self._run = run
        now = self._clock()
        if self._began is None:
            self._began = now
        if now - self._drawn >= _DRAW_EVERY_S:
            self._drawn = now
            elapsed = now - self._began
            self._draw(run, run.time / elapsed if elapsed > 0 else None)

    def _draw(self, run: RunView, pace: float | None) -> None:
        picture = Picture(
            title=self._caption.title,
            time=run.time,
            pace=pace,
            renderer=self._caption.renderer,
            arms=run.views(),
            symbols=self._symbols,
            faults=list(self._faults.values())[-_MOST_FAULTS:],
        )
        # An empty line for the cursor, so that an echoed ^C does not damage the drawing.
        self._live.update(Group(picture, Text()), refresh=True)
