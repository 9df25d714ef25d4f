"""The approach of a grasp, and what the arm has to be able to do after it."""

from __future__ import annotations

from collections.abc import Generator, Iterator, Sequence
from dataclasses import dataclass
from itertools import islice

import numpy as np

from bt_dualarm.arm.arm import Arm
from bt_dualarm.arm.branches import MOST_BRANCHES, beginning_at, first_possible
from bt_dualarm.collision.checker import Contact, overlap_with_fixed
from bt_dualarm.core.errors import Failure, nearest_to_success
from bt_dualarm.core.pose import Matrix, Pose, Vector
from bt_dualarm.grasping.candidates import CLEAR, RankedGrasp
from bt_dualarm.grasping.grasp import Grasp
from bt_dualarm.planning.problem import QUICK_CHECKS, refuse_contact
from bt_dualarm.sim.object_body import body_of
from bt_dualarm.sim.world import World
from bt_dualarm.skill.grasp_search import WantedGrasp, goals_with_room
from bt_dualarm.skill.placing import LEAST_ROOM_M, LOWEST_M, SEARCH_M
from bt_dualarm.skill.retreat import RetreatTo, possible_retreats
from bt_dualarm.skill.symmetry import goals_alike
from bt_dualarm.trajectory.paths import line
from bt_dualarm.trajectory.trajectory import Trajectory

_OPENINGS = 8  # openings to check while the fingers close next to other parts
_PASSING = 3  # openings with which the hand passes other parts of the object
_INSIDE_M = 0.0025  # overlap from which the object has no room: more than holes are off
_RETREAT_M = 0.05  # length of the retreat from a goal
_CHECKS = 48  # descents to a goal that are checked, to all poses that look like it together

TRIES = 16
"""Grasps for which an approach is searched until the object counts as out of reach."""

_SEARCHES = 3
"""Grasps to which no path may be found before the search for the others checks less: each takes
seconds of computing, and an arm that is enclosed finds none to any of them."""

_ONWARD_ROOM_M = 0.006
"""Distance that the arm keeps along the path of a part, if a grasp allows it: softly followed, the
part turns in the hand, and the way back begins with that."""

_OWN_ROOM_M = 0.005
"""Distance of the object from the arm's own links, where it is picked and when it is lifted."""

_ROOMIER = 8
"""Further grasps that are tried for one with that room."""

# Differences of two tool poses within which both are assumed reachable or neither
_NEAR_M = 0.02
_NEAR_RAD = 0.2


class UnsuitedGoalFailure(Failure):
    """With no grasp the arm could set the object down at the goal."""


@dataclass(frozen=True, eq=False)
class GraspApproach:
    """Planned approach of a grasp.

    Attributes:
        ranked: Grasp at its end.
        to_standoff: Collision-free motion to the standoff.
        rows: Configurations of the straight part, of shape (n, dof), rad.
        standoff: Length of the straight part, m.
    """

    ranked: RankedGrasp
    to_standoff: Trajectory
    rows: Matrix
    standoff: float

    @property
    def out(self) -> Pose:
        """Pose of the tool in the world at the standoff."""
        return self.ranked.tool @ Pose.from_rpy((0.0, 0.0, -self.standoff))

    def back_out(self, arm: Arm, speed: float) -> Iterator[float]:
        """Retreat along the straight part, so that another attempt begins at the standoff.

        Args:
            arm: Arm that stands somewhere on it.
            speed: Fraction of its limits, above 0 to 1.
        """
        rows = arm.line_on(self.out)
        motion = arm.begin(arm.time_path(rows, speed), may_touch=True)
        while not motion.done:
            yield motion.progress
            arm.check()
        yield from arm.settle()


def first_approach(
    arm: Arm,
    order: Sequence[RankedGrasp],
    wanted: WantedGrasp,
    standoff: float,
    speed: float,
    seen: Pose | None = None,
    lift: float = 0.0,
) -> Generator[None, None, GraspApproach]:
    """Plan the approach of the first of several grasps that has one; yields once per tick.

    Args:
        arm: Arm with its gripper open.
        order: Grasps, the best first.
        wanted: Specification of the grasp.
        standoff: Length of the straight part, m.
        speed: Fraction of the arm's limits up to the standoff, above 0 to 1.
        seen: Estimated pose of the object in the world, at which the plan then avoids it.
        lift: Height by which the arm must be able to lift the object straight up, m.

    Raises:
        Failure: ``OUT_OF_REACH`` with the reason of the grasp that came nearest to success, caused
            by all, as an `UnsuitedGoalFailure` if it is the goal; ``OVERLOADED``; ``BUSY``.
    """
    began_s = arm.time
    reasons = list[Failure]()
    unsuited = set[int]()
    left = list(order)
    beyond = list[Pose]()
    cramped: GraspApproach | None = None
    roomier = _ROOMIER
    searched = 0  # in vain
    checks = arm.checks
    while left and len(reasons) < TRIES and roomier:
        # What is next to an unreachable grasp, or to one that does not suit the goal, is no better:
        # it comes last.
        other = (one for one in left if not any(_is_near(one.tool, pose) for pose in beyond))
        ranked = next(other, left[0])
        left.remove(ranked)
        out = ranked.tool @ Pose.from_rpy((0.0, 0.0, -standoff))
        suits = False
        try:
            if wanted.goal is not None:
                refuse_goal(arm, wanted.name or "", wanted.goal, ranked.grasp)
            suits = True
            room = 0.0 if wanted.onward is None else _ONWARD_ROOM_M
            try:
                rows = yield from _rows_to(arm, out, ranked, wanted, seen, lift, room)
            except Failure:
                if not room:
                    raise
                beyond.append(ranked.tool)
                if cramped is not None:
                    roomier -= 1
                    continue
                room = 0.0
                rows = yield from _rows_to(arm, out, ranked, wanted, seen, lift)
            turned = arm.turned([rows])
            estimated = {wanted.name: seen} if seen is not None and wanted.name else {}
            arm.checks = checks if searched < _SEARCHES else min(checks, QUICK_CHECKS)
            try:
                with arm.avoiding(estimated):
                    motion = yield from arm.plan(
                        [rows[0]], speed, began_s=began_s, turned=[one[0] for one in turned]
                    )
            finally:
                arm.checks = checks
            found = GraspApproach(
                ranked, motion, beginning_at(motion.end, (rows, *turned)), standoff
            )
            if wanted.onward is None or room:
                return found
            cramped = found
        except Failure as failure:
            if failure.code in ("BUSY", "OVERLOADED"):
                raise
            searched += failure.code == "NO_PLAN"
            if not suits:
                unsuited.add(len(reasons))
            reasons.append(failure.with_traceback(None))  # a traceback would keep this frame alive
            if failure.code == "UNREACHABLE" or not suits:
                beyond.append(ranked.tool)
        yield
    if cramped is not None:
        return cramped
    nearest = nearest_to_success(reasons)
    what = f"no path to {wanted.label}"
    kind = Failure
    if reasons.index(nearest) in unsuited:
        what = f"{wanted.label} could not be set down at `then_at`"
        kind = UnsuitedGoalFailure
    raise kind(
        "OUT_OF_REACH",
        f"{what}: {nearest.reason}",
        plans_tried=len(reasons),
        **nearest.numbers,
    ) from ExceptionGroup("no way", reasons)


def _rows_to(
    arm: Arm,
    out: Pose,
    ranked: RankedGrasp,
    wanted: WantedGrasp,
    seen: Pose | None,
    lift: float,
    room: float = 0.0,
) -> Generator[None, None, Matrix]:
    """Configurations along the line to a grasp, in a branch in which the arm can do what follows.

    That is the approach itself, the lift, and where the object moves on a joint, to move it. Yields
    once for two branches that are refused.

    Args:
        arm: Arm with its gripper open.
        out: Pose of the tool at the standoff.
        ranked: The grasp.
        wanted: Specification of the grasp.
        seen: As for `first_approach`.
        lift: As for `first_approach`.
        room: Distance that the arm keeps from everything where it moves the object, m.

    Raises:
        Failure: That of the preferred branch: ``IN_COLLISION``, ``PATH_BROKEN``, ``SINGULAR``, or
            ``OVERLOADED``; as `Kinematics.branches_along`.
    """
    tool = ranked.tool
    poses = line(out, tool).poses
    onward = wanted.onward
    later = [] if onward is None else [move @ tool for move in onward.moves]
    touched = frozenset({wanted.name} if wanted.name else ())
    free = _geoms_of_part(arm.world, wanted) if onward is not None else None

    def attempt(whole: Matrix) -> Matrix:
        rows = whole[: len(poses)]
        if onward is not None and free is not None:
            # As the arm will follow it from there: a redundant one may do so otherwise.
            after = arm.kinematics.follow_on(later, rows[-1])
            onward.refuse_contact(arm, after, free, room)
        if lift > 0.0:
            lifted = arm.line_after(rows[-1], tool.raised(lift))
            _refuse_own_links(arm, wanted, lifted, lift)
        if wanted.name and wanted.edges is None:
            arm.refuse_load(wanted.name, rows[-1], seen)
        arm.refuse_collision_along(rows, ignore=touched)
        _refuse_beside(arm, wanted, rows, ranked.grasp.width)
        _refuse_other_parts(arm, wanted, rows, ranked.grasp.width)
        return rows

    branches = arm.kinematics.branches_along([*poses, *later], arm.setpoint.q)
    return (yield from first_possible(branches, attempt, per_tick=2, is_final=arm.is_of_hand))


def refuse_goal(
    arm: Arm, name: str, goal: Pose, grasp: Grasp, absent: frozenset[str] = frozenset()
) -> None:
    """Check that a grasp lets the arm set an object down at a goal, and retreat.

    As `place` does it: the object must have room there, the descent is as low as the surroundings
    require, and could go on below the goal; the fingers open no wider than there is room for, and
    the retreat may be short. The configuration is noted in `KnownObjects.goals`.

    Args:
        arm: Arm with its gripper open.
        name: Name of the object.
        goal: Pose of the object in the world.
        grasp: The grasp.
        absent: Names of arms that will not be there.

    Raises:
        Failure: That of the goal as given: ``IN_COLLISION``, ``UNREACHABLE``, ``PATH_BROKEN`` or
            ``SINGULAR``, if none of the goals that the object's symmetry allows is possible.
    """
    if arm.world.objects[name].is_free:
        # A goal may be too low for its support, and one in a hole may slope, or be beside it.
        overlap: Contact | None = None
        for pose in (goal, goal.raised(LOWEST_M)):
            overlap = overlap_with_fixed(arm.world, name, pose)
            if overlap is None or overlap.depth < _INSIDE_M:
                break
        else:
            if overlap is not None:
                raise overlap.failure()
    held = absent | {name}
    closed = arm.checker(held)
    opening: float | None = None
    if arm.name in arm.world.grippers and arm.gripper.description.fingers:
        closed.open_fingers(grasp.width)
        opening = min(grasp.width + 2.0 * LEAST_ROOM_M, arm.gripper.description.stroke)
    (goals,) = goals_with_room(arm, name, goal, [grasp])
    if not goals:
        goals = tuple(pose for _, pose in goals_alike(arm.world, name, goal))
    most = min(max(_CHECKS // len(goals), 1), MOST_BRANCHES)
    first: Failure | None = None
    for alike in goals:
        tool = alike @ grasp.tool
        if first is not None and arm.kinematics.is_beyond(tool):
            continue  # a search takes milliseconds
        retreats = possible_retreats(arm, tool, name, grasp.tool.inverse, _RETREAT_M)
        try:
            lines = arm.lines(tool.raised(LOWEST_M), tool, tool.raised(-SEARCH_M))
            for down, _ in islice(lines, most):
                contact = closed.first_contact(down)
                try:
                    if contact is not None:
                        raise contact[1].failure()
                    _refuse_retreats(arm, down[-1], retreats, held, opening)
                except Failure as failure:
                    first = first or failure.with_traceback(None)  # would keep this frame alive
                    if arm.is_of_hand(failure):
                        break
                else:
                    arm.known.goals[name] = down[-1]
                    return
        except Failure as failure:
            first = first or failure.with_traceback(None)
    if first is not None:
        raise first


def _refuse_retreats(
    arm: Arm,
    q: Vector,
    retreats: Sequence[RetreatTo],
    held: frozenset[str],
    opening: float | None,
) -> None:
    """Check that one of some retreats is possible from a configuration, of shape (dof,), rad.

    Raises:
        Failure: That of the first one, if none is.
    """
    first: Failure | None = None
    for retreat in retreats:
        try:
            rows = arm.line_after(q, retreat.end)
            arm.refuse_collision_along(rows, held, opening=opening)
            retreat.refuse_links(arm, rows)
        except Failure as failure:
            first = first or failure.with_traceback(None)
        else:
            return
    if first is not None:
        raise first


def _geoms_of_part(world: World, wanted: WantedGrasp) -> list[int]:
    """Geoms of the part at which something is grasped; of all parts if none is named."""
    name = wanted.name or ""
    parts = body_of(world.objects[name]).parts
    return [
        geom
        for geom, part in zip(world.object_geoms(name), parts, strict=True)
        if wanted.part in (None, part.name)
    ]


def _refuse_own_links(arm: Arm, wanted: WantedGrasp, rows: Matrix, lift: float) -> None:
    """Check that no link of the arm is next to the object, at its place and when it is lifted.

    Everything else that it could touch depends on the grasp only, or not even on that.

    Args:
        arm: Arm with its gripper open.
        wanted: Specification of the grasp.
        rows: Configurations of the lift, of shape (n, dof), rad.
        lift: Its height, m.

    Raises:
        Failure: ``IN_COLLISION`` with the object.
    """
    world = arm.world
    name = wanted.name
    if name is None or name not in world.objects or not world.objects[name].is_free:
        return
    checker = arm.checker()
    checker.keep_clear(_OWN_ROOM_M)
    body = world.arms[arm.name]
    links = list(body.geom_ids - body.tool_geom_ids)
    its = list(world.payload_geoms(name))
    allowed = np.full_like(checker.least, -np.inf)
    for one, other in ((links, its), (its, links)):
        pairs = np.ix_(one, other)
        allowed[pairs] = checker.least[pairs]
    checker.least[:] = allowed
    for row in (0, len(rows) // 2, len(rows) - 1):
        checker.move_object(name, wanted.object_pose.raised(lift * row / max(len(rows) - 1, 1)))
        contact = checker.contact(rows[row])
        if contact is not None:
            raise contact.failure()


def _refuse_beside(arm: Arm, wanted: WantedGrasp, rows: Matrix, width: float) -> None:
    """Check that the hand touches nothing but one part of something that moves on a joint.

    What cannot be lifted does not yield either, where another part is next to a finger.

    Args:
        arm: Arm with its gripper open.
        wanted: Specification of the grasp.
        rows: Configurations of the approach, of shape (n, dof), rad.
        width: Opening around the part, m.

    Raises:
        Failure: ``IN_COLLISION`` with the object.
    """
    world = arm.world
    obj = world.objects.get(wanted.name or "")
    if obj is None or obj.joint is None or wanted.name is None:
        return
    checker = arm.checker()
    its = _geoms_of_part(world, wanted)
    checker.least[its, :] = checker.least[:, its] = -np.inf
    refuse_contact(checker, rows)
    description = arm.gripper.description
    for opening in np.linspace(description.stroke, width, _OPENINGS) if description.fingers else ():
        checker.open_fingers(float(opening))
        contact = checker.contact(rows[-1])
        if contact is not None:
            raise contact.failure()


def _refuse_other_parts(arm: Arm, wanted: WantedGrasp, rows: Matrix, width: float) -> None:
    """Check that the open hand passes the walls of something hollow, and other parts of a compound.

    Its opening on the way is between the widest and the one just before it closes.

    Args:
        arm: Arm with its gripper open.
        wanted: Specification of the grasp.
        rows: Configurations of the approach, of shape (n, dof), rad.
        width: Opening around the part, m.

    Raises:
        Failure: ``IN_COLLISION`` with the object.
    """
    world = arm.world
    name = wanted.name
    description = arm.gripper.description
    if (
        name is None
        or wanted.edges is not None
        or wanted.section is not None
        or not description.fingers
    ):
        return
    if not world.objects[name].is_free or len(body_of(world.objects[name]).parts) < 2:
        return
    checker = arm.checker(frozenset(world.objects.keys() - {name}))
    checker.move_object(name, wanted.object_pose)
    for opening in np.linspace(
        description.stroke, min(width + 2.0 * CLEAR, description.stroke), _PASSING
    ):
        checker.open_fingers(float(opening))
        refuse_contact(checker, rows)


def _is_near(one: Pose, other: Pose) -> bool:
    return one.distance(other) < _NEAR_M and one.angle(other) < _NEAR_RAD
