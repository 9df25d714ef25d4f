"""Reports of a tree: node views, status changes, trace events, a report of each run of a leaf."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from itertools import count
from typing import Any, Final, Generic, Literal, TypeAlias, TypeVar

from bt_dualarm.spec.yaml_reader import Data

_Item = TypeVar("_Item")


class BoundedLog(Generic[_Item]):
    """A log with bounded memory, which keeps the first and the last items.

    Args:
        each: Number of items kept from the start, and as many from the end.

    Attributes:
        left_out: Number of items between them that were dropped.
    """

    def __init__(self, each: int) -> None:
        self.left_out = 0
        self._each = each
        self._first: list[_Item] = []
        self._last: deque[_Item] = deque()

    def add(self, item: _Item) -> None:
        """Append an item."""
        if len(self._first) < self._each:
            self._first.append(item)
            return
        self._last.append(item)
        if len(self._last) > self._each:
            self._last.popleft()
            self.left_out += 1

    def __iter__(self) -> Iterator[_Item]:
        yield from self._first
        yield from self._last


@dataclass(frozen=True)
class PortsRead:
    """Trace event: a leaf has started with these ports.

    Attributes:
        time: Simulated time in seconds.
        arm: Name of the arm.
        path: Path of the leaf, as in `StatusChange`.
        ports: Values of all ports in YAML notation, with references resolved.
    """

    time: float
    arm: str
    path: str
    ports: Mapping[str, Data]


@dataclass(frozen=True)
class KeyWritten:
    """Trace event: a leaf has written a key of its arm's blackboard.

    Attributes:
        time: Simulated time in seconds.
        arm: Name of the arm.
        path: Path of the leaf.
        key: Name of the key.
        value: Value in YAML notation.
    """

    time: float
    arm: str
    path: str
    key: str
    value: Data


TraceEvent: TypeAlias = PortsRead | KeyWritten

OnTraceEvent: TypeAlias = Callable[[TraceEvent], None]
"""Receiver of trace events in the order of their times."""

StatusName: TypeAlias = Literal["INVALID", "RUNNING", "SUCCESS", "FAILURE"]
"""py_trees' statuses by name. INVALID: never ticked, or halted before it could finish."""


@dataclass(frozen=True)
class NodeView:
    """State of a node and its descendants, for display.

    Attributes:
        name: The node's ``name`` in the file, otherwise its kind.
        kind: ``sequence``, ``retry``, … or the skill's name.
        status: Status after the last tick or halt.
        since: Simulated time in seconds of the last status change.
        children: Children in the order of the file.
        progress: Progress from 0 to 1 of a running leaf that reports it, else None.
        reason: ``CODE: sentence`` of a failed leaf, otherwise empty.
        halted: Whether INVALID means that it was halted, rather than that it never ran.
        waiting: Sentence on the other arms that a running node waits for, otherwise empty.
    """

    name: str
    kind: str
    status: StatusName
    since: float
    children: tuple[NodeView, ...] = ()
    progress: float | None = None
    reason: str = ""
    halted: bool = False
    waiting: str = ""


@dataclass(frozen=True)
class StatusChange:
    """Change of a node's status, RUNNING → INVALID (halted) included.

    Attributes:
        time: Simulated time in seconds.
        arm: Name of the arm.
        path: Names from the root down, joined by ``/``; equal siblings are numbered ``circle#2``.
        kind: Kind of the node, as in `NodeView`.
        old: Previous status.
        new: New status.
        code: Failure code of a leaf, ``HALTED`` of a halted leaf, otherwise empty.
        reason: Reason of a leaf's failure in one sentence, otherwise empty.
        metrics: Metrics of the leaf with the numbers of its failure; empty while it runs.
    """

    time: float
    arm: str
    path: str
    kind: str
    old: StatusName
    new: StatusName
    code: str = ""
    reason: str = ""
    metrics: Mapping[str, Any] = field(default_factory=dict)  # Any: a number or text, by its name


@dataclass
class LeafReport:
    """Report of one run of a leaf, from its first tick to its end.

    Attributes:
        path: Path of the leaf, as in `StatusChange`.
        skill: Kind of the leaf.
        status: RUNNING until it ends; INVALID if it was halted.
        started_s: Simulated time of its first tick in seconds.
        ended_s: Simulated time of its end in seconds; None while it runs.
        code: Code, as in `StatusChange`.
        reason: Reason, as in `StatusChange`.
        metrics: Metrics, as in `StatusChange`.
    """

    path: str
    skill: str
    status: StatusName
    started_s: float
    ended_s: float | None = None
    code: str = ""
    reason: str = ""
    metrics: Mapping[str, Any] = field(default_factory=dict)  # Any: a number or text, by its name

    def as_dict(self) -> dict[str, object]:
        """Returns JSON-ready data with keys in the order of ``summary.json``."""
        return {**vars(self), "metrics": dict(self.metrics)}


MOST_RUNS: Final = 200
"""Number of first runs of a leaf whose reports are kept, and of last runs."""


class LeafReports:
    """Reports of the leaves of one tree in bounded memory, in the order in which their runs began.

    Of a leaf that runs more often than twice `MOST_RUNS`, the runs in between are dropped.
    """

    def __init__(self) -> None:
        self._numbers = count()
        self._by_path: dict[str, BoundedLog[tuple[int, LeafReport]]] = {}

    @property
    def left_out(self) -> int:
        """Number of runs that were dropped."""
        return sum(runs.left_out for runs in self._by_path.values())

    def add(self, report: LeafReport) -> None:
        """Add the report of a run that begins."""
        runs = self._by_path.setdefault(report.path, BoundedLog(MOST_RUNS))
        runs.add((next(self._numbers), report))

    def __len__(self) -> int:
        return sum(1 for _ in self)

    def __iter__(self) -> Iterator[LeafReport]:
        kept = [run for runs in self._by_path.values() for run in runs]
        for _, report in sorted(kept, key=lambda run: run[0]):
            yield report
