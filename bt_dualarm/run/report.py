"""What is said at the end of a run: how each arm did, what was measured, what went wrong."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from rich.console import Console, ConsoleOptions, RenderResult
from rich.padding import Padding
from rich.text import Text

from bt_dualarm.errors import Number
from bt_dualarm.run.outcome import ArmResult, Ending, Outcome, RunResult
from bt_dualarm.run.symbols import STYLES, Symbols
from bt_dualarm.tree.report import LeafReport

_MOST_METRICS = 6
"""A line for a person names no more than this; the record has them all."""

_SHOWN_AS = {"m": (1e3, "mm"), "rad": (180 / math.pi, "°"), "s": (1.0, "s")}


@dataclass(frozen=True)
class Report:
    """The last words on a run, to be printed by rich at any width.

    Attributes:
        title: Of the tree file.
        result: What the run did.
        folder: Where the record is, if one was wanted.
        symbols: The alphabet.
    """

    title: str
    result: RunResult
    folder: Path | None
    symbols: Symbols

    def __rich_console__(self, _console: Console, _options: ConsoleOptions) -> RenderResult:
        """A headline, a paragraph per arm, and where the record is."""
        yield self._headline()
        for arm in self.result.arms:
            yield Padding(self._arm(arm), (0, 0, 0, 2))
            for leaf in last_runs(arm):
                if line := self._leaf(leaf):
                    yield Padding(line, (0, 0, 0, 6))
            if arm.fault:
                yield Padding(Text(arm.fault, style="red"), (0, 0, 0, 6))
        if self.folder is not None:
            yield Text.assemble(("record: ", "dim"), str(self.folder))

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
        if arm.clipped_setpoints:
            line.append(f"  {arm.clipped_setpoints} set-points clipped", style="yellow")
        return line

    def _outcome(self, outcome: Outcome) -> Text:
        """The sign and the word."""
        word = outcome.replace("_", " ")
        return Text(f"{self.symbols.status[outcome]} {word}", style=STYLES[outcome])

    def _leaf(self, leaf: LeafReport) -> Text | None:
        """What a leaf measured, or why it failed; nothing where there is nothing to say."""
        if leaf.status == "FAILURE":
            line = Text(f"{leaf.path}  ", style="red")
            return line.append(f"{leaf.code}: {leaf.reason}" if leaf.code else leaf.reason)
        words = [in_words(name, value) for name, value in leaf.metrics.items()]
        if leaf.status != "SUCCESS" or not words:
            return None
        return Text.assemble((f"{leaf.path}  ", "dim"), ", ".join(words[:_MOST_METRICS]))


def last_runs(arm: ArmResult) -> Iterator[LeafReport]:
    """The last run of each leaf: a leaf that was retried has been heard before."""
    yield from {leaf.path: leaf for leaf in arm.leaves}.values()


def in_words(name: str, value: Number) -> str:
    """``path_rms_m`` of 0.00012 is ``path rms 0.12 mm``: three digits, a unit people read."""
    if isinstance(value, bool | str):
        return f"{name.replace('_', ' ')} {str(value).lower() if value in (True, False) else value}"
    stem, _, unit = name.rpartition("_")
    if not stem or unit not in _SHOWN_AS:
        return f"{name.replace('_', ' ')} {value:.3g}"
    factor, shown = _SHOWN_AS[unit]
    gap = "" if shown == "°" else " "
    return f"{stem.replace('_', ' ')} {value * factor:.3g}{gap}{shown}"
