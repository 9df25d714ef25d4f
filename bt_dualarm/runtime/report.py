"""What is said at the end of a run: how each arm did, what was measured, what went wrong."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from rich.console import Console, ConsoleOptions, RenderResult
from rich.text import Text

from bt_dualarm.errors import Number
from bt_dualarm.runtime.outcome import Ending, Outcome
from bt_dualarm.runtime.result import ArmResult, LeafResult, RunResult
from bt_dualarm.runtime.symbols import STYLES, Symbols

_MOST_METRICS = 6
"""A line for a person names no more than this; the record has them all."""

_SHOWN_AS = {
    "m": (1e3, "mm"),
    "rad": (180 / math.pi, "deg"),
    "s": (1.0, "s"),
    "n": (1.0, "N"),
    "nm": (1.0, "N m"),
    "kg": (1.0, "kg"),
    "px": (1.0, "px"),
}
"""Factor and name of the unit that people read, by the ending of a number's name."""

_DRAWN = " (its pictures are being drawn)"
"""The outcome is said first: nobody waits for pictures to hear it."""

_INDENT = " " * 6

_READABLE = 36
"""Columns that a sentence needs beside the names of the leaves."""


@dataclass(frozen=True)
class Report:
    """The last words on a run, to be printed by rich at any width.

    Attributes:
        title: Name of the tree file.
        result: What the run did.
        folder: Folder of the record, None where none was wanted.
        symbols: The alphabet.
    """

    title: str
    result: RunResult
    folder: Path | None
    symbols: Symbols

    def __rich_console__(self, _console: Console, options: ConsoleOptions) -> RenderResult:
        """A headline, a paragraph per arm, and where the record comes to lie."""
        yield self._headline()
        for arm in self.result.arms.values():
            yield Text("  ").append_text(self._arm(arm))
            yield from _entries(arm, options.max_width - len(_INDENT))
        if self.folder is not None:
            yield Text.assemble(("record: ", "dim"), str(self.folder), (_DRAWN, "dim"))

    def _headline(self) -> Text:
        result, dot = self.result, self.symbols.dot
        line = self._outcome(result.outcome)
        line.append(f"  {self.title}", style="bold")
        line.append(f"  {dot}  {result.sim_time_s:.1f} s in {result.wall_time_s:.1f} s")
        line.append(f"  {dot}  {result.real_time_factor:.1f}{self.symbols.times} real time")
        if result.ending is not Ending.FINISHED:
            line.append(f"\n{result.ending.capitalize()}.", style="yellow")
        return line

    def _arm(self, arm: ArmResult) -> Text:
        line = self._outcome(arm.outcome)
        line.append(f"  {arm.name}", style="bold").append(f" {self.symbols.dot} {arm.robot}")
        if arm.ended_s is not None:
            line.append(f"  after {arm.ended_s:.1f} s", style="dim")
        if len(arm.lives) > 1:
            line.append(f"  lives: {', '.join(life.outcome for life in arm.lives)}", style="dim")
        if arm.clipped_setpoints:
            line.append(f"  {arm.clipped_setpoints} set-points clipped", style="yellow")
        return line

    def _outcome(self, outcome: Outcome) -> Text:
        """The sign and the word."""
        word = outcome.replace("_", " ")
        return Text(f"{self.symbols.status[outcome]} {word}", style=STYLES[outcome])


def _entries(arm: ArmResult, width: int) -> Iterator[Text]:
    """What each leaf has to say, in a column beside the names or, where that is narrow, below."""
    failed = arm.outcome is Outcome.FAILURE
    entries = [_Entry.of(leaf, failed=failed) for leaf in arm.leaves.values()]
    if arm.fault:
        entries.append(_Entry("its tree", tuple(arm.fault.split()), "red"))
    entries = [entry for entry in entries if entry.words]
    column = max((len(entry.name) for entry in entries), default=0) + 2
    beside = width - column >= _READABLE
    gap = column if beside else 2
    for entry in entries:
        lines = flowed(entry.words, width - gap)
        if not beside:
            lines.insert(0, "")
        text = Text(_INDENT).append(entry.name.ljust(column if beside else 0), entry.name_style)
        yield text.append(f"\n{_INDENT}{' ' * gap}".join(lines), entry.style)


@dataclass(frozen=True)
class _Entry:
    """A leaf's name, and words (each may hold spaces) that stay whole when lines are broken."""

    name: str
    words: tuple[str, ...]
    style: str

    @classmethod
    def of(cls, leaf: LeafResult, *, failed: bool) -> _Entry:
        """What it measured, or why it failed. Its path without the root, which all leaves share.

        Where the tree has failed, that it was halted: a timeout or a guard has nothing else to say.
        """
        name = leaf.path.partition("/")[2] or leaf.path
        if leaf.status == "FAILURE":
            return cls(name, tuple(f"{leaf.code}: {leaf.reason}".split()), "red")
        facts = [in_words(key, value) for key, value in leaf.metrics.items()][:_MOST_METRICS]
        commas = [f"{fact}," for fact in facts[:-1]] + facts[-1:]
        if leaf.code == "HALTED" and (facts or failed):
            commas = [_halted(leaf) + (":" if facts else ""), *commas]
        return cls(name, tuple(commas), "default")

    @property
    def name_style(self) -> str:
        return "red" if self.style == "red" else "dim"


def _halted(leaf: LeafResult) -> str:
    """That it was halted, and how long it had run by then."""
    if leaf.ended_s is None:
        return "halted"
    return f"halted after {leaf.ended_s - leaf.started_s:.1f} s"


def flowed(words: Sequence[str], width: int) -> list[str]:
    """Lines of at most ``width`` columns that break between words only."""
    lines = [""]
    for word in words:
        if lines[-1] and len(lines[-1]) + 1 + len(word) > width:
            lines.append(word)
        else:
            lines[-1] = f"{lines[-1]} {word}" if lines[-1] else word
    return lines


def in_words(name: str, value: Number) -> str:
    """``path_rms_m`` of 0.00012 is ``path rms 0.12 mm``: three digits, a unit people read."""
    plain = name.replace("_", " ")
    if isinstance(value, bool):
        return f"{plain} {'yes' if value else 'no'}"
    if isinstance(value, str):
        return f"{plain} {value}"
    stem, _, unit = name.rpartition("_")
    if not stem or unit not in _SHOWN_AS:
        return f"{plain} {value:.3g}" if isinstance(value, float) else f"{plain} {value}"
    factor, shown = _SHOWN_AS[unit]
    return f"{stem.replace('_', ' ')} {value * factor:.3g} {shown}"
