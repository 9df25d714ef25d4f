"""Handover of an object from one arm to another: where, with which grasp, and in which steps.

The arms announce every step to each other, see `bt_dualarm.skill.joint`:

1. The taker chooses the pose of the object and its own grasp by the reach of both arms.
2. Both move there, the taker to the standoff of its grasp.
3. The taker closes next to the giver's fingers, compliant, and takes over the weight.
4. When the taker feels the weight, and the giver the decrease, the giver announces
   its release. The taker confirms that it keeps the object; only then does the giver open.
5. The giver retreats, the taker lifts the object and checks its grip.

Until the confirmation of step 4 the giver keeps the object, whatever happens; afterwards the taker
does. At least one of them holds it at all times.
"""

from __future__ import annotations

import itertools
import math
from collections import deque
from collections.abc import Generator, Iterator
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from bt_dualarm.arm.arm import Arm
from bt_dualarm.arm.passengers import stands_at
from bt_dualarm.arm.payload import UNKNOWN_KG, cup_measures, jaw_measures
from bt_dualarm.collision.checker import CollisionChecker
from bt_dualarm.collision.distance import HANDS_APART_M, HANDS_M, PLANNING_MARGIN_M
from bt_dualarm.control.dynamics import ArmDynamics, refuse_overload
from bt_dualarm.core.errors import Failure
from bt_dualarm.core.pose import Matrix, Pose, Vector
from bt_dualarm.grasping.candidates import (
    CLEAR,
    TOUCHING,
    Obstacle,
    clearances,
    cup_grasps,
    jaw_grasps,
    least_width,
    ranked,
)
from bt_dualarm.grasping.grasp import Box, CupMeasures, Grasp, JawMeasures, Load
from bt_dualarm.kinematics.inverse_kinematics import Kinematics
from bt_dualarm.kinematics.multi_arm import MultiArmKinematics, ToolTarget
from bt_dualarm.sim.grippers import SharedGrasp
from bt_dualarm.sim.object_body import body_of
from bt_dualarm.sim.world import World
from bt_dualarm.skill.grasp_approach import refuse_goal
from bt_dualarm.skill.grasp_search import GRAVITY, obstacles_around
from bt_dualarm.skill.joint import shared_grasp
from bt_dualarm.skill.symmetry import goals_alike, turns_alike
from bt_dualarm.trajectory.paths import line
from bt_dualarm.trajectory.trajectory import Trajectory

_SHARES: Final = (0.0, 0.25, -0.25, 0.5, -0.5, 0.75, -0.75)
"""Grasp positions of the taker along a long object, as fractions of half its length."""

_FINE_SHARES: Final = tuple(np.linspace(-0.9, 0.9, 31).tolist())
"""Those that are tried if none of the above is near enough to its center for the load, and far
enough from the giver's hand."""

_PLANNED_M: Final = HANDS_M + 0.004
"""Distance of the hands that plans keep, m: more than the guard keeps."""

_ROOM_M: Final = HANDS_M + 0.003
"""Clearance of a grasp from the giver's hand, m: the hands keep `HANDS_M`."""

_GOAL_ROOM_M: Final = 0.001
"""Distance of the hand from everything at `then_at`, m: in less room the fingertips would touch the
floor of a bin before the object, if that has moved by micrometers in the hand."""

_CLEAR_M: Final = 0.01
"""Distance of arms that wait from everything that is no arm, m."""

_TOUCH_RADIUS_M: Final = 0.004
"""Radius of the flat spot that a tool without a gripper touches, m."""

_PALM_M: Final = 0.004
"""Additional clearance of the palm, m: the giver does not know the object's pose exactly."""

# Candidate poses of the object.

_GRID_M: Final = 0.1  # distance of candidate positions
_BEST_SHARE: Final = 0.62  # distance from the first joint, as a fraction of the reach
_MOST_SHARE: Final = 0.88  # positions beyond it are not considered
_LEAST_SHARE: Final = 0.30
_POSITIONS: Final = 14
_MORE_POSITIONS: Final = 60  # where only one orientation is tried at each
_APART_M: Final = 0.12  # minimum distance between two chosen positions
_TURNS: Final = np.deg2rad([0.0, 90.0, 180.0, 270.0])  # about the giver's tool axis

_SPINS: Final = np.deg2rad([30, -30, 60, -60, 90, -90, 120, -120, 150, -150, 180])
"""Rotations about the vertical of an object on which something rides."""

_BACK_M: Final = 0.1
_BACK: Final = Pose.from_rpy((0.0, 0.0, -_BACK_M))
"""Retreat for which the giver needs room."""

# Costs; all terms are between 0 and about 2.

_POSITION_COST: Final = 3.0
_STOOD_COST: Final = 3.0  # cost of a hand that has no room where the object stood
_GROUND_M: Final = 1.0  # half the size of the ground there
_DOWN_COST: Final = 0.35  # cost if the giver points down instead of toward the taker
_TURN_COST: Final = 0.4  # cost of rotating the giver's tool by 180°
_ALIKE_COST: Final = 0.1  # cost of the largest rotation by which an object looks the same
_EACH: Final = 3  # grasps that are tried at a pose
_OF_FIXED: Final = 72  # grasps in all if the giver fixes the pose
_TRIES: Final = 260  # poses with a grasp for which both arms are searched
_PLANS: Final = 5  # plans that are proposed
_NEAR_RAD: Final = 0.4  # rotation of two grasps that count as the same
_NEAR_M: Final = 0.015


@dataclass(frozen=True, eq=False)
class HandoverWish:
    """Requirements of the giver for the handover.

    Attributes:
        position: Position of the object in the world, of shape (3,), m; None for any.
        quaternion: Its orientation in the world; None for any.
        mass: Mass by the giver's estimate, with its uncertainty, kg; None if it does not know it.
    """

    position: Vector | None = None
    quaternion: Vector | None = None
    mass: float | None = None


@dataclass(frozen=True, eq=False)
class HandoverPlan:
    """Where the object is handed over, and the grasp with which it is taken.

    Attributes:
        number: Number of the plan, from 1.
        object_pose: Pose of the object in the world.
        giver_q: Configuration of the giver, of shape (dof,), rad.
        taker_q: Configuration of the taker at the standoff, of shape (dof,), rad.
        grasp: Grasp of the taker on the object.
    """

    number: int
    object_pose: Pose
    giver_q: Vector
    taker_q: Vector
    grasp: Grasp


def handover_label(obj: str, giver: str, taker: str) -> str:
    """Returns the displayed name of a handover, the same for both arms."""
    return f"the handover of {obj!r} from {giver} to {taker}"


def tool_pose_of(world: World, arm: str) -> Pose:
    """Measured pose of an arm's tool in the world, from its encoders."""
    return world.nominal[arm].tool_pose_at(world.hardware[arm].q)


def object_in_tool(world: World, arm: str, obj: str) -> Pose:
    """Estimated pose of a held object in the arm's tool frame.

    Raises:
        Failure: ``PARTNER_GONE``: the arm no longer holds it.
    """
    held = world.attachments.find(arm, obj)
    if held is None:
        raise Failure("PARTNER_GONE", f"{arm} no longer holds {obj!r}")
    return world.robots[arm].tool.inverse @ held.relative


def object_in_hand(arm: Arm, giver: str, obj: str) -> Pose:
    """Pose of an object in the giver's tool frame, as the taker knows it.

    As its camera has seen the object in the giver's hand; otherwise by the giver's estimate.

    Raises:
        Failure: ``PARTNER_GONE``: the giver no longer holds it.
    """
    estimate = object_in_tool(arm.world, giver, obj)
    seen = arm.known.seen_in_hand(obj, giver)
    return estimate if seen is None else arm.world.robots[giver].tool.inverse @ seen


class HandoverSearch:
    """Searches for a pose of the object and a grasp with which two arms can hand it over.

    The pose of the object, and with it both arms' configurations, are the solution of one problem
    of inverse kinematics with both arms (`MultiArmKinematics`): the giver's tool at a pose in the
    world, the taker's at a pose seen from the giver's.

    Args:
        arm: Taker.
        giver: Name of the giver, which holds the object.
        obj: Name of the object.
        wish: Requirements of the giver.
        standoff: Length of the taker's straight approach, m.
        margin: Safety factor of the taker's grip.
        shake: Acceleration of the tool that the grip must withstand, m/s².
        most_force: Largest force of each pad, or of a cup, that the object withstands, N.
        mass: Mass by the taker's tree, kg; None to use what one of the arms knows.
        goal: Pose of the object in the world at which the taker will set it down; None for any.

    Attributes:
        known_mass: Mass that one of the arms knows, kg; None if it is assumed.
    """

    def __init__(
        self,
        arm: Arm,
        giver: str,
        obj: str,
        wish: HandoverWish,
        *,
        standoff: float,
        margin: float,
        shake: float,
        most_force: float,
        mass: float | None,
        goal: Pose | None = None,
    ) -> None:
        self._arm = arm
        self._goal = goal
        self._giver = giver
        self._object = obj
        self._wish = wish
        self._standoff = standoff
        world = self._world = arm.world
        self._in_giver = object_in_hand(arm, giver, obj)
        self._giver_q = world.hardware[giver].q.copy()
        declared = world.objects[obj]
        self._solid = world.object_solid(obj)
        self._alike = turns_alike(declared)
        is_fixed = wish.position is not None and wish.quaternion is not None
        self._each = max(_EACH, _OF_FIXED // len(self._alike)) if is_fixed else _EACH
        self._center = world.loaded_center(obj)
        self._middle = body_of(declared).middle
        self.known_mass = mass or wish.mass or arm.known.mass(obj)
        self.mass = self.known_mass or UNKNOWN_KG
        self._obstructed_at_goal = False
        self._cramped = np.zeros(0)
        self.grasps = self._grasps(margin, shake, most_force)
        self._kinematics = {
            name: Kinematics(world.robots[name], world.arms[name].base, 0)
            for name in (giver, arm.name)
        }
        holding = world.nominal[giver]
        self._giver_dynamics = ArmDynamics(holding, holding.loads)
        self._released_dynamics = ArmDynamics(holding)
        self._both = MultiArmKinematics(
            {name: (world.robots[name], world.arms[name].base) for name in (giver, arm.name)}
        )
        self.tries = 0
        self.reasons: dict[str, int] = {}
        self._unsuited: dict[int, Failure | None] = {}

    def find(self) -> Iterator[HandoverPlan | None]:
        """Yields plans, the best first, and None where a tick passes without one."""
        found = 0
        for plan in self._plans():
            found += plan is not None
            yield plan
        # Grasps with room where the object stood may be those that no arm reaches.
        if not found and self._goal is None and 0 < self._cramped.sum() < len(self._cramped):
            self._cramped[:] = 0.0
            yield from self._plans()

    def _plans(self) -> Iterator[HandoverPlan | None]:
        """Result of `find` for one order of the grasps."""
        number = 0
        most = self.tries + _TRIES
        sharing = (SharedGrasp(self._giver, self._object, _PLANNED_M),)
        margins = dict.fromkeys(self._world.arms, PLANNING_MARGIN_M)
        obj = frozenset({self._object})
        absent = frozenset({self._arm.name})
        here = CollisionChecker(self._world, self._giver, margins, absent)
        back = CollisionChecker(self._world, self._giver, margins, absent | obj)
        there = CollisionChecker(self._world, self._arm.name, margins, obj, sharing=sharing)
        giver = CollisionChecker(self._world, self._giver, margins)
        taker = CollisionChecker(self._world, self._arm.name, margins, obj)
        taken = (SharedGrasp(self._arm.name, self._object, _PLANNED_M),)
        leaving = CollisionChecker(self._world, self._giver, margins, obj, sharing=taken)
        for checker in (here, taker):  # of the configurations in which the arms wait
            checker.keep_clear(_CLEAR_M)
        found = list[HandoverPlan]()
        for object_pose in self._poses():
            tool = object_pose @ self._in_giver.inverse
            refused = False
            for grasp in self._best(object_pose, tool):
                if self.tries >= most or number >= _PLANS or refused:
                    break
                if grasp is None:
                    yield None
                    continue
                if self._kinematics[self._arm.name].is_beyond(object_pose @ grasp.tool):
                    self._note(f"UNREACHABLE of {self._arm.name}")
                    continue
                self.tries += 1
                plan, refused = self._try(
                    object_pose, tool, grasp, (here, back, there, giver, taker, leaving)
                )
                if plan is None:
                    yield None
                    continue
                if any(_alike(plan, other) for other in found):
                    continue
                number += 1
                plan = HandoverPlan(
                    number, plan.object_pose, plan.giver_q, plan.taker_q, plan.grasp
                )
                found.append(plan)
                yield plan
                break  # another pose next
            if self.tries >= most or number >= _PLANS or self._suits_none:
                return

    def _try(
        self,
        object_pose: Pose,
        tool: Pose,
        grasp: Grasp,
        checkers: tuple[CollisionChecker, ...],
    ) -> tuple[HandoverPlan | None, bool]:
        """Plan for a pose and a grasp, or None; and whether the giver is the reason."""
        here, back, there, giver, taker, leaving = checkers
        arm = self._arm
        seen = tool.inverse @ object_pose @ grasp.tool
        try:
            q = self._both.solve(
                (
                    ToolTarget(self._giver, tool),
                    ToolTarget(arm.name, seen, seen_from=self._giver),
                ),
                {self._giver: self._giver_q, arm.name: arm.setpoint.q},
            )
        except Failure as failure:
            presents = failure.numbers.get("arm") != self._giver or self._presents(tool)
            who = "both" if presents else self._giver
            self._note(f"{failure.code} of {who}")
            return None, not presents
        giver_q = q[self._giver]
        contact = here.contact(giver_q)
        if contact is not None:
            self._note(f"{contact.first} at {contact.second}")
            return None, True
        if not self._can_retreat(giver_q, back):
            self._note(f"the retreat of {self._giver}")
            return None, True
        goal = object_pose @ grasp.tool
        out = goal @ Pose.from_rpy((0.0, 0.0, -self._standoff))
        try:
            rows = arm.line(out, goal)
        except Failure as failure:
            self._note(f"{failure.code} of the approach")
            return None, False
        body = self._world.arms[self._giver]
        try:
            holding = self._giver_dynamics.at_rest(giver_q)
            refuse_overload(holding[None], self._world.robots[self._giver])
        except Failure as failure:
            self._note(f"{failure.code} of {self._giver}")
            return None, True
        try:
            for pose, row in ((out, rows[0]), (goal, rows[-1])):
                arm.refuse_load(self._object, row, pose @ grasp.tool.inverse)
        except Failure as failure:
            self._note(f"{failure.code} of {arm.name}")
            return None, False
        there.move_other(body, giver_q)
        found = there.first_contact(rows)
        if found is not None:
            self._note(f"{found[1].first} at {found[1].second}")
            return None, False
        # Each arm comes to its place while the other one may already be at its own.
        taker.move_other(body, giver_q)
        giver.move_other(self._world.arms[arm.name], rows[0])
        contact = taker.contact(rows[0]) or giver.contact(giver_q)
        if contact is not None:
            self._note(f"{contact.first} at {contact.second}, at the standoff")
            return None, False
        leaving.move_other(self._world.arms[arm.name], rows[-1])
        if not self._can_leave(giver_q, goal, leaving):
            self._note(f"the retreat of {self._giver} beside {arm.name}")
            return None, False
        return HandoverPlan(0, object_pose, giver_q, rows[0], grasp), False

    def _presents(self, tool: Pose) -> bool:
        """Whether the giver reaches a pose of its tool, whatever the taker does.

        The best attempt for both misses either target, or both.
        """
        try:
            self._kinematics[self._giver].solve(tool, self._giver_q)
        except Failure:
            return False
        return True

    def _can_retreat(self, q: Vector, checker: CollisionChecker) -> bool:
        """Whether the giver can retreat straight from a configuration of shape (dof,), rad."""
        kinematics = self._kinematics[self._giver]
        here = kinematics.forward(q)
        try:
            rows = kinematics.follow_on(line(here, here @ _BACK).poses, q)
            holding = np.array([self._released_dynamics.at_rest(row) for row in rows[::4]])
            refuse_overload(holding, self._world.robots[self._giver])
        except Failure:
            return False
        return _is_free(checker, rows)

    def _can_leave(self, q: Vector, taker: Pose, checker: CollisionChecker) -> bool:
        """Whether the giver has a retreat, as `retreat_from` tries them, past the taker.

        Args:
            q: Configuration of the giver, of shape (dof,), rad.
            taker: Pose of the taker's tool, which holds the object.
            checker: Checker of the giver, with the taker where it is then.
        """
        kinematics = self._kinematics[self._giver]
        here = kinematics.forward(q)
        gripper = self._world.grippers.get(self._giver)
        has_fingers = gripper is not None and bool(gripper.gripper.fingers)
        for share in _RETREATS_M:
            for direction in _directions_from(here, taker.position, has_fingers=has_fingers):
                away = share * _BACK_M * direction
                try:
                    rows = kinematics.follow_on(line(here, here.shifted(away)).poses, q)
                except Failure:
                    continue
                if _is_free(checker, rows):
                    return True
        return False

    def _note(self, reason: str) -> None:
        self.reasons[reason] = self.reasons.get(reason, 0) + 1

    def refusal(self) -> Failure:
        """Failure that states why there is no plan."""
        arm = self._arm.name
        elsewhere = f"`point` of `grasp` chooses where {self._giver} holds it"
        if not self.grasps and self._obstructed_at_goal:
            return Failure(
                "OUT_OF_REACH",
                f"no grasp of {arm} on {self._object!r} beside the hand of {self._giver} leaves it "
                f"room at `then_at`; {elsewhere}",
            )
        gripper = self._world.grippers.get(arm)
        if not self.grasps and gripper is not None and gripper.gripper.fingers:
            opening = gripper.gripper.stroke
            width = least_width(self._solid)
            if width > opening - 2.0 * CLEAR:
                return Failure(
                    "OUT_OF_REACH",
                    f"{self._object!r} is {1e3 * width:.0f} mm wide; the fingers of {arm} open to "
                    f"{1e3 * opening:.0f} mm",
                    width_m=width,
                    opening_m=opening,
                )
        if not self.grasps:
            assumed = " (assumed, as `mass` is not given)" if self.known_mass is None else ""
            return Failure(
                "OUT_OF_REACH",
                f"no grasp of {arm} on {self._object!r} leaves the hand of {self._giver} room and "
                f"holds {self.mass:.3g} kg{assumed}; {elsewhere}",
            )
        if self._suits_none:
            first = next(iter(self._unsuited.values()))
            assert first is not None  # noqa: S101 - none suits
            return Failure(
                "OUT_OF_REACH",
                f"no grasp of {arm} on {self._object!r} beside the hand of {self._giver} lets it "
                f"set it down at `then_at`: {first.reason}",
            )
        often = sorted(self.reasons, key=lambda reason: (-self.reasons[reason], reason))
        return Failure(
            "OUT_OF_REACH",
            f"no pose of {self._object!r} lets {self._giver} present it and {arm} take it: "
            f"{', '.join(often[:3]) or 'none is within the reach of both'}",
            tries=self.tries,
        )

    # Grasps of the taker

    def _grasps(self, margin: float, shake: float, most_force: float) -> tuple[Grasp, ...]:
        """Grasps next to the giver's hand, for any direction of gravity."""
        arm = self._arm
        world = self._world
        friction = world.objects[self._object].friction
        # Gravity may have any direction, so it counts as an acceleration in the worst one.
        load = Load(margin * self.mass, np.zeros(3), shake + GRAVITY, self._center)
        if arm.name not in world.grippers:
            spot = CupMeasures(_TOUCH_RADIUS_M, 1e-3, math.inf, 1.0)
            return cup_grasps(self._solid, spot, load)
        description = world.grippers[arm.name].gripper
        if not description.fingers:
            cup = cup_measures(description, friction)
            cup = replace(cup, most_force=min(cup.most_force, most_force))
            return cup_grasps(self._solid, cup, load)
        jaw = jaw_measures(description, friction)
        jaw = replace(jaw, palm=jaw.palm - _PALM_M)
        object_pose = world.nominal[self._giver].tool_pose_at(self._giver_q) @ self._in_giver
        grasps: tuple[Grasp, ...] = ()
        for shares in (_SHARES, _FINE_SHARES):
            found = jaw_grasps(self._solid, jaw, load, jaw.friction, shares=shares)
            weak = [grasp for grasp in found if grasp.force <= most_force]
            order = ranked(weak, object_pose, jaw, self._hand(), lambda _: 0.0)
            grasps = tuple(one.grasp for one in order if one.clearance >= _ROOM_M)
            self._obstructed_at_goal = bool(grasps) and self._goal is not None
            if self._goal is not None:
                grasps = self._with_room_at(self._goal, grasps, jaw)
            else:
                self._cramped = self._cramped_where_it_stood(grasps, jaw)
            if grasps:
                break
        return grasps

    def _with_room_at(
        self, goal: Pose, grasps: tuple[Grasp, ...], jaw: JawMeasures
    ) -> tuple[Grasp, ...]:
        """Grasps with which the hand has room where the object will be set down."""
        world = self._world
        obstacles = obstacles_around(self._arm, self._object, goal.apply(self._middle))
        alike = [pose for _, pose in goals_alike(world, self._object, goal)]
        rooms = clearances(grasps, alike, jaw, obstacles).max(axis=0)
        is_free = rooms >= -TOUCHING
        self._cramped = (rooms[is_free] < _GOAL_ROOM_M).astype(float)
        return tuple(itertools.compress(grasps, is_free))

    def _cramped_where_it_stood(self, grasps: tuple[Grasp, ...], jaw: JawMeasures) -> Vector:
        """Whether the hand would have no room if the object stood as it did at first: 1, else 0.

        Where it will be placed is not known, but most probably the same side is down: a hand that
        holds it there, or near the ground, could not place it at all.
        """
        declared = self._world.declared_objects[self._object]
        stood = Pose(np.zeros(3), declared.pose.pose.quaternion)
        down = stood.inverse.turn(np.array((0.0, 0.0, -1.0)))
        ground = Pose.from_rpy((0.0, 0.0, -self._solid.reach(down) - _GROUND_M))
        below = Obstacle(Box(np.full(3, _GROUND_M)), ground)
        order = ranked(grasps, stood, jaw, [below], lambda _: 0.0)
        roomy = {id(one.grasp) for one in order if one.clearance >= _GOAL_ROOM_M}
        return np.array([id(grasp) not in roomy for grasp in grasps], dtype=float)

    def _hand(self) -> list[Obstacle]:
        """The giver's hand, and what rides on the object, as boxes around their geoms."""
        world = self._world
        sensed = world.sensed
        found = []
        geoms = set(world.arms[self._giver].tool_geom_ids)
        for one in world.passengers_of(self._object):
            geoms.update(world.object_geoms(one.object))
        for geom in sorted(geoms):
            center, half = world.model.geom_aabb[geom].reshape(2, 3)
            axes = sensed.geom_xmat[geom].reshape(3, 3)
            pose = Pose.from_axes(sensed.geom_xpos[geom].copy(), axes.tolist())
            pose = pose @ Pose.from_rpy(tuple(center.tolist()))
            found.append(Obstacle(Box(half.copy()), pose))
        return found

    def _best(self, object_pose: Pose, tool: Pose) -> Iterator[Grasp | None]:
        """Grasps that suit a pose of the object best: from the taker's side, facing the giver.

        Yields None for each that is found not to suit the goal.
        """
        if not self.grasps:
            return
        toward = object_pose.apply(self._middle) - self._kinematics[self._arm.name].bounding_ball[0]
        toward = toward / max(float(np.linalg.norm(toward)), 1e-9)
        giver_axis = tool.rotation_matrix[:, 2]
        axes = np.array([object_pose.turn(one.tool.rotation_matrix[:, 2]) for one in self.grasps])
        margins = np.array([one.margin for one in self.grasps])
        offsets = np.array(
            [object_pose.turn(one.tool.position - self._middle) for one in self.grasps]
        )
        cost = (
            1.0
            - axes @ toward
            + 0.6 * (1.0 + axes @ giver_axis)
            + 0.5 * np.maximum(axes[:, 2], 0.0)  # from below
            + 0.5 / np.minimum(margins, 4.0)
            # Near the taker rather than beyond the giver's hand.
            + 4.0 * np.maximum(offsets @ toward, -0.1)
        )
        if len(self._cramped):  # of fingers
            cost += self._cramped if self._goal is not None else _STOOD_COST * self._cramped
        chosen = list[Grasp]()
        for index in np.argsort(cost, kind="stable"):
            grasp = self.grasps[index]
            if any(
                grasp.tool.distance(other.tool) < _NEAR_M
                and grasp.tool.angle(other.tool) < _NEAR_RAD
                for other in chosen
            ):
                continue
            if self._goal is not None:
                is_new = index not in self._unsuited
                if self._unsuited_for(int(index), self._goal) is not None:
                    if is_new:
                        yield None
                    continue
            chosen.append(grasp)
            yield grasp
            if len(chosen) >= self._each:
                break

    def _unsuited_for(self, index: int, goal: Pose) -> Failure | None:
        """Why a grasp does not let the taker set the object down at a goal; None if it does.

        The other arms have left by then.
        """
        if index not in self._unsuited:
            arm = self._arm
            grasp = self.grasps[index]
            others = frozenset(arm.world.arms) - {arm.name}
            self._unsuited[index] = None
            try:
                refuse_goal(arm, self._object, goal, grasp, others)
            except Failure as failure:
                # A traceback would keep this frame alive.
                self._unsuited[index] = failure.with_traceback(None)
        return self._unsuited[index]

    @property
    def _suits_none(self) -> bool:
        """Whether no grasp lets the taker set the object down at the goal."""
        known = self._unsuited
        return len(known) == len(self.grasps) > 0 and all(known.values())

    # Poses of the object

    def _poses(self) -> Iterator[Pose]:
        """Candidate poses of the object in the world, the best first."""
        found = list[tuple[float, int, Pose]]()
        now = self._world.nominal[self._giver].tool_pose_at(self._giver_q)
        # Who asks for a pose in which what rides on it would fall, or holds it so, pours it out.
        stays = self._wish.quaternion is None and self._stands(now.quaternion)
        is_asked = self._wish.position is not None  # which is that of its frame
        for place_cost, place in self._positions():
            orientations = self._orientations(place, now)
            if stays:
                orientations = [one for one in orientations if self._stands(one[1])]
            for turn_cost, quaternion in orientations:
                tool = Pose(np.zeros(3), quaternion)
                # The position is that of the object, whichever way the tool is turned.
                turned = tool @ Pose(np.zeros(3), self._in_giver.quaternion)
                origin = place if is_asked else place - turned.turn(self._middle)
                found.append((place_cost + turn_cost, len(found), Pose(origin, turned.quaternion)))
        for _, _, pose in sorted(found, key=lambda one: one[:2]):
            yield pose

    def _stands(self, quaternion: Vector) -> bool:
        """Whether what rides on the object stands with an orientation of the giver's tool."""
        object_pose = Pose(np.zeros(3), quaternion) @ Pose(np.zeros(3), self._in_giver.quaternion)
        return stands_at(self._world, self._object, object_pose)

    def _positions(self) -> list[tuple[float, Vector]]:
        """Positions of its center and their costs: within comfortable reach of both arms."""
        if self._wish.position is not None:
            return [(0.0, self._wish.position)]
        balls = [self._kinematics[name].bounding_ball for name in (self._giver, self._arm.name)]
        centers = np.array([ball[0] for ball in balls])
        radii = np.array([ball[1] for ball in balls])
        middle = centers[0] + (centers[1] - centers[0]) * radii[0] / radii.sum()
        steps = np.arange(-1.2, 1.2 + 1e-9, _GRID_M)
        grid = np.stack(np.meshgrid(steps, steps, steps[6:19], indexing="ij"), -1).reshape(-1, 3)
        points = middle + grid
        shares = np.linalg.norm(points[:, None] - centers, axis=2) / radii
        fits = (shares < _MOST_SHARE).all(axis=1) & (shares > _LEAST_SHARE).all(axis=1)
        points = points[fits]
        shares = shares[fits]
        held = self._world.nominal[self._giver].tool_pose_at(self._giver_q).position
        cost = _POSITION_COST * ((shares - _BEST_SHARE) ** 2).sum(axis=1)
        cost += 0.3 * np.linalg.norm(points - held, axis=1)
        cost += 0.5 * np.abs(points[:, 2] - centers[:, 2].mean())
        chosen = list[tuple[float, Vector]]()
        for index in np.argsort(cost, kind="stable"):
            if all(np.linalg.norm(points[index] - other) > _APART_M for _, other in chosen):
                chosen.append((float(cost[index]), points[index]))
                if len(chosen) >= (
                    _POSITIONS if self._wish.quaternion is None else _MORE_POSITIONS
                ):
                    break
        return chosen

    def _orientations(self, place: Vector, now: Pose) -> list[tuple[float, Vector]]:
        """Orientations of the giver's tool at a position, as quaternions, and their costs."""
        if self._wish.quaternion is not None:
            wish = Pose(np.zeros(3), self._wish.quaternion)
            grasp = Pose(np.zeros(3), self._in_giver.inverse.quaternion)
            tools = [wish @ turn @ grasp for turn in self._alike]
            return [(_ALIKE_COST * i / len(tools), tool.quaternion) for i, tool in enumerate(tools)]
        taker = self._kinematics[self._arm.name].bounding_ball[0]
        giver = self._kinematics[self._giver].bounding_ball[0]
        level = np.array((*(taker - giver)[:2], 0.0))
        if np.linalg.norm(level) < 0.1:
            level = np.array((*(place - giver)[:2], 0.0))
        level = level / max(float(np.linalg.norm(level)), 1e-9)
        out = np.array((*(place - giver)[:2], 0.0))
        out = out / max(float(np.linalg.norm(out)), 1e-9)
        down = np.array((0.0, 0.0, -1.0))
        axes = [
            (0.0, level + out),
            (0.1, level),
            (0.15, level + out + down),
            (0.15, out),
            (_DOWN_COST, down),
        ]
        found = [(0.05, now.quaternion)]  # as it is
        if self._world.passengers_of(self._object):
            for yaw in _SPINS:
                spin = Pose.from_rpy((0.0, 0.0, 0.0), (0.0, 0.0, float(yaw)))
                tool = spin @ Pose(np.zeros(3), now.quaternion)
                found.append((_TURN_COST * abs(float(yaw)) / math.pi, tool.quaternion))
        for cost, axis in axes:
            length = float(np.linalg.norm(axis))
            if length < 1e-6:
                continue
            z = axis / length
            x = now.rotation_matrix[:, 0] - (now.rotation_matrix[:, 0] @ z) * z
            if np.linalg.norm(x) < 1e-3:
                x = now.rotation_matrix[:, 1] - (now.rotation_matrix[:, 1] @ z) * z
            x = x / np.linalg.norm(x)
            first = Pose.from_axes(np.zeros(3), np.column_stack((x, np.cross(z, x), z)).tolist())
            for turn in _TURNS:
                tool = first @ Pose.from_rpy((0.0, 0.0, 0.0), (0.0, 0.0, float(turn)))
                turned = tool.angle(Pose(np.zeros(3), now.quaternion)) / math.pi
                found.append((cost + _TURN_COST * turned, tool.quaternion))
        return found


def _alike(one: HandoverPlan, other: HandoverPlan) -> bool:
    return (
        one.object_pose.distance(other.object_pose) < 0.05
        and one.object_pose.angle(other.object_pose) < 0.3
    )


# Sensors of the load

_SETTLED_S: Final = 0.1
"""Simulated seconds over which a load is averaged."""


class LoadSense:
    """Force with which a held object pulls at an arm's hand, from its own sensors.

    Fingers with tactile sensors measure it at the pads; otherwise the joint torques show how it
    changes, as far as friction permits.

    Args:
        arm: Arm that holds the object.
    """

    def __init__(self, arm: Arm) -> None:
        self._arm = arm
        self._felt = deque[tuple[float, Vector]]()

    @property
    def is_tactile(self) -> bool:
        """Whether the pads measure the load."""
        return self._arm.name in self._arm.world.grippers and self._arm.gripper.load is not None

    def look(self) -> Vector:
        """Mean force in the last moments, of shape (3,), N, in the world; to be called per tick."""
        arm = self._arm
        load = arm.gripper.load if self.is_tactile else arm.external_wrench[:3]
        assert load is not None  # noqa: S101 - `is_tactile`
        self._felt.append((arm.time, load))
        while arm.time - self._felt[0][0] > _SETTLED_S:
            self._felt.popleft()
        mean: Vector = np.mean([one for _, one in self._felt], axis=0)
        return mean

    @property
    def is_settled(self) -> bool:
        """Whether the mean spans the whole time."""
        return len(self._felt) > 1 and self._felt[-1][0] - self._felt[0][0] > 0.7 * _SETTLED_S


def let_go_of(arm: Arm, obj: str) -> Iterator[float | None]:
    """Open the gripper around an object that a partner holds, as far as there is room.

    Yields once per tick until the hand no longer holds it. A weld is removed at once.

    Args:
        arm: Arm that releases the object.
        obj: Name of the object.

    Raises:
        Failure: ``NOT_OPEN``: something blocks the fingers.
    """
    held = arm.world.attachments.find(arm.name, obj)
    if held is not None and not held.by_gripper:
        arm.detach(obj)
        arm.known.forget(obj, "it was handed over")
        return
    gripper = arm.gripper
    # From the command on, the object is the partner's: it stays so if this leaf ends now.
    gripper.command(_opening(arm, obj) if gripper.description.fingers else 1.0)
    gripper.let_go(obj)
    arm.known.forget(obj, "it was handed over")
    yield from gripper.until_open(0.05)


_LEAVES_S: Final = 10.0
"""Time limit for a giver that was halted to retreat, s."""


def let_leave(arm: Arm, giver: str, obj: str) -> Iterator[None]:
    """Hold still while the giver's hand leaves the object, if its retreat was halted.

    The hands are nearer to each other than arms otherwise may be. Once no leaf of this arm consents
    to that any more, the guard would stop the giver where it is. Yields once per tick.

    Args:
        arm: Arm that has the object.
        giver: Name of the arm that had it.
        obj: Name of the object.
    """
    began = arm.time
    with shared_grasp(arm, giver, obj):
        while giver in arm.world.arms and arm.time - began < _LEAVES_S:
            # With the object: moved now, it would turn in this hand at the fingers of the giver.
            apart = CollisionChecker(arm.world, arm.name, {giver: HANDS_APART_M}, sharing=())
            found = apart.contact(arm.setpoint.q)
            if found is None or arm.world.arm_of(found.second) != giver:
                return
            yield


_LEAST_OPENING_M: Final = 0.006  # minimum increase of the opening for the pads to leave the object
_MOST_OPENING_M: Final = 0.03
_OPENING_STEP_M: Final = 0.004


def _opening(arm: Arm, obj: str) -> float:
    """Widest opening up to which the fingers have room, m."""
    gripper = arm.gripper
    now = gripper.width
    least = min(now + _LEAST_OPENING_M, gripper.description.stroke)
    checker = arm.checker(frozenset({obj}))
    widest = least
    most = min(now + _MOST_OPENING_M, gripper.description.stroke)
    for width in np.arange(least, most + 1e-9, _OPENING_STEP_M):
        checker.open_fingers(float(width))
        if checker.contact(arm.setpoint.q) is not None:
            break
        widest = float(width)
    return widest


_RETREAT_WAIT_S: Final = 5.0  # time for others to clear the path
_HELD_S: Final = 0.2  # time after which a retreat that the guard has stopped is tried elsewhere
_RETREATS_M: Final = (1.0, 0.8, 0.6, 0.45)  # fractions of the requested length, tried in order


def retreat_from(
    arm: Arm, partner: str, obj: str, length: float, speed: float
) -> Iterator[float | None]:
    """Retreat straight from an object that the arm has released; yields once per tick.

    The hands are so near to each other that the guard may stop a retreat that the planner accepts:
    it judges by set-points, with an allowance for what happens between its samples. The arm then
    tries another direction from there, before it waits.

    Args:
        arm: Arm whose gripper is open.
        partner: Name of the arm that holds the object now, and stands still.
        obj: Name of the object, which the hand may touch.
        length: Length of the retreat, m.
        speed: Fraction of the arm's limits, above 0 to 1.

    Raises:
        Failure: As motions, if no retreat is possible.
    """
    yield from arm.come_to_rest()  # the retreat of a halted attempt may still be braking
    ignore = frozenset({obj})
    directions = retreat_directions(arm, partner)
    first: Failure | None = None
    for waits in (False, True):
        for share in _RETREATS_M:
            for direction in directions:
                here = arm.commanded_tool_pose
                away = share * length * direction
                before = arm.resting
                # The partner stays where it is. The search has found room for a retreat from where
                # the arms were to be; now they may be nearer to each other by a millimeter.
                arm.resting |= {partner}
                try:
                    rows = arm.line_on(here.shifted(away))
                    arm.refuse_collision_along(rows, ignore)
                except Failure as failure:
                    first = first or failure
                    continue
                finally:
                    arm.resting = before
                motion = arm.time_path(rows, speed)
                if waits:
                    yield from arm.follow(motion, ignore, _RETREAT_WAIT_S)
                    return
                if (yield from _is_executed(arm, motion, ignore)):
                    return
    raise first or Failure("NO_PLAN", "no retreat is possible")


def retreat_directions(arm: Arm, partner: str) -> list[Vector]:
    """Unit vectors in the world along which an arm may retreat, the preferred one first."""
    here = arm.commanded_tool_pose
    other = arm.tool_pose_of(partner).position if partner in arm.world.arms else here.position
    has_gripper = arm.name in arm.world.grippers
    has_fingers = has_gripper and bool(arm.gripper.description.fingers)
    return _directions_from(here, other, has_fingers=has_fingers)


def _is_free(checker: CollisionChecker, rows: Matrix) -> bool:
    """Whether nothing is touched at some of many configurations, of shape (n, dof), rad."""
    return checker.first_contact(rows[::4]) is None and checker.contact(rows[-1]) is None


def _directions_from(here: Pose, other: Vector, *, has_fingers: bool) -> list[Vector]:
    """Directions as `retreat_directions`, from a tool's pose and the position of another tool."""
    back = -here.rotation_matrix[:, 2]
    up = np.array((0.0, 0.0, 1.0))
    apart = here.position - other
    apart -= (apart @ back) * back
    if has_fingers:
        # The object is between the fingers: across them, one would push it out of the other hand.
        across = here.rotation_matrix[:, 1]
        up = up - (up @ across) * across
        apart -= (apart @ across) * across
    aside = apart / max(float(np.linalg.norm(apart)), 1e-9)
    found = (back, back + 0.5 * up, back - 0.5 * up, back + 0.5 * aside, back + aside)
    return [direction / float(np.linalg.norm(direction)) for direction in found]


def _is_executed(
    arm: Arm, trajectory: Trajectory, ignore: frozenset[str]
) -> Generator[float | None, None, bool]:
    """Execute a motion unless the guard stops it; returns whether it was executed."""
    motion = arm.begin(trajectory)
    watch = arm.watch(motion, ignore)
    while not motion.done:
        yield motion.progress
        arm.check()
        watch.look(arm.time)
        if motion.held_since is not None and arm.time - motion.held_since > _HELD_S:
            yield from arm.halt()
            return False
    yield from arm.settle()
    return True
