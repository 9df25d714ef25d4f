"""Causes that lie in objects: not there, not attached, too heavy, fixed, no room to spawn."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

from bt_dualarm.replay.evidence import Cause, Evidence
from bt_dualarm.replay.timeline import Change, Node

_TAKERS: Final = ("approach_and_attach", "grasp", "regrasp")
"""Leaves that take hold of an object."""


def world_causes(e: Evidence) -> Iterator[Cause]:
    """What was the matter with an object or an arm that the leaf deals with."""
    name = e.ports.get("object")
    if isinstance(name, str) and e.code and e.leaf.kind in _TAKERS:
        yield from _held_by_another(e, name)
    if isinstance(name, str) and e.code in ("NOT_THERE", "NOT_ATTACHED", "NOT_REMOVED"):
        gone = absence(e, name)
        if gone is not None:
            yield gone
        elif e.code == "NOT_ATTACHED":
            yield not_attached(e, name)
    if e.code == "OVERLOADED":
        yield _too_heavy(e)
    if e.code == "INVALID_TARGET" and e.record.start["objects"].get(name, {}).get("fixed"):
        yield e.cause("FIXED", f"{name} is fixed: no arm can carry it", "fixed: false")
    if e.code == "NOT_AT_REST":
        moved = 1e3 * float(e.numbers.get("moved_m", 0.0))
        sentence = f"{name} fell or slid after it was let go: it moved by {moved:.0f} mm"
        yield e.cause("FELL", sentence, "let go of it where it stands on something")
    if e.code == "NOT_SPAWNED":
        yield e.cause("NO_ROOM", e.reason, "another place, or nothing in this one")


def _held_by_another(e: Evidence, name: str) -> Iterator[Cause]:
    scene = e.scene(e.ended)
    for other in e.record.arms:
        if other != e.arm and name in scene.held(other):
            sentence = f"{other} holds {name} already: {e.reason}"
            yield e.cause("HELD", sentence, f"let {other} put {name} down before {e.leaf.path!r}")


def absence(e: Evidence, name: str) -> Cause | None:
    """Why an object was not in the world when the leaf ended; None if it was."""
    if e.scene(e.ended).has(name):
        return None
    takers = _ended(e, "remove", name)
    if takers:
        node, change = takers[-1]
        sentence = f"{node.arm}:{node.path} (remove) took {name} away at {change.time:.2f} s"
        remedy = f"remove {name} later"
        return e.cause("TAKEN_AWAY", sentence, remedy, leaf=node.path, time_s=change.time)
    sentence = f"{name} was not in the world: spawned is false, and no leaf had spawned it"
    return e.cause("NOT_SPAWNED_YET", sentence, f"a leaf that spawns {name} before")


def not_attached(e: Evidence, name: str) -> Cause:
    """Why an arm did not hold an object that a leaf needs in its hand."""
    lost = [*_ended(e, "detach", name, arm=e.arm), *_ended(e, "place", name, arm=e.arm)]
    taken = [leaf for kind in _TAKERS for leaf in _ended(e, kind, name, arm=e.arm)]
    if lost and (not taken or lost[-1][1].index > taken[-1][1].index):
        node, change = lost[-1]
        sentence = f"{node.path!r} ({node.kind}) had let go of {name} at {change.time:.2f} s"
        remedy = f"let go of {name} later"
        return e.cause("LET_GO", sentence, remedy, leaf=node.path, time_s=change.time)
    if not taken:
        sentence = f"{e.arm} never took hold of {name}: no leaf had taken it before"
        taker = "grasp" if e.code == "NOT_HELD" else "approach_and_attach"
        return e.cause("NEVER_ATTACHED", sentence, f"{taker}: {{object: {name}}} before")
    holders = [arm for arm in e.record.arms if name in e.scene(e.ended).held(arm)]
    who = f"; {holders[0]} holds it" if holders else ""
    return e.cause("LOST_HOLD", f"{e.arm} no longer held {name}{who}")


def _too_heavy(e: Evidence) -> Cause:
    objects = e.record.start["objects"]
    wanted = e.ports.get("object")
    held = [name for name in e.scene(e.ended).held(e.arm) if name in objects]
    names = held or ([wanted] if isinstance(wanted, str) and wanted in objects else [])
    loads = ", ".join(f"{name} ({objects[name]['mass']:g} kg)" for name in names) or "what it holds"
    sentence = f"{loads} is too heavy for {e.robot}: {e.reason}"
    return e.cause("OVERLOADED", sentence, "a lighter object, a slower motion or a stronger robot")


def _ended(e: Evidence, kind: str, name: str, arm: str | None = None) -> list[tuple[Node, Change]]:
    """Leaves of a kind that succeeded with an object until then, in the order of their ends."""
    found = [
        (node, change)
        for node in e.timeline.leaves()
        if node.kind == kind and name in map(str, node.ports.values()) and arm in (None, node.arm)
        for change in node.changes
        if change.new == "SUCCESS" and change.time <= e.ended + 1e-9
    ]
    return sorted(found, key=lambda pair: pair[1].index)
