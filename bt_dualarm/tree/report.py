"""What a tree tells the outside: a view to draw, changes to log, a record per run of a leaf."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal, TypeAlias

StatusName: TypeAlias = Literal["INVALID", "RUNNING", "SUCCESS", "FAILURE"]
"""py_trees' statuses by name. INVALID: never ticked, or halted before it could finish."""


@dataclass(frozen=True)
class NodeView:
    """One node as it stands now, with those below it: all that a display needs.

    Attributes:
        name: The node's ``name`` in the file, else its kind.
        kind: ``sequence``, ``retry``, … or the skill's name.
        status: Status after the last tick or halt.
        since: Simulated time in seconds at which it took this status.
        children: Nodes below it, in the order of the file.
        progress: Share done from 0 to 1 of a running leaf that knows it, else None.
        reason: ``CODE: sentence`` of a failed leaf, else empty.
        halted: Whether INVALID means that it ran and was halted, rather than that it never ran.
    """

    name: str
    kind: str
    status: StatusName
    since: float
    children: tuple[NodeView, ...] = ()
    progress: float | None = None
    reason: str = ""
    halted: bool = False


@dataclass(frozen=True)
class StatusChange:
    """One node took another status. Every change is told, RUNNING → INVALID (halted) too.

    Attributes:
        time: Simulated time in seconds.
        arm: Name of the arm whose tree it is.
        path: Names from the root down, joined by ``/``; equal siblings are numbered ``circle#2``.
        kind: Kind of the node, as in `NodeView`.
        old: Status before.
        new: Status now.
        code: Code of a leaf's failure, ``HALTED`` of a halted leaf, else empty.
        reason: One sentence of a leaf's failure, else empty.
        metrics: Numbers that the leaf measured, with those of its failure; empty while it runs.
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
    """One run of one leaf, from its first tick to its end; a leaf that is retried has several.

    Attributes:
        path: Path of the leaf, as in `StatusChange`.
        skill: The leaf's kind.
        status: RUNNING until it ends; INVALID when it was halted.
        started_s: Simulated time of its first tick in seconds.
        ended_s: Simulated time of its end in seconds; None while it runs.
        code: Code of its end, as in `StatusChange`.
        reason: Sentence of its failure, as in `StatusChange`.
        metrics: Numbers of its end, as in `StatusChange`.
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
        """JSON-ready, keys in the order of ``summary.json``."""
        return {**vars(self), "metrics": dict(self.metrics)}
