"""The report of a run: printed text, and ``summary.json`` with the processor and versions."""

from __future__ import annotations

import ctypes
import hashlib
import math
import platform
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from importlib.metadata import version
from pathlib import Path
from types import MappingProxyType
from typing import Final, TypedDict

import numpy as np
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
    "m": (1e3, "mm"),
    "rad": (180 / math.pi, "deg"),
    "s": (1.0, "s"),
    "n": (1.0, "N"),
    "nm": (1.0, "N m"),
    "kg": (1.0, "kg"),
    "px": (1.0, "px"),
}
"""Factor and name of the printed unit, by the suffix of a metric's name."""

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
    stem, _, unit = name.rpartition("_")
    if not stem or unit not in _SHOWN_AS:
        return f"{plain} {value:.3g}" if isinstance(value, float) else f"{plain} {value}"
    factor, shown = _SHOWN_AS[unit]
    return f"{stem.replace('_', ' ')} {value * factor:.3g} {shown}"


# The kind of processor is part of the summary, because the last bits of the results depend on it.
# Processors of one kind compute the same bits from the same file and seed. On another kind, the C
# library (with or without fused multiply-add), NumPy's loops (by SIMD extension) and BLAS (by core)
# round differently: samples differ by about 1e-13, and the state hash differs.


_CORE_NAMES: Final = (
    "scipy_openblas_get_corename64_",
    "scipy_openblas_get_corename",
    "openblas_get_corename64_",
    "openblas_get_corename",
)
"""Names of OpenBLAS's ``openblas_get_corename`` in the builds that NumPy is linked to."""


class Processor(TypedDict):
    """Kind of a processor, JSON-ready.

    Attributes:
        machine: Architecture, for example ``x86_64``.
        simd: SIMD extensions that NumPy uses.
        blas: Core type that OpenBLAS detected; ``unknown`` for another BLAS.
        arithmetic: Fingerprint of results of the C library, NumPy and BLAS; hashes of runs are
            comparable only if it is equal.
    """

    machine: str
    simd: list[str]
    blas: str
    arithmetic: str


def processor() -> Processor:
    """Kind of the processor that this process runs on."""
    return {
        "machine": platform.machine(),
        "simd": _simd(),
        "blas": _blas_core(),
        "arithmetic": _fingerprint(),
    }


def _simd() -> list[str]:
    found = np.show_config(mode="dicts")["SIMD Extensions"]
    return [*found.get("baseline", []), *found.get("found", [])]


def _blas_core() -> str:
    # A library handle also resolves symbols of the libraries that it is linked to.
    library = ctypes.CDLL(np.linalg._umath_linalg.__file__)
    for name in _CORE_NAMES:
        if hasattr(library, name):
            core_name = getattr(library, name)
            core_name.restype = ctypes.c_char_p
            return str(core_name().decode())
    return "unknown"


def _fingerprint() -> str:
    """Hash of computations that are sensitive to rounding, 16 hexadecimal digits."""
    angles = [0.37 * number + 0.01 for number in range(500)]
    values = np.array(angles)
    matrix = np.sin(values[:480]).reshape(20, 24)
    answers = (
        np.array([function(angle) for function in (math.sin, math.cos) for angle in angles]),
        np.array([math.exp(angle / 100) for angle in angles]),
        np.array([math.pow(angle, 1.3) for angle in angles]),
        np.array([math.atan2(angle, 1.3) for angle in angles]),
        np.sin(values),
        np.exp(values / 100),
        np.add.reduce(matrix, axis=1),
        matrix @ matrix.T,
        np.linalg.solve(matrix @ matrix.T + np.eye(20), matrix[:, 0]),
    )
    return hashlib.sha256(b"".join(answer.tobytes() for answer in answers)).hexdigest()[:16]


_PACKAGES = (
    "bt_dualarm",
    "example-robot-data",
    "mujoco",
    "numpy",
    "ompl",
    "opencv-python-headless",
    "placo",
    "py_trees",
    "ruckig",
    "scipy",
)


@cache
def versions() -> Mapping[str, str]:
    """Versions of Python and of every package that can change a result; cached, it takes 9 ms."""
    found = {"python": platform.python_version()} | {name: version(name) for name in _PACKAGES}
    return MappingProxyType(found)


def summary_of(
    result: RunResult, attachments: Sequence[Mapping[str, object]], attachments_left_out: int
) -> dict[str, object]:
    """The content of ``summary.json``; names carry their units.

    Args:
        result: Result of the run.
        attachments: Every attachment, or the first and the last ones if there were many.
        attachments_left_out: Number of dropped attachments.
    """
    summary = {
        "outcome": result.outcome,
        "ending": result.ending,
        "error": result.error,
        "at_rest": result.at_rest,
        "sim_time_s": result.sim_time_s,
        "wall_time_s": result.wall_time_s,
        "real_time_factor": result.real_time_factor,
        "seed": result.seed,
        "reality": result.reality,
        "state_sha256": result.state_sha256,
        "processor": processor(),
        "versions": versions(),
        "renderer": result.renderer,
        "attachments": attachments,
        "attachments_left_out": attachments_left_out,
        "goals": {name: vars(goal) for name, goal in result.goals.items()},
        "faults": [vars(event) for event in result.faults],
        "false_success": result.is_false_success,
        "arms": {arm.name: _arm(arm) for arm in result.arms.values()},
    }
    return {name: json_ready(value) for name, value in summary.items()}


def _arm(arm: ArmResult) -> dict[str, object]:
    return {
        "outcome": arm.outcome,
        "robot": arm.robot,
        "fault": arm.fault,
        "lives": [vars(life) for life in arm.lives],
        "lives_left_out": arm.lives_left_out,
        "clipped_setpoints": arm.clipped_setpoints,
        "guard": arm.guard,
        "slow_ticks": [vars(tick) for tick in arm.slow_ticks],
        "runs_left_out": arm.runs_left_out,
        "leaves": [run.as_dict() for run in arm.runs],
    }


def json_ready(value: object) -> object:
    """A value with types that JSON has: plain Python numbers, rounded to nine decimals.

    Numbers that are not finite become null, because JSON has none.
    """
    if isinstance(value, Mapping):
        return {str(key): json_ready(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [json_ready(item) for item in value]
    if hasattr(value, "tolist"):
        return json_ready(value.tolist())
    if isinstance(value, float):
        return round(value, 9) if math.isfinite(value) else None
    return str(value) if isinstance(value, str) else value
