"""The story of a failure: which leaf, with which ports, after what, and why."""

from __future__ import annotations

from dataclasses import dataclass

from bt_dualarm.replay.before import second_before
from bt_dualarm.replay.causes import causes_of
from bt_dualarm.replay.decisive import Verdict, chain_of, descend, failures, waiting
from bt_dualarm.replay.evidence import Cause, Evidence
from bt_dualarm.replay.record import Facts, Record, ReplayError
from bt_dualarm.replay.timeline import Node, Timeline

_JUST_S = 1.0
"""Seconds for which a failure is told about at a time after it, besides what runs then."""


@dataclass(frozen=True)
class Story:
    """Why one leaf failed, or was still running.

    Attributes:
        arm: Name of the arm.
        leaf: Path of the leaf.
        kind: Kind of the leaf.
        place: File and line of the leaf.
        status: ``FAILURE``, ``HALTED`` or ``RUNNING``; ``SUCCESS`` of one that was asked for.
        code: Code of its failure, or empty.
        reason: Sentence of its failure, or empty.
        numbers: Numbers that it measured by its end.
        began_s: When this run of it began in s.
        ended_s: When it ended in s; None while it ran.
        at_s: Time in s that is told about: its end, the time asked for, or the record's end.
        chain: Nodes from the root down: path, kind, place, status at that time.
        ports: Ports with the values that they had.
        keys: Keys behind its ports: value, writer and time.
        before: Sentences on what the arm and its camera did in the second before.
        causes: Causes, the most telling first.
        others: Leaves that had failed before it, and were passed over.
    """

    arm: str
    leaf: str
    kind: str
    place: str
    status: str
    code: str
    reason: str
    numbers: Facts
    began_s: float
    ended_s: float | None
    at_s: float
    chain: tuple[Facts, ...]
    ports: Facts
    keys: tuple[Facts, ...]
    before: tuple[str, ...]
    causes: tuple[Cause, ...]
    others: tuple[str, ...]

    def as_dict(self) -> Facts:
        """The story as plain data, ready for JSON."""
        return {**vars(self), "causes": [vars(cause) for cause in self.causes]}


def stories(record: Record, asked: str | None = None) -> tuple[Story, ...]:
    """Why a run failed, or what it waited for; the earliest failure first.

    Args:
        record: The record.
        asked: Name or path of a leaf, or a time in s; None for whatever made the run fail.

    Returns:
        No story where nothing failed and nothing was running.

    Raises:
        ReplayError: No node has such a name, or the time is outside of the record.
    """
    timeline = Timeline(record)
    verdicts = _verdicts(record, timeline, asked)
    return tuple(_told(Evidence(record, timeline, verdict)) for verdict in verdicts)


def _verdicts(record: Record, timeline: Timeline, asked: str | None) -> list[Verdict]:
    if asked is None:
        return [*failures(timeline), *waiting(timeline)]
    time = _as_time(asked)
    if time is None:
        return [_of_node(timeline, node) for node in _asked_for(timeline, asked)]
    record.index_at(time)
    failed = [
        Verdict(chain_of(timeline.roots[leaf.arm], leaf), end)
        for leaf in timeline.leaves()
        for end in leaf.changes
        if end.new == "FAILURE" and end.time <= time + 1e-9
    ]
    running = [
        Verdict(chain_of(timeline.roots[leaf.arm], leaf), None, at=time)
        for leaf in timeline.leaves()
        if leaf.status_at(time) == "RUNNING"
    ]
    nearest = max(failed, key=lambda verdict: verdict.time, default=None)
    if nearest is not None and (not running or time - nearest.time <= _JUST_S):
        return [nearest, *running]
    return running


def _as_time(asked: str) -> float | None:
    try:
        return float(asked.removesuffix("s").strip())
    except ValueError:
        return None


def _asked_for(timeline: Timeline, name: str) -> list[Node]:
    """Nodes of a name that have run; of several those that failed.

    Raises:
        ReplayError: There is none, or none of them ever ran.
    """
    named = timeline.named(name)
    ran = [node for node in named if node.changes]
    if not ran:
        paths = ", ".join(f"{node.arm}:{node.path}" for node in named)
        raise ReplayError(f"{paths} never ran")
    failed = [node for node in ran if node.last("FAILURE") is not None]
    return failed or ran


def _of_node(timeline: Timeline, node: Node) -> Verdict:
    root = timeline.roots[node.arm]
    end = node.last("FAILURE") or node.changes[-1]
    above = chain_of(root, node)
    if node.children and end.new == "FAILURE":
        below = descend(node, end)
        return Verdict((*above[:-1], *below.chain), below.end, below.others)
    return Verdict(above, None if end.new == "RUNNING" else end)


def _told(e: Evidence) -> Story:
    end = e.verdict.end
    status = "RUNNING" if end is None else "HALTED" if end.code == "HALTED" else end.new
    return Story(
        arm=e.arm,
        leaf=e.leaf.path,
        kind=e.leaf.kind,
        place=e.leaf.place,
        status=status,
        code=e.code,
        reason=e.reason,
        numbers=dict(e.numbers),
        began_s=e.began,
        ended_s=None if end is None else end.time,
        at_s=e.ended,
        chain=tuple(_link(node, e) for node in e.verdict.chain),
        ports=e.ports,
        keys=tuple(e.keys),
        before=tuple(second_before(e)),
        causes=causes_of(e),
        others=tuple(f"{node.arm}:{node.path}" for node in e.verdict.others),
    )


def _link(node: Node, e: Evidence) -> Facts:
    return {
        "path": node.path,
        "kind": node.kind,
        "place": node.place,
        "status": node.status_at(e.ended),
    }
