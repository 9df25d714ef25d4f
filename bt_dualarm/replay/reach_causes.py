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

_ABSURD_M: Final = 5.0
"""Distance of a target from the origin beyond which another unit may have been meant."""


def reach_causes(e: Evidence) -> Iterator[Cause]:
    """What kept the arm from where the leaf wanted it to be."""
    if e.code in ("IN_COLLISION", "NO_PLAN", "OUT_OF_REACH", "TIMED_OUT", "PATH_BROKEN"):
        yield from _in_the_way(e)
    if "reach_m" in e.numbers:
        yield _outside(e)
    elif e.code in _TOO_FAR and e.leaf.kind != "track" and "grasps" not in e.numbers:
        yield from _too_far(e)
    if e.code == "JOINT_LIMIT":
        yield e.cause("JOINT_LIMIT", e.reason, "an angle within the joint's limits")


def _outside(e: Evidence) -> Cause:
    """A target that is farther away than any posture of the arm reaches."""
    away, reach = float(e.numbers["distance_m"]), float(e.numbers["reach_m"])
    wanted = _target(e)
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
    own = [name for name in (first, second) if name.startswith(f"{e.arm}/")]
    if len(own) == 2:
        sentence = f"the arm would be in its own way: {first} would touch {second}"
        yield e.cause("SELF_COLLISION", sentence)
        return
    other = second.partition("/")[0]
    if other in e.record.arms and other != e.arm:
        yield other_arm(e, other)
        return
    held = f", which {e.arm} holds," if "/" not in first else ""
    remedy = f"move {other} away, or go another way"
    yield e.cause("IN_THE_WAY", f"{second} is in the way: {first}{held} would touch it", remedy)


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
    named = _target(e)
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


def _target(e: Evidence) -> tuple[str, Vector] | None:
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
