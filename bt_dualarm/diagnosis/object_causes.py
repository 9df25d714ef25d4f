"""Causes of failures in objects, grippers and the blackboard."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Final

from bt_dualarm.core.errors import DualArmError
from bt_dualarm.diagnosis.evidence import Cause, Evidence
from bt_dualarm.replay.timeline import Change, TimelineNode
from bt_dualarm.robots.gripper import load_gripper


def blackboard_causes(e: Evidence) -> Iterator[Cause]:
    """Yields causes in the value of a key and its writer."""
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
            when = "wrote it too late" if node.last("SUCCESS") else "had not finished yet"
            sentence = f"nothing had written {key['key']!r}: {node.path!r} ({node.place}) {when}"
            remedy = f"let {node.path!r} run before {e.leaf.path!r}"
            yield e.cause("NEVER_WRITTEN", sentence, remedy, leaf=node.path)
        else:
            sentence = f"nothing had written {key['key']!r}, and no leaf writes it"
            yield e.cause("NEVER_WRITTEN", sentence, f"set: {{key: {key['key']}, value: …}} before")
        return
    for key in e.keys:
        sentence = (
            f"{key['leaf']!r} had written {key['key']} = {key['value']!r} at "
            f"{key['time_s']:.2f} s, which port {key['port']!r} does not accept: {e.reason}"
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


def _writes(e: Evidence, node: TimelineNode, key: str) -> bool:
    """Whether a leaf of the arm writes the key, by its port or by a recorded event."""
    if node.arm != e.arm:
        return False
    did = any(note["leaf"] == node.path and note["key"] == key for note in e.notes("wrote"))
    return did or node.ports.get("key") == key


_GRASPING_LEAVES: Final = ("approach_and_attach", "grasp", "regrasp")
"""Node types that grasp an object."""

_RELEASING_LEAVES: Final = ("detach", "place", "insert", "release")
"""Node types that release one."""

_FALLEN_M: Final = 0.05
"""Loss of height in m of a fallen object: more than fingers and welds settle."""

_FALL_SAMPLES: Final = 60
"""Number of times before the leaf at which a fall is searched."""

_FALLING_S: Final = 1.0
"""Largest time in s between a fall and the removal of the support that caused it."""

_JUST_BEFORE_S: Final = 0.04
"""Seconds before the end of a `remove` leaf, when the world is still unchanged."""

_LYING_M: Final = 0.01
"""Largest distance in m between an object and one that supports it."""


def world_causes(e: Evidence) -> Iterator[Cause]:
    """Yields causes in an object or arm that the leaf uses."""
    removal = e.timeline.removal(e.arm)
    if removal is not None and e.code in ("", "HALTED") and removal[1].time <= e.ended + 1e-9:
        yield _taken_away(e, e.arm, removal)
    name = e.ports.get("object")
    if isinstance(name, str) and e.code and e.leaf.kind in _GRASPING_LEAVES:
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
        sentence = f"{name} fell or slid after its release: it moved by {moved:.0f} mm"
        yield e.cause("FELL", sentence, "release it where something supports it")
    if e.code == "NOT_SPAWNED":
        yield e.cause("NO_ROOM", e.reason, "another pose, or clear this one")


def _held_by_another(e: Evidence, name: str) -> Iterator[Cause]:
    scene = e.scene(e.ended)
    for other in e.record.arms:
        if other != e.arm and name in scene.held(other):
            sentence = f"{other} holds {name} already: {e.reason}"
            yield e.cause("HELD", sentence, f"let {other} place {name} before {e.leaf.path!r}")


def absence(e: Evidence, name: str) -> Cause | None:
    """Why an object was not in the world when the leaf ended; None if it was."""
    if e.scene(e.ended).has(name):
        return None
    removals = _ended(e, "remove", name)
    if removals:
        return _taken_away(e, name, removals[-1])
    sentence = f"{name} was not in the world: spawned is false, and no leaf had spawned it"
    return e.cause("NOT_SPAWNED_YET", sentence, f"a leaf that spawns {name} before")


def _taken_away(e: Evidence, name: str, removal: tuple[TimelineNode, Change]) -> Cause:
    """Cause for the removal of an object, or of this arm, by a leaf."""
    node, change = removal
    sentence = f"{node.arm}:{node.path} (remove) removed {name} at {change.time:.2f} s"
    remedy = f"remove {name} later"
    if name == e.arm:
        sentence += f", before its tree had ended: it was at {e.leaf.path!r}"
        remedy += f", or removable: true for {name}"
    return e.cause("TAKEN_AWAY", sentence, remedy, leaf=node.path, time_s=change.time)


def _fell_before(e: Evidence, name: str) -> Iterator[Cause]:
    """Yields a cause if the object had fallen before the leaf began, with the lost support."""
    if not e.scene(e.began).has(name):
        return
    low = float(e.scene(e.began).position(name)[2])
    before = None
    for scene in e.moments_before(_FALL_SAMPLES):
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
                f"{name} fell when {lost}, {how}, was removed by {node.arm}:{node.path} "
                f"(remove) at {change.time:.2f} s"
            )
            remedy = f"remove {lost} after {name} was grasped, or place {name} first"
            yield e.cause("FELL", sentence, remedy, leaf=node.path, time_s=change.time)
            return
    fallen = float(before.position(name)[2]) - low
    sentence = f"{name} fell by {1e3 * fallen:.0f} mm after {before.time:.2f} s"
    yield e.cause("FELL", sentence, f"place {name} on a support", time_s=before.time)


def _carried_meanwhile(e: Evidence, name: str) -> Iterator[Cause]:
    """Yields a cause if the leaf released an object that another leaf was carrying."""
    for node in e.timeline.roots[e.arm].leaves_at(e.began, "RUNNING"):
        if node.path != e.leaf.path and name in map(str, node.ports.values()):
            sentence = f"{e.leaf.path!r} released {name} while {node.path!r} was carrying it"
            remedy = f"run them in sequence: {e.leaf.path!r} after {node.path!r}"
            yield e.cause("LET_GO", sentence, remedy, leaf=e.leaf.path, time_s=e.began)


def not_attached(e: Evidence, name: str) -> Cause:
    """Cause for an arm that does not hold an object that a leaf requires to be held."""
    lost = [*_ended(e, "detach", name, arm=e.arm), *_ended(e, "place", name, arm=e.arm)]
    taken = [leaf for kind in _GRASPING_LEAVES for leaf in _ended(e, kind, name, arm=e.arm)]
    if lost and (not taken or lost[-1][1].index > taken[-1][1].index):
        node, change = lost[-1]
        sentence = f"{node.path!r} ({node.kind}) had released {name} at {change.time:.2f} s"
        remedy = f"release {name} later"
        return e.cause("LET_GO", sentence, remedy, leaf=node.path, time_s=change.time)
    if not taken:
        attempts = [
            (node, change)
            for node in e.timeline.leaves()
            if node.arm == e.arm
            and node.kind in _GRASPING_LEAVES
            and name in map(str, node.ports.values())
            for change in node.changes
            if change.old == "RUNNING" and change.time <= e.ended + 1e-9
        ]
        if attempts:
            node, change = max(attempts, key=lambda pair: pair[1].index)
            how = "was halted" if change.code in ("", "HALTED") else f"failed with {change.code}"
            reason = f": {change.reason}" if change.reason else ""
            sentence = (
                f"{e.arm} never grasped {name}: {node.path!r} ({node.kind}) {how} at "
                f"{change.time:.2f} s{reason}"
            )
            remedy = f"let the tree end where {node.path!r} fails"
            return e.cause("NEVER_ATTACHED", sentence, remedy, leaf=node.path, time_s=change.time)
        sentence = f"{e.arm} never grasped {name}: no leaf had grasped it before"
        taker = "grasp" if e.code == "NOT_HELD" else "approach_and_attach"
        return e.cause("NEVER_ATTACHED", sentence, f"{taker}: {{object: {name}}} before")
    holders = [arm for arm in e.record.arms if name in e.scene(e.ended).held(arm)]
    who = f"; {holders[0]} holds it" if holders else ""
    return e.cause("LOST_HOLD", f"{e.arm} no longer held {name}{who}")


def carried(e: Evidence) -> set[str]:
    """Objects that are welded to the arm, or that a leaf has grasped and none has released."""
    names = set(e.scene(e.ended).held(e.arm))
    for name in e.record.start["objects"]:
        taken = [leaf for kind in _GRASPING_LEAVES for leaf in _ended(e, kind, name, arm=e.arm)]
        freed = [leaf for kind in _RELEASING_LEAVES for leaf in _ended(e, kind, name, arm=e.arm)]
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


def _ended(
    e: Evidence, kind: str, name: str, arm: str | None = None
) -> list[tuple[TimelineNode, Change]]:
    """Leaves of a type that succeeded with an object before, in the order of their ends."""
    found = e.timeline.ended(kind, name, arm)
    return [(node, change) for node, change in found if change.time <= e.ended + 1e-9]


_GRIP_CODES: Final = frozenset({"SLIPPED", "DROPPED", "NOT_GRASPED", "TOO_HEAVY", "NOT_HELD"})

_NEAR_M: Final = 0.06
"""Distance in m up to which another object may occupy the space of a finger."""

_SLIPPERY: Final = 0.3
"""Coefficient of friction below which a finger grasp is unreliable; about that of wet steel."""


def grip_causes(e: Evidence) -> Iterator[Cause]:
    """Yields causes that kept fingers or a cup from holding the object of a leaf."""
    name = e.ports.get("object")
    facts = e.record.start["objects"].get(name) if isinstance(name, str) else None
    if facts is None:
        return
    if e.code in _GRIP_CODES and float(facts["friction"]) < _SLIPPERY:
        sentence = f"{name} is slippery: its friction is {facts['friction']:g}; {e.reason}"
        yield e.cause("LOW_FRICTION", sentence, "a rougher surface, more force, or another grasp")
    elif e.code == "TOO_HEAVY":
        sentence = f"{name} ({facts['mass']:g} kg) is too heavy for the grip: {e.reason}"
        yield e.cause("OVERLOADED", sentence, "a lighter object, or a stronger gripper")
    opening = _opening(e)
    size = " by ".join(f"{1e3 * side:g}" for side in facts["size"])
    opens = "" if opening is None else f", and the fingers open {1e3 * opening:.0f} mm"
    wide = opening is not None and facts["shape"] == "box" and sorted(facts["size"])[1] > opening
    if e.code == "TOO_WIDE":
        sentence = f"{name} is {size} mm{opens}: {e.reason}"
        yield e.cause("TOO_WIDE", sentence, "a smaller object, or fingers that open wider")
    elif "grasps" in e.numbers and e.code == "OUT_OF_REACH":
        beside = e.scene(e.began).beside(str(name), _NEAR_M)
        if beside and not wide:
            yield _crowded(e, str(name), beside)
        elif wide:
            sentence = (
                f"{name} is {size} mm{opens}; there is no room for fingers around its short side"
            )
            remedy = "a smaller object, fingers that open wider, or a suction cup"
            yield e.cause("TOO_WIDE", sentence, remedy)
        else:
            remedy = "turn it, support it from below, or use a suction cup"
            yield e.cause("NO_ROOM", f"{name} is {size} mm{opens}: {e.reason}", remedy)
    if e.code == "NOT_HELD":
        yield not_attached(e, str(name))


def _crowded(e: Evidence, name: str, beside: list[tuple[str, float]]) -> Cause:
    """Cause for objects in the space of the fingers."""
    near = ", ".join(f"{other} ({1e3 * gap:.0f} mm away)" for other, gap in beside)
    sentence = f"there is no room for the fingers around {name}; beside it is {near}"
    return e.cause("NO_ROOM", sentence, f"move {beside[0][0]} away, or remove it first")


def _opening(e: Evidence) -> float | None:
    """Largest opening of the arm's fingers in m; None for a cup or an unknown gripper."""
    mounted = e.record.arms[e.arm].get("gripper")
    name = mounted.get("kind") if isinstance(mounted, dict) else mounted
    try:
        gripper = load_gripper(str(name), Path(e.record.start["path"]).parent)
    except (DualArmError, OSError, ValueError):
        return None
    return gripper.stroke or None
