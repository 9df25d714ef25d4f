"""Which leaf decided that a tree failed: from the root down, node by node."""

from __future__ import annotations

from dataclasses import dataclass

from bt_dualarm.replay.timeline import Change, Node, Timeline


@dataclass(frozen=True, eq=False)
class Verdict:
    """A leaf that is to be told about.

    Attributes:
        chain: Nodes from the root to the leaf.
        end: Change that ended the leaf; None while it runs.
        others: Leaves that failed before it, in a node that goes on to its next child.
        at: Time in s that was asked for, before the end of the leaf; None for its end.
    """

    chain: tuple[Node, ...]
    end: Change | None
    others: tuple[Node, ...] = ()
    at: float | None = None

    @property
    def leaf(self) -> Node:
        """The leaf itself."""
        return self.chain[-1]

    @property
    def time(self) -> float:
        """When it ended, or what was asked for, or infinity while it runs; in s."""
        if self.end is not None:
            return self.end.time
        return float("inf") if self.at is None else self.at


def failures(timeline: Timeline) -> list[Verdict]:
    """The deciding leaf of each tree that failed, the earliest first."""
    found = []
    for root in timeline.roots.values():
        end = root.last("FAILURE")
        if end is not None:
            found.append(descend(root, end))
    return sorted(found, key=lambda verdict: verdict.time)


def waiting(timeline: Timeline) -> list[Verdict]:
    """Leaves that were running when the run ended, of trees that had not ended.

    Of a tree whose record ends at the failure of a leaf, that leaf; of an arm that was taken away
    before, what it did then, or its root where it had not begun.
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
                found.append(Verdict(chain_of(root, leaf), None, at=removal[1].time))
            continue
        for leaf in (node for node in root.walk() if not node.children):
            last = leaf.changes[-1] if leaf.changes else None
            if last is not None and (last.new == "RUNNING" or last.code == "HALTED"):
                end = None if last.new == "RUNNING" else last
                found.append(Verdict(chain_of(root, leaf), end))
            elif last is not None and last.new == "FAILURE" and last.index == _latest(root):
                found.append(Verdict(chain_of(root, leaf), last))
    return found


def _latest(root: Node) -> int:
    """Number of the last change in a tree."""
    return max(change.index for node in root.walk() for change in node.changes)


def descend(root: Node, end: Change) -> Verdict:
    """The leaf that decided a failure of a node.

    Args:
        root: Node that failed, or that succeeded where that was not wanted.
        end: Change with which it did.
    """
    chain, others, node = [root], [], root
    while node.children:
        began = node.begun(end)
        child, change, failed_before = _deciding(node, began, end)
        if child is None or change is None:
            break
        others += failed_before
        chain.append(child)
        node, end = child, change
    return Verdict(tuple(chain), end, tuple(others))


def chain_of(root: Node, leaf: Node) -> tuple[Node, ...]:
    """Nodes from the root to a leaf."""
    return tuple(
        node
        for node in root.walk()
        if leaf.path == node.path or leaf.path.startswith(f"{node.path}/")
    )


def _deciding(
    node: Node, began: Change, end: Change
) -> tuple[Node | None, Change | None, list[Node]]:
    """The child that decided, its change, and leaves of those that had failed before."""
    blamed = "SUCCESS" if _wants_failure(node, end) else "FAILURE"
    ended = []
    for child in node.children:
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
    # A `fail`, however deep in a branch, is the author's last word on what has failed before it.
    blamed_ones = [i for i, leaf in enumerate(leaves) if leaf.kind != "fail"]
    last = blamed_ones[-1] if blamed_ones else len(ended) - 1
    child, change = ended[last]
    return child, change, [leaf for i, leaf in enumerate(leaves) if i != last]


def _wants_failure(node: Node, end: Change) -> bool:
    return node.kind == "inverter" and end.new == "FAILURE"


def _was_halted(change: Change) -> bool:
    return change.old == "RUNNING" and change.new == "INVALID"


def _is_within(change: Change, began: Change, end: Change) -> bool:
    """Whether it happened in that run; children change before their parents say so."""
    return began.time <= change.time <= end.time
