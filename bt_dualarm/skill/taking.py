"""Taking something with a gripper: go there, close as firmly as it asks for, lift it, look."""

from __future__ import annotations

import math
from collections.abc import Generator, Iterator, Mapping, Sequence
from typing import Final

import numpy as np

from bt_dualarm.arm.arm import Arm
from bt_dualarm.arm.gripper import OTHER_WIDTH_M
from bt_dualarm.errors import Failure, Number
from bt_dualarm.motion.grasping.ranking import RankedGrasp
from bt_dualarm.motion.timing.trajectory import Trajectory
from bt_dualarm.pose import Pose, Vector
from bt_dualarm.skill.grasp_search import WantedGrasp
from bt_dualarm.skill.grasp_way import WayToGrasp, first_way
from bt_dualarm.skill.grip import Grip
from bt_dualarm.skill.taking_ports import TakingPorts
from bt_dualarm.skill.touch_sense import TouchSense
from bt_dualarm.world.world import World

_NOT_IT: Final = "the gripper closed on something else or nothing"
_HOLD_S: Final = 0.15  # that pads have to press
_CLOSING_S: Final = 1.5
_REACHED_M: Final = 0.1  # from the tool to the centre of what has no name and is between the pads
_PRESSED_M: Final = 0.006  # that a cup may be pressed on deeper than the face was thought to be
_PRESSED_N: Final = 12.0
_PRESSING: Final = 0.01  # share of the limits
_EARLY_M: Final = 0.012
_EDGE_S: Final = 0.3  # at the beginning of the way, where joints break loose: no force counts


class Taking:
    """One thing being taken.

    Args:
        arm: Arm that takes it.
        ports: How it is to go about it.
        wanted: What is to be taken.
        seen: Whether it lies there by sight; then no plan knows it at any other place.
        metrics: What was measured on the way, to be filled.

    Attributes:
        failures: Codes that taking something may end with, and what they mean.
    """

    failures: Final[Mapping[str, str]] = {
        "GRIPPER_FULL": "the gripper holds something else, or something is attached to the tool",
        "INVALID_TARGET": "the object is fixed, bears less than the gripper's least force, or "
        "the approach has no length",
        "NOT_THERE": "the object is not in the world",
        "TOO_WIDE": "the fingers do not open that far",
        "TOO_HEAVY": "no grasp of this gripper bears its weight",
        "NO_FACE": "the object has no sides for the fingers, or no face for the cup",
        "OUT_OF_REACH": "no way of the arm to any grasp: unreachable or in collision",
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
        self._arm, self._ports, self._wanted, self._metrics = arm, ports, wanted, metrics
        self._seen = wanted.lies if seen else None

    def through(self, order: Sequence[RankedGrasp]) -> Generator[float | None, None, RankedGrasp]:
        """Go to the first of these grasps, best first, that has a way; close, lift and look.

        Yields the progress once a tick; returns the grasp by which it was taken. Where another
        arm is in the way it waits and looks for a way anew, as `MoveTo.along`.

        Raises:
            Failure: ``GRIPPER_FULL``; ``OUT_OF_REACH``, before it moves where no other arm is the
                reason; ``NOT_GRASPED``, ``SLIPPED``, ``DROPPED``; what motions raise. What was
                taken and not lifted is put back, unless the way back fails as well: then it is
                still held.
        """
        arm = self._arm
        arm.gripper.refuse_full()
        yield from self.open(arm)
        way = yield from self._go_before(order)
        try:
            yield from self._approach(way)
            name = yield from self._close(way)
        except Failure:
            yield from self._leave(way)
            raise
        grip, low = Grip(arm, name), arm.commanded_tool_pose
        try:
            yield from self._lift(name, grip)
        except Failure as failure:
            if failure.code == "SLIPPED":
                yield from grip.judge(failure)
            arm.gripper.forget_lost()
            if name in arm.gripper.held:
                yield from self._put_back(way, low)
            raise
        return way.ranked

    @staticmethod
    def open(arm: Arm) -> Iterator[None]:
        """Open the gripper of an arm, as wide as it goes; nothing is believed to be in it then."""
        gripper = arm.gripper
        gripper.command(gripper.page.stroke if gripper.page.fingers else 1.0)
        began, way = arm.time, gripper.page.stroke - gripper.width
        while arm.time - began < 1.0 + way / max(gripper.page.speed.most, 1e-3):
            if gripper.at_rest and abs(gripper.width - gripper.page.stroke) < 2e-3:
                break
            yield
        gripper.forget_released()

    def _leave(self, way: WayToGrasp) -> Iterator[float]:
        """Open, and go back out, so that another try begins where this one did.

        Whatever it was that the gripper ran into: there the next plan could not even begin.
        """
        arm = self._arm
        try:
            for _ in arm.halt():
                yield 1.0
            arm.gripper.command(arm.gripper.page.stroke if arm.gripper.page.fingers else 1.0)
            yield from way.back_out(arm, self._ports.approach_speed)
        except Failure:
            return  # why it was not taken is what counts

    def _put_back(self, way: WayToGrasp, low: Pose) -> Iterator[float]:
        """Lower what could not be lifted to where it was taken, let go of it, and go back out."""
        arm, speed = self._arm, self._ports.approach_speed
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
            yield from way.back_out(arm, speed)
        except Failure:
            return  # why it was not lifted is what counts

    def _go_before(self, order: Sequence[RankedGrasp]) -> Generator[float | None, None, WayToGrasp]:
        """Go to where the straight way to a grasp begins, and wait until that is free."""
        arm, ports, wanted = self._arm, self._ports, self._wanted
        ways: list[WayToGrasp] = []
        touched = frozenset({wanted.name} if wanted.name else ())

        def planned() -> Generator[None, None, Trajectory]:
            way = yield from first_way(arm, order, wanted, ports.standoff, ports.speed, self._seen)
            ways.append(way)
            return way.to_standoff

        unseen = touched if self._seen else frozenset[str]()
        for progress in arm.past_others(ports.speed, unseen).along(planned):
            yield None if progress is None else 0.5 * progress
        yield from arm.past_others(ports.speed, touched).until_free(ways[-1].rows, known_free=True)
        return ways[-1]

    def _approach(self, way: WayToGrasp) -> Iterator[float | None]:
        """Go straight to the grasp, and stop where the tool touches something."""
        arm, along = self._arm, way.ranked.tool.rotation_matrix[:, 2]
        sense = TouchSense(arm, along, alone=True)
        motion = arm.begin(arm.time_path(way.rows, self._ports.approach_speed), may_touch=True)
        began = arm.time
        while not motion.done:
            yield 0.5 + 0.2 * motion.progress
            arm.check()
            if sense.force() > self._ports.touch and arm.time - began > _EDGE_S:
                yield from arm.halt()
                yield from arm.relax()
                break
        if not arm.gripper.page.fingers:
            yield from self._press(way, along)
        left = float((way.ranked.tool.position - arm.tool_pose.position) @ along)
        self._metrics["approach_force_n"] = sense.most
        if left > _EARLY_M:
            raise Failure(
                "NOT_GRASPED",
                f"the gripper touched something {1e3 * left:.0f} mm before it was there",
                left_m=left,
                force_n=sense.most,
            )

    def _press(self, way: WayToGrasp, along: Vector) -> Iterator[float | None]:
        """Press a cup on, slowly: its rim lies where the face was thought to be, or lower."""
        arm, tool = self._arm, way.ranked.tool
        sense = TouchSense(arm, along)
        deeper = Pose(tool.position + _PRESSED_M * along, tool.quaternion)
        rows = arm.line_on(deeper)
        motion = arm.begin(arm.time_path(rows, _PRESSING), may_touch=True)
        while not motion.done and sense.force() < _PRESSED_N:
            yield 0.7
            arm.check()
        yield from arm.halt()

    def _close(self, way: WayToGrasp) -> Generator[float | None, None, str]:
        """Close with the force that the load asks for, and see that it is what was meant."""
        gripper, grasp, arm = self._arm.gripper, way.ranked.grasp, self._arm
        page = gripper.page
        force = self._force(grasp.force)
        gripper.command(force=force, speed=page.speed.least if not page.fingers else None)
        began, since = arm.time, None
        try:
            while since is None or arm.time - since < _HOLD_S:
                yield None
                since = None if not gripper.holding else arm.time if since is None else since
                if since is None and arm.time - began > _CLOSING_S:
                    break
        except GeneratorExit:  # halted: it lies where it lay, and nobody believes that it is held
            gripper.command(page.stroke if page.fingers else 1.0)
            raise
        self._metrics |= {"width_m": gripper.width, "grip_force_n": force}
        self._metrics["grasp_margin"] = force / max(grasp.force, 1e-9)
        name = self._wanted.name or thing_at(arm.world, arm.tool_pose.position, _REACHED_M)
        off = abs(gripper.width - grasp.width)
        why_not: str | None = None
        if since is None or name is None or (page.fingers and off > OTHER_WIDTH_M):
            why_not = _NOT_IT
        elif self._seen is None:
            elsewhere = name not in arm.world.objects  # taken away meanwhile
            why_not = _NOT_IT if elsewhere else gripper.why_not(name, arm.world.object_pose(name))
        if name is None or why_not is not None:
            numbers = {"width_m": gripper.width, "expected_m": grasp.width}
            raise Failure("NOT_GRASPED", why_not or _NOT_IT, **numbers)
        lies = gripper.between_the_pads(self._wanted.lies, way.ranked.grasp.tool)
        gripper.hold(name, lies, self._wanted.most_force, told=self._wanted.edges is None)
        return name

    def _force(self, needed: float) -> float:
        page = self._arm.gripper.page
        if not page.fingers:
            needed = page.force.most  # a vacuum crushes nothing
        return min(page.force.clipped(self._ports.force or needed), self._wanted.most_force)

    def _lift(self, name: str, grip: Grip) -> Iterator[float]:
        """Raise it a little: what hangs in the fingers keeps them apart, and weighs."""
        arm, start = self._arm, self._arm.commanded_tool_pose
        height = float(arm.world.object_pose(name).position[2])
        up = Pose(start.position + np.array((0.0, 0.0, self._ports.lift)), start.quaternion)
        move = arm.past_others(self._ports.approach_speed)
        for progress in move.straight(up, known_free=True):
            yield 0.8 + 0.2 * (progress or 0.0)
            grip.look()
        began = arm.time
        while arm.time - began < _HOLD_S or not arm.gripper.holding:
            if arm.time - began > 1.0:
                raise Failure("DROPPED", f"{name!r} is no longer held")
            yield 1.0
            grip.look()
        rose = float(arm.world.object_pose(name).position[2]) - height
        self._metrics["lifted_m"] = rose  # the truth, beside what the arm senses


def thing_at(world: World, place: Vector, radius: float) -> str | None:
    """What is known to lie at a place of the world, of shape (3,), m; None if nothing does.

    Args:
        world: World as the arm's plans know it.
        place: Place in the world.
        radius: Distance in m from there within which its centre lies.
    """
    name = _nearest(world, place)
    near = name and np.linalg.norm(world.object_pose(name).position - place) <= radius
    return name if near else None


def _nearest(world: World, place: Vector) -> str | None:
    """The thing that can be carried and whose centre is nearest to a place."""
    away = {
        name: float(np.linalg.norm(world.object_pose(name).position - place))
        for name, thing in world.objects.items()
        if not thing.fixed
    }
    return min(away, key=lambda name: away[name], default=None)


def twin_at(world: World, name: str, place: Vector) -> str:
    """Which object of a form lies at a place: the one that is named, or another one like it.

    Args:
        world: World as the arm's plans know it.
        name: Name of an object.
        place: Place in the world at which such a thing was seen, of shape (3,), m.

    Returns:
        The name of the nearest one, if that is there; else the one given.
    """
    wanted = world.declared_objects[name]
    away = {
        other: float(np.linalg.norm(world.object_pose(other).position - place))
        for other, thing in world.objects.items()
        if not thing.fixed and (thing.shape, thing.size) == (wanted.shape, wanted.size)
    }
    nearest = min(away, key=lambda other: (away[other], other != name), default=name)
    return nearest if away.get(nearest, math.inf) < 0.5 * min(wanted.size) else name


def refuse_too_frail(arm: Arm, what: str, bears: float | None) -> None:
    """Look whether a thing bears the least force of the gripper.

    Args:
        arm: Arm whose gripper it is.
        what: The thing in words.
        bears: Force in N of each pad, or of a cup, that it bears; None for any.

    Raises:
        Failure: ``INVALID_TARGET`` with both forces.
    """
    least = arm.gripper.page.force.least
    if (bears or math.inf) < least:
        reason = f"{what} bears {bears:g} N; the least that the gripper does is {least:g} N"
        raise Failure("INVALID_TARGET", reason, most_force_n=bears or 0.0, least_n=least)
