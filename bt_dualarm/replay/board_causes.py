"""Causes that lie on the blackboard: a key without value, a wrong value, a condition not met."""

from __future__ import annotations

from collections.abc import Iterator

from bt_dualarm.replay.evidence import Cause, Evidence
from bt_dualarm.replay.timeline import Node


def board_causes(e: Evidence) -> Iterator[Cause]:
    """What a key had, and who wrote it."""
    if e.code == "NO_VALUE":
        yield from _without_value(e)
    elif e.leaf.kind == "compare" and e.code in ("FALSE", "NOT_COMPARABLE"):
        yield _condition(e)


def _without_value(e: Evidence) -> Iterator[Cause]:
    for key in e.keys:
        if key["leaf"] is not None:
            continue
        writers = [node for node in e.timeline.leaves() if _writes(e, node, key["key"])]
        if writers:
            node = writers[0]
            when = "wrote it too late" if node.last("SUCCESS") else "had not run to its end yet"
            sentence = f"nobody had written {key['key']!r}: {node.path!r} ({node.place}) {when}"
            remedy = f"let {node.path!r} run before {e.leaf.path!r}"
            yield e.cause("NEVER_WRITTEN", sentence, remedy, leaf=node.path)
        else:
            sentence = f"nobody had written {key['key']!r}, and no leaf does"
            yield e.cause("NEVER_WRITTEN", sentence, f"set: {{key: {key['key']}, value: …}} before")
        return
    for key in e.keys:
        sentence = (
            f"{key['leaf']!r} had written {key['key']} = {key['value']!r} at "
            f"{key['time_s']:.2f} s, which port {key['port']!r} does not take: {e.reason}"
        )
        remedy = f"another value of {key['key']}"
        yield e.cause("WRONG_VALUE", sentence, remedy, leaf=key["leaf"], time_s=key["time_s"])


def _condition(e: Evidence) -> Cause:
    for key in e.keys:
        if key["leaf"] is not None:
            sentence = (
                f"{e.reason}: {key['leaf']!r} had written {key['key']} = {key['value']!r} at "
                f"{key['time_s']:.2f} s"
            )
            remedy = f"another value of {key['key']}"
            return e.cause("CONDITION", sentence, remedy, leaf=key["leaf"], time_s=key["time_s"])
    return e.cause("CONDITION", e.reason)


def _writes(e: Evidence, node: Node, key: str) -> bool:
    """Whether a leaf of that arm writes the key, by its port or by what it did later."""
    if node.arm != e.arm:
        return False
    did = any(note["leaf"] == node.path and note["key"] == key for note in e.notes("wrote"))
    return did or node.ports.get("key") == key
