"""Carrying one object with several arms: grasp, coupled motions, setting down, release.

Every arm has a leaf of its own. The leaves meet in a joint action, in which the first arm that was
given a goal leads: it plans for all, with the grasps that each arm has proposed for its hand. Each
arm executes its own part.
"""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, Final

import numpy as np
import scipy

from bt_dualarm.arm.arm import Arm
from bt_dualarm.arm.known_objects import SetDown
from bt_dualarm.arm.passengers import PassengerCheck
from bt_dualarm.arm.payload import UNKNOWN_KG, PayloadCheck
from bt_dualarm.collision.distance import PLANNING_MARGIN_M
from bt_dualarm.collision.group import GroupChecker
from bt_dualarm.collision.support import support_below
from bt_dualarm.control.internal_wrench import CarryingArm, InternalWrenchRegulator
from bt_dualarm.core.errors import Failure, Number
from bt_dualarm.core.pose import Pose, Vector
from bt_dualarm.grasping.candidates import CLEAR, RankedGrasp
from bt_dualarm.grasping.grasp import CompoundSolid
from bt_dualarm.grasping.sections import Section, farthest_apart, section_at, sections
from bt_dualarm.kinematics.multi_arm import MultiArmKinematics
from bt_dualarm.perception.known_shape import KnownShape
from bt_dualarm.planning.carrying import CarriedPath, CarryPlanner
from bt_dualarm.sim.object_body import body_of
from bt_dualarm.skill.carry_planning import (
    FREE_M,
    CarryPlan,
    CarryPlanning,
    CarryPorts,
    Proposal,
    shares_of,
)
from bt_dualarm.skill.grasp_search import GRAVITY, WantedGrasp, grasps_on
from bt_dualarm.skill.grip import Grip, TouchSense, make_room
from bt_dualarm.skill.guarded_move import TOUCHDOWN_M_S, Lag
from bt_dualarm.skill.joint import JointPart
from bt_dualarm.skill.left_standing import LeftStanding
from bt_dualarm.skill.picking import Taking
from bt_dualarm.skill.retreat import plan_retreat, possible_retreats
from bt_dualarm.spec.values import PoseSpec
from bt_dualarm.trajectory.coupled import CoupledMotion, stacked_limits
from bt_dualarm.trajectory.path_timing import time_path
from bt_dualarm.trajectory.set_points import at_scale
from bt_dualarm.trajectory.trajectory import Trajectory

_HOLD_S: Final = 0.15  # time for which the pads must press
_CLOSING_S: Final = 1.5  # time limit for the fingers to press
_EARLY_M: Final = 0.012  # distance from the grasp at which a contact is one with something else
_EDGE_S: Final = 0.3  # start of the approach to ignore, while joints break away
_BRISK: Final = 0.1  # a descent begins with this fraction of the acceleration limits
_STEADY: Final = 0.6  # fraction of a descent's speed above which a stopped hand is detected
_FIRM: Final = 3.0  # times the contact force at which one hand ends the descent for all
_CONFIRMED_S: Final = 0.05  # time for which an internal wrench must exceed its bound
_ROOM: Final = 0.97  # fraction of the limits that motions use; the rest is for corrections
_JERK_ROOM: Final = 0.85  # the same of the jerk: without it, a correction goes on at random
_STILL_SHARE: Final = 5e-3  # allowed motion of a beam's ends, which rock, per half of its length
_SETTLED_RAD: Final = 3e-3  # joint error between two motions that the other arms may cause
_ROOM_M: Final = 0.012  # opening on each side of the object for the retreat
_LEVER_M: Final = 0.02  # distance that makes a hand's rotation as important as its position
_RESTS_M: Final = 0.003  # distance from a support at which the object counts as standing on it
_REST_S: Final = 5.0  # time limit for all arms to come to rest


@dataclass(frozen=True, eq=False)
class _Leg:
    """One coupled motion, as announced by the leader.

    Attributes:
        number: Number of the leg, from 1.
        motion: The motion.
        regulator: Its correction, which senses how the arms press on the object.
        compliant: Whether the arms comply on contact.
        top_m_s: Highest speed of the tools, m/s; only of a leg with a bounded one.
    """

    number: int
    motion: CoupledMotion
    regulator: InternalWrenchRegulator
    compliant: bool = False
    top_m_s: float = 0.0


class Carrying:
    """One arm's part in carrying an object.

    Args:
        arm: The arm.
        joint: Joint action with the other arms.
        members: Names of all arms, in alphabetical order.
        obj: Name of the object.
        goals: Poses of the object, as the leaf gives them; empty to follow another arm.
        ports: Ports of the skill.
        metrics: Metrics of the skill, to be filled.

    Attributes:
        failures: Failure codes and their meaning.
    """

    failures: Final[Mapping[str, str]] = {
        "PARTNER_GONE": "another arm of the action failed, was halted, ended or was removed; this "
        "one holds the object where it is",
        "NOT_THERE": "the object is not in the world",
        "INVALID_TARGET": "the object is fixed or has no two ends, no arm or several arms with "
        "different goals were given one, or an arm is named that cannot take part",
        "GRIPPER_FULL": "the gripper holds something else, or something is attached to the tool",
        "TOO_WIDE": "the fingers do not open that far",
        "TOO_HEAVY": "no grasp of this gripper can support its share of the weight",
        "NO_FACE": "the ends have no sides for the fingers, or no face for the cup",
        "OUT_OF_REACH": "the arms have no grasps with which they can follow the whole path",
        "NOT_GRASPED": "a gripper closed on nothing, or on something else",
        "SLIPPED": "the object slid between the fingers",
        "DROPPED": "the object was lost",
        "INTERNAL_FORCE": "the arms pressed against each other through the object with more than "
        "the allowed force or moment",
        "NOT_REACHED": "what the object touched is above or below its goal, or it is not at it",
        "NO_CONTACT": "no support was detected below it",
        "NOT_OPEN": "the fingers did not open",
        "NOT_PLACED": "it is not at its goal at the end: it fell, slid, was moved, or was not held "
        "as estimated",
        "SPILLED": "what stood on the object fell off",
    }

    def __init__(
        self,
        arm: Arm,
        joint: JointPart,
        members: Sequence[str],
        obj: str,
        goals: tuple[PoseSpec, ...],
        ports: CarryPorts,
        metrics: dict[str, Number],
    ) -> None:
        self._arm = arm
        self._joint = joint
        self._members = tuple(members)
        self._object = obj
        self._goals = goals
        self._ports = ports
        self._metrics = metrics
        self._proposals: dict[str, Proposal] = {}
        self._phase = 0
        self._stands = False  # whether the object stands while the grippers close or open

    def through(self) -> Iterator[float | None]:
        """Grasp, carry, and set down if requested; yields the progress once per tick.

        Raises:
            Failure: As declared; as motions.
        """
        arm = self._arm
        yield from self._joint.meet()
        if self._joint.is_completed:
            return
        yield from self._propose()
        if all(one.has_released for one in self._proposals.values()):
            yield from self._finish()
            return
        arm.known.set_down = None
        plan, goals = yield from self._plan()
        passengers = PassengerCheck(arm.world, self._object, goals)
        try:
            if plan.chosen:
                yield from self._approach(plan)
                self._stands = True
                yield from self._close(plan)
            grip = Grip(arm, self._object)
            self._bear(plan)
            yield from self._sync()
            if plan.chosen:
                yield from arm.relax()
                yield from self._sync()
            self._stands = False
            carry = _Coupled(self, plan, grip)
            yield from carry.run(goals)
            if plan.set_down:
                yield from self._release(grip, goals[-1], plan.grasps[arm.name].inverse)
            else:
                self._score(goals[-1])
        except (Failure, GeneratorExit):
            self._let_go_alone()
            raise
        passengers.refuse_spilled()
        yield from self._complete(is_away=plan.set_down)

    def _complete(self, *, is_away: bool) -> Iterator[float | None]:
        """Wait until all arms have done their part.

        Args:
            is_away: Whether this one has retreated: it may be in the path of one that has not.
        """
        arm = self._arm
        move = arm.past_others(self._ports.speed)
        for _ in self._joint.complete(moves_aside=is_away):
            if is_away:
                yield from move.make_way()
            yield None
        arm.known.set_down = None

    def _finish(self) -> Iterator[float | None]:
        """Retreat from an object that all arms have released at its goal in an earlier attempt."""
        arm = self._arm
        released = arm.known.set_down
        if released is None:
            raise Failure("NOT_PLACED", f"{self._object!r} was moved meanwhile")
        passengers = PassengerCheck(arm.world, self._object, [released.goal])
        for _ in arm.gripper.until_open():
            yield 0.9
        left = LeftStanding(arm, self._object, _STILL_SHARE)
        away = arm.tool_pose.distance(released.tool)
        yield from self._retreat(left, released.goal, self._ports.retreat - away)
        passengers.refuse_spilled()
        yield from self._complete(is_away=True)

    @property
    def _all_hold(self) -> bool:
        return set(self._members) <= set(self._arm.world.attachments.holders(self._object))

    def _rests_on_support(self) -> bool:
        """Whether the object is where it stands on something, by the shapes that plans use."""
        world = self._arm.world
        pose = world.object_pose(self._object)
        return support_below(world, self._object, pose, _RESTS_M, _RESTS_M) is not None

    def _let_go_alone(self) -> None:
        """Open the gripper if it holds the standing object, and those of the others do not.

        One arm may be halted in the tick in which the others grasp or release it. All can grasp it
        again together, but not if one has it already.
        """
        arm = self._arm
        held = arm.world.attachments.find(arm.name, self._object)
        if self._stands and held is not None and not self._all_hold:
            description = arm.gripper.description
            arm.gripper.command(description.stroke if description.fingers else 1.0)
            arm.gripper.let_go(self._object, stands=True)

    # Meeting and planning

    def _propose(self) -> Iterator[None]:
        """Announce this arm's capabilities to the others, and wait for them."""
        arm = self._arm
        world = arm.world
        obj = self._object
        if world.objects[obj].fixed:
            raise Failure("INVALID_TARGET", world.fixed_reason(obj))
        yield from arm.halt()
        grasps: tuple[tuple[RankedGrasp, ...], ...] = ()
        refusals: tuple[Failure | None, ...] = ()
        why_not = None
        held = world.attachments.find(arm.name, obj)
        if held is not None and held.by_gripper and not self._all_hold and self._rests_on_support():
            yield from Taking.open(arm)
            held = None
        if held is None or not held.by_gripper:
            arm.gripper.refuse_full()
            try:
                grasps, refusals = self._grasps_at_sections()
            except Failure as failure:
                why_not = failure.with_traceback(None)
        elif arm.controller.compliance.active:  # halted as it set the object down: it still presses
            for _ in arm.relax():
                yield
        carrying = CarryingArm(world.nominal[arm.name], world.hardware[arm.name], arm.controller)
        mine = Proposal(
            self._goals,
            carrying,
            arm.setpoint.q.copy(),
            grasps,
            refusals,
            why_not,
            has_released=self._has_released(),
        )
        self._joint.send(proposal=mine)
        self._proposals[arm.name] = mine
        yield from self._until(lambda messages: "proposal" in messages)
        for other in self._joint.others:
            self._proposals[other] = self._joint.messages(other)["proposal"]
        self._proposals = {name: self._proposals[name] for name in self._members}
        if mine.why_not is not None and not all(
            one.has_released for one in self._proposals.values()
        ):
            raise mine.why_not

    def _has_released(self) -> bool:
        """Whether this arm has released the object at its goal already, and nobody holds it."""
        world = self._arm.world
        released = self._arm.known.set_down
        if released is None or released.object != self._object:
            return False
        if world.attachments.holders(self._object):
            return False
        now = world.object_pose(self._object)
        goals = [released.goal]
        if self._goals:
            if not self._ports.set_down:
                return False
            goals.append(self._goals[-1].pose_from(now))
        shape = KnownShape.of(world.objects[self._object])
        for goal in goals:
            away, turned = shape.away(now, goal)
            if away > self._ports.tolerance or turned > self._ports.angle_tolerance:
                return False
        return True

    @property
    def _mass(self) -> float | None:
        """Mass of the object, kg; None if unknown: the hands then use their maximum force."""
        world = self._arm.world
        if self._ports.mass is not None:
            return self._ports.mass
        estimates = world.nominal[self._arm.name].estimates_payload
        return None if estimates else world.loaded_mass(self._object)

    def _sections(self) -> list[Section]:
        """Sections at which the arms hold the object; of a compound, parts that are far apart."""
        world = self._arm.world
        parts = body_of(world.objects[self._object]).parts
        count = len(self._members)
        if len(parts) > 1:
            found = self._parts_apart(count)
        else:
            (part,) = parts
            from_world = (world.object_pose(self._object) @ part.pose).inverse
            bases = [from_world.apply(world.arms[name].base.position) for name in self._members]
            found = [
                replace(one, pose=part.pose @ one.pose)
                for one in sections(part.solid, count, self._ports.spread, bases)
            ]
        if not found:
            raise Failure(
                "INVALID_TARGET",
                f"{self._object!r} has no {count} ends or parts, far enough apart, at which "
                f"{' and '.join(self._members)} can hold it",
            )
        return found

    def _parts_apart(self, count: int) -> list[Section]:
        """Sections that are parts of a compound, such as handles, or of the rim of a hollow one."""
        body = body_of(self._arm.world.objects[self._object])
        groups: dict[str, tuple[int, ...]] = {}
        for index, part in enumerate(body.parts):
            if not body.graspable or index in body.graspable:
                name = part.name or f"{index}"
                groups[name] = (*groups.get(name, ()), index)
        centers = dict[str, Vector]()
        for name, its in groups.items():
            weights = np.array([body.parts[index].weight for index in its])
            places = np.array([body.parts[index].middle for index in its])
            centers[name] = weights @ places / weights.sum()
        return [
            section_at(body.held_at(groups[name]), centers[name])
            for name in farthest_apart(centers, count)
        ]

    def _grasps_at_sections(
        self,
    ) -> tuple[tuple[tuple[RankedGrasp, ...], ...], tuple[Failure | None, ...]]:
        """Grasps of this arm's hand at each section, and why it has none at a section.

        Raises:
            Failure: If it has none at any of them, with the reason for the first.
        """
        arm = self._arm
        world = arm.world
        object_pose = world.object_pose(self._object)
        parts = self._sections()
        mass = self._mass
        shares = shares_of(world, self._object, [part.pose for part in parts])
        self._refuse_width(parts[0])
        found = list[tuple[RankedGrasp, ...]]()
        refusals = list[Failure | None]()
        for part, share in zip(parts, shares, strict=True):
            wanted = WantedGrasp(
                self._object,
                object_pose @ part.pose,
                share * (mass or UNKNOWN_KG),
                self._ports.shake,
                self._ports.margin,
                section=part.solid,
            )
            grasps: tuple[RankedGrasp, ...] = ()
            refusal: Failure | None = None
            try:
                grasps = tuple(one for one in grasps_on(arm, wanted) if part.allows(one.grasp))
                if not grasps:
                    refusal = Failure(
                        "OUT_OF_REACH",
                        f"no grasp of {arm.name} leaves room for the rest of the object",
                    )
            except Failure as failure:
                refusal = failure.with_traceback(None)
            found.append(grasps)
            refusals.append(refusal)
        if refusals[0] is not None and not any(found):
            raise refusals[0]
        return tuple(found), tuple(refusals)

    def _refuse_width(self, part: Section) -> None:
        """Check that the fingers open around the ends of the object."""
        description = self._arm.gripper.description
        if not description.fingers or isinstance(part.solid, CompoundSolid):
            return
        across = [axis for axis in np.eye(3) if abs(float(axis @ part.axis)) < 0.5]
        if part.closing is not None:
            across = [part.closing]
        width = min(part.solid.reach(axis) + part.solid.reach(-axis) for axis in across)
        if width > description.stroke - 2.0 * CLEAR:
            raise Failure(
                "TOO_WIDE",
                f"the ends of {self._object!r} are {1e3 * width:.0f} mm wide; the fingers open to "
                f"{1e3 * description.stroke:.0f} mm",
                width_m=width,
                opening_m=description.stroke,
            )

    def _plan(self) -> Generator[None, None, tuple[CarryPlan, list[Pose]]]:
        """Plan for all arms if this one leads; otherwise wait for the plan."""
        asked = {name: one.goals for name, one in self._proposals.items() if one.goals}
        if not asked:
            raise Failure("INVALID_TARGET", "none of the arms was given `to` or `path`")
        if len(set(asked.values())) > 1:
            raise Failure("INVALID_TARGET", f"{' and '.join(asked)} were given different goals")
        leader = next(iter(asked))
        object_pose = self._arm.world.object_pose(self._object)
        goals = [goal.pose_from(object_pose) for goal in asked[leader]]
        if self._arm.name == leader:
            planning = CarryPlanning(self._arm, self._proposals, self._object, self._ports)
            plan = yield from planning.plan(object_pose, goals, self._sections())
            self._joint.send(plan=plan)
            return plan, goals
        yield from self._joint.until(lambda: "plan" in self._joint.messages(leader), (leader,))
        return self._joint.messages(leader)["plan"], goals

    # Grasping and releasing

    def _approach(self, plan: CarryPlan) -> Iterator[float | None]:
        arm = self._arm
        ports = self._ports
        chosen = plan.chosen[arm.name]
        rows = plan.approach[arm.name]
        yield from make_room(arm, ports.approach_speed)
        yield from Taking.open(arm)
        for progress in arm.travel([rows[0]], ports.speed):
            self._joint.check()
            yield None if progress is None else 0.2 * progress
        yield from self._sync()
        along = chosen.tool.rotation_matrix[:, 2]
        sense = TouchSense(arm, along, alone=True)
        motion = arm.begin(arm.time_path(rows, ports.approach_speed), may_touch=True)
        began = arm.time
        while not motion.done:
            yield 0.2 + 0.05 * motion.progress
            arm.check()
            self._joint.check()
            if sense.exceeds(ports.touch) and arm.time - began > _EDGE_S:
                yield from arm.halt(give_way=True)
                yield from arm.relax()
                break
        remaining = float((chosen.tool.position - arm.tool_pose.position) @ along)
        self._metrics["approach_force_n"] = sense.most
        if remaining > _EARLY_M:
            raise Failure(
                "NOT_GRASPED",
                f"the gripper touched something {1e3 * remaining:.0f} mm before its goal",
                left_m=remaining,
                force_n=sense.most,
            )
        yield from self._sync()

    def _close(self, plan: CarryPlan) -> Iterator[float | None]:
        """Close all grippers, and add the object to all models at once."""
        arm = self._arm
        gripper = arm.gripper
        description = gripper.description
        chosen = plan.chosen[arm.name].grasp
        force = description.force.most
        if description.fingers and self._mass is not None:
            force = description.force.clipped(chosen.force)
        gripper.command(
            force=force, speed=description.speed.least if not description.fingers else None
        )
        self._metrics["grip_force_n"] = force
        latest = arm.time + gripper.closing_limit_s(_CLOSING_S)
        since: float | None = None
        try:
            while since is None or arm.time - since < _HOLD_S:
                yield 0.25
                self._joint.check()
                since = None if not gripper.holding else arm.time if since is None else since
                if arm.time > latest and since is None:
                    raise Failure(
                        "NOT_GRASPED",
                        "the gripper closed on something else or nothing",
                        width_m=gripper.width,
                        expected_m=chosen.width,
                    )
            self._metrics["width_m"] = gripper.width
            object_pose = arm.tool_pose @ plan.grasps[arm.name].inverse
            why_not = gripper.why_not(self._object, object_pose)
            if why_not is not None:
                raise Failure("NOT_GRASPED", why_not, width_m=gripper.width)
            yield from self._sync()
        except (Failure, GeneratorExit):
            # The object still stands: what is not yet added to the model is not held.
            gripper.command(description.stroke if description.fingers else 1.0)
            raise
        gripper.hold(self._object, object_pose)

    def _bear(self, plan: CarryPlan) -> None:
        """Add this arm's share of the weight to its model, at its grasp.

        All grasps are shifted by as much as their weighted center is beside the center of mass.
        """
        center = sum(
            (plan.shares[name] * plan.grasps[name].position for name in self._members), np.zeros(3)
        )
        mass_center = self._arm.world.loaded_center(self._object)
        at = mass_center + plan.grasps[self._arm.name].position - center
        identity = np.array((1.0, 0.0, 0.0, 0.0))
        share = plan.shares[self._arm.name]
        self._arm.world.attachments.bear(self._arm.name, self._object, share, Pose(at, identity))

    def _release(self, grip: Grip, goal: Pose, in_tool: Pose) -> Iterator[float | None]:
        """Open all grippers, retreat, and check the pose of the object.

        Args:
            grip: Slip check, which ends.
            goal: Pose at which the object should stand.
            in_tool: Pose of the object in the tool's frame.
        """
        arm = self._arm
        gripper = arm.gripper
        description = gripper.description
        yield from arm.relax()
        # A compliant arm still compensates the moment with which the hands twist each other: once
        # they open, that would turn it away from its set-point.
        arm.controller.compliance.active = False
        yield from self._sync()
        self._stands = True
        gripper.command(
            min(gripper.width + 2.0 * _ROOM_M, description.stroke) if description.fingers else 1.0
        )
        if not description.fingers:
            gripper.let_go(self._object, stands=True)
        try:
            for _ in gripper.until_open():
                yield 0.9
        finally:  # also of a leaf that is halted: the hand opens, and the others do so, too
            gripper.let_go(self._object, stands=True)
            arm.known.set_down = SetDown(self._object, goal, arm.commanded_tool_pose)
        left = LeftStanding(arm, self._object, _STILL_SHARE)
        yield from self._sync()
        del grip
        yield from self._retreat(left, goal, self._ports.retreat, in_tool)

    def _retreat(
        self, left: LeftStanding, goal: Pose, length: float, in_tool: Pose | None = None
    ) -> Iterator[float | None]:
        """Leave the released object, and check its pose.

        Args:
            left: Referee for the object.
            goal: Pose at which it should stand.
            length: Length of the retreat, m; none is needed if it is not positive.
            in_tool: Pose of the object in the tool's frame; by default as it is at its goal.
        """
        arm = self._arm
        tool = arm.commanded_tool_pose
        if length > 0.0:
            there = tool.inverse @ goal if in_tool is None else in_tool
            retreats = possible_retreats(arm, tool, self._object, there, length)
            # From another configuration the retreat may differ or not exist: the others move aside.
            move = replace(
                arm.past_others(self._ports.approach_speed, frozenset({self._object})),
                give_way=False,
            )
            for progress in move.along(lambda: plan_retreat(move, retreats, self._metrics)):
                left.look()
                yield 0.9 + 0.1 * (progress or 0.0)
        ports = self._ports
        yield from left.until_placed(
            goal, ports.tolerance, ports.angle_tolerance, ports.settle, self._metrics
        )

    def _score(self, goal: Pose) -> None:
        """Check that the carried object is truly at its goal."""
        left = LeftStanding(self._arm, self._object)
        if not left.is_there:
            raise Failure("DROPPED", f"{self._object!r} was removed from the world")
        away, turned = left.away_from(goal)
        self._metrics |= {"placed_error_m": away, "placed_turned_rad": turned}
        if away > self._ports.tolerance or turned > self._ports.angle_tolerance:
            raise Failure(
                "NOT_REACHED",
                f"{self._object!r} is {1e3 * away:.1f} mm and {np.degrees(turned):.1f}° from its "
                "goal",
                placed_error_m=away,
                placed_turned_rad=turned,
            )

    def _sync(self) -> Iterator[None]:
        """Wait until all arms have come this far; tells them this arm's set-point."""
        self._phase += 1
        phase = self._phase
        self._joint.send(phase=phase, q=self._arm.setpoint.q.copy())
        yield from self._until(lambda messages: messages.get("phase", 0) >= phase)
        self._joint.check()  # one that was halted meanwhile comes no farther

    def _until(
        self,
        has_come: Callable[[Mapping[str, Any]], bool],  # Any: facts by name
    ) -> Iterator[None]:
        """Wait for the message of every other arm in turn, so that a missing one is named.

        Args:
            has_come: Whether an arm has sent enough.
        """
        for other in self._joint.others:
            yield from self._joint.until(partial(self._has_sent, other, has_come), (other,))

    def _has_sent(
        self,
        other: str,
        has_come: Callable[[Mapping[str, Any]], bool],  # Any: facts by name
    ) -> bool:
        return has_come(self._joint.messages(other))


class _Coupled:
    """The coupled motions of one arm.

    Args:
        carrying: Part of this arm.
        plan: Plan of the leader.
        grip: Monitor of this arm's grip.
    """

    def __init__(self, carrying: Carrying, plan: CarryPlan, grip: Grip) -> None:
        self._carrying = carrying
        self._arm = carrying._arm
        self._joint = carrying._joint
        self._ports = carrying._ports
        self._metrics = carrying._metrics
        self._object = carrying._object
        self._proposals = carrying._proposals
        self._plan = plan
        self._grip = grip
        self._number = 0
        self._leads = plan.leader == self._arm.name
        self._over_since: float | None = None
        self._lifts = 1 if plan.chosen else 0  # number of the leg that lifts the object
        world = self._arm.world
        names = list(self._proposals)
        self._kinematics = MultiArmKinematics(
            {name: (world.robots[name], world.arms[name].base) for name in names}
        )
        parts = self._kinematics.parts
        self._regulator = InternalWrenchRegulator(
            {name: self._proposals[name].carrying for name in names},
            plan.shares,
            parts,
            self._arm.period,
        )
        self._grasps = dict(plan.grasps)
        self._force_n = self._moment_nm = 0.0

    def run(self, goals: Sequence[Pose]) -> Iterator[float | None]:
        """Lift, carry along the path, and lower until contact."""
        ports = self._ports
        if self._plan.chosen:  # otherwise it is in the air already
            object_pose = self._object_pose()
            yield from self._leg(
                [object_pose, object_pose.raised(ports.lift)], 0.3 * ports.speed, 0.25
            )
        above = [goals[-1]]
        if self._plan.set_down:
            above = [goals[-1].raised(ports.height), goals[-1].raised(FREE_M)]
        yield from self._leg([None, *goals[:-1], *above], ports.speed, 0.3)
        if self._plan.set_down:
            yield from self._lower(goals[-1])
        self._metrics |= {"internal_force_n": self._force_n, "internal_moment_nm": self._moment_nm}
        self._metrics["believed_error_m"] = self._object_pose().distance(goals[-1])

    def _object_pose(self, q: Mapping[str, Vector] | None = None) -> Pose:
        """Pose of the object, estimated from the tools of all arms."""
        world = self._arm.world
        at = q or {name: world.hardware[name].q for name in self._grasps}
        tools = [world.nominal[name].tool_pose_at(at[name]) for name in self._grasps]
        return pose_held(tools, list(self._grasps.values()))

    def _leg(
        self, poses: Sequence[Pose | None], speed: float, done: float
    ) -> Iterator[float | None]:
        """One motion through poses of the object; None stands for the current one."""
        leg = yield from self._next_leg(poses, speed)
        yield from self._execute(leg, done)

    def _next_leg(
        self,
        poses: Sequence[Pose | None],
        speed: float,
        *,
        compliant: bool = False,
        slow: float = 0.0,
    ) -> Generator[float | None, None, _Leg]:
        """Plan the next motion of all arms if this one leads; otherwise wait for it."""
        self._number += 1
        number = self._number
        leader = self._plan.leader
        # All are at rest and have reported their configuration.
        yield from self._carrying._sync()
        if not self._leads:
            yield from self._joint.until(
                lambda: getattr(self._joint.messages(leader).get("leg"), "number", 0) >= number,
                (leader,),
            )
            found: _Leg = self._joint.messages(leader)["leg"]
            return found
        motion = yield from self._planned(poses, speed, slow)
        top = self._top_speed(motion.trajectory) if slow else 0.0
        leg = _Leg(number, motion, self._regulator, compliant, top)
        self._joint.send(leg=leg)
        return leg

    def _planned(
        self, poses: Sequence[Pose | None], speed: float, slow: float
    ) -> Generator[None, None, CoupledMotion]:
        arm = self._arm
        world = arm.world
        parts = self._kinematics.parts
        q = {name: self._joint.messages(name)["q"] for name in self._joint.others}
        q[arm.name] = arm.setpoint.q.copy()
        here = self._object_pose(q)
        # As commanded now: the displacement by internal wrenches is kept.
        self._grasps = {
            name: here.inverse @ world.nominal[name].tool_pose_at(q[name]) for name in parts
        }
        widths = {name: world.grippers[name].width for name in parts if name in world.grippers}
        checker = GroupChecker(world, parts, self._object, self._grasps, PLANNING_MARGIN_M, widths)
        planner = CarryPlanner(self._kinematics, self._grasps, checker, seed=0)
        joined = planner.joined(q)
        checker.let_stand(joined)  # a carry that was halted as it set the object down goes on
        stops = [here if pose is None else pose for pose in poses]
        if slow:
            start, goal, low = stops
            path = planner.down(start, goal, low, joined)
        else:
            path = yield from planner.through([here, *stops[1:]], joined)
        return self._timed(path, speed, slow)

    def _timed(self, path: CarriedPath, speed: float, slow: float) -> CoupledMotion:
        """Time a path for all arms: as fast as the limits, efforts and grips of all allow.

        Args:
            path: The path.
            speed: Fraction of the limits, above 0 to 1.
            slow: Highest speed of the tools, m/s, which they soon reach; 0 for no such bound.
        """
        world = self._arm.world
        parts = self._kinematics.parts
        limits = stacked_limits({name: world.robots[name].limits for name in parts})
        allowed = limits.scaled(_ROOM * speed)
        allowed = replace(allowed, jerk=np.minimum(allowed.jerk, _JERK_ROOM * limits.jerk))
        if slow:
            allowed = replace(limits.scaled(_BRISK), velocity=allowed.velocity)
        motion = time_path(path.rows, allowed, self._arm.period)
        top = self._top_speed(motion) if slow else 0.0
        if top > slow:
            share = float((np.abs(motion.v) / allowed.velocity).max()) * slow / top
            slower = replace(allowed, velocity=share * allowed.velocity)
            motion = time_path(path.rows, slower, self._arm.period)
        scale = 1.0
        for name, part in parts.items():
            own = Trajectory(
                motion.dt, *(rows[:, part].copy() for rows in (motion.q, motion.v, motion.a))
            )
            within = PayloadCheck(world, name).within_efforts(own)
            scale = min(scale, own.duration / max(within.duration, 1e-9))
        if scale < 0.999:
            motion = at_scale(motion, scale)
        support: float | None = 0.0
        if any(world.nominal[name].estimates_payload for name in parts):
            support = None
        elif self._number <= self._lifts or slow:
            support = GRAVITY * world.loaded_mass(self._object)
        self._regulator.begin(support)
        return CoupledMotion(motion, parts, limits, self._regulator, self._regulator.is_pressed)

    def _top_speed(self, motion: Trajectory) -> float:
        """Highest speed of a tool, m/s."""
        world = self._arm.world
        top = 0.0
        for name, part in self._kinematics.parts.items():
            tools = [world.nominal[name].tool_position_at(q) for q in motion.q[:, part]]
            steps = np.linalg.norm(np.diff(tools, axis=0), axis=1)
            top = max(top, float(steps.max(initial=0.0)) / motion.dt)
        return top

    def _execute(
        self, leg: _Leg, done: float, force: float | None = None
    ) -> Iterator[float | None]:
        """Follow one motion to its end, or until contact.

        Args:
            leg: The motion.
            done: Progress at its beginning.
            force: Contact force that ends it, N; None if it ends at its end.
        """
        arm = self._arm
        motion = leg.motion
        source = motion.source(arm.name)
        arm.begin_with_others(source, compliant=leg.compliant)
        sense = None if force is None else _Touchdown(arm, force, leg.top_m_s)
        while not source.done:
            yield done + 0.5 * motion.reached
            arm.check()
            yield from self._grip.watch()
            self._watch(leg)
            self._follow_others(motion)
            if sense is None or not motion.has_begun or motion.is_braking:
                continue
            sense.look(motion.common.parameter.scale, -float(leg.regulator.total[2]))
            if sense.has_touched:
                self._joint.send(touched=leg.number)
            others = [self._joint.messages(name).get("touched") for name in self._joint.others]
            # One end may touch first: the arms comply, and lower the other end, too.
            has_one_touched = sense.has_ever_touched or leg.number in others
            if (
                sense.is_firm
                or (sense.has_touched and all(number == leg.number for number in others))
                or (has_one_touched and sense.all_press)
            ):
                motion.brake()
        if sense is not None:
            self._metrics["impact_n"] = sense.most
            return
        try:
            for _ in arm.settle(_SETTLED_RAD):
                yield None
                self._follow_others(motion)
        except Failure:
            self._joint.check()  # an arm that is left alone with the object need not come to rest
            raise

    def _follow_others(self, motion: CoupledMotion) -> None:
        """End the motion, on its path, if another arm has left."""
        for other in self._joint.others:
            if self._joint.left(other):
                motion.brake()
                self._joint.check()

    def _watch(self, leg: _Leg) -> None:
        """Bound the internal wrench.

        Raises:
            Failure: ``INTERNAL_FORCE``.
        """
        regulator = leg.regulator
        self._force_n = max(self._force_n, regulator.force_n)
        self._moment_nm = max(self._moment_nm, regulator.moment_nm)
        ports = self._ports
        too_much = (
            regulator.force_n > ports.most_internal_force
            or regulator.moment_nm > ports.most_internal_moment
        )
        now = self._arm.time
        if not too_much:
            self._over_since = None
            return
        self._over_since = now if self._over_since is None else self._over_since
        if now - self._over_since >= _CONFIRMED_S:
            leg.motion.brake()
            raise Failure(
                "INTERNAL_FORCE",
                f"the arms press against each other through {self._object!r} with "
                f"{regulator.force_n:.0f} N and {regulator.moment_nm:.1f} N m",
                internal_force_n=regulator.force_n,
                internal_moment_nm=regulator.moment_nm,
            )

    def _lower(self, goal: Pose) -> Iterator[float | None]:
        """Lower the object until contact with its support."""
        ports = self._ports
        low = goal.raised(-ports.search)
        # Otherwise fingers that hold a light object slide along it, and never feel the contact.
        force = self._grip.firm_for(ports.force)
        leg = yield from self._next_leg(
            [goal.raised(FREE_M), goal, low], ports.down_speed, compliant=True, slow=TOUCHDOWN_M_S
        )
        yield from self._execute(leg, 0.8, force)
        began = self._arm.time
        while not self._arm.controller.at_rest and self._arm.time - began < _REST_S:
            yield 0.85
        height = float(self._object_pose().position[2] - goal.position[2])
        self._metrics["height_off_m"] = height
        if leg.motion.common.done and not leg.motion.is_braking:
            raise Failure(
                "NO_CONTACT",
                f"no support was felt {-1e3 * height:.0f} mm below its goal",
                height_off_m=height,
            )
        if abs(height) > ports.tolerance:
            yield from self._arm.relax()
            raise Failure(
                "NOT_REACHED",
                f"it touched something {1e3 * height:.1f} mm above its goal"
                if height > 0.0
                else f"what it touched is {-1e3 * height:.1f} mm below its goal",
                height_off_m=height,
            )


class _Touchdown:
    """Detects that a hand that lowers an object has stopped.

    Args:
        arm: The arm that lowers its hand.
        force: Contact force that counts, N.
        top_m_s: Speed of the descent, m/s: at much lower speed no contact is detected.

    Attributes:
        has_touched: Whether its end of the object touches the support.
        has_ever_touched: Whether it has done so before.
        is_firm: Whether it presses so hard that all arms must stop.
        all_press: Whether all arms together press so hard. An arm may not feel that it does: a hand
            along which the object slides goes on.
        most: Largest force, N.
    """

    def __init__(self, arm: Arm, force: float, top_m_s: float) -> None:
        down = np.array((0.0, 0.0, -1.0))
        self._sense = TouchSense(arm, down)
        self._lag = Lag(arm, down, _STEADY * top_m_s)
        self._force = force
        self.has_touched = self.has_ever_touched = self.is_firm = self.all_press = False
        self.most = 0.0
        self._least_n = np.inf

    def look(self, scale: float, pressed_n: float) -> None:
        """Take a sample; to be called once per tick.

        Args:
            scale: Time scale of the motion.
            pressed_n: Force with which all arms press the object down, besides its weight, N; any
                constant may be added to it.
        """
        lag = self._lag
        lag.look(scale)
        felt = self._sense.force(stands=lag.has_stopped or lag.stands)
        if not (lag.is_steady or lag.stands):
            return
        self.most = max(self.most, felt)
        self.has_touched = (felt > self._force and lag.has_stopped) or lag.stands
        self.has_ever_touched = self.has_ever_touched or self.has_touched
        self._least_n = min(self._least_n, pressed_n)
        self.all_press = pressed_n - self._least_n > _FIRM * self._force
        self.is_firm = self.has_touched and felt > _FIRM * self._force


def pose_held(tools: Sequence[Pose], grasps: Sequence[Pose]) -> Pose:
    """Pose of an object that several hands hold, by least squares.

    Above all the positions of the hands count: one that tilts at the end of a long object, as its
    arm yields, would move the other end by centimeters.

    Args:
        tools: Poses of the hands in the world.
        grasps: Poses of the hands in the frame of the object.
    """
    there, here = (
        np.vstack([
            [pose.position for pose in poses] - np.mean([pose.position for pose in poses], axis=0),
            *(_LEVER_M * pose.rotation_matrix.T for pose in poses),
        ])
        for poses in (tools, grasps)
    )  # fmt: skip
    rotation, _ = scipy.spatial.transform.Rotation.align_vectors(there, here)
    middle = np.mean([pose.position for pose in tools], axis=0)
    held_at = np.mean([pose.position for pose in grasps], axis=0)
    return Pose.from_rotation(middle - rotation.apply(held_at), rotation)
