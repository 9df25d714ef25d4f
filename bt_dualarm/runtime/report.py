"""The report of a run as printed text."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType

from rich.console import Console, ConsoleOptions, RenderResult
from rich.text import Text

from bt_dualarm.core.errors import Number
from bt_dualarm.runtime.outcome import ArmResult, Ending, LeafResult, Outcome, RunResult

STYLES: Mapping[str, str] = MappingProxyType(
    {
        "SUCCESS": "green",
        "FAILURE": "bold red",
        "RUNNING": "bold cyan",
        "INVALID": "dim",
        "HALTED": "yellow",
        "UNFINISHED": "yellow",
        "REMOVED": "dim",
        "NOT_SPAWNED": "dim",
    }
)
"""Color of each status and outcome, and of halted nodes.

The signs differ as well, so the colors are not essential.
"""


@dataclass(frozen=True)
class Symbols:
    """Set of characters for drawing trees.

    Attributes:
        status: Sign of each status and outcome, and of halted nodes.
        branch: Line to a child with siblings below it.
        last: Line to the last child.
        through: Line past the descendants of a child with siblings below it.
        full: Done part of a progress bar.
        empty: Remaining part of a progress bar.
        more: Ellipsis for omitted lines or letters.
        dot: Separator.
        times: Multiplication sign.
        line: Horizontal rule.
        fault: Sign of an injected fault.
    """

    status: Mapping[str, str]
    branch: str
    last: str
    through: str
    full: str
    empty: str
    more: str
    dot: str
    times: str
    line: str
    fault: str


UNICODE = Symbols(
    status=MappingProxyType(
        {
            "SUCCESS": "✔",
            "FAILURE": "✘",
            "RUNNING": "▶",
            "INVALID": "·",
            "HALTED": "■",
            "UNFINISHED": "■",
            "REMOVED": "◌",
            "NOT_SPAWNED": "○",
        }
    ),
    branch="├─",
    last="└─",
    through="│ ",
    full="━",
    empty="─",
    more="…",
    dot="·",
    times="×",  # noqa: RUF001 - a multiplication it is
    line="─",
    fault="⚡",
)

ASCII = Symbols(
    status=MappingProxyType(
        {
            "SUCCESS": "+",
            "FAILURE": "x",
            "RUNNING": ">",
            "INVALID": ".",
            "HALTED": "#",
            "UNFINISHED": "#",
            "REMOVED": "-",
            "NOT_SPAWNED": "o",
        }
    ),
    branch="|-",
    last="`-",
    through="| ",
    full="=",
    empty="-",
    more="~",
    dot="|",
    times="x",
    line="-",
    fault="!",
)


_MOST_METRICS = 6
"""Most metrics printed per leaf; the record has all of them."""

_SHOWN_AS = {
    "m_s": (1.0, "m/s"),
    "rad_s": (180 / math.pi, "deg/s"),
    "m": (1e3, "mm"),
    "rad": (180 / math.pi, "deg"),
    "s": (1.0, "s"),
    "n": (1.0, "N"),
    "nm": (1.0, "N m"),
    "kg": (1.0, "kg"),
    "px": (1.0, "px"),
}
"""Factor and name of the printed unit, by the suffix of a metric's name; the first one counts."""

_PENDING = " (its figures are being drawn)"
"""The report is printed before the plots are drawn, so that the user need not wait for them."""

_INDENT = " " * 6

_READABLE = 36
"""Fewest columns for sentences next to the names of the leaves."""


@dataclass(frozen=True)
class Report:
    """Report at the end of a run, printable by rich at any width.

    Attributes:
        title: Name of the tree file.
        result: Result of the run.
        folder: Folder of the record, None without a record.
        symbols: Characters to draw with.
    """

    title: str
    result: RunResult
    folder: Path | None
    symbols: Symbols

    def __rich_console__(self, _console: Console, options: ConsoleOptions) -> RenderResult:
        """Headline, a paragraph per arm, and the folder of the record."""
        yield self._headline()
        for arm in self.result.arms.values():
            yield Text("  ").append_text(self._arm(arm))
            yield from _entries(arm, options.max_width - len(_INDENT))
        for name, goal in self.result.goals.items():
            sign = self.symbols.status["SUCCESS" if goal.met else "FAILURE"]
            line = Text(f"  {sign} goal {name}", style=STYLES["SUCCESS" if goal.met else "FAILURE"])
            yield line.append(f"  {goal.reason or 'met'}", style="default")
        if self.folder is not None:
            yield Text.assemble(("record: ", "dim"), str(self.folder), (_PENDING, "dim"))

    def _headline(self) -> Text:
        result = self.result
        dot = self.symbols.dot
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
        """Sign and name of an outcome."""
        word = outcome.replace("_", " ")
        return Text(f"{self.symbols.status[outcome]} {word}", style=STYLES[outcome])


def _entries(arm: ArmResult, width: int) -> Iterator[Text]:
    """Yields the text of each leaf, beside its name or, in a narrow terminal, below it."""
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
    """A leaf's name and its words, which stay whole at line breaks; a word may contain spaces."""

    name: str
    words: tuple[str, ...]
    style: str

    @classmethod
    def of(cls, leaf: LeafResult, *, failed: bool) -> _Entry:
        """Entry with the metrics of a leaf, or the reason of its failure.

        The name is its path without the root, which all leaves share. If the tree has failed,
        leaves halted without metrics are listed too: a timeout or a guard shows in nothing else.
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
    """Record that a leaf was halted, and how long it had run."""
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
    """A metric as text: ``path_rms_m`` of 0.00012 becomes ``path rms 0.12 mm``."""
    plain = name.replace("_", " ")
    if isinstance(value, bool):
        return f"{plain} {'yes' if value else 'no'}"
    if isinstance(value, str):
        return f"{plain} {value}"
    for unit, (factor, shown) in _SHOWN_AS.items():
        stem = name.removesuffix(f"_{unit}")
        if stem != name:
            return f"{stem.replace('_', ' ')} {value * factor:.3g} {shown}"
    return f"{plain} {value:.3g}" if isinstance(value, float) else f"{plain} {value}"
