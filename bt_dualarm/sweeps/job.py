"""What a worker process runs, and the row that it returns: the protocol of jobs.

There are two kinds of jobs: the trial of a tree (`trial`) and the call of a function (`calls`).
"""

from __future__ import annotations

import json
import resource
import socket
import time
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final, Protocol, TypeAlias

from bt_dualarm.runtime.summary import processor
from bt_dualarm.spec.node_types import escaped

Cell: TypeAlias = str | float | int | bool | None
"""Value in a table."""

Row: TypeAlias = Mapping[str, Cell]
"""Row of the table: values by column."""

CRASHED: Final = "CRASHED"
"""Outcome of a job without a result, because its worker died each time."""

REFUSED: Final = "REFUSED"
"""Outcome of a job that its worker did not run because it has other code or files."""

LONGEST_TEXT: Final = 500
"""Letters of a sentence in a row."""

COST_COLUMNS: Final = (
    "cpu_s", "wall_s", "memory_mb", "machine", "processor", "attempts", "audited",
)  # fmt: skip
"""Columns that depend on the machine and its load; the others are a function of the job."""


class Job(Protocol):
    """A piece of work that a worker process can run; it is pickled to get there."""

    @property
    def index(self) -> int:
        """Number of the job, from 0."""

    @property
    def identity(self) -> str:
        """Hash of everything that determines its result."""

    @property
    def label(self) -> str:
        """Name of the job in messages."""

    @property
    def inputs(self) -> Mapping[str, str]:
        """Digests of code and files that the worker must find the same; empty for any."""

    def run(self) -> Row:
        """Run it in this process; an error becomes part of the row."""

    def lost_row(self, reason: str, attempts: int) -> Row:
        """Row of the job if its worker died each time."""


@dataclass
class Costs:
    """What a job has cost this process since the object was created."""

    _wall_s: float = field(default_factory=time.perf_counter)
    _cpu_s: float = field(default_factory=time.process_time)

    def __post_init__(self) -> None:
        """Let the peak of this process's memory begin again, where Linux allows it."""
        with suppress(OSError):
            Path("/proc/self/clear_refs").write_text("5", encoding="ascii")

    def columns(self) -> Row:
        """The `COST_COLUMNS`."""
        return {
            "cpu_s": time.process_time() - self._cpu_s,
            "wall_s": time.perf_counter() - self._wall_s,
            "memory_mb": _peak_mb(),
            **machine_columns(attempts=1),
        }


def machine_columns(attempts: int) -> Row:
    """The columns that name the machine, and the number of attempts there."""
    return {
        "machine": socket.gethostname(),
        "processor": processor()["arithmetic"],
        "attempts": attempts,
        "audited": False,
    }


def lost_columns(reason: str, attempts: int) -> Row:
    """Columns of a job whose worker died each time."""
    return {
        "outcome": CRASHED,
        "code": "WORKER_DIED",
        "reason": short(reason),
        **machine_columns(attempts),
    }


def refused_columns(reason: str) -> Row:
    """Columns of a job that its worker did not run."""
    return {"outcome": REFUSED, "reason": reason, "machine": socket.gethostname()}


def difference(found: Mapping[str, str], wanted: Mapping[str, str]) -> str:
    """Sentence on the inputs of a job that are not as they should be; empty if all are."""
    names = sorted({*found, *wanted})
    differing = [name for name in names if found.get(name) != wanted.get(name)]
    return f"it differs from the sweep in {', '.join(differing)}" if differing else ""


def flat(value: object) -> Cell:
    """A value as one cell: numbers and texts as they are, vectors and mappings as text."""
    if value is None or isinstance(value, str | float | int | bool):
        return value
    return json.dumps(value)


def short(text: str) -> str:
    """Text in one line of at most `LONGEST_TEXT` letters."""
    line = escaped(" ".join(text.split()), keep="")
    return line if len(line) <= LONGEST_TEXT else f"{line[: LONGEST_TEXT - 1]}…"


def _peak_mb() -> float:
    with suppress(OSError, ValueError):
        for line in Path("/proc/self/status").read_text(encoding="ascii").splitlines():
            if line.startswith("VmHWM:"):
                return int(line.split()[1]) / 1024
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
