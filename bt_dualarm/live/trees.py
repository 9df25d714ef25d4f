"""Trees as a page shows them: rows with depth and path, from a run or from a record."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping

from bt_dualarm.replay.timeline import Change, Node
from bt_dualarm.spec.source import Json
from bt_dualarm.tree.report import NodeView


def rows_of(root: NodeView | None) -> list[Json]:
    """Rows of a tree as it stands; none of an arm that is not in the world."""
    return [] if root is None else [*_now(root, root.name, 0)]


def rows_at(root: Node, time: float) -> list[Json]:
    """Rows of a tree as it stood at a time in s."""
    return [*_then(root, root.standing_at(time), 0)]


def _now(node: NodeView, path: str, depth: int) -> Iterator[Json]:
    yield _row(
        path,
        depth,
        node.kind,
        status=node.status,
        halted=node.halted,
        since=round(node.since, 3),
        progress=node.progress,
        reason=node.reason,
    )
    seen: Counter[str] = Counter()
    for child in node.children:
        seen[child.name] += 1
        count = seen[child.name]
        shown = child.name if count == 1 else f"{child.name}#{count}"
        yield from _now(child, f"{path}/{shown}", depth + 1)


def _then(node: Node, standing: Mapping[str, Change], depth: int) -> Iterator[Json]:
    change = standing.get(node.path)
    failed = change is not None and change.new == "FAILURE" and change.code
    yield _row(
        node.path,
        depth,
        node.kind,
        status="INVALID" if change is None else change.new,
        halted=change is not None and change.new == "INVALID" and change.old == "RUNNING",
        since=0.0 if change is None else round(change.time, 3),
        progress=None,
        reason=f"{change.code}: {change.reason}" if change is not None and failed else "",
    )
    for child in node.children:
        yield from _then(child, standing, depth + 1)


def _row(path: str, depth: int, kind: str, **fields: object) -> Json:
    name = path.rpartition("/")[2]
    return {"path": path, "depth": depth, "name": name, "kind": kind, **fields}
