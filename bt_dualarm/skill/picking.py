"""Picking with a gripper: approach, close, lift, and verify that the object is held."""

from __future__ import annotations

import math
from collections.abc import Generator, Iterator, Mapping, Sequence
from typing import Final

import numpy as np

from bt_dualarm.arm.arm import Arm
from bt_dualarm.arm.gripper import OTHER_WIDTH_M
from bt_dualarm.arm.payload import jaw_measures
from bt_dualarm.core.errors import BlockedFailure, Failure, Number
from bt_dualarm.core.pose import Pose, Vector
from bt_dualarm.grasping.candidates import RankedGrasp
from bt_dualarm.sim.object_body import body_of
from bt_dualarm.sim.world import World
from bt_dualarm.skill.articulated import HandForce
from bt_dualarm.skill.grasp_approach import GraspApproach, first_approach
from bt_dualarm.skill.grasp_search import GRAVITY, TakingPorts, WantedGrasp
from bt_dualarm.skill.grip import Grip, TouchSense, contact_of_fingers, make_room
from bt_dualarm.trajectory.overlap import OverlappedMotion
from bt_dualarm.trajectory.trajectory import Trajectory

_NOT_IT: Final = "the gripper closed on something else or nothing"
_WEIGHED_KG: Final = 0.02  # error of a mass that tactile sensors measured, beside their gain's
_HOLD_S: Final = 0.15  # time for which the pads must press
_CLOSING_S: Final = 1.5  # time limit for the fingers to press
_REACHED_M: Final = 0.1  # largest distance of the tool from the center of an undeclared object
_PRESSED_M: Final = 0.006  # distance by which a cup is pressed beyond the estimated face
_PRESSED_N: Final = 12.0  # contact force of a cup that seals
_PRESSING: Final = 0.01  # fraction of the limits while pressing a cup on
_FREE_SHARE: Final = 0.1  # fraction of the lift at either end in which no weight is measured
_EARLY_M: Final = 0.012  # distance from the grasp at which a contact is one with something else
_EDGE_S: Final = 0.12  # start of the straight part, before the force has a zero
_CLEAR_M: Final = 0.01  # uncertainty of the distance at which the gripper may touch the object
_NEAR_M_S: Final = 0.15  # highest speed of the tool there
_ROOM_M: Final = (
    0.012  # opening on each side of an object whose pose is known, before the fingers close
)
_BRISK: Final = 0.6  # fraction of the speed on straight parts without contact


_AWAY_M: Final = 0.01  # displacement of an object after which the planned grasp would miss it


class MovedAwayFailure(Failure):
    """The object is no longer where its grasp was planned; the gripper has not been near it yet."""


class Taking:
    """Pick of one object.

    Args:
        arm: Arm that picks.
        ports: Ports of the skill.
        wanted: Specification of the grasp.
        seen: Whether the pose is an estimate; plans then ignore the true pose.
        metrics: Metrics of the skill, to be filled.

    Attributes:
        failures: Failure codes of a pick and their meaning.
    """

    failures: Final[Mapping[str, str]] = {
        "GRIPPER_FULL": "the gripper holds something else, or something is attached to the tool",
        "INVALID_TARGET": "the object is fixed, or cannot withstand the gripper's minimum force",
        "NOT_THERE": "the object is not in the world",
        "TOO_WIDE": "the fingers do not open that far",
        "TOO_HEAVY": "no grasp of this gripper can support its weight",
        "NO_FACE": "there are no sides for the fingers, or no face for the cup, or none at `point`",
        "OUT_OF_REACH": "no approach of any grasp is both reachable and collision-free",
        "NOT_GRASPED": "the gripper closed on nothing, or on something else",
        "SLIPPED": "the object slid between the fingers",
        "DROPPED": "the object was lost",
    }

    def __init__(
        self,
        arm: Arm,
        ports: TakingPorts,
        wanted: WantedGrasp,
        seen: bool,
        metrics: dict[str, Number],
    ) -> None:
        self._arm = arm
        self._ports = ports
        self._wanted = wanted
        self._metrics = metrics
        self._seen = wanted.object_pose if seen else None
        self._entered: GraspApproach | None = None  # whose straight part has begun
        self._motion: OverlappedMotion
        self._opening: float | None = None  # of the fingers during this motion, m

    def through(self, order: Sequence[RankedGrasp]) -> Generator[float | None, None, RankedGrasp]:
        """Execute the first feasible of these grasps, best first: approach, close, lift, verify.

        Yields the progress once per tick; returns the executed grasp. If another arm is in the
        path, the arm waits and replans, as `PastOthers.along`.

        Raises:
            Failure: ``GRIPPER_FULL``; ``OUT_OF_REACH``, before any motion unless another arm is the
                reason; ``NOT_GRASPED``, ``SLIPPED``, ``DROPPED``; as motions. An object that was
                grasped but not lifted is put back; it stays held only if that fails as well.
        """
        arm = self._arm
        arm.gripper.refuse_full()
        yield from make_room(arm, self._ports.approach_speed)
        yield from self.open(arm, self._wanted.opening)
        try:
            approach = yield from self._approach(order)
            if self._wanted.point is not None:
                self._metrics["point_off_m"] = self._wanted.off_point(approach.ranked.grasp)
            hangs = self._hangs_on_a_joint
            if hangs:  # an object that cannot follow the fingers pulls the arm: yield
                arm.controller.compliance.soften()
            name = yield from self._close(approach)
            if hangs:
                hand = HandForce(arm)
                yield from hand.relax()
                yield from hand.rest()
                return approach.ranked
            if not arm.gripper.description.fingers:
                yield from arm.relax()  # so that the cup's contact force does not act on the lift
        except Failure:
            if self._entered is not None:
                yield from self._retreat(self._entered)
            raise
        grip = Grip(arm, name)
        low = arm.commanded_tool_pose
        try:
            yield from self._lift(name, grip)
        except Failure as failure:
            if failure.code == "SLIPPED":
                yield from grip.judge(failure)
            arm.gripper.forget_lost()
            if name in arm.gripper.held:
                yield from self._put_back(approach, low)
            raise
        return approach.ranked

    @staticmethod
    def open(arm: Arm, opening: float | None = None) -> Iterator[None]:
        """Open the gripper of an arm, and detach what it held.

        Args:
            arm: Arm with the gripper.
            opening: Opening of the fingers, m; by default the widest.
        """
        gripper = arm.gripper
        fingers = gripper.description.fingers
        wide = opening if opening is not None and fingers else gripper.description.stroke
        gripper.command(wide if fingers else 1.0)
        began = arm.time
        travel = abs(wide - gripper.width)
        while arm.time - began < 1.0 + travel / max(gripper.description.speed.most, 1e-3):
            if gripper.at_rest and abs(gripper.width - wide) < 2e-3:
                break
            yield
        yield from gripper.until_let_go()
        gripper.forget_released()

    def _retreat(self, approach: GraspApproach) -> Iterator[float]:
        """Open and retreat, so that another attempt begins at the standoff.

        No plan can start while the gripper is in contact.
        """
        arm = self._arm
        try:
            for _ in arm.halt():
                yield 1.0
            fingers = arm.gripper.description.fingers
            arm.gripper.command(arm.gripper.description.stroke if fingers else 1.0)
            if not fingers:
                yield from arm.relax()  # the retreat is stiff, so it must begin without contact
                for _ in arm.gripper.until_let_go():
                    yield 1.0
            yield from approach.back_out(arm, self._ports.approach_speed)
        except Failure:
            return  # the leaf fails with the reason why nothing was grasped

    def _put_back(self, approach: GraspApproach, low: Pose) -> Iterator[float]:
        """Lower an object that could not be lifted to where it was, release it, and retreat."""
        arm = self._arm
        speed = self._ports.approach_speed
        try:
            for _ in arm.halt():
                yield 1.0
            rows = arm.line_on(low)
            motion = arm.begin(arm.time_path(rows, speed), may_touch=True, compliant=True)
            while not motion.done:
                yield 1.0
                arm.check()
            for _ in self.open(arm):
                yield 1.0
            yield from approach.back_out(arm, speed)
        except Failure:
            return  # the leaf fails with the reason why it was not lifted

    def _approach(
        self, order: Sequence[RankedGrasp]
    ) -> Generator[float | None, None, GraspApproach]:
        """Move to the standoff of a grasp and straight on to the grasp.

        It is one motion without a stop, unless other arms are near: then the arm waits at the
        standoff until none of them blocks the straight part.
        """
        arm = self._arm
        ports = self._ports
        wanted = self._wanted
        approaches: list[GraspApproach] = []
        touched = frozenset({wanted.name} if wanted.name else ())

        def to_standoff() -> Generator[None, None, Trajectory]:
            self._refuse_moved_away()
            lift = 0.0 if self._hangs_on_a_joint else ports.lift
            approach = yield from first_approach(
                arm, order, wanted, ports.standoff, ports.speed, self._seen, lift
            )
            approaches.append(approach)
            return approach.to_standoff

        def whole() -> Generator[None, None, Trajectory]:
            begin = OverlappedMotion.of((yield from to_standoff()))
            self._opening = self._opening_along(approaches[-1])
            self._motion = self._straight_on(begin, approaches[-1])
            return self._motion.motion

        unseen = touched if self._seen else frozenset[str]()
        move = arm.past_others(ports.speed, unseen)
        if not arm.controller.neighbors and not self._is_uncertain:
            yield from move.along(whole, lambda *given: self._enter(approaches[-1], unseen, *given))
        else:
            until = arm.time + move.wait_s
            while True:
                for progress in move.to_line(to_standoff, lambda: approaches[-1].rows, touched):
                    yield None if progress is None else 0.5 * progress
                begin = OverlappedMotion.of(Trajectory.rest(arm.setpoint.q, arm.period))
                self._opening = self._opening_at(approaches[-1])
                self._motion = self._straight_on(begin, approaches[-1])
                wait_s = move.backoff.renew()
                try:
                    yield from self._enter(approaches[-1], unseen, self._motion.motion, wait_s)
                    break
                except BlockedFailure:
                    if arm.time > until:
                        raise
                    # Out of the way of the arms that may be waiting for this one.
                    yield from arm.halt()
                    back = arm.past_others(ports.approach_speed, touched)
                    yield from back.straight(approaches[-1].out, known_free=True)
                    self._entered = None
        return approaches[-1]

    def _refuse_moved_away(self) -> None:
        """Refuse to go on to an object that something has moved since the grasp was planned.

        Another arm may have taken it while this one waited, and placed it elsewhere.

        Raises:
            MovedAwayFailure: ``NOT_GRASPED``, or ``NOT_THERE`` if it was removed.
        """
        name = self._wanted.name
        if name is None or self._seen is not None or self._hangs_on_a_joint:
            return
        world = self._arm.world
        if name not in world.objects:
            raise MovedAwayFailure("NOT_THERE", f"{name!r} was removed meanwhile")
        away = world.object_pose(name).distance(self._wanted.object_pose)
        if away > _AWAY_M:
            by = " and ".join(world.attachments.holders(name))
            who = f" by {by}" if by else ""
            raise MovedAwayFailure(
                "NOT_GRASPED", f"{name!r} was moved by {1e3 * away:.0f} mm meanwhile{who}"
            )

    @property
    def _hangs_on_a_joint(self) -> bool:
        """Whether the object moves on a joint: it is not lifted."""
        obj = self._arm.world.objects.get(self._wanted.name or "")
        return obj is not None and self._wanted.edges is None and obj.joint is not None

    @property
    def _is_uncertain(self) -> bool:
        """Whether the arm has to estimate its load, and knows its friction as little.

        Such an arm is farther from a fast motion, and comes to rest later.
        """
        return self._arm.world.nominal[self._arm.name].estimates_payload

    @property
    def _free_scale(self) -> float:
        """Fraction of the arm's limits on straight parts on which nothing is touched."""
        ports = self._ports
        return ports.approach_speed if self._is_uncertain else _BRISK * ports.speed

    def _straight_on(self, begin: OverlappedMotion, approach: GraspApproach) -> OverlappedMotion:
        """A motion to the standoff and the straight part after it: slow where contact is possible.

        The speed there bounds the force of an unexpected contact.
        """
        arm = self._arm
        ports = self._ports
        free_scale = self._free_scale
        opening = self._opening
        rows = approach.rows
        count = round((len(rows) - 1) * max(1.0 - self._near_m(approach) / approach.standoff, 0.0))
        if count > 0:
            far = arm.time_path(rows[: count + 1], free_scale)
            begin = arm.overlapped(begin, far, ports.speed, 0.5 * far.duration, opening=opening)
        slow = min(ports.approach_speed, free_scale)
        near, _ = arm.slow_path(rows[count:], slow, _NEAR_M_S, free_scale)
        touched = frozenset[str]()
        # The hand may touch the object where both motions are on the straight part. It must not cut
        # the corner at the standoff through the object, and never if that does not yield.
        if count > 0 and self._wanted.name and not self._hangs_on_a_joint:
            touched = frozenset({self._wanted.name})
        return arm.overlapped(
            begin, near, ports.speed, 0.5 * near.duration, touched, opening=opening
        )

    def _opening_along(self, approach: GraspApproach) -> float | None:
        """Opening of the fingers during the whole approach, m; None if it stays as it is.

        The plan is for fingers as wide as they open. Those of a linkage reach farther ahead, the
        less they open: what a wide hand passes, a narrower one may touch.
        """
        arm = self._arm
        opening = self._opening_at(approach)
        if opening is None:
            return None
        if contact_of_fingers(arm, arm.setpoint.q, opening) is not None:
            return None
        try:
            arm.refuse_collision_along(approach.to_standoff, opening=opening)
        except Failure:
            return None
        return opening

    def _opening_at(self, approach: GraspApproach) -> float | None:
        """Opening of the fingers from the standoff on, m; None if it stays as it is.

        The less they open, the less there is to close later. Plans are for fingers as wide as they
        open: they stay so beside what cannot yield.
        """
        description = self._arm.gripper.description
        if not description.fingers or self._seen is not None or self._hangs_on_a_joint:
            return None
        wide = approach.ranked.grasp.width + 2.0 * _ROOM_M
        return min(wide, self._wanted.opening or description.stroke, description.stroke)

    def _near_m(self, approach: GraspApproach) -> float:
        """Distance from the grasp within which the gripper may touch the object, m."""
        arm = self._arm
        description = arm.gripper.description
        if not description.fingers:
            return _CLEAR_M
        solid = self._wanted.solid(arm.world)
        in_tool = approach.ranked.grasp.tool.inverse
        back = in_tool.rotation_matrix.T @ np.array((0.0, 0.0, -1.0))
        nearest = float(in_tool.position[2]) - solid.reach(back)
        tip = jaw_measures(description, self._wanted.friction(arm.world)).tip
        return max(tip - nearest, 0.0) + _CLEAR_M

    def _enter(
        self, approach: GraspApproach, unseen: frozenset[str], motion: Trajectory, wait_s: float
    ) -> Iterator[float | None]:
        """Execute the motion of `_straight_on`, and stop on contact on its straight part."""
        arm = self._arm
        along = approach.ranked.tool.rotation_matrix[:, 2]
        standoff_s = self._motion.ends_s[0]
        self._refuse_moved_away()
        running = arm.begin(motion)
        watch = arm.watch(running, unseen, standoff_s)
        if self._opening is not None:
            arm.gripper.command(self._opening)
        sense = TouchSense(arm, along, alone=True)
        while running.parameter.s < standoff_s:
            yield 0.5 * running.parameter.s / standoff_s
            arm.check()
            self._refuse_moved_away()
            watch.look(arm.time)
            sense.listen()
            arm.refuse_when_held_up(running, wait_s)
        self._entered = approach
        arm.expect_contact(compliant=False)
        began = arm.time
        stopped = False
        while not running.done:
            yield 0.5 + 0.2 * running.progress
            arm.check()
            arm.refuse_when_held_up(running, wait_s)
            if running.held_since is not None:  # this arm has not moved it
                self._refuse_moved_away()
            if sense.exceeds(self._ports.touch) and arm.time - began > _EDGE_S:
                stopped = True
                yield from arm.halt(give_way=True)
                yield from arm.relax()
                break
        if not arm.gripper.description.fingers:
            yield from self._press(approach, along)
        remaining = float((approach.ranked.tool.position - arm.tool_pose.position) @ along)
        self._metrics["approach_force_n"] = sense.most
        if stopped:
            self._metrics["contact_error_m"] = remaining
        if remaining > _EARLY_M:
            raise Failure(
                "NOT_GRASPED",
                f"the gripper touched something {1e3 * remaining:.0f} mm before its goal",
                left_m=remaining,
                force_n=sense.most,
            )

    def _press(self, approach: GraspApproach, along: Vector) -> Iterator[float | None]:
        """Press a cup on slowly, beyond the estimated face, until it holds or presses firmly.

        The vacuum is on from the start: what is light or tall would give way to the pressure, and
        tilt, before the cup seals.
        """
        arm = self._arm
        tool = approach.ranked.tool
        arm.gripper.command(force=self._force(approach.ranked.grasp.force))
        sense = TouchSense(arm, along)
        deeper = tool.shifted(_PRESSED_M * along)
        rows = arm.line_on(deeper)
        # The integrator of a stiff arm would press ever harder, until the rim slides.
        motion = arm.begin(arm.time_path(rows, _PRESSING), may_touch=True, compliant=True)
        try:
            while not (motion.done or arm.gripper.holding or sense.force() >= _PRESSED_N):
                yield 0.7
                arm.check()
            yield from arm.halt()
        except GeneratorExit:  # halted: release what is not attached yet
            arm.gripper.command(1.0)
            raise

    def _close(self, approach: GraspApproach) -> Generator[float | None, None, str]:
        """Close with the force that the load needs, and verify that it holds the right object."""
        gripper = self._arm.gripper
        grasp = approach.ranked.grasp
        arm = self._arm
        description = gripper.description
        force = self._force(grasp.force)
        gripper.command(
            force=force, speed=description.speed.least if not description.fingers else None
        )
        latest = arm.time + gripper.closing_limit_s(_CLOSING_S)
        since = None
        try:
            while since is None or arm.time - since < _HOLD_S:
                yield None
                since = None if not gripper.holding else arm.time if since is None else since
                if since is None and arm.time > latest:
                    break
        except GeneratorExit:  # halted: release what is not attached yet
            gripper.command(description.stroke if description.fingers else 1.0)
            raise
        self._metrics |= {"width_m": gripper.width, "grip_force_n": force}
        self._metrics["grasp_margin"] = force / max(grasp.force, 1e-9)
        if description.fingers:
            self._metrics["width_error_m"] = gripper.width - grasp.width
        name = self._wanted.name or object_at(arm.world, arm.tool_pose.position, _REACHED_M)
        width_error = abs(gripper.width - grasp.width)
        why_not: str | None = None
        if since is None or name is None or (description.fingers and width_error > OTHER_WIDTH_M):
            why_not = _NOT_IT
        elif self._seen is None:
            is_gone = name not in arm.world.objects  # removed meanwhile
            why_not = _NOT_IT if is_gone else gripper.why_not(name, arm.world.object_pose(name))
        if name is None or why_not is not None:
            if name is not None and arm.world.attachments.holders(name):
                self._refuse_moved_away()  # another arm was faster
            numbers = {"width_m": gripper.width, "expected_m": grasp.width}
            raise Failure("NOT_GRASPED", why_not or _NOT_IT, **numbers)
        object_pose = gripper.between_the_pads(self._wanted.object_pose, approach.ranked.grasp.tool)
        gripper.hold(
            name, object_pose, self._wanted.most_force, mass_declared=self._wanted.edges is None
        )
        return name

    def _force(self, needed: float) -> float:
        description = self._arm.gripper.description
        if not description.fingers:
            needed = description.force.most  # a vacuum does not crush the object
        return min(description.force.clipped(self._ports.force or needed), self._wanted.most_force)

    def _lift(self, name: str, grip: Grip) -> Iterator[float]:
        """Lift the object a little: what is held keeps the fingers apart."""
        arm = self._arm
        start = self._arm.commanded_tool_pose
        height = float(arm.world.object_pose(name).position[2])
        up = start.raised(self._ports.lift)
        move = arm.past_others(self._free_scale)
        since = arm.time  # since when the gripper holds
        errors: list[float | None] = []
        for progress in move.straight(up, known_free=True) if self._ports.lift > 0.0 else ():
            yield 0.8 + 0.2 * (progress or 0.0)
            grip.look()
            # Without the ends, where something may support it; its acceleration cancels out.
            if _FREE_SHARE < (progress or 0.0) < 1.0 - _FREE_SHARE:
                errors.append(self._weight_error(name))
            since = since if arm.gripper.holding else arm.time
        began = arm.time
        while arm.time - since < _HOLD_S:
            if arm.time - began > 1.0:
                raise Failure("DROPPED", f"{name!r} is no longer held")
            yield 1.0
            grip.look()
            since = since if arm.gripper.holding else arm.time
        if errors and None not in errors:
            error = float(np.mean(np.array(errors, float)))
            self._metrics["weight_error_n"] = error
            tactile = arm.gripper.description.tactile
            if tactile is not None:  # the next grasp can be as firm as this object requires
                mass = self._wanted.mass + error / GRAVITY
                arm.known.weighed(name, max(mass, 0.0) / (1.0 - tactile.gain) + _WEIGHED_KG)
        rose = float(arm.world.object_pose(name).position[2]) - height
        self._metrics["lifted_m"] = rose  # true height, for the score only

    def _weight_error(self, name: str) -> float | None:
        """Measured minus assumed weight of the held object, N.

        None if the arm assumes none: it is about to estimate the mass.
        """
        arm = self._arm
        pads = arm.gripper.load
        if pads is not None:  # tactile sensors measure the object only
            return -float(pads[2]) - GRAVITY * self._wanted.mass
        if any(load.object == name and load.borne is not None for load in arm.payload):
            # Joint torques show what the model, which includes the load, does not explain.
            return -float(arm.external_wrench[2])
        return None


def object_at(world: World, place: Vector, radius: float) -> str | None:
    """Name of the movable object at a position, or None.

    Args:
        world: World that plans use.
        place: Position in the world, of shape (3,), m.
        radius: Largest distance of the object's center from there, m.
    """
    distances = {
        name: float(np.linalg.norm(world.object_middle(name) - place))
        for name, declared in world.objects.items()
        if declared.is_free
    }
    nearest = min(distances, key=distances.__getitem__, default=None)
    return nearest if nearest is not None and distances[nearest] <= radius else None


def twin_at(world: World, name: str, pose: Pose) -> str:
    """Name of the object at a pose: the named one, or another of the same shape and size.

    Args:
        world: World that plans use.
        name: Name of an object.
        pose: Estimated pose of such an object in the world.

    Returns:
        The name of the nearest one, if it is near enough; otherwise the given name.
    """
    wanted = world.declared_objects[name]
    body = body_of(wanted)
    place = pose.apply(body.middle)
    away = {
        other: float(np.linalg.norm(world.object_middle(other) - place))
        for other, obj in world.objects.items()
        if obj.is_free and body_of(obj) is body
    }
    nearest = min(away, key=lambda other: (away[other], other != name), default=name)
    least = min(wanted.size) if body.is_simple else float(np.ptp(body.corners, axis=0).min())
    return nearest if away.get(nearest, math.inf) < 0.5 * least else name


def refuse_too_frail(arm: Arm, what: str, bears: float | None) -> None:
    """Check that an object withstands the minimum force of the gripper.

    Args:
        arm: Arm with the gripper.
        what: The object in messages.
        bears: Force of each pad, or of a cup, that the object withstands, N; None for any.

    Raises:
        Failure: ``INVALID_TARGET`` with both forces.
    """
    least = arm.gripper.description.force.least
    if (bears or math.inf) < least:
        reason = f"{what} bears {bears:g} N; the gripper's minimum force is {least:g} N"
        raise Failure("INVALID_TARGET", reason, most_force_n=bears or 0.0, least_n=least)
