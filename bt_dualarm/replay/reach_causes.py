"""Causes of failures to get somewhere: out of reach, a joint's limit, something in the way."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Final

import numpy as np

from bt_dualarm.errors import DualArmError
from bt_dualarm.motion.kinematics.workspace import Workspace
from bt_dualarm.pose import Vector
from bt_dualarm.replay.evidence import Cause, Evidence
from bt_dualarm.spec.source import with_tuples
from bt_dualarm.spec.values import PoseSpec
from bt_dualarm.world.robots.catalogue import load_robot

_TOO_FAR: Final = frozenset({"UNREACHABLE", "OUT_OF_REACH", "PATH_BROKEN", "SINGULAR"})
_LEAST_GAP_M: Final = 1e-3

_DRIFT_M: Final = 0.03
"""Distance from which on a tool that begins elsewhere each time has drifted."""

_STRAIGHT: Final = 0.7
"""Share of all steps from run to run that their sum is at least, where it goes one way."""

_ABSURD_M: Final = 5.0
"""Distance of a target from the origin beyond which another unit may have been meant."""


def reach_causes(e: Evidence) -> Iterator[Cause]:
    """What kept the arm from where the leaf wanted it to be."""
    if e.code in _TOO_FAR | {"IN_COLLISION", "NO_PLAN", "JOINT_LIMIT"}:
        yield from _drifted(e)
    if e.code in ("IN_COLLISION", "NO_PLAN", "OUT_OF_REACH", "TIMED_OUT", "PATH_BROKEN"):
        yield from _in_the_way(e)
    if "reach_m" in e.numbers:
        yield _outside(e)
    elif e.code in _TOO_FAR and e.leaf.kind != "track" and "grasps" not in e.numbers:
        yield from _too_far(e)
    if e.code == "JOINT_LIMIT":
        yield e.cause("JOINT_LIMIT", e.reason, "an angle within the joint's limits")


def _drifted(e: Evidence) -> Iterator[Cause]:
    """A motion from where the tool is, begun anew and anew from where it had ended."""
    loops = [node for node in e.verdict.chain if node.kind in ("repeat", "while")]
    if not loops or e.ports.get("to") is not None or e.ports.get("object") is not None:
        return
    begun = loops[-1].last("RUNNING", before=e.verdict.end.index if e.verdict.end else None)
    since = 0.0 if begun is None else begun.time
    times = [e.leaf.begun(end).time for end in e.leaf.changes if end.new == "SUCCESS"]
    times = [time for time in times if since <= time < e.began]
    tools = [e.scene(time).tool(e.arm) for time in (*times, e.began)]
    points = np.array([tool for tool in tools if tool is not None])
    if len(points) < 2:
        return
    whole = points[-1] - points[0]
    far = float(np.linalg.norm(whole))
    steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
    if far < _DRIFT_M or far < _STRAIGHT * float(steps.sum()):
        return
    each = ", ".join(f"{1e3 * x:.0f}" for x in whole / len(steps))
    sentence = (
        f"{e.leaf.path!r} ({e.leaf.kind}) begins each time where it has ended before: from run to "
        f"run the tool moved on by ({each}) mm, {far:.2f} m in {len(steps)} runs; then {e.reason}"
    )
    remedy = f"go back to one place before each {e.leaf.kind}"
    if e.ports.get("end") == "rim":
        remedy = "end: center, or go back to one place before each turn"
    yield e.cause("DRIFT", sentence, remedy, leaf=e.leaf.path)


def _outside(e: Evidence) -> Cause:
    """A target that is farther away than any posture of the arm reaches."""
    away, reach = float(e.numbers["distance_m"]), float(e.numbers["reach_m"])
    wanted = target_of(e)
    what = "the target" if wanted is None else wanted[0]
    slip = "" if wanted is None else _unit_slip(e, wanted[1])
    if slip:
        return e.cause("OUT_OF_REACH", f"{what} is {away:.0f} m away: {slip}", "metres in the file")
    sentence = (
        f"{what} is {1e3 * (away - reach):.0f} mm outside the reach of {e.robot} from this base: "
        f"{away:.2f} m from its first joint, and its tool reaches {reach:.2f} m"
    )
    remedy = f"bring {what} or the base of {e.arm} at least that much nearer"
    return e.cause("OUT_OF_REACH", sentence, remedy)


def _in_the_way(e: Evidence) -> Iterator[Cause]:
    """The body that the arm would have met."""
    first, second = str(e.numbers.get("first", "")), str(e.numbers.get("second", ""))
    if not second:
        return
    held = e.scene(e.ended).held(e.arm)
    if second in held and second != first:  # two shapes of one arm, in whichever order
        first, second = second, first
    if second.startswith(f"{e.arm}/"):
        what = first if first.startswith(f"{e.arm}/") else f"{first}, which {e.arm} holds,"
        sentence = f"the arm would be in its own way: {what} would touch {second}"
        yield e.cause("SELF_COLLISION", sentence)
        return
    other = second.partition("/")[0]
    holders = [arm for arm in e.record.arms if other in e.scene(e.ended).held(arm)]
    if other in e.record.arms or holders:
        cause = other_arm(e, (holders or [other])[0])
        more = f"; {first} would touch {other}, which it holds" if holders else ""
        yield e.cause(cause.kind, cause.sentence + more, cause.remedy, leaf=cause.leaf)
        return
    holds = f", which {e.arm} holds," if "/" not in first else ""
    remedy = f"move {other} away, or go another way"
    yield e.cause("IN_THE_WAY", f"{second} is in the way: {first}{holds} would touch it", remedy)


def other_arm(e: Evidence, other: str) -> Cause:
    """Another arm stands, or moves, where this one has to go; what it was doing there."""
    root = e.timeline.roots[other]
    doing = [leaf.path for leaf in root.leaves_at(e.ended, "RUNNING")]
    state = root.status_at(e.ended)
    if doing:
        what = f"{other} was there, at {doing[0]!r}"
    else:
        what = f"{other} stands there; its tree has ended ({state})"
    remedy = f"let {other} leave, or let {e.arm} wait for it before {e.leaf.path!r}"
    leaf = doing[0] if doing else ""
    return e.cause("OTHER_ARM", f"{e.arm} could not pass {other}: {what}", remedy, leaf=leaf)


def _too_far(e: Evidence) -> Iterator[Cause]:
    base = np.array(e.record.arms[e.arm]["base"]["xyz"])
    named = target_of(e)
    short = float(e.numbers.get("residual_m", 0.0) or 0.0)
    if named is None:
        how = f": {e.reason}"
        remedy = "a smaller curve or step, a base nearer by, or another posture to begin from"
        yield e.cause("OUT_OF_REACH", f"the way leaves the reach of {e.robot}{how}", remedy)
        return
    what, point = named
    gap = _gap(e, point)
    away = float(np.linalg.norm(point - base))
    slip = _unit_slip(e, point)
    if slip:
        sentence = f"{what} is {away:.0f} m away from {e.arm}: {slip}"
        yield e.cause("OUT_OF_REACH", sentence, "metres in the file")
        return
    if gap is not None and gap > _LEAST_GAP_M:
        sentence = (
            f"{what} is {1e3 * gap:.0f} mm outside the reach of {e.robot} from this base, "
            f"{away:.2f} m away from it"
        )
        remedy = f"bring {what} or the base of {e.arm} at least {1e3 * gap:.0f} mm nearer"
        yield e.cause("OUT_OF_REACH", sentence, remedy)
        return
    sentence = f"{e.robot} cannot have its tool at {what} with this orientation: {e.reason}"
    more = f"; it stays {1e3 * short:.0f} mm away" if short else ""
    remedy = "another orientation, or a base elsewhere"
    yield e.cause("OUT_OF_REACH", sentence + more, remedy)


def _unit_slip(e: Evidence, point: Vector) -> str:
    """Whether a point that is far away would be within reach in another unit; in words."""
    if np.linalg.norm(point) < _ABSURD_M:
        return ""
    for unit, metres in (("centimetres", 0.01), ("millimetres", 0.001)):
        gap = _gap(e, metres * point)
        if gap is not None and gap <= _LEAST_GAP_M:
            return f"it would be within reach if these were {unit}, but they are metres"
    return ""


def target_of(e: Evidence) -> tuple[str, Vector] | None:
    """What the leaf wanted to reach, in words, and where it is, of shape (3,), m."""
    to, thing = e.ports.get("to"), e.ports.get("object")
    if isinstance(to, dict) and "xyz" in to:
        point = np.array(to["xyz"], dtype=float)
        return f"({', '.join(f'{x:g}' for x in point)})", point
    if isinstance(thing, str) and e.scene(e.began).has(thing):
        return thing, e.scene(e.began).position(thing)
    offset, tool = e.ports.get("offset"), e.scene(e.began).tool(e.arm)
    if isinstance(offset, dict) and offset.get("frame") == "world" and tool is not None:
        point = tool + np.array(offset["xyz"], dtype=float)
        return f"({', '.join(f'{x:.3g}' for x in point)})", point
    return None


def _gap(e: Evidence, point: Vector) -> float | None:
    """Distance in m to which the tool cannot get nearer; None where the robot is not known here."""
    said = e.record.arms[e.arm]
    try:
        robot = load_robot(said["robot"], Path(e.record.start["path"]).parent)
        return Workspace(robot, PoseSpec.model_validate(with_tuples(said["base"])).pose).gap(point)
    except (DualArmError, OSError, ValueError):
        return None
