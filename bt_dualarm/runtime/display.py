"""What a person sees while a run goes on: pictures of the trees, lines, or nothing."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager, ExitStack
from dataclasses import dataclass
from typing import Literal, Protocol, TypeAlias

from rich.console import Console, Group
from rich.live import Live
from rich.text import Text

from bt_dualarm.runtime.layout import Picture
from bt_dualarm.runtime.parts import IdleObserver, Observer, RunView
from bt_dualarm.runtime.symbols import ASCII, STYLES, UNICODE, Symbols
from bt_dualarm.tree.report import StatusChange

Mode: TypeAlias = Literal["live", "log", "quiet"]

_DRAW_EVERY_S = 0.1
"""Ten pictures a second on the wall, whatever the simulated clock does."""


class Display(Observer, Protocol):
    """An observer that owns the terminal from ``with`` to its end."""

    def __enter__(self) -> Display:
        """Take the terminal."""

    def __exit__(self, *error: object) -> None:
        """Give it back as it was."""


@dataclass(frozen=True)
class Caption:
    """What stands above the trees.

    Attributes:
        title: Name of the tree file.
        renderer: What draws the cameras' pictures, empty where there is no camera.
    """

    title: str
    renderer: str = ""


def suited_mode(console: Console, wish: Mode | None) -> Mode:
    """``live`` only where lines can be redrawn; the default is the richest one that works."""
    can_redraw = console.is_terminal and not console.is_dumb_terminal
    if wish in (None, "live"):
        return "live" if can_redraw else "log"
    return wish or "log"


def suited_symbols(console: Console, *, ascii_only: bool) -> Symbols:
    """ASCII where it is wanted, or where the terminal's encoding knows no more."""
    return UNICODE if not ascii_only and console.encoding.startswith("utf") else ASCII


def open_display(
    mode: Mode, console: Console, symbols: Symbols, caption: Caption, clock: Callable[[], float]
) -> Display:
    """The display of a mode.

    Args:
        mode: Answer of `suited_mode`.
        console: Console that it draws on.
        symbols: Answer of `suited_symbols`.
        caption: What stands above the trees.
        clock: Seconds on the wall.
    """
    if mode == "live":
        return LiveDisplay(console, symbols, caption, clock)
    return LogDisplay(console, symbols) if mode == "log" else QuietDisplay()


class QuietDisplay(IdleObserver, AbstractContextManager["QuietDisplay"]):
    """Shows nothing."""

    def __exit__(self, *error: object) -> None:
        """There is nothing to give back."""


class LogDisplay(QuietDisplay):
    """A line per status change, for files, pipes and plain terminals.

    That a node which had ended is set back for another start is no news, and not written.

    Args:
        console: Console that it writes on.
        symbols: The alphabet.
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


class LiveDisplay(QuietDisplay):
    """All trees, redrawn in place at most ten times a second.

    Args:
        console: A terminal.
        symbols: The alphabet.
        caption: What stands above the trees.
        clock: Seconds on the wall.
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
        self._stack = ExitStack()
        self._live = Live(console=console, auto_refresh=False, vertical_overflow="crop")

    def __enter__(self) -> LiveDisplay:
        """Hide the cursor and begin to draw."""
        self._stack.enter_context(self._live)
        return self

    def __exit__(self, *error: object) -> None:
        """Draw the last state, and leave it standing above the cursor, which is shown again.

        How fast it went is left to the report, which counts the whole run.
        """
        with self._stack:
            if self._run is not None:
                self._draw(self._run, None)

    def after_ticks(self, run: RunView) -> None:
        """Draw if the last picture is old enough."""
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
        )
        # The cursor rests on an empty line: the ^C that a terminal echoes there breaks nothing.
        self._live.update(Group(picture, Text()), refresh=True)
