"""Causes of failures in objects, grippers, the blackboard, and the visibility of targets."""

from __future__ import annotations

import colorsys
import itertools
import math
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Final

import numpy as np

from bt_dualarm.core.errors import DualArmError
from bt_dualarm.diagnosis.evidence import COMPARING_LEAVES, Cause, Evidence
from bt_dualarm.replay.record import Facts
from bt_dualarm.replay.timeline import CameraSight, Change, Scene, TimelineNode, held_over_time
from bt_dualarm.robots.gripper import Gripper, load_gripper
from bt_dualarm.sim.object_body import half_extents
from bt_dualarm.spec.document import ObjectSpec
from bt_dualarm.spec.joints import moved_name
from bt_dualarm.spec.relative_pose import RELATIONS
from bt_dualarm.spec.values import Color
from bt_dualarm.spec.yaml_reader import with_tuples


def blackboard_causes(e: Evidence) -> Iterator[Cause]:
    """Yields causes in the value of a key and its writer."""
    if e.code == "NO_VALUE":
        yield from _without_value(e)
    elif e.leaf.kind in COMPARING_LEAVES and e.code in ("FALSE", "NOT_COMPARABLE"):
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


GRASPING_LEAVES: Final = ("approach_and_attach", "grasp", "regrasp")
"""Node types that grasp an object."""

_RELEASING_LEAVES: Final = ("detach", "open_gripper", "place", "release")
"""Node types that release one."""

_LOCATING_LEAVES: Final = ("locate", "scan")
"""Node types that find out where one lies."""

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

_LOST_CODES: Final = frozenset(
    {"DROPPED", "SLIPPED", "NOT_GRASPED", "NOT_HELD", "NOT_HOLDING", "NOT_PLACED"}
)
"""Failure codes that an object which was removed from the world may cause."""


_MISPLACED_M: Final = 0.01
"""Motion in m of an object that makes a pose relative to it useless."""

_MISPLACED_CODES: Final = frozenset(
    {"UNREACHABLE", "OUT_OF_REACH", "SINGULAR", "PATH_BROKEN", "IN_COLLISION", "NO_PLAN"}
    | {"INVALID_TARGET", "NO_CONTACT", "NOT_REACHED", "NOT_SUPPORTED", "NOT_PLACED"}
)
"""Failure codes of leaves with a goal that is not where it should be."""


def world_causes(e: Evidence) -> Iterator[Cause]:
    """Yields causes in an object or arm that the leaf uses."""
    removal = e.timeline.removal(e.arm)
    if removal is not None and e.code in ("", "HALTED") and removal[1].time <= e.ended + 1e-9:
        yield taken_away(e, e.arm, removal)
    name = e.ports.get("object")
    if isinstance(name, str) and e.code and e.leaf.kind in GRASPING_LEAVES:
        yield from _held_by_another(e, name)
        if e.code == "GRIPPER_FULL":
            yield from _hand_full(e)
        else:
            yield from _fell_before(e, name)
            yield from _fell_meanwhile(e, name)
    if isinstance(name, str) and e.code in _LOST_CODES:
        gone = absence(e, name)
        if gone is not None:
            yield gone
    if isinstance(name, str) and e.code in ("NOT_THERE", "NOT_ATTACHED", "NOT_REMOVED"):
        gone = absence(e, name)
        if gone is not None:
            yield gone
        elif e.code == "NOT_ATTACHED":
            yield not_attached(e, name)
    if name is None and "object" in e.ports and e.code in ("NOT_HELD", "NOT_ATTACHED"):
        yield _empty_handed(e)
    if e.code == "OVERLOADED":
        yield _too_heavy(e)
    is_carried = "joint" not in e.ports and e.ports.get("then_to") is None
    is_fixed = is_carried and e.record.start["objects"].get(name, {}).get("fixed")
    if e.code == "INVALID_TARGET" and is_fixed:
        moves = "; `part`" in e.reason
        remedy = f"the `part` of {name} that is to be moved" if moves else "fixed: false"
        yield e.cause("FIXED", f"{name} is fixed: no arm can carry it", remedy)
    if e.code == "NOT_AT_REST":
        yield from _carried_meanwhile(e, str(name))
        moved = 1e3 * float(e.numbers.get("moved_m", 0.0))
        sentence = f"{name} fell or slid after its release: it moved by {moved:.0f} mm"
        yield e.cause("FELL", sentence, "release it where something supports it")
    if e.code == "SPILLED":
        yield e.cause("SPILLED", e.reason, "a slower motion, or a carrier with walls")
    yield from _moved_since(e)
    if e.code == "UNKNOWN_POSE":
        absences = [absence(e, other) for other in sorted(referred_to(e))]
        yield from (one for one in absences if one is not None)
        remedy = "let `locate` find it before, or give the pose in the world"
        yield e.cause("POSE_UNKNOWN", e.reason, remedy)
    if e.code == "NOT_SPAWNED":
        yield e.cause("NO_ROOM", e.reason, "another pose, or clear this one")


def _moved_since(e: Evidence) -> Iterator[Cause]:
    """Yields a cause if the object to which a pose is relative had moved since the arm knew it."""
    age = e.numbers.get("known_for_s")
    objects = referred_to(e)
    # The age is that of the oldest pose: of several, the arm may have seen another one since.
    if e.code not in _MISPLACED_CODES or not isinstance(age, (int, float)) or len(objects) != 1:
        return
    (name,) = objects
    before, now = e.scene(max(e.began - age, 0.0)), e.scene(e.began)
    if not (before.has(name) and now.has(name)):
        return
    declared = e.record.start["objects"][name]
    # From the start on, the arm has assumed the pose in the file, without the object's noise.
    is_since_start = declared["spawned"] and e.began - age < 1e-6
    is_of_file = e.numbers["known_by"] == "declared" and is_since_start
    assumed = np.array(declared["pose"]["xyz"]) if is_of_file else before.position(name)
    moved = float(np.linalg.norm(now.position(name) - assumed))
    if moved < _MISPLACED_M:
        return
    sentence = (
        f"{name} was {1e3 * moved:.0f} mm from where {e.arm} assumed it, by its pose of "
        f"{age:.1f} s before ({e.numbers['known_by']})"
    )
    if is_of_file and any((*declared["noise"]["xyz"], declared["noise"]["yaw"])):
        sentence += "; its noise displaces it from its pose in the file"
    holders = [
        arm
        for arm in e.record.arms
        if any(
            name in names and before.time <= began <= e.began
            for began, names in held_over_time(e.record, arm)
        )
    ]
    if holders:
        sentence += f"; {' and '.join(holders)} held it meanwhile"
    remedy = f"let `locate` find {name} before, or give the pose in the world"
    yield e.cause("POSE_OUTDATED", sentence, remedy)


def referred_to(e: Evidence) -> set[str]:
    """Names of the objects to which poses in the leaf's ports are relative."""
    declared = e.record.start["objects"]
    names = (name for port in e.leaf.ports.values() for name in _references(port))
    return {name for name in names if name in declared}


def _references(value: object) -> Iterator[str]:
    """Names of objects to which poses in a port are relative."""
    if isinstance(value, Mapping):
        for key, part in value.items():
            if key in RELATIONS and isinstance(part, str):
                yield part.partition(".")[0]
            yield from _references(part)
    elif isinstance(value, list):
        for part in value:
            yield from _references(part)


def _held_by_another(e: Evidence, name: str) -> Iterator[Cause]:
    scene = e.scene(e.ended)
    for other in e.record.arms:
        if other != e.arm and name in scene.held(other):
            sentence = f"{other} holds {name} already: {e.reason}"
            yield e.cause("HELD", sentence, f"let {other} place {name} before {e.leaf.path!r}")


def _hand_full(e: Evidence) -> Iterator[Cause]:
    """Yields a cause for each object that the arm has grasped and not released."""
    for name in sorted(carried(e)):
        taken, _ = _last_taken(e, name)
        if taken is None:
            continue
        node, change = taken
        sentence = (
            f"{e.arm} still holds {name}, which {node.path!r} ({node.kind}) took at "
            f"{change.time:.2f} s"
        )
        remedy = f"place or release {name} before {e.leaf.path!r}"
        yield e.cause("HAND_FULL", sentence, remedy, leaf=node.path, time_s=change.time)


def absence(e: Evidence, name: str) -> Cause | None:
    """Why an object was not in the world when the leaf ended; None if it was, or by a fault."""
    if e.scene(e.ended).has(name):
        return None
    removals = _ended(e, "remove", name)
    if removals:
        return taken_away(e, name, removals[-1])
    if e.scene(0.0).has(name):
        return None
    sentence = f"{name} was not in the world: spawned is false, and no leaf had spawned it"
    return e.cause("NOT_SPAWNED_YET", sentence, f"a leaf that spawns {name} before")


def taken_away(e: Evidence, name: str, removal: tuple[TimelineNode, Change]) -> Cause:
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
    released = [leaf for kind in _RELEASING_LEAVES for leaf in _ended(e, kind, name)]
    set_down_at = max((change.time for _, change in released), default=0.0)
    before = None
    for scene in e.moments_before(_FALL_SAMPLES):
        if not scene.has(name) or scene.time < set_down_at:
            return
        if float(scene.position(name)[2]) > low + _FALLEN_M:
            before = scene
            break
        if _is_held(e, name, scene.time):
            return  # an arm has lowered it
    if before is None or _is_held(e, name, e.began):
        return
    found = [leaf for kind in _LOCATING_LEAVES for leaf in _ended(e, kind, name, arm=e.arm)]
    if any(change.time > before.time for _, change in found):
        return  # the arm knew where it lay
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


def _fell_meanwhile(e: Evidence, name: str) -> Iterator[Cause]:
    """Yields a cause if the object that nobody held fell while the leaf was reaching for it."""
    before, now = e.scene(e.began), e.scene(e.ended)
    if not (before.has(name) and now.has(name)) or _is_held(e, name, e.began):
        return
    fallen = float(before.position(name)[2] - now.position(name)[2])
    if fallen > _FALLEN_M and not _is_held(e, name, e.ended):
        sentence = f"{name} fell by {1e3 * fallen:.0f} mm while {e.leaf.path!r} reached for it"
        yield e.cause("FELL", sentence, f"place {name} on a support")


def _fell_in_view(e: Evidence, name: str) -> Cause | None:
    """Cause if an arm let go of the target that it moved, and it fell; else None."""
    lost = [
        (time, arm)
        for arm in e.record.arms
        for (_, before), (time, after) in itertools.pairwise(held_over_time(e.record, arm))
        if name in before and name not in after and e.began < time <= e.ended
    ]
    if not lost or _is_held(e, name, e.ended) or not e.scene(e.ended).has(name):
        return None
    time, arm = max(lost)
    before, now = e.scene(max(time - _JUST_BEFORE_S, 0.0)), e.scene(e.ended)
    fallen = float(before.position(name)[2] - now.position(name)[2])
    if fallen < _FALLEN_M:
        return None
    running = e.timeline.roots[arm].leaves_at(time, "RUNNING")
    leaf = running[0].path if running else ""
    sentence = f"{name} fell by {1e3 * fallen:.0f} mm when {arm} let go of it at {time:.2f} s"
    if leaf:
        sentence += f", at {leaf!r}"
    remedy = f"let {arm} hold {name} until {e.leaf.path!r} has ended, or set it down"
    return e.cause("LET_GO", sentence, remedy, leaf=leaf, time_s=time)


def _is_held(e: Evidence, name: str, time: float) -> bool:
    """Whether an arm held an object at a time, by a weld or with its gripper."""
    return bool(e.scene(time).holders(name))


def _carried_meanwhile(e: Evidence, name: str) -> Iterator[Cause]:
    """Yields a cause if the leaf released an object that another leaf was carrying."""
    for node in e.timeline.roots[e.arm].leaves_at(e.began, "RUNNING"):
        if node.path != e.leaf.path and name in map(str, node.ports.values()):
            sentence = f"{e.leaf.path!r} released {name} while {node.path!r} was carrying it"
            remedy = f"run them in sequence: {e.leaf.path!r} after {node.path!r}"
            yield e.cause("LET_GO", sentence, remedy, leaf=e.leaf.path, time_s=e.began)


def not_attached(e: Evidence, name: str) -> Cause:
    """Cause for an arm that does not hold an object that a leaf requires to be held."""
    wanted = moved_name(name, str(e.ports["joint"])) if e.leaf.kind == "operate" else name
    taken, released = _last_taken(e, name)
    changes = held_over_time(e.record, e.arm)
    if wanted != name and not any(wanted in held for time, held in changes if time <= e.ended):
        taken = None  # the arm has held other parts of the object only
    if taken is not None and released is not None:
        node, change = released
        sentence = f"{node.path!r} ({node.kind}) had released {name} at {change.time:.2f} s"
        remedy = f"release {name} later"
        return e.cause("LET_GO", sentence, remedy, leaf=node.path, time_s=change.time)
    if taken is None:
        attempts = [
            (node, change)
            for node in e.timeline.leaves()
            if node.arm == e.arm
            and node.kind in (*GRASPING_LEAVES, "take_over")
            and name in map(str, node.ports.values())
            for change in node.changes
            # A leaf that is refused fails in its first tick.
            if change.new == "FAILURE" or (change.old == "RUNNING" and change.new != "SUCCESS")
            if change.time <= e.ended + 1e-9
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
        taker = "grasp" if e.code == "NOT_HELD" else "approach_and_attach"
        of = f", then_to: {e.ports['to']}" if e.leaf.kind == "operate" else ""
        remedy = f"{taker}: {{object: {wanted}{of}}} before"
        sentence = f"{e.arm} never grasped {wanted}: no leaf had grasped it before"
        if wanted != name and name in e.scene(e.ended).held(e.arm):
            sentence = f"{e.arm} holds {name} by a part that {e.ports['joint']!r} does not move"
            remedy = f"put {name} down, and {remedy}"
        return e.cause("NEVER_ATTACHED", sentence, remedy)
    holders = e.scene(e.ended).holders(name)
    who = f"; {holders[0]} holds it" if holders else ""
    return e.cause("LOST_HOLD", f"{e.arm} no longer held {name}{who}")


def _empty_handed(e: Evidence) -> Cause:
    """Cause for an arm that holds nothing, while a leaf requires it to hold any object."""
    objects = e.record.start["objects"]
    tried = [
        (change.index, obj)
        for node in e.timeline.leaves()
        if node.arm == e.arm and node.kind in (*GRASPING_LEAVES, "take_over")
        for obj in map(str, node.ports.values())
        if obj in objects
        for change in node.changes
        if change.time <= e.ended + 1e-9
    ]
    if tried:
        return not_attached(e, max(tried)[1])
    sentence = f"{e.arm} holds nothing: no leaf had grasped an object before"
    return e.cause("NEVER_ATTACHED", sentence, "`grasp` an object before")


def carried(e: Evidence) -> set[str]:
    """Objects that are welded to the arm, or that a leaf has grasped and none has released."""
    names = set(e.scene(e.ended).held(e.arm))
    for name in e.record.start["objects"]:
        taken, released = _last_taken(e, name)
        if taken is not None and released is None:
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


def _last_taken(
    e: Evidence, name: str
) -> tuple[tuple[TimelineNode, Change] | None, tuple[TimelineNode, Change] | None]:
    """The arm's last leaf that took an object, and the leaf that has released it since, if any."""
    kinds = (*GRASPING_LEAVES, "take_over")
    taken = [leaf for kind in kinds for leaf in _ended(e, kind, name, arm=e.arm)]
    if not taken:
        return None, None
    last = max(taken, key=lambda pair: pair[1].index)
    released = [
        (node, change)
        for node in e.timeline.leaves()
        if node.arm == e.arm and node.kind in (*_RELEASING_LEAVES, "hand_over")
        if node.ports.get("object") in (None, name)  # None: whatever the arm holds
        for change in node.changes
        if change.new == "SUCCESS" and last[1].index < change.index
        if change.time <= e.ended + 1e-9
    ]
    return last, min(released, key=lambda pair: pair[1].index, default=None)


def _ended(
    e: Evidence, kind: str, name: str, arm: str | None = None
) -> list[tuple[TimelineNode, Change]]:
    """Leaves of a type that succeeded with an object before, in the order of their ends."""
    found = e.timeline.ended(kind, name, arm)
    return [(node, change) for node, change in found if change.time <= e.ended + 1e-9]


_KNOCKED_S: Final = 3.0
"""Seconds before the end of a leaf in which what it lost may have been knocked."""

_TOUCHED_S: Final = 0.2
"""Largest time in s between the last contact and the motion in the hand that it has caused."""

_MOVED_M: Final = 0.003
_MOVED_RAD: Final = math.radians(3.0)
"""Motion of an object in the hand from which it has slipped."""

_TOGETHER: Final = frozenset({"carry_together", "hand_over", "take_over"})
"""Node types with which another arm takes hold of the object."""


def knock_causes(e: Evidence) -> Iterator[Cause]:
    """Yields what a lost object, or the hand around it, touched before it moved in the hand."""
    if e.code not in ("SLIPPED", "DROPPED") or e.leaf.kind == "operate":
        return
    times = e.record.times
    rows = range(e.record.index_at(max(e.began, e.ended - _KNOCKED_S)), e.record.index_at(e.ended))
    recent = (Scene(e.record, float(times[row])) for row in rows)
    scenes = itertools.dropwhile(lambda scene: not scene.held(e.arm), recent)
    start = next(scenes, None)
    if start is None:
        return
    name = start.held(e.arm)[0]  # a gripper holds one object
    held = start.pose_in(e.arm, name)
    from_the_start = {(touch.own, touch.other) for touch in start.touches(e.arm)}
    first: dict[tuple[str, str], float] = {}
    last: dict[tuple[str, str], float] = {}
    moved_at = e.ended
    for scene in itertools.chain((start,), scenes):
        if not scene.has(name) or scene.tool(e.arm) is None:
            return
        # A contact may begin and end between two recorded states.
        ahead = scene.ahead(float(times[e.record.index_at(scene.time) + 1]) - scene.time)
        touches = (*scene.touches(e.arm), *ahead.touches(e.arm))
        for pair in {(touch.own, touch.other) for touch in touches} - from_the_start:
            first.setdefault(pair, scene.time)
            last[pair] = scene.time
        pose = scene.pose_in(e.arm, name)
        if pose.distance(held) > _MOVED_M or pose.angle(held) > _MOVED_RAD:
            moved_at = scene.time
            break
    is_shared = e.leaf.kind in _TOGETHER
    met = [
        pair
        for pair, time in last.items()
        if moved_at - time <= _TOUCHED_S
        and not (is_shared and pair[1].partition("/")[0] in e.record.arms)
    ]
    if not met:
        return
    own, other = max(met, key=lambda pair: (pair[0] == name, last[pair]))
    sentence = f"{own} ran into {other} at {first[own, other]:.2f} s: {e.reason}"
    remedy = f"{e.clearance(other)}, or touch it more gently"
    yield e.cause("RAN_INTO", sentence, remedy, time_s=first[own, other])


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
    elif e.code == "TOO_HEAVY" and _assumed_too_heavy(e, facts):
        assumed = float(e.numbers["assumed_kg"])
        sentence = (
            f"the leaf assumes {assumed:.3g} kg, as `mass` is not given; {name} has "
            f"{facts['mass']:g} kg: {e.reason}"
        )
        yield e.cause("OVERLOADED", sentence, f"give the leaf the mass: mass: {facts['mass']:g}")
    elif e.code == "TOO_HEAVY" and e.numbers.get("other_grasps"):
        sentence = f"{name} ({facts['mass']:g} kg) is too heavy for such a grip: {e.reason}"
        yield e.cause("OVERLOADED", sentence, "another `approach`, or none; or a lighter object")
    elif e.code == "TOO_HEAVY":
        sentence = f"{name} ({facts['mass']:g} kg) is too heavy for the grip: {e.reason}"
        yield e.cause("OVERLOADED", sentence, "a lighter object, or a stronger gripper")
    gripper = _gripper(e)
    if e.code in ("SLIPPED", "DROPPED") and gripper and float(facts["mass"]) > gripper.payload:
        # An arm that estimates its payload does not refuse it before.
        sentence = (
            f"{name} ({facts['mass']:g} kg) is too heavy for the grip: {gripper.name} may hold "
            f"{gripper.payload:g} kg; {e.reason}"
        )
        yield e.cause("OVERLOADED", sentence, "a lighter object, or a stronger gripper")
    opening = gripper.stroke or None if gripper else None
    sides = facts["size"]
    if 0 < len(sides) < 3:  # a radius, and a length
        sides = 2.0 * half_extents(facts["shape"], sides, np.eye(3))
    size = " by ".join(f"{1e3 * side:.3g}" for side in sides)
    measures = f"{size} mm" if size else f"a {facts['shape']}"
    opens = "" if opening is None else f", and the fingers open {1e3 * opening:.0f} mm"
    wide = opening is not None and facts["shape"] == "box" and sorted(sides)[1] > opening
    if e.code == "TOO_WIDE":
        sentence = f"{name} is {measures}{opens}: {e.reason}"
        yield e.cause("TOO_WIDE", sentence, "a smaller object, or fingers that open wider")
    elif e.numbers.get("other_grasps") and e.code == "OUT_OF_REACH":
        remedy = "another `approach`, or none" if e.ports.get("approach") else "another gripper"
        yield e.cause("NO_ROOM", e.reason, remedy)
    elif "grasps" in e.numbers and e.code == "OUT_OF_REACH":
        beside = e.scene(e.began).beside(str(name), _NEAR_M)
        if beside and not wide:
            yield _crowded(e, str(name), beside)
        elif wide:
            sentence = (
                f"{name} is {measures}{opens}; there is no room for fingers around its short side"
            )
            remedy = "a smaller object, fingers that open wider, or a suction cup"
            yield e.cause("TOO_WIDE", sentence, remedy)
        else:
            remedy = "turn it, support it from below, or use a suction cup"
            yield e.cause("NO_ROOM", f"{name} is {measures}{opens}: {e.reason}", remedy)
    if e.code == "NOT_HELD":
        yield not_attached(e, str(name))


def _assumed_too_heavy(e: Evidence, facts: Facts) -> bool:
    """Whether a leaf without a mass has assumed a larger one than the object has."""
    assumed = e.numbers.get("assumed_kg")
    return isinstance(assumed, (int, float)) and assumed > 1.05 * float(facts["mass"])


def _crowded(e: Evidence, name: str, beside: list[tuple[str, float]]) -> Cause:
    """Cause for objects in the space of the fingers."""
    near = ", ".join(f"{other} ({1e3 * gap:.0f} mm away)" for other, gap in beside)
    sentence = f"there is no room for the fingers around {name}; next to it is {near}"
    return e.cause("NO_ROOM", sentence, f"move {beside[0][0]} away, or remove it first")


def _gripper(e: Evidence) -> Gripper | None:
    """Gripper of the arm; None if it has none, or its description cannot be read."""
    mounted = e.record.arms[e.arm].get("gripper")
    name = mounted.get("kind") if isinstance(mounted, dict) else mounted
    try:
        return load_gripper(str(name), Path(e.record.start["path"]).parent)
    except (DualArmError, OSError, ValueError):
        return None


VISION_CODES: Final = frozenset({"NOT_SEEN", "LOST", "NOT_FOLLOWING", "NOT_STILL"})
"""Failure codes of leaves that did not see their target, or not often enough."""

_LATE_S: Final = 0.5
"""Latency in s from which no arm can follow a moving target."""

_HIGH_DROP: Final = 0.5
"""Fraction of lost frames that impairs tracking."""


def camera_causes(e: Evidence) -> Iterator[Cause]:
    """Yields causes in the delivery of frames, independent of their content."""
    camera = e.record.arms[e.arm].get("camera") if e.arm in e.record.arms else None
    if not camera or e.code not in VISION_CODES | {"", "HALTED"}:
        return
    taken = e.notes("frame", since=e.began, until=e.ended)
    if not taken:
        return
    latency = float(camera["latency"])
    drop = float(camera["drop"])
    if latency >= _LATE_S:
        sentence = (
            f"images of {e.arm} arrive {latency:g} s after exposure (latency): "
            "the target had moved on by then"
        )
        yield e.cause("LATE_PICTURES", sentence, "a smaller latency, or a target at rest")
    if drop >= _HIGH_DROP:
        seen = len(e.notes("look", since=e.began, until=e.ended))
        sentence = (
            f"images of {e.arm} are lost: of {len(taken)} taken, {seen} arrived (drop: {drop:g})"
        )
        yield e.cause("LOST_PICTURES", sentence, "a smaller drop, or a higher fps")


_SIZE_TOLERANCE: Final = 0.2
"""Deviation from which a size counts as different, relative to the longest side."""

_BACKGROUND_SHARE: Final = 0.15
"""Fraction of an image from which a region beyond its edge may be the background."""

_SEEN_SHARE: Final = 0.7
"""Fraction of frames with the target from which visibility was not the cause."""

_HARDLY_SEEN: Final = 0.2
"""Fraction of frames up to which detections may be of something else that has its color."""

_FOLLOWED_S: Final = 2.0
"""Seconds before the end whose frames count for that share."""

_FOLLOWED_LOOKS: Final = 40
"""Number of times between which speeds are measured."""

_HIGH_SHARE: Final = 0.5
"""Fraction of a limit from which a larger one would hardly make the arm faster."""

_LOOKING_AROUND: Final = frozenset({"scan", "locate"})
"""Leaves that turn the camera themselves, so that occlusion matters more than the field of view."""


def sight_causes(e: Evidence) -> Iterator[Cause]:
    """Yields causes that kept the camera from seeing its target."""
    color, name_of_object, marker = (e.ports.get(name) for name in ("color", "object", "marker"))
    if (color, name_of_object, marker) == (None, None, None) or e.arm not in e.record.arms:
        return
    if color is None and e.code not in VISION_CODES | {"INACCURATE"}:
        return  # many leaves have an object that they do not search with the camera
    if e.code == "UNREACHABLE" and e.leaf.kind == "track":
        yield e.cause("LEFT_REACH", e.reason, "a larger `reach`, or a target that stays nearer")
    meant = _candidates(e)
    if len(meant) == 1 and e.code in VISION_CODES | {"INACCURATE"}:
        (name,) = meant
        lost = absence(e, name) or _fell_in_view(e, name)
        if lost is not None:
            yield lost
            return
    if e.code == "INACCURATE":
        yield from filter(None, (_wrong_kind(e, meant),))
    if e.code not in VISION_CODES and not _saw_nothing(e):
        return
    if e.code == "NOT_FOLLOWING" and e.numbers.get("cause") in _NOT_FOLLOWED:
        yield _not_followed(e, meant)
        return
    if e.code == "NOT_FOLLOWING" and meant and _seen_share(e) > _SEEN_SHARE:
        yield _too_slow(e, meant[0])
        return
    wrong = _wrong_kind(e, meant) or (_wrong_color(e, color, meant) if color else None)
    if wrong is not None:
        yield wrong
        return
    for name in meant:
        yield from _of_target(e, name)


_NOT_FOLLOWED: Final = {
    "latency": (
        "LATE_PICTURES",
        "a smaller latency, noise or drop of the camera, a higher fps, or a slower target",
    ),
    "reach": ("LEFT_REACH", "a larger `reach`, or a target that stays nearer"),
    "occlusion": ("OCCLUDED", "keep the line of sight to the target clear"),
    "guard": (
        "SLOWED",
        "more room around the target, or a start away from singularities and limits",
    ),
    "jitter": ("UNSTEADY", "a smaller latency or noise of the camera, or a lower `speed`"),
}
"""Kind of cause and remedy for each ``cause`` that `track` states, besides its speed."""


def _not_followed(e: Evidence, meant: list[str]) -> Cause:
    """Cause that `track` itself has measured; for an occlusion, what was in the way."""
    kind, remedy = _NOT_FOLLOWED[e.numbers["cause"]]
    if kind == "OCCLUDED" and meant:
        sights = (scene.sight(e.arm, meant[0]) for scene in e.moments(_FOLLOWED_LOOKS))
        for sight in sights:
            if sight is not None and sight.state == "hidden":
                return _hidden(e, meant[0], sight)
    return e.cause(kind, e.reason, remedy)


def _seen_share(e: Evidence) -> float:
    """Fraction of the frames before the end in which the target was found."""
    looks = e.notes("look", since=max(e.began, e.ended - _FOLLOWED_S), until=e.ended)
    return sum(bool(look["pixel"]) for look in looks) / max(len(looks), 1)


def _too_slow(e: Evidence, name: str) -> Cause:
    """Cause for a target that was visible and yet left the center of the image."""
    scenes = [scene for scene in e.moments(_FOLLOWED_LOOKS) if scene.has(name)]
    paths = {"target": [scene.position(name) for scene in scenes]}
    paths["tool"] = [tool for scene in scenes if (tool := scene.tool(e.arm)) is not None]
    step = (e.ended - e.began) / _FOLLOWED_LOOKS
    top = {
        what: max((float(np.linalg.norm(b - a)) for a, b in itertools.pairwise(path)), default=0.0)
        / max(step, 1e-6)
        for what, path in paths.items()
    }
    sentence = f"{name} was in view: {e.reason}"
    is_slower = top["tool"] < top["target"]  # otherwise it lacked acceleration, or swung
    if is_slower:
        sentence = (
            f"{name} was in view; {e.arm} was too slow: the target moved at up to "
            f"{top['target']:.2f} m/s, the tool at up to {top['tool']:.2f} m/s"
        )
    shares = {what: float(share) for what, share in e.record.arms[e.arm]["limits"].items()}
    shares["speed"] = float(e.ports.get("speed") or 1.0)
    least = min(shares, key=lambda what: shares[what])
    remedy = "a slower target, or a larger max_error"
    if shares[least] < _HIGH_SHARE:
        where = "its leaf" if least == "speed" else "its limits"
        sentence += f"; {where} may use {shares[least]:g} of the {least} limit of {e.robot}"
        remedy = f"a larger fraction of the {least} limit, or a slower target"
    elif e.ports.get("controller") == "proportional":
        gains = ", ".join(f"{key} {e.ports[key]:g} m" for key in ("gain_u", "gain_v"))
        sentence += f"; a proportional controller moves by its gains ({gains}) at full error"
        remedy = f"{'larger' if is_slower else 'smaller'} gains, or controller: predictive"
    return e.cause("TOO_SLOW", sentence, remedy)


def _saw_nothing(e: Evidence) -> bool:
    """Whether it was running or halted, and had hardly found its target in the last second."""
    if e.code not in ("", "HALTED"):
        return False
    looks = e.notes("look", since=max(e.began, e.ended - 1.0), until=e.ended)
    seen = sum(bool(look["pixel"]) for look in looks)
    return seen <= _HARDLY_SEEN * len(looks)


def _candidates(e: Evidence) -> list[str]:
    """Objects that may be the target: the one it is scored by, otherwise those of the color."""
    color = e.ports.get("color")
    objects = e.record.start["objects"]
    for named in (e.ports.get("score"), e.ports.get("object")):
        if isinstance(named, str) and named in objects:
            return [named]
    if e.ports.get("marker"):
        return [name for name, facts in objects.items() if facts.get("marker")]
    same = [name for name, facts in objects.items() if _has(facts, color)]
    movable = [name for name, facts in objects.items() if not facts["fixed"]]
    return same or movable


def _has(facts: Facts, color: object) -> bool:
    """Whether an object has the hue of a color; its brightness depends on the light."""
    try:
        wanted = Color.model_validate(with_tuples(color))
    except ValueError:
        return False
    red, green, blue, _ = ObjectSpec.model_validate(with_tuples(facts)).rgba
    hue, saturation, _ = colorsys.rgb_to_hsv(red, green, blue)
    return any(
        _between(360.0 * hue, each.hue) and saturation >= 0.5 * each.saturation[0]
        for each in wanted.ranges
    )


def _between(hue: float, ends: tuple[float, float]) -> bool:
    low, high = ends
    return low <= hue <= high if low <= high else hue >= low or hue <= high


def _wrong_kind(e: Evidence, meant: list[str]) -> Cause | None:
    """Cause if the leaf searches for a marker or size that differs from the object's."""
    objects = e.record.start["objects"]
    asked = e.ports.get("marker")
    size = e.ports.get("size")
    if asked and meant:
        name = meant[0]
        has = objects[meant[0]]["marker"]
        same = all(asked[key] == has[key] for key in ("id", "dictionary") if key in asked)
        if not same:
            wanted = f"{asked['id']} of {asked.get('dictionary', 'its set')}"
            sentence = (
                f"it looked for marker {wanted}; {name} has {has['id']} of {has['dictionary']}"
            )
            return e.cause("NOT_RECOGNISED", sentence, f"id: {has['id']}")
    if size and meant and not e.ports.get("object"):
        name = meant[0]
        has = [float(side) for side in objects[meant[0]]["size"]]
        deviation = [
            abs(one - other) for one, other in zip(sorted(size), sorted(has), strict=False)
        ]
        if has and (len(size) != len(has) or max(deviation) > _SIZE_TOLERANCE * max(has)):
            wanted, real = (" by ".join(f"{1e3 * x:g}" for x in each) for each in (size, has))
            sentence = f"it looked for an object of {wanted} mm; {name} is {real} mm"
            return e.cause("NOT_RECOGNISED", sentence, f"size: {has}")
    return None


def _wrong_color(e: Evidence, color: object, meant: list[str]) -> Cause | None:
    objects = e.record.start["objects"]
    if not meant or any(_has(objects[name], color) for name in meant):
        return None
    name = meant[0]
    color_port = e.leaf.ports.get("color")
    has = objects[name]["color"]
    wanted = color_port if isinstance(color_port, str) else "other hues"
    sentence = f"the camera looked for {wanted}, but {name} is {has}"
    return e.cause("WRONG_COLOR", sentence, f"color: {has}")


def _of_target(e: Evidence, name: str) -> Iterator[Cause]:
    """Yields causes of not finding a target of the right color, from its visibility."""
    gone = absence(e, name)
    if gone is not None:
        yield gone
        return
    last_seen = _last_seen(e)
    since = e.began if last_seen is None else last_seen
    looks = e.notes("look", since=since, until=e.ended)
    if 2 * e.numbers.get("spanned_images", 0) > len(looks) > 0:
        sentence = (
            f"{name} reached from border to border of the image, which does not show where its "
            "center is"
        )
        remedy = "a camera farther away or with a larger `fov`, or a smaller target"
        yield e.cause("TOO_LARGE_IN_VIEW", sentence, remedy)
        return
    sights = [
        (scene.time, sight)
        for scene in e.moments(since=since)
        if (sight := scene.sight(e.arm, name)) is not None
    ]
    if not sights:
        return
    states = [sight.state for _, sight in sights]
    worst = max(("seen", "hidden", "outside"), key=states.count)
    if worst == "seen" and states[0] != "seen":
        worst = states[0]
    if e.code == "LOST":
        # The arm stops without the target: what it does afterwards is not the cause.
        worst = next((state for state in reversed(states) if state != "seen"), worst)
    if worst == "outside" and e.leaf.kind in _LOOKING_AROUND and "hidden" in states:
        worst = "hidden"
    sight = next(sight for _, sight in sights if sight.state == worst)
    if worst == "hidden":
        yield _hidden(e, name, sight)
    elif worst == "outside":
        yield _outside(e, name, sight, last_seen)
    elif float(e.numbers.get("beyond_share", 0.0)) > _BACKGROUND_SHARE:
        share = 100.0 * float(e.numbers["beyond_share"])
        sentence = f"the background of {name} has its color: {share:.0f} % of the image"
        remedy = "`color` with ranges that match only the object, or a marker on it"
        yield e.cause("SAME_COLOR_BEHIND", sentence, remedy)
    elif e.numbers.get("unlike"):
        yield _unlike(e, name, next((one for _, one in sights if one.hidden_by), sight))
    else:
        away = f"{sight.distance_m:.2f} m away"
        sentence = f"{name} was in view, {away}, but was not detected as the target"
        yield e.cause("NOT_RECOGNISED", sentence, "tune the color ranges (bt-tune-color)")


def _unlike(e: Evidence, name: str, sight: CameraSight) -> Cause:
    """Cause of not finding a target whose color was found, in an outline of another shape."""
    if sight.hidden_by:
        return _hidden(e, name, sight)
    sentence = f"{name} was in view, {sight.distance_m:.2f} m away: {e.reason}"
    remedy = f"the shape and size that {name} has, or a look at it from elsewhere, once it rests"
    return e.cause("NOT_RECOGNISED", sentence, remedy)


def _hidden(e: Evidence, name: str, sight: CameraSight) -> Cause:
    hidden = name if sight.state == "hidden" else f"a part of {name}"
    away = f"{sight.distance_m:.2f} m away"
    sentence = f"{sight.hidden_by} is between the camera and {hidden}, {away}"
    return e.cause("OCCLUDED", sentence, f"move {sight.hidden_by}, or look from elsewhere")


def _outside(e: Evidence, name: str, sight: CameraSight, last_seen: float | None) -> Cause:
    sentence = (
        f"{name} was outside the image: {sight.off_axis_deg:.0f}° off the camera's axis, "
        f"and its view ends at {sight.half_view_deg:.0f}°"
    )
    if last_seen is not None:
        mover = _mover(e, name, last_seen)
        sentence += f"; it was seen last at {last_seen:.2f} s" + (f", {mover}" if mover else "")
    remedy = f"a posture or base of {e.arm} from which its camera looks at {name}"
    return e.cause("OUT_OF_VIEW", sentence, remedy, time_s=last_seen)


def _last_seen(e: Evidence) -> float | None:
    """Time in s of the last frame with the target; None if there is none."""
    if e.code == "LOST" and "unseen_s" in e.numbers:
        # Later frames may show an object of its color that the arm did not take for the target.
        return e.ended - float(e.numbers["unseen_s"])
    looks = e.notes("look", since=e.began, until=e.ended)
    return max((look["stamp"] for look in looks if look["pixel"]), default=None)


def _mover(e: Evidence, name: str, last_seen: float) -> str:
    """Clause on the arm that held the object at the end, and on its leaf when it was seen last.

    Empty if none did.
    """
    for arm, root in e.timeline.roots.items():
        if name in e.scene(e.ended).held(arm):
            leaves = [leaf.path for leaf in root.leaves_at(last_seen, "RUNNING")]
            at = f" at {leaves[0]!r}" if leaves else ""
            return f"{arm} carried it away{at}"
    return ""
