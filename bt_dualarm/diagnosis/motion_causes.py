"""Causes of failures in motions: contacts and forces, workspace, time."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Final

import numpy as np

from bt_dualarm.core.errors import KINEMATIC_CODES, DualArmError
from bt_dualarm.core.pose import Vector
from bt_dualarm.diagnosis.evidence import LOOK_BACK_S, Cause, Evidence, descend
from bt_dualarm.diagnosis.joint_causes import MovedJoint
from bt_dualarm.diagnosis.object_causes import (
    GRASPING_LEAVES,
    carried,
    referred_to,
    taken_away,
)
from bt_dualarm.kinematics.inverse_kinematics import Workspace
from bt_dualarm.replay.timeline import ContactPoint, TimelineNode, held_over_time
from bt_dualarm.robots.robot import Robot
from bt_dualarm.robots.robot_description import load_robot
from bt_dualarm.runtime.outcome import Ending
from bt_dualarm.skill.cell import waiting_sentence
from bt_dualarm.spec.joints import moved_name
from bt_dualarm.spec.node_types import counted
from bt_dualarm.spec.values import PoseSpec
from bt_dualarm.spec.yaml_reader import with_tuples

_DEFAULT_LIMIT_N: Final = 280.0
"""Default force limit of an arm."""

_RESTING_M: Final = 1e-6

_INSERTING: Final = {
    "NOT_FOUND": "an `at` nearer to the hole, or a larger `radius`",
    "JAMMED": "a `depth` no deeper than the hole, another rotation of `at`, or a wider hole",
    "NOT_INSERTED": "an `at` nearer to the hole, or a firmer grasp of the peg",
}
"""What may be changed where a peg did not go in, by failure code."""


def contact_causes(e: Evidence) -> Iterator[Cause]:
    """Yields causes in the contacts of the arm; of parts that it moves, see `joint_causes`."""
    is_joint = e.leaf.kind == "operate"
    if e.code == "FORCE_LIMIT" and ("second" in e.numbers or not is_joint):
        yield from _pressed(e)
    if e.code == "COLLISION":
        yield from _collided(e)
    if e.code in ("TRACKING_ERROR", "NOT_REACHED", "PROXIMITY_NOT_REACHED") and not is_joint:
        yield from _blocked(e)
    if e.code == "NO_CONTACT":
        yield _nothing_there(e)
    if e.leaf.kind == "insert" and e.code in _INSERTING:
        met = {touch.other for touch in e.scene(e.ended).touches(e.arm)} - {e.ports["object"]}
        touched = f"; it touched {' and '.join(sorted(met))}" if met else ""
        yield e.cause(e.code, f"{e.reason}{touched}", _INSERTING[e.code])


def _nothing_there(e: Evidence) -> Cause:
    """Cause for a contact or support that was not found within the search distance."""
    if "search" in e.ports:
        below = 1e3 * float(e.ports["search"])
        name = e.ports.get("object")
        place = f"the place of {name}" if name else "the place"
        sentence = f"there is no ground within {below:.0f} mm below {place}: {e.reason}"
        return e.cause("NOTHING_THERE", sentence, "a lower `at`, or a longer `search`")
    if "distance_m" not in e.numbers:  # the distance follows from a pose
        remedy = "a lower `at`"
        if "depth" in e.ports:
            remedy = "another `at`, `depth` or `direction`"
        if "push" in e.ports:
            remedy += "; or a stiffer or firmer hold of the hole"
        return e.cause("NOTHING_THERE", e.reason, remedy)
    distance = 1e3 * float(e.numbers["distance_m"])
    sentence = f"there was nothing to touch within {distance:.0f} mm"
    return e.cause("NOTHING_THERE", sentence, "a longer distance, or another direction")


def held_still_causes(e: Evidence) -> Iterator[Cause]:
    """Yields a cause for each arm that did not hold still what the leaf goes `into` to its end."""
    into = e.ports.get("into")
    if not isinstance(into, str) or not e.code or not e.scene(e.began).has(into):
        return
    for holder in e.scene(e.began).holders(into):
        if holder == e.arm:
            continue
        remedy = f"hold_still: {{partner: {e.arm}}} in the tree of {holder} until {e.leaf.path!r}"
        remedy += " has ended"
        removal = e.timeline.removal(holder)
        if removal is not None and removal[1].time <= e.ended:
            node, change = removal
            sentence = (
                f"{node.arm}:{node.path} (remove) removed {holder}, which held {into}, at "
                f"{change.time:.2f} s"
            )
            remedy = f"remove {holder} when {e.leaf.path!r} has ended"
            yield e.cause("TAKEN_AWAY", sentence, remedy, leaf=node.path, time_s=change.time)
            continue
        lost = [
            time
            for time, names in held_over_time(e.record, holder)
            if e.began < time <= e.ended and into not in names
        ]
        if lost:
            doing = _running(e, holder, lost[0])
            sentence = f"{holder} let go of {into} at {lost[0]:.2f} s{doing}"
            yield e.cause("LET_GO", sentence, remedy, time_s=lost[0])
            continue
        running = e.timeline.roots[holder].leaves_at(e.around, "RUNNING")
        holding = [
            leaf
            for leaf in running
            if leaf.kind == "hold_still" and leaf.ports.get("partner") == e.arm
        ]
        if not holding and e.code not in KINEMATIC_CODES:
            sentence = (
                f"{holder}, which holds {into}, was not in hold_still with partner: {e.arm}"
                f"{_running(e, holder, e.around)}"
            )
            yield e.cause("OTHER_ARM", sentence, remedy)


def _running(e: Evidence, arm: str, time: float) -> str:
    """What another arm was doing at a time, as a parenthesis; empty if its tree had ended."""
    running = e.timeline.roots[arm].leaves_at(time, "RUNNING")
    return f" (running {running[0].path!r})" if running else ""


def _pressed(e: Evidence) -> Iterator[Cause]:
    limit = float(e.record.arms[e.arm]["force_limit"])
    second = e.numbers.get("second", "something")
    wanted = e.ports.get("force")
    if limit < _DEFAULT_LIMIT_N:
        asked = f"; the leaf itself requests {wanted} N" if wanted is not None else ""
        sentence = (
            f"the force limit of {e.arm} is {limit:g} N, and it pressed on {second} with "
            f"{float(e.numbers.get('force_n', 0.0)):.0f} N{asked}"
        )
        yield e.cause("LOW_FORCE_LIMIT", sentence, "a higher force_limit, or a slower motion")
    else:
        # Nothing in a record tells encoder noise, which a heavy arm feels as a force, from contact.
        advice = (
            f"move {second} away, or move more slowly; an arm of more than 150 kg may need "
            "a higher force_limit"
        )
        yield e.cause("PRESSED", e.reason, advice)


def _collided(e: Evidence) -> Iterator[Cause]:
    threshold = float(e.record.arms[e.arm]["collision"]["threshold"])
    met = _obstacles(e)
    if met:
        touch = met[0]
        sentence = f"{touch.own} ran into {touch.other}: {e.reason}"
        yield e.cause("RAN_INTO", sentence, e.clearance(touch.other))
    elif threshold < 1.0:
        sentence = f"the collision threshold is {threshold:g} times the usual one: {e.reason}"
        yield e.cause("LOW_THRESHOLD", sentence, "collision: {threshold: 1.0}")
    else:
        yield e.cause("HIT", e.reason)


def _blocked(e: Evidence) -> Iterator[Cause]:
    yield from _beyond_payload(e)
    met = _obstacles(e)
    if met:
        touch = met[0]
        other = touch.other.partition("/")[0]
        kind = "OTHER_ARM" if other in e.record.arms else "BLOCKED"
        sentence = f"{touch.own} was blocked by {touch.other}: {e.reason}"
        yield e.cause(kind, sentence, e.clearance(other))
        return
    saturated = int(e.numbers.get("saturated", 0) or _guard_saturated(e))
    held = e.scene(e.ended).held(e.arm)
    if held and saturated:
        objects = e.record.start["objects"]
        mass = sum(float(objects[name]["mass"]) for name in held if name in objects)
        sentence = f"{e.arm} is too weak for the {mass:g} kg that it holds: {e.reason}"
        yield e.cause("OVERLOADED", sentence, "a lighter object, or a slower motion")
    elif "at_effort_limit" in e.numbers:
        weak = e.numbers["at_effort_limit"]
        sentence = f"{weak} of {e.arm} has too little effort for this posture: {e.reason}"
        yield e.cause("OVERLOADED", sentence, "a posture nearer to the base, or a lighter gripper")


def _beyond_payload(e: Evidence) -> Iterator[Cause]:
    """Yields a cause if what the arm holds, or is about to lift, exceeds its payload."""
    objects = e.record.start["objects"]
    wanted = e.ports.get("object") if e.leaf.kind in GRASPING_LEAVES else None
    names = {*e.scene(e.ended).held(e.arm), *([wanted] if isinstance(wanted, str) else [])}
    mass = sum(float(objects[name]["mass"]) for name in names if name in objects)
    robot = _robot(e)
    if robot is not None and robot.payload is not None and mass > robot.payload:
        weigh = "weigh" if len(names) > 1 else "weighs"
        payload = f"the payload of {e.robot} is {robot.payload:g} kg"
        sentence = f"{' and '.join(sorted(names))} {weigh} {mass:g} kg; {payload}: {e.reason}"
        yield e.cause("OVERLOADED", sentence, "a lighter object or a stronger robot")


def _obstacles(e: Evidence) -> list[ContactPoint]:
    """Contacts new in the last second, otherwise all in it, most frequent first."""
    held = carried(e)  # includes objects held by fingers, without a weld
    before = {(touch.own, touch.other) for touch in e.scene(e.ended - LOOK_BACK_S).touches(e.arm)}
    found: Counter[tuple[str, str]] = Counter()
    deepest: dict[tuple[str, str], ContactPoint] = {}
    for scene in e.moments(25, since=e.ended - LOOK_BACK_S):
        for touch in scene.touches(e.arm):
            if touch.other in held:
                continue
            pair = touch.own, touch.other
            if touch.depth_m > _RESTING_M:
                found[pair] += 1
                deepest.setdefault(pair, touch)
    new = [pair for pair, _ in found.most_common() if pair not in before]
    return [deepest[pair] for pair in new or [pair for pair, _ in found.most_common()]]


def _guard_saturated(e: Evidence) -> int:
    if e.record.summary is None:
        return 0
    return int(e.record.summary["arms"].get(e.arm, {}).get("guard", {}).get("saturated", 0))


_TOO_FAR: Final = frozenset({"UNREACHABLE", "OUT_OF_REACH", "PATH_BROKEN", "SINGULAR"})
_LEAST_GAP_M: Final = 1e-3

_LOOKING: Final = frozenset({"look_at", "scan"})
"""Leaves whose target is one of the camera, at a distance of the tool."""

_DRIFT_M: Final = 0.03
"""Smallest distance in m between the first and the last start that counts as drift."""

_STRAIGHT: Final = 0.7
"""Smallest ratio of that distance to the sum of all steps, for a drift in one direction."""

_ABSURD_M: Final = 5.0
"""Distance of a target from the origin in m beyond which another unit may be intended."""


def reach_causes(e: Evidence) -> Iterator[Cause]:
    """Yields causes that kept the arm from its target."""
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
    """Yields a cause for a relative motion that is repeated from where it ended."""
    loops = [node for node in e.root_cause.chain if node.kind in ("repeat", "while")]
    if not loops or e.ports.get("to") is not None or e.ports.get("object") is not None:
        return
    begun = loops[-1].last("RUNNING", before=e.root_cause.end.index if e.root_cause.end else None)
    since = 0.0 if begun is None else begun.time
    times = [e.leaf.begun(end).time for end in e.leaf.changes if end.new == "SUCCESS"]
    times = [time for time in times if since <= time < e.began]
    tools = [e.scene(time).tool(e.arm) for time in (*times, e.began)]
    points = np.array([tool for tool in tools if tool is not None])
    if len(points) < 2:
        return
    whole = points[-1] - points[0]
    distance = float(np.linalg.norm(whole))
    steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
    if distance < _DRIFT_M or distance < _STRAIGHT * float(steps.sum()):
        return
    each = ", ".join(f"{1e3 * x:.0f}" for x in whole / len(steps))
    sentence = (
        f"{e.leaf.path!r} ({e.leaf.kind}) starts each time where it ended before: between "
        f"runs the tool moved by ({each}) mm, {distance:.2f} m in {counted(len(steps), 'run')}; "
        f"then {e.reason}"
    )
    remedy = f"return to a fixed pose before each {e.leaf.kind}"
    if e.ports.get("end") == "rim":
        remedy = "end: center, or return to a fixed pose before each turn"
    yield e.cause("DRIFT", sentence, remedy, leaf=e.leaf.path)


def _outside(e: Evidence) -> Cause:
    """Cause for a target outside the arm's workspace."""
    away = float(e.numbers["distance_m"])
    reach = float(e.numbers["reach_m"])
    wanted = target_of(e)
    what = "the target" if wanted is None else wanted[0]
    slip = "" if wanted is None else _unit_slip(e, wanted[1])
    if slip:
        return e.cause("OUT_OF_REACH", f"{what} is {away:.0f} m away: {slip}", "meters in the file")
    sentence = (
        f"{what} is {1e3 * (away - reach):.0f} mm outside the reach of {e.robot} from this base: "
        f"{away:.2f} m from its first joint, and its tool reaches {reach:.2f} m"
    )
    remedy = f"bring {what} or the base of {e.arm} at least that much nearer"
    return e.cause("OUT_OF_REACH", sentence, remedy)


def _in_the_way(e: Evidence) -> Iterator[Cause]:
    """Yields a cause for the body with which the arm would collide."""
    first = str(e.numbers.get("first", ""))
    second = str(e.numbers.get("second", ""))
    if not second:
        return
    held = e.scene(e.ended).held(e.arm)
    if second in held and second != first:  # two shapes of one arm, in whichever order
        first, second = second, first
    other = second.partition("/")[0]
    # A leaf may plan for its partners, too.
    if other == e.arm or (other in e.record.arms and first.startswith(f"{other}/")):
        who = "the arm" if other == e.arm else other
        what = first if first.startswith(f"{other}/") else f"{first}, which {other} holds,"
        sentence = f"{who} would collide with itself: {what} would touch {second}"
        yield e.cause("SELF_COLLISION", sentence)
        return
    holders = e.scene(e.ended).holders(other)
    if other in e.record.arms or holders:
        cause = other_arm(e, (holders or [other])[0])
        more = f"; {first} would touch {other}, which it holds" if holders else ""
        remedy = cause.remedy
        if holders and "into" in e.ports and not e.ports["into"]:
            remedy += f"; or, if they are to meet, name it: into: {other}"
            remedy += f", while {holders[0]} is in hold_still with partner: {e.arm}"
        yield e.cause(cause.kind, cause.sentence + more, remedy, leaf=cause.leaf)
        return
    holds = f", which {e.arm} holds," if "/" not in first else ""
    remedy = e.clearance(other)
    if other in referred_to(e) and "/" not in first:
        remedy = f"another place relative to {other}, by `xyz` or another orientation"
        yield e.cause("TOO_NARROW", f"{first}, which {e.arm} holds, would touch {second}", remedy)
        return
    if e.leaf.kind == "place" and first.startswith(f"{e.arm}/"):
        remedy = f"grasp it otherwise: {_other_grasp(e)}; or {remedy}"
    yield e.cause("IN_THE_WAY", f"{second} is in the path: {first}{holds} would touch it", remedy)


def _other_grasp(e: Evidence) -> str:
    """What to change in the leaf that took the held object, for another grasp of it."""
    taken = [
        (change.index, leaf.kind)
        for leaf in e.timeline.leaves()
        if leaf.arm == e.arm and leaf.kind in ("grasp", "regrasp", "take_over")
        for change in leaf.changes
        if change.new == "SUCCESS" and change.time <= e.began + 1e-9
    ]
    _, kind = max(taken, default=(0, "grasp"))
    if kind == "regrasp":  # it has no port for the goal
        return "another `approach` of `regrasp`"
    return f"give `then_at` of `{kind}` this goal"


def other_arm(e: Evidence, other: str) -> Cause:
    """Cause for another arm in the path of this one, with the leaf that it was running."""
    root = e.timeline.roots[other]
    doing = [node.path for node in root.at_work(e.around)]
    state = root.status_at(e.around)
    if doing:
        what = f"{other} was there, running {doing[0]!r}"
    else:
        what = f"{other} is there; its tree has ended ({state})"
    remedy = f"let {other} leave, or let {e.arm} wait for it before {e.leaf.path!r}"
    leaf = doing[0] if doing else ""
    return e.cause("OTHER_ARM", f"{e.arm} was blocked by {other}: {what}", remedy, leaf=leaf)


def _too_far(e: Evidence) -> Iterator[Cause]:
    base = np.array(e.record.arms[e.arm]["base"]["xyz"])
    named = target_of(e)
    short = float(e.numbers.get("residual_m", 0.0) or 0.0)
    if named is None:
        how = f": {e.reason}"
        remedy = "a smaller curve or step, a nearer base, or another initial posture"
        yield e.cause("OUT_OF_REACH", f"the path leaves the workspace of {e.robot}{how}", remedy)
        return
    what, point = named
    if e.leaf.kind == "take_over":  # the giver brings it from where it is
        giver = e.ports.get("from")
        sentence = f"{giver} and {e.arm} found no place to hand over {what}: {e.reason}"
        remedy = f"another place (`at` of `hand_over`), or another grasp of {giver} (`point`)"
        yield e.cause("OUT_OF_REACH", sentence, remedy)
        return
    if e.leaf.kind == "carry_together":  # each arm holds it elsewhere; one leaf plans for all
        names = [e.arm, *map(str, e.ports.get("with", ()))]
        arms = " and ".join((", ".join(names[:-1]), names[-1])) if names[1:] else e.arm
        obj = e.ports["object"]
        sentence = f"{arms} found no grasps with which they can carry {obj}: {e.reason}"
        yield e.cause("OUT_OF_REACH", sentence, "another path, or other positions of the bases")
        return
    gap = _gap(e, point)
    away = float(np.linalg.norm(point - base))
    slip = _unit_slip(e, point)
    if e.leaf.kind in _LOOKING and not slip:
        yield _viewpoint(e, what, gap)
        return
    if slip:
        sentence = f"{what} is {away:.0f} m away from {e.arm}: {slip}"
        yield e.cause("OUT_OF_REACH", sentence, "meters in the file")
        return
    if gap is not None and gap > _LEAST_GAP_M:
        sentence = (
            f"{what} is {1e3 * gap:.0f} mm outside the reach of {e.robot} from this base, "
            f"{away:.2f} m away from it"
        )
        if short > gap:  # the workspace is that of all orientations
            sentence += f"; with this orientation, the tool stays {1e3 * short:.0f} mm away"
        nearer = 1e3 * max(gap, short)
        remedy = f"bring {what} or the base of {e.arm} at least {nearer:.0f} mm nearer"
        yield e.cause("OUT_OF_REACH", sentence, remedy)
        return
    sentence = f"{e.robot} cannot reach {what} with this orientation: {e.reason}"
    is_told = "no closer to the target" in e.reason
    more = f"; it stays {1e3 * short:.0f} mm away" if short and not is_told else ""
    remedy = "another orientation, or another base position"
    if e.leaf.kind == "place":
        if not _is_oriented(e.ports.get("at")):  # `place` has tried all headings
            sentence = f"{e.robot} cannot reach {what} with this grasp, in any heading: {e.reason}"
            remedy = "another base position"
        remedy = f"grasp it otherwise: {_other_grasp(e)}; or {remedy}"
    yield e.cause("OUT_OF_REACH", sentence + more, remedy)


def _is_oriented(pose: object) -> bool:
    """Whether a pose of the ports, as they are recorded, has an orientation."""
    notations = ("rpy", "quat", "look_at")
    return isinstance(pose, Mapping) and any(pose.get(name) is not None for name in notations)


def _viewpoint(e: Evidence, what: str, gap: float | None) -> Cause:
    """Cause for a point from which the camera cannot keep its distance."""
    distance = float(e.ports["distance"])
    sentence = f"{e.robot} cannot look at {what} from {distance:g} m: {e.reason}"
    if gap is None or gap <= distance:
        remedy = "a smaller `distance`, another direction, a larger `lean`, or a nearer base"
        return e.cause("OUT_OF_REACH", sentence, remedy)
    sentence += f"; its tool comes no nearer to it than {gap:.2f} m"
    remedy = f"bring {what} or the base of {e.arm} at least {1e3 * (gap - distance):.0f} mm nearer"
    return e.cause("OUT_OF_REACH", sentence, remedy)


def _unit_slip(e: Evidence, point: Vector) -> str:
    """Clause on a distant point that would be within reach in another unit; otherwise empty."""
    if np.linalg.norm(point) < _ABSURD_M:
        return ""
    for unit, meters in (("centimeters", 0.01), ("millimeters", 0.001)):
        gap = _gap(e, meters * point)
        if gap is not None and gap <= _LEAST_GAP_M:
            return f"it would be within reach if the numbers were {unit}; the file uses meters"
    return ""


def target_of(e: Evidence) -> tuple[str, Vector] | None:
    """Target of the leaf: its name and its position in the world, of shape (3,), m."""
    to = e.ports.get("to") or e.ports.get("at")
    name = e.ports.get("object")
    moved = _moved_part(e)
    if moved is not None:
        return moved
    if e.leaf.kind == "scan":  # where the object is, the arm does not know
        point = np.array(e.ports["center"], dtype=float)
        return f"the area around ({', '.join(f'{x:g}' for x in point)})", point
    if isinstance(to, dict) and "xyz" in to:
        point = np.array(to["xyz"], dtype=float)
        return f"({', '.join(f'{x:g}' for x in point)})", point
    if isinstance(name, str) and e.scene(e.began).has(name):
        return name, e.scene(e.began).position(name)
    offset = e.ports.get("offset")
    tool = e.scene(e.began).tool(e.arm)
    if isinstance(offset, dict) and offset.get("frame") == "world" and tool is not None:
        point = tool + np.array(offset["xyz"], dtype=float)
        return f"({', '.join(f'{x:.3g}' for x in point)})", point
    return None


def _moved_part(e: Evidence) -> tuple[str, Vector] | None:
    """Where the hand would be at the end of the motion of a joint; None for other leaves."""
    tool = e.scene(e.began).tool(e.arm)
    if e.leaf.kind != "operate" or tool is None:
        return None
    joint = MovedJoint(e.scene(e.began), moved_name(str(e.ports["object"]), str(e.ports["joint"])))
    to = float(e.ports["to"])
    goal = math.radians(to) if joint.is_hinge else to
    return f"the part of {joint.name} at {joint.text_of(goal)}", joint.point_at(tool, goal)


def _gap(e: Evidence, point: Vector) -> float | None:
    """Smallest distance in m of the tool from a point; None for an unknown robot."""
    robot = _robot(e)
    if robot is None:
        return None
    base = PoseSpec.model_validate(with_tuples(e.record.arms[e.arm]["base"])).pose
    return Workspace(robot, base).gap(point)


def _robot(e: Evidence) -> Robot | None:
    """The arm's robot; None if its description can no longer be read."""
    facts = e.record.arms[e.arm]
    try:
        return load_robot(facts["robot"], Path(e.record.start["path"]).parent, facts.get("locked"))
    except (DualArmError, OSError, ValueError):
        return None


_SAME_S: Final = 1e-6
"""Difference in s of the times of two changes in the same tick."""

_STILL_M: Final = 2e-3
"""Largest displacement in m of the tool of an arm that has not moved."""

_AT_TARGET_M: Final = 0.15
"""Distance in m from a target within which a body blocks tool or wrist."""


def time_causes(e: Evidence) -> Iterator[Cause]:
    """Yields causes of a leaf that ran out of time, was halted, or was still running."""
    if e.code not in ("", "HALTED", "TIMED_OUT"):
        return
    held_up = _held_up(e)
    if held_up is not None:
        yield held_up
        return
    beyond = float(e.numbers.get("beyond_s", 0.0))
    if beyond > 0.0 and e.root_cause.at is None:
        sentence = (
            f"the target had been out of reach for {beyond:.1f} s, and {e.leaf.path!r} waited"
        )
        yield e.cause("LEFT_REACH", sentence, "a larger `reach`, or a target that comes nearer")
        return
    if e.code == "TIMED_OUT":
        yield e.cause("TOO_LITTLE_TIME", e.reason)
        return
    limit = _timeout(e)
    ran = f"{e.leaf.path!r} had run for {e.ended - e.began:.2f} s"
    if limit is not None:
        path, reason = limit
        sentence = f"{ran} when the timeout {path!r} ended it: {reason}"
        faster = ", or a faster motion" if "speed" in e.ports else ""
        remedy = f"more `seconds` of that timeout{faster}"
        yield e.cause("TOO_LITTLE_TIME", sentence + _usual(e), remedy, leaf=path)
    elif e.root_cause.at is not None:
        yield _at_work(e)
    elif e.root_cause.end is None or _ended_with_run(e):
        yield _cut_short(e, ran)


def _timeout(e: Evidence) -> tuple[str, str] | None:
    """Path and sentence of the timeout that halted the leaf; None if none did."""
    end = e.root_cause.end
    if end is None or end.new != "INVALID":
        return None
    for node in reversed(e.root_cause.chain):
        for change in node.changes:
            # One around it that fails later, or by what its child reports, has not halted it.
            if change.code == "TIMEOUT" and abs(change.time - e.ended) < _SAME_S:
                return node.path, change.reason
    return None


def _cut_short(e: Evidence, ran: str) -> Cause:
    """Cause for a leaf that was running when the run ended: why that ended.

    Args:
        e: The evidence.
        ran: Clause on how long the leaf had run.
    """
    summary = e.record.summary or {}
    ending = summary.get("ending")
    if ending == Ending.INVARIANT:
        return e.cause("INVARIANT", f"the run ended by an invariant: {summary.get('error')}")
    ended = f"the run ended at {e.record.until:.2f} s"
    if ending in (Ending.DURATION, Ending.TIME_LIMIT):
        sentence = f"{ended}: {ran}{_usual(e)}"
        return e.cause("TOO_LITTLE_TIME", sentence, "a later time_limit or --duration")
    why = summary.get("error") or ending or "its process was ended"
    return e.cause("RUN_ENDED", f"{ended}: {why}; {ran}")


def _at_work(e: Evidence) -> Cause:
    """Cause for a leaf that was running at the requested time, with its later outcome."""
    ends = [each for each in e.leaf.changes if each.time > e.began and each.old == "RUNNING"]
    came = "it was still running at the end of the record"
    if ends:
        end = ends[0]
        what = {"SUCCESS": "it succeeded", "FAILURE": f"it failed with {end.code}"}
        came = f"{what.get(end.new, 'it was halted')} at {end.time:.2f} s"
    waits = ": it waits for its time to pass" if e.leaf.kind == "wait" else ""
    sentence = f"{e.leaf.path!r} had run for {e.ended - e.began:.2f} s{waits}; {came}"
    return e.cause("RUNNING", sentence)


def _held_up(e: Evidence) -> Cause | None:
    """Cause for another arm that this one waited for, by its guard."""
    notes = e.notes("guard", since=e.began, until=e.ended + 0.05)
    reasons = [e.reason, *(str(note["reason"]) for note in reversed(notes[-3:]))]
    if e.code != "TIMED_OUT" and not (notes and notes[-1]["does"] == "stopped"):
        return _waited_for(e)
    for reason in reasons:
        for other in e.record.arms:
            if other != e.arm and f"{other}/" in reason:
                cause = other_arm(e, other)
                return e.cause(cause.kind, f"{cause.sentence}; {reason}", cause.remedy)
    return None


def _waited_for(e: Evidence) -> Cause | None:
    """Cause for another arm at the target of a leaf that has not moved its own arm."""
    wanted = target_of(e)
    tools = [e.scene(time).tool(e.arm) for time in (e.began, e.ended)]
    if wanted is None or tools[0] is None or tools[1] is None:
        return None
    if float(np.linalg.norm(tools[1] - tools[0])) > _STILL_M:
        return None
    now = e.scene(e.ended)
    meant = now.holders(str(e.ports.get("into")))  # it is to be there
    for body in now.near(wanted[1], _AT_TARGET_M):
        owner = body.partition("/")[0]
        other = (now.holders(owner) or [owner])[0]
        if other not in meant and other in e.record.arms and other != e.arm:
            cause = other_arm(e, other)
            sentence = f"{cause.sentence}; {body} is at the tool's goal"
            return e.cause(cause.kind, sentence, cause.remedy, leaf=cause.leaf)
    return None


def _usual(e: Evidence) -> str:
    """Clause on the longest successful run of the same leaf; empty if there is none."""
    took = [end.time - e.leaf.begun(end).time for end in e.leaf.changes if end.new == "SUCCESS"]
    return f"; an earlier run took {max(took):.2f} s" if took else ""


def _ended_with_run(e: Evidence) -> bool:
    """Whether the root was halted at the same time."""
    root: TimelineNode = e.root_cause.chain[0]
    last = root.changes[-1] if root.changes else None
    return last is not None and last.new == "INVALID" and abs(last.time - e.root_cause.time) < 1e-6


# Causes that lie with another arm: waits for a signal, a rendezvous, a claim or a free path.

_WAIT_CODES: Final = frozenset({"", "HALTED", "TIMEOUT", "PARTNER_GONE", "DEADLOCK"})


def coordination_causes(e: Evidence) -> Iterator[Cause]:
    """Yields causes of a node that waited for other arms: what they did meanwhile."""
    if e.code not in _WAIT_CODES:
        return
    if e.code == "DEADLOCK":
        remedy = "meet and claim in the same order in all trees, or give one wait a timeout"
        if "cannot go on" in e.reason or "cannot return" in e.reason:  # an arm is in the way
            remedy = "let the arm that waits do so elsewhere, or come there later"
        elif "prescribed path" in e.reason:
            remedy = "let one arm move when the other is done: claim a zone, or meet in between"
        yield e.cause("DEADLOCK", e.reason, remedy, leaf=e.leaf.path)
        return
    waits = [
        note
        for note in e.notes("waits", since=e.began, until=e.ended)
        # With the node itself its wait ends as well.
        if note["leaf"] == e.leaf.path and not (note.get("ended") and note["time_s"] >= e.ended)
    ]
    if (waits and waits[-1].get("ended")) or (not waits and e.code != "PARTNER_GONE"):
        return
    others = [str(other) for other in waits[-1]["others"]] if waits else []
    what = f"{e.arm} {e.reason}" if e.reason.startswith("waits ") else e.reason
    if waits:
        since = float(waits[-1]["since"])
        wait = waiting_sentence(str(waits[-1]["target"]), others, since)
        repeats = not e.reason or e.reason.startswith(wait)
        what = f"{e.arm} {wait}" if repeats else f"{e.arm} {wait} ({e.reason})"
    for other in others or [name for name in e.timeline.roots if f"{name} " in e.reason]:
        if other == e.arm or other not in e.timeline.roots:
            continue
        # Grasping is the only thing for which it does not help that the other arm goes away.
        named = e.ports.get("object") if e.leaf.kind in GRASPING_LEAVES else None
        is_in_path = bool(waits) and waits[-1]["target"] == "path"
        if is_in_path and isinstance(named, str) and named in e.scene(e.ended).held(other):
            remedy = f"let {other} place {named} before {e.leaf.path!r}"
            yield e.cause("HELD", f"{other} holds {named} already: {what}", remedy)
        removal = e.timeline.removal(other)
        if removal is not None and removal[1].time <= e.ended:
            cause = taken_away(e, other, removal)
            sentence = f"{cause.sentence}: {what.partition(f': {other} was removed')[0]}"
            remedy = f"remove {other} when {e.leaf.path!r} has ended"
            yield replace(cause, sentence=sentence, remedy=remedy)
            continue
        sentence, leaf, time = _meanwhile(e, other)
        yield e.cause("OTHER_ARM", f"{what}: {sentence}", leaf=leaf, time_s=time)


def _meanwhile(e: Evidence, other: str) -> tuple[str, str, float | None]:
    """What another arm did when the wait ended: a sentence, the leaf, the time of its end."""
    root = e.timeline.roots[other]
    failed = root.last("FAILURE")
    if failed is not None and failed.time <= e.ended:
        deciding = descend(root, failed)
        end = deciding.end or failed
        sentence = f"{other} had failed at {end.time:.2f} s, at {deciding.leaf.path!r}"
        how = ": ".join(filter(None, (end.code, end.reason)))
        return f"{sentence} with {how}" if how else sentence, deciding.leaf.path, end.time
    doing = [node.path for node in root.at_work(e.around)]
    if doing:
        return f"{other} was at {doing[0]!r} then", doing[0], None
    return f"the tree of {other} was {root.status_at(e.around)} then", "", None
