"""The diagnosis of a failure: which leaf, with which ports, after what, and why."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Final

from bt_dualarm.diagnosis.evidence import (
    INVERTERS,
    Cause,
    Evidence,
    RootCause,
    chain_of,
    descend,
    failures,
    second_before,
    waiting,
)
from bt_dualarm.diagnosis.injected_faults import injected_causes
from bt_dualarm.diagnosis.joint_causes import joint_causes
from bt_dualarm.diagnosis.motion_causes import (
    contact_causes,
    coordination_causes,
    held_still_causes,
    reach_causes,
    time_causes,
)
from bt_dualarm.diagnosis.object_causes import (
    blackboard_causes,
    camera_causes,
    grip_causes,
    knock_causes,
    sight_causes,
    world_causes,
)
from bt_dualarm.replay.record import Facts, Record, ReplayError
from bt_dualarm.replay.timeline import Change, Timeline, TimelineNode
from bt_dualarm.runtime.outcome import Ending
from bt_dualarm.spec.node_types import escaped

_RULES: Final[tuple[Callable[[Evidence], Iterator[Cause]], ...]] = (
    injected_causes,
    coordination_causes,
    held_still_causes,
    blackboard_causes,
    world_causes,
    joint_causes,
    knock_causes,
    grip_causes,
    contact_causes,
    camera_causes,
    sight_causes,
    reach_causes,
    time_causes,
)


def _partner_causes(e: Evidence) -> Iterator[Cause]:
    """Yields the cause of each other arm's failure that ended what the arms did together."""
    if e.code != "PARTNER_GONE":
        return
    for other, root in e.timeline.roots.items():
        if other == e.arm or f"{other} " not in e.reason:
            continue
        failed = root.last("FAILURE")
        if failed is not None and failed.time <= e.ended:
            deciding = descend(root, failed)
        else:  # the tree may go on: it tries again, or does something else
            ends = [
                (change.index, leaf, change)
                for leaf in root.walk()
                for change in leaf.changes
                if not leaf.children and change.new == "FAILURE" and leaf.path in e.reason
                if e.began <= change.time <= e.ended + 1e-9
            ]
            if not ends:
                continue
            _, leaf, end = max(ends, key=lambda found: found[0])
            deciding = RootCause(chain_of(root, leaf), end)
        if deciding.end is None or deciding.end.code == "PARTNER_GONE":
            continue
        first = causes_of(Evidence(e.record, e.timeline, deciding))[0]
        path = deciding.leaf.path
        what = f"{other} had failed at {deciding.end.time:.2f} s, at {path!r}: {first.sentence}"
        if e.reason.startswith("waits "):
            what = f"{e.arm} {e.reason.partition(f': {other} ')[0]}: {what}"
        yield replace(first, sentence=what, leaf=first.leaf or path)


_DATA_ERRORS: Final = (LookupError, TypeError, ValueError, AttributeError, ArithmeticError)
"""Errors that Python raises when data do not have the structure that a rule expects."""


def causes_of(e: Evidence) -> tuple[Cause, ...]:
    """Causes of the end of a leaf, the most significant first; at least its own reason."""
    if e.root_cause.end is not None and e.root_cause.end.new == "SUCCESS":
        return (e.cause("SUCCESS", f"{e.leaf.path!r} succeeded{_inverted(e)}"),)
    found: list[Cause] = []
    unreadable: list[Cause] = []
    for rule in (_partner_causes, *_RULES):
        try:
            causes = [*rule(e)]
        except _DATA_ERRORS as error:
            # Ports, metrics and values of keys depend on the skill, which may be unavailable: an
            # untrusted record may contain any JSON.
            what = f"the record of {e.leaf.path!r} does not fit a {e.leaf.kind}"
            sentence = f"{what}: {type(error).__name__}: {str(error)[:200]}"
            unreadable.append(e.cause("UNREADABLE", sentence, leaf=e.leaf.path))
            continue
        for cause in causes:
            if all((cause.kind, cause.sentence) != (known.kind, known.sentence) for known in found):
                found.append(cause)
    return (*(found or (_own_reason(e),)), *unreadable[:1])


def _inverted(e: Evidence) -> str:
    """Clause on the node that failed because the leaf succeeded; empty if none did."""
    for node in reversed(e.root_cause.chain):
        if node.kind in INVERTERS and node.status_at(e.ended) == "FAILURE":
            return f", and {node.path!r} inverts that"
    return ""


def _own_reason(e: Evidence) -> Cause:
    """Cause that the leaf itself reports."""
    if e.leaf.kind == "fail":
        sentence = f"the tree failed on purpose ({e.leaf.place}): {e.reason}"
        return e.cause("SAID_SO", sentence, leaf=e.leaf.path)
    if e.code == "BUSY":
        owner = str(e.numbers.get("owner", ""))
        sentence = f"{e.leaf.path!r} tried to move {e.arm} while {owner!r} was moving it"
        return e.cause("BUSY", sentence, "run them in a sequence", leaf=owner)
    if e.code == "EXCEPTION":
        sentence = f"the code of {e.leaf.kind} has a bug: {e.reason} (see run.log)"
        return e.cause("FAULT", sentence, leaf=e.leaf.path)
    if e.leaf.kind == "force_failure":
        sentence = f"{e.leaf.path!r} ({e.leaf.place}) fails whatever the result of its child"
        return e.cause("SAID_SO", sentence, leaf=e.leaf.path)
    if not e.code and e.root_cause.end is not None:
        return e.cause("FAILED", f"{e.leaf.path!r} failed, though none of its children did")
    if not e.code:
        return e.cause("RUNNING", f"{e.leaf.path!r} was running, and nothing blocked it")
    return e.cause(e.code, e.reason or f"{e.leaf.path!r} ended with {e.code}")


_RECENT_S = 1.0
"""Seconds for which a failure before the requested time is reported with the running leaves."""


@dataclass(frozen=True)
class Story:
    """Why one leaf failed, or was still running.

    Attributes:
        arm: Name of the arm.
        leaf: Path of the leaf.
        kind: Node type of the leaf.
        place: File and line of the leaf.
        status: ``FAILURE``, ``HALTED`` or ``RUNNING``; ``SUCCESS`` for a leaf requested by name.
        code: Code of its failure, or empty.
        reason: Sentence of its failure, or empty.
        numbers: Metrics at its end.
        began_s: Start of this run of it in s.
        ended_s: Its end in s; None while it ran.
        at_s: Time in s of the diagnosis: its end, the requested time, or the record's end.
        chain: Nodes from the root down: path, node type, location, status at that time.
        ports: Ports with their resolved values.
        keys: Blackboard keys behind its ports: value, writer and time.
        before: Sentences on the arm and its camera in the second before.
        causes: Causes, the most significant first.
        others: Leaves that had failed before it without deciding the failure.
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
        """The diagnosis as JSON-ready data."""
        return {**vars(self), "causes": [vars(cause) for cause in self.causes]}


def stories(record: Record, asked: str | None = None) -> tuple[Story, ...]:
    """Diagnoses of why a run failed, or what it waited for; the earliest failure first.

    Args:
        record: The record.
        asked: Name or path of a leaf, or a time in s; None for the failures of the run.

    Returns:
        Empty if no leaf failed and none was running.

    Raises:
        ReplayError: No node has this name, or the time is outside the record.
    """
    timeline = Timeline(record)
    found = _root_causes(record, timeline, asked)
    return tuple(_story_of(Evidence(record, timeline, each)) for each in found)


def _root_causes(record: Record, timeline: Timeline, asked: str | None) -> list[RootCause]:
    if asked is None:
        return [*failures(timeline), *waiting(timeline)]
    time = _as_time(asked)
    if time is None:
        return [_of_node(timeline, node) for node in _named_nodes(timeline, asked)]
    record.index_at(time)
    failed = [
        (node, end)
        for node in timeline.nodes()
        for end in node.changes
        if end.new == "FAILURE" and end.time <= time + 1e-9
    ]
    # A node that runs while none of its children does waits itself: a claim, a pause of a retry.
    running = [
        RootCause(chain_of(timeline.roots[node.arm], node), None, at=time)
        for tree in timeline.roots.values()
        for node in tree.at_work(time)
    ]
    # Of those that failed in the latest tick, children did before their parents. A timeout or an
    # inverter fails without a leaf that does.
    latest = max((end.time for _, end in failed), default=-math.inf)
    nearest = [each for each in failed if each[1].time == latest]
    if nearest and (not running or time - latest <= _RECENT_S):
        node, end = min(nearest, key=lambda each: each[1].index)
        return [_of_end(timeline, node, end), *running]
    return running


def _as_time(asked: str) -> float | None:
    try:
        return float(asked.removesuffix("s").strip())
    except ValueError:
        return None


def _named_nodes(timeline: Timeline, name: str) -> list[TimelineNode]:
    """Nodes with a name that have run; only the failed ones if there are any.

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


def _of_node(timeline: Timeline, node: TimelineNode) -> RootCause:
    root = timeline.roots[node.arm]
    # A node that has ended is reset before it starts again, and when a halt reaches it.
    ends = [change for change in node.changes if change.new != "INVALID" or change.old == "RUNNING"]
    end = node.last("FAILURE") or ends[-1]
    removal = timeline.removal(node.arm)
    if removal is not None and end.new == "INVALID" and end.time == root.changes[-1].time:
        return RootCause(chain_of(root, node), None, at=removal[1].time)
    return _of_end(timeline, node, end)


def _of_end(timeline: Timeline, node: TimelineNode, end: Change) -> RootCause:
    """The leaf that decided a change of a node's status, and how it ended."""
    above = chain_of(timeline.roots[node.arm], node)
    if node.children and end.new == "FAILURE":
        below = descend(node, end)
        return RootCause((*above[:-1], *below.chain), below.end, below.others)
    return RootCause(above, None if end.new == "RUNNING" else end)


def _story_of(e: Evidence) -> Story:
    end = e.root_cause.end
    status = "RUNNING" if end is None else "HALTED" if end.new == "INVALID" else end.new
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
        chain=tuple(_link(node, e) for node in e.root_cause.chain),
        ports=e.ports,
        keys=tuple(e.keys),
        before=tuple(second_before(e)),
        causes=causes_of(e),
        others=tuple(f"{node.arm}:{node.path}" for node in e.root_cause.others),
    )


def _link(node: TimelineNode, e: Evidence) -> Facts:
    return {
        "path": node.path,
        "kind": node.kind,
        "place": node.place,
        "status": node.status_at(e.ended),
    }


_MOST_NUMBERS = 12


def story_text(story: Story) -> str:
    """A diagnosis as text of several lines; line breaks in texts of the record are escaped."""
    return "\n".join(escaped(line, keep="") for line in _lines(story))


def _lines(story: Story) -> Iterator[str]:
    when = f"{story.status} at {story.at_s:.2f} s"
    if story.ended_s is None:
        when = f"ran at {story.at_s:.2f} s, for {story.at_s - story.began_s:.2f} s"
    code = f" {story.code}" if story.code and story.code != story.status else ""
    yield f"{story.arm}: {story.leaf} ({story.place}) {when}{code}"
    for number, cause in enumerate(story.causes):
        mark = "why" if number == 0 else "also"
        yield f"  {mark}: {cause.sentence}"
        if cause.remedy:
            yield f"       to change: {cause.remedy}"
    if story.reason and all(story.reason not in cause.sentence for cause in story.causes):
        yield f"  reason: {story.reason}"
    yield "  chain:"
    for depth, link in enumerate(story.chain):
        name = str(link["path"]).rpartition("/")[2]
        kind = "" if link["kind"] == name else f" [{link['kind']}]"
        yield f"    {'  ' * depth}{name}{kind} {link['status']}"
    yield from _values("ports", story.ports)
    for key in story.keys:
        writer = "no leaf" if key["leaf"] is None else f"{key['leaf']} at {key['time_s']:.2f} s"
        yield f"  key {key['key']} = {_short(key['value'])}, written by {writer}"
    yield from _values("numbers", dict([*story.numbers.items()][:_MOST_NUMBERS]))
    if story.before:
        yield "  in the second before:"
        yield from (f"    {sentence}" for sentence in story.before)
    for other in story.others:
        yield f"  failed earlier, not decisive: {other}"


def _values(title: str, values: Facts) -> Iterator[str]:
    if values:
        yield f"  {title}:"
        yield from (f"    {name}: {_short(value)}" for name, value in values.items())


def _short(value: object) -> str:
    if isinstance(value, float):
        return f"{value:.6g}"
    text = value if isinstance(value, str) else json.dumps(value)
    return text if len(text) <= 100 else f"{text[:97]}..."


def goals_missed(record: Record) -> tuple[str, ...]:
    """A line on each goal of the file that was not met, and on a violated invariant."""
    summary = record.summary or {}
    goals = summary.get("goals")
    lines = []
    if summary.get("ending") == Ending.INVARIANT:
        lines.append(f"invariant: {summary.get('error')}")
    for name, goal in goals.items() if isinstance(goals, dict) else ():
        if isinstance(goal, dict) and not goal.get("met"):
            lines.append(f"goal {name} was not met: {goal.get('reason')}")
    return tuple(escaped(" ".join(line.split()), keep="")[:500] for line in lines)


def state_of(record: Record) -> str:
    """One line on the run of a record, and whether the record is complete."""
    line = f"{record.name}, seed {record.start['seed']}, {record.until:.2f} s"
    if record.summary is None:
        line += "; the run was interrupted"
    if record.torn:
        line += f"; of its history {record.torn}"
    return line
