"""Evidence on one failed leaf: everything that causes are derived from."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Final

import numpy as np

from bt_dualarm.replay.record import Facts, Record
from bt_dualarm.replay.timeline import Change, Scene, Timeline, TimelineNode
from bt_dualarm.spec.cell import CLAIM
from bt_dualarm.spec.expressions import keys_in
from bt_dualarm.spec.node_types import REFERENCE, counted


@dataclass(frozen=True, eq=False)
class RootCause:
    """The leaf that decided a failure, or another leaf to be diagnosed.

    Attributes:
        chain: Nodes from the root to the leaf.
        end: Change that ended the leaf; None while it runs.
        others: Leaves that failed before it, in a node that continues with its next child.
        at: Requested time in s before the end of the leaf; None for its end.
    """

    chain: tuple[TimelineNode, ...]
    end: Change | None
    others: tuple[TimelineNode, ...] = ()
    at: float | None = None

    @property
    def leaf(self) -> TimelineNode:
        """The leaf itself."""
        return self.chain[-1]

    @property
    def time(self) -> float:
        """Time of its end in s, or the requested time, or infinity while it runs."""
        if self.end is not None:
            return self.end.time
        return float("inf") if self.at is None else self.at


def failures(timeline: Timeline) -> list[RootCause]:
    """The deciding leaf of each tree that failed, the earliest first."""
    found = []
    for root in timeline.roots.values():
        end = root.last("FAILURE")
        if end is not None:
            found.append(descend(root, end))
    return sorted(found, key=lambda root_cause: root_cause.time)


def waiting(timeline: Timeline) -> list[RootCause]:
    """Leaves that were running when the run ended, of trees that had not ended.

    For a tree whose record ends at the failure of a leaf, that leaf; for an arm that was removed
    before, the leaf running then, or its first leaf if it had not begun.
    """
    found = []
    for root in timeline.roots.values():
        if root.last("SUCCESS", "FAILURE") is not None:
            continue
        removal = timeline.removal(root.arm)
        if removal is not None:
            if not timeline.may_be_removed(root.arm):
                running = root.leaves_at(removal[1].time, "RUNNING")
                leaf = running[0] if running else next(n for n in root.walk() if not n.children)
                found.append(RootCause(chain_of(root, leaf), None, at=removal[1].time))
            continue
        for leaf in filter(_is_at_work, root.walk()):
            last = leaf.changes[-1] if leaf.changes else None
            was_halted = last is not None and (last.code == "HALTED" or _was_halted(last))
            if last is not None and (last.new == "RUNNING" or was_halted):
                end = None if last.new == "RUNNING" else last
                found.append(RootCause(chain_of(root, leaf), end))
            elif last is not None and last.new == "FAILURE" and last.index == _latest(root):
                found.append(RootCause(chain_of(root, leaf), last))
    return found


def _is_at_work(node: TimelineNode) -> bool:
    """Whether a node is a leaf, or waits without any of its children having begun."""
    begun = any(child.changes for child in node.children)
    return not node.children or (node.kind == CLAIM and bool(node.changes) and not begun)


def _latest(root: TimelineNode) -> int:
    """Index of the last change in a tree."""
    return max(change.index for node in root.walk() for change in node.changes)


def descend(root: TimelineNode, end: Change) -> RootCause:
    """The leaf that decided the failure of a node, searched from the node down.

    Args:
        root: Node that failed, or that succeeded below an inverter.
        end: Change to that status.
    """
    chain = [root]
    others = []
    node = root
    while node.children:
        began = node.begun(end)
        child, change, failed_before = _deciding(node, began, end)
        if child is None or change is None:
            break
        others += failed_before
        chain.append(child)
        node = child
        end = change
    return RootCause(tuple(chain), end, tuple(others))


INVERTERS: Final = ("inverter", "not")
"""Node types that fail when their child succeeds."""


def chain_of(root: TimelineNode, leaf: TimelineNode) -> tuple[TimelineNode, ...]:
    """Nodes from the root to a leaf."""
    return tuple(
        node
        for node in root.walk()
        if leaf.path == node.path or leaf.path.startswith(f"{node.path}/")
    )


def _deciding(
    node: TimelineNode, began: Change, end: Change
) -> tuple[TimelineNode | None, Change | None, list[TimelineNode]]:
    """The deciding child, its change, and the leaves of other failed children."""
    # An inverter fails because its child succeeds, and that because one of its own does.
    succeeds = (end.new == "SUCCESS") != (node.kind in INVERTERS)
    blamed = "SUCCESS" if succeeds else "FAILURE"
    ended = []
    # A cleanup is halted in the tick in which it begins, after what it cleans up.
    children = node.children[:1] if node.kind == "on_halt" else node.children
    for child in children:
        changes = [
            change
            for change in child.changes
            if _is_within(change, began, end) and (change.new == blamed or _was_halted(change))
        ]
        if changes:
            ended.append((child, changes[-1]))
    if not ended:
        return None, None, []
    failed = [(child, change) for child, change in ended if change.new == blamed]
    ended = sorted(failed or ended, key=lambda pair: pair[1].index)
    leaves = [descend(other, its_end).leaf for other, its_end in ended]
    # A `fail` leaf only reports what has failed before it, however deep it is in a branch.
    deciding = [i for i, leaf in enumerate(leaves) if leaf.kind != "fail"]
    last = deciding[-1] if deciding else len(ended) - 1
    child, change = ended[last]
    return child, change, [leaf for i, leaf in enumerate(leaves) if i != last]


def _was_halted(change: Change) -> bool:
    return change.old == "RUNNING" and change.new == "INVALID"


def _is_within(change: Change, began: Change, end: Change) -> bool:
    """Whether a change belongs to a run; children change their status before their parents."""
    return began.time <= change.time <= end.time


LOOK_BACK_S: Final = 1.0
"""Seconds before the end of a leaf that are reported."""

COMPARING_LEAVES: Final = ("compare", "test")
"""Node types that judge keys, which what ran before has written."""

_MOST_SCENES: Final = 64
"""Scenes cached for rules that use the same times."""

_WITH_UNIT: Final = re.compile(r"_(m|mm|rad|deg|n|nm|kg|s|hz|px|px2|share|rad_s|m_s)$")
"""Unit suffix of a metric's name, as in `bt_dualarm.core.errors.Failure`."""


@dataclass(frozen=True)
class Cause:
    """Why a leaf failed, as far as the record shows.

    Attributes:
        kind: Upper-case identifier of the type of cause.
        sentence: Description with numbers.
        remedy: Suggested change, if known, otherwise empty.
        arm: Affected arm.
        leaf: Path of the leaf that caused it; empty if none did.
        time_s: Time of the cause in s; None if it existed from the start.
    """

    kind: str
    sentence: str
    remedy: str = ""
    arm: str = ""
    leaf: str = ""
    time_s: float | None = None


@dataclass(frozen=True, eq=False)
class Evidence:
    """Recorded data on one run of one leaf, from which causes are derived.

    Attributes:
        record: The record.
        timeline: Its trees.
        root_cause: The leaf, and how it ended.
    """

    record: Record
    timeline: Timeline
    root_cause: RootCause

    @property
    def leaf(self) -> TimelineNode:
        """The leaf itself."""
        return self.root_cause.leaf

    @property
    def arm(self) -> str:
        """Name of the arm."""
        return self.leaf.arm

    @property
    def robot(self) -> str:
        """Name of its robot, or path of its description."""
        return str(self.record.arms[self.arm]["robot"])

    @property
    def code(self) -> str:
        """Code of its end; empty while it runs."""
        return "" if self.root_cause.end is None else self.root_cause.end.code

    @property
    def reason(self) -> str:
        """Sentence of its end."""
        return "" if self.root_cause.end is None else self.root_cause.end.reason

    @property
    def numbers(self) -> Mapping[str, Any]:  # numbers and names, as JSON has them
        """Metrics and numbers of its failure; a value whose name has a unit is always a number."""
        if self.root_cause.end is None:
            return {}
        return {
            name: value
            for name, value in self.root_cause.end.metrics.items()
            if not _WITH_UNIT.search(name)
            or (isinstance(value, float | int) and not isinstance(value, bool))
        }

    @property
    def ended(self) -> float:
        """Time of its end, or of the record's end, in s."""
        return min(self.root_cause.time, self.record.until)

    @property
    def around(self) -> float:
        """Time in s at which to look at what other arms did when it ended.

        The end of a run halts all leaves in one tick, and so may a timeout: the moment before.
        """
        end = self.root_cause.end  # a halted node with children has no code
        return self.ended - 1e-6 if end is not None and _was_halted(end) else self.ended

    @cached_property
    def began(self) -> float:
        """Time at which this run of it began, in s."""
        end = self.root_cause.end
        if end is not None:
            return self.leaf.begun(end).time
        until = self.ended + 1e-9
        running = [each for each in self.leaf.changes if each.new == "RUNNING"]
        return max((each.time for each in running if each.time <= until), default=0.0)

    @cached_property
    def ports(self) -> Facts:
        """Ports with their resolved values, or as in the file if it never began."""
        for note in reversed(self.notes("ports", until=self.ended)):
            if note["leaf"] == self.leaf.path:
                return dict(note["ports"])
        return dict(self.leaf.ports)

    @cached_property
    def keys(self) -> list[Facts]:
        """Keys that its ports refer to: key, port, value, writer, time; None if unwritten."""
        found = []
        for port, value in self.leaf.ports.items():
            # A text may also be a message, in which keys need not form an expression.
            keys = REFERENCE.findall(value) if isinstance(value, str) else keys_in(value)
            for key in dict.fromkeys(keys):
                written = [
                    note
                    for note in self.notes("wrote", until=self.ended)
                    if note["key"] == key and self._came_before(note)
                ]
                last = written[-1] if written else {"value": None, "leaf": None, "time_s": None}
                found.append({"key": key, "port": port, **_only(last, "value", "leaf", "time_s")})
        return found

    def _came_before(self, note: Facts) -> bool:
        """Whether a leaf had written a key before this one ended, not later in the same tick."""
        end = self.root_cause.end
        if end is None or note["time_s"] < end.time:
            return True
        return all(
            change.index < end.index
            for node in self.timeline.roots[self.arm].walk()
            if node.path == note["leaf"]
            for change in node.changes
            if change.time == end.time
        )

    @property
    def decided_before(self) -> Evidence | None:
        """The leaf that ended last before this one began, if it failed: it may end a loop."""
        own_end = self.root_cause.end
        if own_end is None:
            return None
        began = self.leaf.begun(own_end).index
        ends = [
            (change.index, leaf, change)
            for leaf in self.timeline.leaves()
            if leaf.arm == self.arm
            for change in leaf.changes
            if change.new in ("SUCCESS", "FAILURE") and change.index < began
        ]
        if not ends:
            return None
        _, leaf, end = max(ends, key=lambda found: found[0])
        if end.new == "SUCCESS":
            return None
        chain = chain_of(self.timeline.roots[self.arm], leaf)
        return Evidence(self.record, self.timeline, RootCause(chain, end))

    def notes(self, kind: str, *, since: float = 0.0, until: float | None = None) -> list[Facts]:
        """Trace events of its arm of one kind between two times in s, in order."""
        end = self.record.until + 1.0 if until is None else until
        return [
            note
            for note in self.record.notes
            if note["kind"] == kind and note["arm"] == self.arm and since <= note["time_s"] <= end
        ]

    def scene(self, time: float) -> Scene:
        """The world at a time in s."""
        when = round(time, 3)
        scenes = self.timeline.scenes
        if when not in scenes:
            while len(scenes) >= _MOST_SCENES:
                del scenes[next(iter(scenes))]
            scenes[when] = Scene(self.record, when)
        return scenes[when]

    def moments(self, count: int = 12, since: float | None = None) -> Iterator[Scene]:
        """The world at evenly spaced times of its run, the last one first.

        Args:
            count: Number of times.
            since: First time in s; by default its start.
        """
        first = self.began if since is None else max(since, 0.0)
        span = max(self.ended - first, 0.0)
        for number in range(count):
            yield self.scene(self.ended - span * number / count)

    def moments_before(self, count: int) -> Iterator[Scene]:
        """The world at evenly spaced times before its start, the last one first."""
        for number in range(1, count + 1):
            yield self.scene(self.began * (1.0 - number / count))

    def cause(
        self,
        kind: str,
        sentence: str,
        remedy: str = "",
        *,
        leaf: str = "",
        time_s: float | None = None,
    ) -> Cause:
        """Cause for the arm of this evidence."""
        return Cause(kind, sentence, remedy, self.arm, leaf, time_s)

    def clearance(self, other: str) -> str:
        """What to change about a body in the path; a part of the scene cannot be moved."""
        name = other.partition("/")[0]
        if name in self.record.start["objects"] or name in self.record.arms:
            return f"move {name} away, or take another path"
        return f"take a path farther from {name}"


def _only(facts: Facts, *names: str) -> Facts:
    return {name: facts[name] for name in names}


def second_before(e: Evidence) -> Iterator[str]:
    """Yields sentences on arm, guard, camera and contacts in the second before the leaf ended."""
    since = max(e.ended - LOOK_BACK_S, 0.0)
    yield from _arm(e, since)
    yield from _guard(e)
    yield from _camera(e, since)
    touched = {touch.other for scene in e.moments(10, since) for touch in scene.touches(e.arm)}
    if touched:
        yield f"it touched {', '.join(sorted(touched))}"


def _arm(e: Evidence, since: float) -> Iterator[str]:
    record = e.record
    first = record.index_at(since)
    last = record.index_at(e.ended)
    rows = [row for index in range(first, last + 1) if (row := record.arm_row(e.arm, index))]
    tools = [e.scene(time).tool(e.arm) for time in (since, e.ended)]
    if not rows or tools[0] is None or tools[1] is None:
        yield f"{e.arm} was not in the world"
        return
    speed = np.degrees(max(float(np.abs(row[1]).max()) for row in rows))
    torque = max(float(np.abs(row[3]).max()) for row in rows)
    moved = 1e3 * float(np.linalg.norm(tools[1] - tools[0]))
    position = ", ".join(f"{x:.3f}" for x in tools[1])
    yield (
        f"the tool moved by {moved:.0f} mm, to ({position}) m; "
        f"set-points moved at up to {speed:.0f}°/s, motors applied up to {torque:.0f} N m"
    )


def _guard(e: Evidence) -> Iterator[str]:
    for note in e.notes("guard", since=e.began, until=e.ended + 0.05)[-3:]:
        yield f"at {note['time_s']:.2f} s its guard {note['does']} it: {note['reason']}"


def _camera(e: Evidence, since: float) -> Iterator[str]:
    frames = e.notes("frame", since=since, until=e.ended)
    looks = e.notes("look", since=since, until=e.ended)
    if not frames:
        return
    seen = [look for look in looks if look["pixel"]]
    sentence = (
        f"its camera took {counted(len(frames), 'image')}; the target was detected in {len(seen)}"
    )
    if seen:
        (x, y) = seen[-1]["pixel"]
        area = seen[-1]["area_px"]
        sentence += f", last at {seen[-1]['stamp']:.2f} s, pixel ({x:.0f}, {y:.0f}), {area:.0f} px²"
    yield sentence
