"""Causes that lie in objects: not there, not attached, too heavy, fixed, no room to spawn."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

from bt_dualarm.replay.evidence import Cause, Evidence
from bt_dualarm.replay.timeline import Change, Node

_TAKERS: Final = ("approach_and_attach", "grasp", "regrasp")
"""Leaves that take hold of an object."""

_FREERS: Final = ("detach", "place", "insert", "release")
"""Leaves that let go of one."""

_FALLEN_M: Final = 0.05
"""Height by which an object is lower that has fallen: more than fingers and welds settle by."""

_LOOKS: Final = 60
"""Moments before the leaf at which a fall is looked for."""

_FALLING_S: Final = 1.0
"""Seconds around a fall in which what held the object was taken away."""

_JUST_BEFORE_S: Final = 0.04
"""Seconds before a leaf's end at which the world was as it found it."""

_LYING_M: Final = 0.01
"""Distance up to which one object lies on another one, or beside it."""


def world_causes(e: Evidence) -> Iterator[Cause]:
    """What was the matter with an object or an arm that the leaf deals with."""
    removal = e.timeline.removal(e.arm)
    if removal is not None and e.code in ("", "HALTED") and removal[1].time <= e.ended + 1e-9:
        yield _taken_away(e, e.arm, removal)
    name = e.ports.get("object")
    if isinstance(name, str) and e.code and e.leaf.kind in _TAKERS:
        yield from _held_by_another(e, name)
        yield from _fell_before(e, name)
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
        yield from _carried_meanwhile(e, str(name))
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
    removals = _ended(e, "remove", name)
    if removals:
        return _taken_away(e, name, removals[-1])
    sentence = f"{name} was not in the world: spawned is false, and no leaf had spawned it"
    return e.cause("NOT_SPAWNED_YET", sentence, f"a leaf that spawns {name} before")


def _taken_away(e: Evidence, name: str, removal: tuple[Node, Change]) -> Cause:
    """A leaf took an object, or this very arm, out of the world."""
    node, change = removal
    sentence = f"{node.arm}:{node.path} (remove) took {name} away at {change.time:.2f} s"
    remedy = f"remove {name} later"
    if name == e.arm:
        sentence += f", before its tree had ended: it was at {e.leaf.path!r}"
        remedy += f", or removable: true for {name}"
    return e.cause("TAKEN_AWAY", sentence, remedy, leaf=node.path, time_s=change.time)


def _fell_before(e: Evidence, name: str) -> Iterator[Cause]:
    """An object that had fallen before the leaf began, and what it had lost then."""
    if not e.scene(e.began).has(name):
        return
    low = float(e.scene(e.began).position(name)[2])
    before = None
    for scene in e.moments_before(_LOOKS):
        if not scene.has(name):
            return
        if float(scene.position(name)[2]) > low + _FALLEN_M:
            before = scene
            break
    if before is None or any(name in e.scene(e.began).held(arm) for arm in e.record.arms):
        return
    for lost in (*e.record.arms, *e.record.start["objects"]):
        removal = e.timeline.removal(lost)
        if (
            removal is None
            or not 0.0 <= before.time + _FALLING_S - removal[1].time <= 2 * _FALLING_S
        ):
            continue
        node, change = removal
        scene = e.scene(change.time - _JUST_BEFORE_S)
        is_held = lost in e.record.arms and name in scene.held(lost)
        if is_held or (scene.has(lost) and lost in dict(scene.beside(name, _LYING_M))):
            how = "which held it" if is_held else "on which it lay"
            sentence = (
                f"{name} fell when {lost}, {how}, was taken away by {node.arm}:{node.path} "
                f"(remove) at {change.time:.2f} s"
            )
            remedy = f"remove {lost} after {name} was taken, or put {name} down before"
            yield e.cause("FELL", sentence, remedy, leaf=node.path, time_s=change.time)
            return
    fallen = float(before.position(name)[2]) - low
    sentence = f"{name} fell by {1e3 * fallen:.0f} mm after {before.time:.2f} s"
    yield e.cause("FELL", sentence, f"set {name} down on something", time_s=before.time)


def _carried_meanwhile(e: Evidence, name: str) -> Iterator[Cause]:
    """A leaf that let go of what another leaf was carrying."""
    for node in e.timeline.roots[e.arm].leaves_at(e.began, "RUNNING"):
        if node.path != e.leaf.path and name in map(str, node.ports.values()):
            sentence = f"{e.leaf.path!r} let go of {name} while {node.path!r} was carrying it"
            remedy = f"one after the other: {e.leaf.path!r} after {node.path!r}"
            yield e.cause("LET_GO", sentence, remedy, leaf=e.leaf.path, time_s=e.began)


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
        attempts = [
            (node, change)
            for node in e.timeline.leaves()
            if node.arm == e.arm and node.kind in _TAKERS and name in map(str, node.ports.values())
            for change in node.changes
            if change.old == "RUNNING" and change.time <= e.ended + 1e-9
        ]
        if attempts:
            node, change = max(attempts, key=lambda pair: pair[1].index)
            how = "was halted" if change.code in ("", "HALTED") else f"failed with {change.code}"
            said = f": {change.reason}" if change.reason else ""
            sentence = (
                f"{e.arm} never took hold of {name}: {node.path!r} ({node.kind}) {how} at "
                f"{change.time:.2f} s{said}"
            )
            remedy = f"let the tree end where {node.path!r} fails"
            return e.cause("NEVER_ATTACHED", sentence, remedy, leaf=node.path, time_s=change.time)
        sentence = f"{e.arm} never took hold of {name}: no leaf had taken it before"
        taker = "grasp" if e.code == "NOT_HELD" else "approach_and_attach"
        return e.cause("NEVER_ATTACHED", sentence, f"{taker}: {{object: {name}}} before")
    holders = [arm for arm in e.record.arms if name in e.scene(e.ended).held(arm)]
    who = f"; {holders[0]} holds it" if holders else ""
    return e.cause("LOST_HOLD", f"{e.arm} no longer held {name}{who}")


def carried(e: Evidence) -> set[str]:
    """Objects that the arm holds by a weld, or has taken by a leaf and not let go of."""
    names = set(e.scene(e.ended).held(e.arm))
    for name in e.record.start["objects"]:
        taken = [leaf for kind in _TAKERS for leaf in _ended(e, kind, name, arm=e.arm)]
        freed = [leaf for kind in _FREERS for leaf in _ended(e, kind, name, arm=e.arm)]
        if taken and (not freed or taken[-1][1].index > freed[-1][1].index):
            names.add(name)
    return names


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
    found = e.timeline.ended(kind, name, arm)
    return [(node, change) for node, change in found if change.time <= e.ended + 1e-9]
