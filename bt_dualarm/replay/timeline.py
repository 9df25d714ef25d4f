"""The trees of a record with all that happened in them: which node took which status, and when."""

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
    """A node took another status.

    Attributes:
        index: Number of the change among all of the run.
        time: Simulated time in s.
        new: Status from then on.
        old: Status until then.
        code: Code of a failure, ``HALTED``, or empty.
        reason: Sentence of a failure, or empty.
        metrics: Numbers that a leaf had measured by its end.
    """

    index: int
    time: float
    new: str
    old: str
    code: str
    reason: str
    metrics: Mapping[str, object]


_HALTED: Final = ("RUNNING", "INVALID")
"""Statuses before and after a node is halted."""


def _is_wiped_out(change: Change, halt: Change) -> bool:
    """Whether a node that had ended lost its status with that halt of its tree."""
    ended = change.old in ("SUCCESS", "FAILURE") and change.new == "INVALID"
    return ended and change.time == halt.time and change.index < halt.index


@dataclass(frozen=True, eq=False)
class Node:
    """A node of a tree as the file has it, and its changes.

    Attributes:
        arm: Name of the arm whose tree it is.
        path: Names from the root down.
        kind: A word of the language, or a skill's name.
        ports: What the file gives it.
        place: File and line.
        children: Nodes below it.
        changes: What became of it, in order.
    """

    arm: str
    path: str
    kind: str
    ports: Mapping[str, object]
    place: str
    children: tuple[Node, ...]
    changes: list[Change] = field(default_factory=list)

    def walk(self) -> Iterator[Node]:
        """This node, then those below it."""
        yield self
        for child in self.children:
            yield from child.walk()

    def standing_at(self, time: float) -> Mapping[str, Change]:
        """Last change of each node of this tree until a time in s, by path, as displays show it.

        A tree that was halted as a whole shows what it had achieved until then: halting wipes out
        what had ended, too, and only what was running is marked as halted. To be asked of a root.
        """
        last = self._last_until(time)
        halt = last if last is not None and (last.old, last.new) == _HALTED else None
        found: dict[str, Change] = {}
        for node in self.walk():
            changes = [change for change in node.changes if change.time <= time + 1e-9]
            if halt is not None and changes and _is_wiped_out(changes[-1], halt):
                changes.pop()
            if changes:
                found[node.path] = changes[-1]
        return found

    def _last_until(self, time: float) -> Change | None:
        found = [change for change in self.changes if change.time <= time + 1e-9]
        return found[-1] if found else None

    def leaves_at(self, time: float, status: str) -> list[Node]:
        """Leaves below it that had this status at a time in s."""
        leaves = (node for node in self.walk() if not node.children)
        return [leaf for leaf in leaves if leaf.status_at(time) == status]

    def last(self, *statuses: str, before: int | None = None) -> Change | None:
        """Its last change to one of some statuses, before the change of that number."""
        found = [
            change
            for change in self.changes
            if change.new in statuses and (before is None or change.index < before)
        ]
        return found[-1] if found else None

    def begun(self, end: Change) -> Change:
        """The change with which the run began that this one ended."""
        began = self.last("RUNNING", before=end.index) if end.old == "RUNNING" else None
        return began or end

    def status_at(self, time: float) -> str:
        """Status after all that happened until then."""
        until = [change for change in self.changes if change.time <= time + 1e-9]
        return until[-1].new if until else "INVALID"


class Timeline:
    """All trees of a record.

    Args:
        record: The record.
        time: Simulated time in s whose trees are meant, where the file was edited while the run
            went on; by default its end.

    Attributes:
        roots: Root of each arm's tree, by the arm's name.
        scenes: The world at some times, kept by whoever looks for causes.
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
        """Whether a run succeeds although this arm was taken away before its tree had ended."""
        return arm in self._removable

    def removal(self, name: str) -> tuple[Node, Change] | None:
        """The leaf that took an arm or an object away last, and when; None if none did."""
        found = self.ended("remove", name)
        back = self.ended("spawn", name)
        if not found or (back and back[-1][1].index > found[-1][1].index):
            return None
        return found[-1]

    def ended(self, kind: str, name: str, arm: str | None = None) -> list[tuple[Node, Change]]:
        """Leaves of a kind that succeeded with an object or arm, in the order of their ends.

        Args:
            kind: Kind of the leaves.
            name: Name that one of their ports has, as the file writes it or by a parameter.
            arm: Arm whose leaves are meant; None for all.
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

    def nodes(self) -> Iterator[Node]:
        """Every node, arm by arm."""
        return iter(self._nodes.values())

    def leaves(self) -> Iterator[Node]:
        """Every node without children."""
        return (node for node in self._nodes.values() if not node.children)

    def named(self, name: str) -> list[Node]:
        """Nodes of a name: the end of a path, with the arm's name and a colon before it or not.

        Raises:
            ReplayError: There is none; names the nearest.
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


def node_of(arm: str, said: Facts, path: str) -> Node:
    """A node with those below it; names of siblings are told apart as in the events.

    Args:
        arm: Name of the arm.
        said: Facts of the node, as the record has them.
        path: Path of the node.
    """
    seen: Counter[str] = Counter()
    children = []
    for child in said["children"]:
        name = str(child["name"])
        seen[name] += 1
        shown = name if seen[name] == 1 else f"{name}#{seen[name]}"
        children.append(node_of(arm, child, f"{path}/{shown}"))
    return Node(arm, path, said["kind"], said["ports"], said["place"], tuple(children))
