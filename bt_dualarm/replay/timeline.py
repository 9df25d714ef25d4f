"""Timeline of a record: its trees with the status changes of every node."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Final

from bt_dualarm.replay.record import Facts, Record, ReplayError
from bt_dualarm.replay.scene import Scene
from bt_dualarm.spec.problems import suggestion


@dataclass(frozen=True)
class Change:
    """A status change of a node.

    Attributes:
        index: Index of the change among all changes of the run.
        time: Simulated time in s.
        new: Status after the change.
        old: Status before the change.
        code: Code of a failure, ``HALTED``, or empty.
        reason: Sentence of a failure, or empty.
        metrics: Metrics of a leaf that has ended.
    """

    index: int
    time: float
    new: str
    old: str
    code: str
    reason: str
    metrics: Mapping[str, object]


_HALTED: Final = ("RUNNING", "INVALID")
"""Statuses before and after a halt."""


def _is_reset(change: Change, halt: Change) -> bool:
    """Whether a node that had ended was reset by a halt of its tree."""
    ended = change.old in ("SUCCESS", "FAILURE") and change.new == "INVALID"
    return ended and change.time == halt.time and change.index < halt.index


@dataclass(frozen=True, eq=False)
class TimelineNode:
    """A node of a tree with its status changes.

    Attributes:
        arm: Name of the arm whose tree it is.
        path: Names from the root down.
        kind: Node type: a control node, decorator or skill.
        ports: Ports given in the file.
        place: File and line.
        children: Nodes below it.
        changes: Its status changes, in order.
    """

    arm: str
    path: str
    kind: str
    ports: Mapping[str, object]
    place: str
    children: tuple[TimelineNode, ...]
    changes: list[Change] = field(default_factory=list)

    def walk(self) -> Iterator[TimelineNode]:
        """This node, then its descendants."""
        yield self
        for child in self.children:
            yield from child.walk()

    def standing_at(self, time: float) -> Mapping[str, Change]:
        """Last change of each node up to a time in s, by path, as in displays; for a root only.

        For a tree that was halted as a whole, changes of nodes that had already ended are skipped:
        the halt resets them too, but only running nodes count as halted.
        """
        last = self._last_until(time)
        halt = last if last is not None and (last.old, last.new) == _HALTED else None
        found: dict[str, Change] = {}
        for node in self.walk():
            changes = [change for change in node.changes if change.time <= time + 1e-9]
            if halt is not None and changes and _is_reset(changes[-1], halt):
                changes.pop()
            if changes:
                found[node.path] = changes[-1]
        return found

    def _last_until(self, time: float) -> Change | None:
        found = [change for change in self.changes if change.time <= time + 1e-9]
        return found[-1] if found else None

    def leaves_at(self, time: float, status: str) -> list[TimelineNode]:
        """Descendant leaves that had this status at a time in s."""
        leaves = (node for node in self.walk() if not node.children)
        return [leaf for leaf in leaves if leaf.status_at(time) == status]

    def last(self, *statuses: str, before: int | None = None) -> Change | None:
        """Its last change to one of the statuses, before the change with index ``before``."""
        found = [
            change
            for change in self.changes
            if change.new in statuses and (before is None or change.index < before)
        ]
        return found[-1] if found else None

    def begun(self, end: Change) -> Change:
        """The change that started the run that ``end`` ended."""
        began = self.last("RUNNING", before=end.index) if end.old == "RUNNING" else None
        return began or end

    def status_at(self, time: float) -> str:
        """Status at a time in s."""
        until = [change for change in self.changes if change.time <= time + 1e-9]
        return until[-1].new if until else "INVALID"


class Timeline:
    """All trees of a record.

    Args:
        record: The record.
        time: Simulated time in s whose trees are used if the file was edited during the run; by
            default the end.

    Attributes:
        roots: Root of each arm's tree, by the arm's name.
        scenes: Cache of the world at some times, for the diagnosis.
    """

    def __init__(self, record: Record, time: float | None = None) -> None:
        trees = {name: arm["tree"] for name, arm in record.arms.items()}
        for note in record.notes:
            if note["kind"] == "edited" and (time is None or note["time_s"] <= time + 1e-9):
                trees[note["arm"]] = note["tree"]
        self.scenes: dict[float, Scene] = {}
        self.roots = {name: node_of(name, tree, tree["name"]) for name, tree in trees.items()}
        self._nodes = {
            (node.arm, node.path): node for root in self.roots.values() for node in root.walk()
        }
        for index, event in enumerate(record.events):
            node = self._nodes.get((event["arm"], event["path"]))
            if node is not None:
                node.changes.append(_change(index, event))

        self._removable = {
            name for name, arm in record.arms.items() if arm.get("removable") is True
        }

    def may_be_removed(self, arm: str) -> bool:
        """Whether the file allows the removal of this arm before its tree has ended."""
        return arm in self._removable

    def removal(self, name: str) -> tuple[TimelineNode, Change] | None:
        """The leaf that removed an arm or object last, and its change; None if it is present."""
        removals = self.ended("remove", name)
        spawns = self.ended("spawn", name)
        if not removals or (spawns and spawns[-1][1].index > removals[-1][1].index):
            return None
        return removals[-1]

    def ended(
        self, kind: str, name: str, arm: str | None = None
    ) -> list[tuple[TimelineNode, Change]]:
        """Leaves of a node type that succeeded with an object or arm, in the order of their ends.

        Args:
            kind: Node type of the leaves.
            name: Name of the object or arm, a value of one of their ports.
            arm: Arm of the leaves; None for all.
        """
        found = [
            (node, change)
            for node in self.leaves()
            if node.kind == kind and name in map(str, node.ports.values())
            if arm in (None, node.arm)
            for change in node.changes
            if change.new == "SUCCESS"
        ]
        return sorted(found, key=lambda pair: pair[1].index)

    def nodes(self) -> Iterator[TimelineNode]:
        """Every node, arm by arm."""
        return iter(self._nodes.values())

    def leaves(self) -> Iterator[TimelineNode]:
        """Every node without children."""
        return (node for node in self._nodes.values() if not node.children)

    def named(self, name: str) -> list[TimelineNode]:
        """Nodes whose path ends with a name, optionally preceded by the arm's name and a colon.

        Raises:
            ReplayError: There is none; the message suggests the nearest.
        """
        arm, _, rest = name.partition(":")
        wanted = rest if arm in self.roots and rest else name
        found = [
            node
            for node in self._nodes.values()
            if (node.path == wanted or node.path.endswith(f"/{wanted}") or node.kind == wanted)
            and (wanted == name or node.arm == arm)
        ]
        if not found:
            names = {node.path.rpartition("/")[2] for node in self._nodes.values()}
            raise ReplayError(f"no node is called {name!r}; {suggestion(name, names, 'node')}")
        return found


def _change(index: int, event: Facts) -> Change:
    return Change(
        index,
        float(event["time_s"]),
        str(event["new"]),
        str(event["old"]),
        str(event["code"]),
        str(event["reason"]),
        dict(event["metrics"]),
    )


def node_of(arm: str, facts: Facts, path: str) -> TimelineNode:
    """A node with its descendants; equal names of siblings are numbered as in the events.

    Args:
        arm: Name of the arm.
        facts: Facts of the node in the record.
        path: Path of the node.
    """
    seen: Counter[str] = Counter()
    children = []
    for child in facts["children"]:
        name = str(child["name"])
        seen[name] += 1
        shown = name if seen[name] == 1 else f"{name}#{seen[name]}"
        children.append(node_of(arm, child, f"{path}/{shown}"))
    return TimelineNode(arm, path, facts["kind"], facts["ports"], facts["place"], tuple(children))
