"""Hand an object over to another arm."""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterator
from functools import partial

import numpy as np

from bt_dualarm import (
    GRAVITY,
    Angle,
    ArmName,
    CarriedPose,
    Counterpart,
    Failure,
    HandoverPlan,
    HandoverWish,
    JointPart,
    LoadSense,
    ObjectName,
    PassengerCheck,
    PortModel,
    Pose,
    Skill,
    Speed,
    Vector,
    handover_label,
    let_go_of,
    port,
    retreat_from,
    shared_grasp,
)

_MOTIONS = frozenset({"NO_PLAN", "IN_COLLISION", "TIMED_OUT", "DEADLOCK", "UNREACHABLE"})
_PATIENCE_S = 15.0  # time for the taker to clear the path before another plan is tried
_LIGHTER = 0.4  # fraction of the weight that the giver's pads must have lost
_WEIGHED_M = 0.05  # height by which an object of unknown mass is raised to weigh it
_WEIGHING_SPEED = 0.15  # fraction of the arm's limits
_LEVEL = 0.4  # horizontal share of a load that is still one by the weight
_PUSHED_N = 4.0  # change of the load that shows that the taker has met the object
_FELT_N = 0.6  # weight above which pads tell whether it has become lighter
_LIGHTER_S = 1.0  # time limit to measure that once the taker carries
_MOST_RAISES = 12  # number of times that the taker is asked to raise the object a little more


class HandOver(Skill):
    """Present a held object to another arm, and release it once that arm carries it."""

    class Ports(PortModel):
        object: ObjectName = port(..., "object to hand over, which this arm holds")
        to: ArmName = port(..., "arm that takes it, with `take_over`")
        at: CarriedPose | None = port(
            None,
            "pose of the object at the handover; without an orientation any that suits both arms; "
            "by default the place is chosen by the reach of both arms",
        )
        orientation: tuple[Angle, Angle, Angle] | None = port(
            None,
            "roll, pitch and yaw of the object at the handover, wherever that is; by default any "
            "that suits both arms",
        )
        retreat: float = port(
            0.1, "length of the straight retreat from the object", unit="m", ge=0.02, le=0.5
        )
        speed: Speed = port(0.5, "fraction of the arm's limits up to the handover")
        retreat_speed: Speed = port(0.4, "fraction of the arm's limits on the retreat")

    failures = {
        "NOT_HELD": "the arm does not hold the object, or no longer does",
        "NOT_THERE": "the object is not in the world",
        "INVALID_TARGET": "the arm hands over to itself, or the orientation is given twice",
        "PARTNER_GONE": "the other arm has given up, ended or was removed",
        "NOT_TAKEN": "the other arm reports that it carries the object, "
        "but the weight on this arm's pads has not decreased",
        "NOT_OPEN": "the fingers did not open",
        "SPILLED": "what stood on the object fell off",
    }
    example = "hand_over: {object: cube, to: arm2}"
    begins_anywhere = True
    needs_held = True
    lets_go = True
    counterpart = Counterpart("take_over", partner="to", its_partner="from")
    needs = ("bt_dualarm.skill.preload_grasping",)
    ports: Ports

    def run(self) -> Iterator[float | None]:
        """Meet the taker; go where it proposes; release when it carries; retreat."""
        arm = self.arm
        name = self.ports.object
        taker = self.ports.to
        if taker == arm.name:
            raise Failure("INVALID_TARGET", f"{arm.name} cannot hand over to itself")
        if (yield from self._has_handed_over()):
            with shared_grasp(arm, taker, name):
                yield from self._retreat()
            return
        label = handover_label(name, arm.name, taker)
        with JointPart(self.context, label, (arm.name, taker)) as joint:
            yield from joint.meet()
            yield from self._weigh()
            joint.send(wish=self._wish())
            number = 0
            while True:
                plan = yield from self._present(joint, taker, number)
                number = plan.number
                self._passengers.refuse_spilled()
                arrived = self.time
                with shared_grasp(arm, taker, name):
                    if not (yield from self._pass_on(joint, taker, number)):
                        continue  # the taker could not grasp it there
                    self.metrics["handover_s"] = self.time - arrived
                    yield from self._retreat()
                joint.send(clear=True)
                self._passengers.refuse_spilled()
                return

    def _has_handed_over(self) -> Generator[None, None, bool]:
        """Whether the taker has the object: a former attempt was halted while the arm retreated.

        Raises:
            Failure: ``NOT_HELD``: neither of them has it.
        """
        arm = self.arm
        name = self.ports.object
        arm.world.objects.require(name)
        held = arm.world.attachments.find(arm.name, name)
        if held is not None and held.by_gripper:
            yield from arm.gripper.until_decided()
            held = arm.world.attachments.find(arm.name, name)
        if held is not None:
            return False
        if arm.world.attachments.find(self.ports.to, name) is not None:
            return True
        raise Failure("NOT_HELD", f"{arm.name} does not hold {name!r}: `grasp` it first")

    def _retreat(self) -> Iterator[float]:
        """Retreat from the object, which the taker holds."""
        ports = self.ports
        for progress in retreat_from(
            self.arm, ports.to, ports.object, ports.retreat, ports.retreat_speed
        ):
            yield 0.8 + 0.2 * (progress or 0.0)

    def _weigh(self) -> Iterator[float | None]:
        """Raise and lower the object until the arm knows its mass, if it has to estimate that.

        Joint friction hides the weight while the arm stands. Without the mass the taker would have
        to grip for any load, and might find no grasp.
        """
        arm = self.arm
        if not arm.world.nominal[arm.name].estimates_payload:
            return
        start = arm.commanded_tool_pose
        raised = start.raised(_WEIGHED_M)
        for end in (raised, start, raised, start):
            if self._mass() is not None:
                return
            try:
                yield from arm.past_others(_WEIGHING_SPEED).straight(end)
            except Failure as failure:
                if failure.code not in _MOTIONS | {"PATH_BROKEN", "SINGULAR"}:
                    raise
                return  # there is no room: the taker assumes a large mass

    def _mass(self) -> float | None:
        """Mass of the object with its uncertainty, kg; None if the arm does not know it."""
        return self.arm.known.mass(self.ports.object)

    def _wish(self) -> HandoverWish:
        """What the taker has to know before it chooses a pose and a grasp."""
        ports = self.ports
        at = ports.at
        turn = None if ports.orientation is None else Pose.from_rpy((0, 0, 0), ports.orientation)
        quaternion = None if turn is None else turn.quaternion
        if at is not None and (at.rpy or at.quat or at.look_at):
            if turn is not None:
                raise Failure("INVALID_TARGET", "`at` and `orientation` both turn the object")
            quaternion = at.pose.quaternion
        return HandoverWish(None if at is None else np.array(at.xyz), quaternion, self._mass())

    def _present(
        self, joint: JointPart, taker: str, number: int
    ) -> Generator[float | None, None, HandoverPlan]:
        """Go where the taker proposes, or tell it that this is not possible; return the plan.

        Args:
            joint: The handover.
            taker: Name of the taker.
            number: Number of the last plan, which has failed; 0 before the first.
        """
        arm = self.arm
        while True:
            yield from self._stand(joint, partial(_is_beyond, joint, taker, number))
            plan: HandoverPlan = joint.messages(taker)["plan"]
            number = plan.number
            self._passengers = PassengerCheck(arm.world, self.ports.object, [plan.object_pose])
            try:
                for progress in arm.travel([plan.giver_q], self.ports.speed, patience=_PATIENCE_S):
                    joint.check()
                    if _plan(joint, taker) > number:
                        break
                    yield None if progress is None else 0.4 * progress
                else:
                    joint.send(arrived=number, arrived_s=self.time)
                    yield from self._stand(joint, partial(_is_there, joint, taker, number))
                    if joint.messages(taker).get("at") == number:
                        return plan
            except Failure as failure:
                if failure.code not in _MOTIONS:
                    raise
                joint.send(refused=(number, f"{failure.code}: {failure.reason}"))
            yield from arm.halt()

    def _stand(self, joint: JointPart, fulfilled: Callable[[], bool]) -> Iterator[None]:
        """Wait for the taker, and monitor the grip meanwhile."""
        for _ in joint.until(fulfilled):
            self.arm.check()
            yield

    def _pass_on(
        self, joint: JointPart, taker: str, number: int
    ) -> Generator[float | None, None, bool]:
        """Hold still until the taker carries the object, then release it.

        Returns:
            Whether the taker has it; otherwise it proposes another plan.
        """
        arm = self.arm
        name = self.ports.object
        messages = joint.messages
        sense = LoadSense(arm)
        before = sense.look()
        while not sense.is_settled:
            yield 0.5
            before = sense.look()
        weight = self._weight(sense, before)
        feels = sense.is_tactile and weight is not None and weight > _FELT_N
        joint.send(ready=number, weight_n=weight, feels=feels)
        first = before
        is_pushed = not sense.is_tactile  # the joints detect it too late
        for _ in joint.until(
            lambda: messages(taker).get("grasped") == number or _plan(joint, taker) > number
        ):
            arm.check()
            before = sense.look()
            if not is_pushed and float(np.linalg.norm(before - first)) > _PUSHED_N:
                is_pushed = True
                joint.send(pushed=number)
            yield 0.5
        if messages(taker).get("grasped") != number:
            return False
        sense = yield from self._until_carried(joint, taker, number, before, weight)
        if messages(taker).get("carries") != number:
            return False
        yield from self._has_become_lighter(joint, number, sense, before, weight)
        joint.send(releasing=True)
        # The taker answers that it keeps the object, and does so even if its leaf ends now.
        for _ in joint.until(lambda: "keeps" in messages(taker)):
            arm.check()
            yield 0.7
        if taker not in arm.world.arms:
            joint.check()
        yield from let_go_of(arm, name)
        joint.send(released=True)
        return True

    def _until_carried(
        self, joint: JointPart, taker: str, number: int, before: Vector, weight: float | None
    ) -> Generator[float, None, LoadSense]:
        """Wait until the taker carries the object, or proposes another plan.

        A taker without pads raises the object in steps; after each of them it asks whether the
        object has become lighter here.

        Returns:
            The load since the last of these steps.
        """
        messages = joint.messages
        sense = LoadSense(self.arm)
        answered: tuple[int, int] | None = None
        while True:
            for _ in joint.until(partial(_has_news, joint, taker, number, answered)):
                self.arm.check()
                sense.look()
                yield 0.6
            if messages(taker).get("raised") == answered:
                return sense
            answered = messages(taker)["raised"]
            sense = LoadSense(self.arm)
            load = sense.look()
            while not sense.is_settled:
                yield 0.6
                joint.check()
                self.arm.check()
                load = sense.look()
            joint.send(lighter=(answered, _is_lighter(before, load, weight)))

    def _weight(self, sense: LoadSense, load: np.ndarray) -> float | None:
        """Weight of the object, N: from its mass if known, otherwise from the pads.

        None if neither shows it: a load that is not vertical comes from something else as well,
        such as the palm.
        """
        for one in self.arm.payload:
            if one.object == self.ports.object and one.mass is not None:
                return GRAVITY * one.mass
        level = float(np.linalg.norm(load[:2]))
        is_plausible = sense.is_tactile and level < _LEVEL * -float(load[2])
        return -float(load[2]) if is_plausible else None

    def _has_become_lighter(
        self,
        joint: JointPart,
        number: int,
        sense: LoadSense,
        before: np.ndarray,
        weight: float | None,
    ) -> Iterator[float]:
        """Wait until the pads feel that the object has become lighter, if they can.

        The arms go on to press each other apart after the taker has felt the weight, which may load
        this one again: the taker is then asked to raise the object a little.
        """
        began = self.time
        raises = 0
        while sense.is_tactile and weight is not None and weight > _FELT_N:
            load = sense.look()
            lighter = float(load[2] - before[2])
            self.metrics |= {"weight_n": weight, "lighter_n": lighter}
            if _is_lighter(before, load, weight):
                return
            joint.check()
            self.arm.check()
            if self.time - began > _LIGHTER_S:
                if raises >= _MOST_RAISES:
                    raise Failure(
                        "NOT_TAKEN",
                        f"{self.ports.to} reports that it carries {self.ports.object!r}, but "
                        f"{-float(load[2]):.1f} of {weight:.1f} N are still felt here",
                        weight_n=weight,
                        lighter_n=lighter,
                    )
                raises += 1
                joint.send(heavy=(number, raises))
                for _ in joint.until(partial(_has_raised, joint, self.ports.to, number, raises)):
                    self.arm.check()
                    yield 0.7
                sense = LoadSense(self.arm)
                while not sense.is_settled:
                    sense.look()
                    yield 0.7
            yield 0.7


def _has_raised(joint: JointPart, taker: str, number: int, raises: int) -> bool:
    """Whether the taker has raised the object as often as it was asked to."""
    return joint.messages(taker).get("raised_more") == (number, raises)


def _is_lighter(before: Vector, load: Vector, weight: float | None) -> bool:
    """Whether the pads have lost enough of the weight in N; loads are of shape (3,), in N."""
    if weight is None:
        return True
    # It may have become lighter before, while the taker closed.
    left = -float(load[2])
    return float(load[2] - before[2]) > _LIGHTER * weight or left < (1.0 - _LIGHTER) * weight


def _is_beyond(joint: JointPart, taker: str, number: int) -> bool:
    """Whether the taker has proposed another plan."""
    return _plan(joint, taker) > number


def _is_there(joint: JointPart, taker: str, number: int) -> bool:
    """Whether the taker is at its standoff, or has proposed another plan."""
    return joint.messages(taker).get("at") == number or _plan(joint, taker) > number


def _has_news(joint: JointPart, taker: str, number: int, answered: tuple[int, int] | None) -> bool:
    """Whether the taker carries the object, has proposed another plan, or asks something new."""
    messages = joint.messages(taker)
    is_decided = messages.get("carries") == number or _plan(joint, taker) > number
    return is_decided or messages.get("raised") != answered


def _plan(joint: JointPart, taker: str) -> int:
    """Number of the plan that the taker has proposed last; 0 before the first."""
    plan = joint.messages(taker).get("plan")
    return 0 if plan is None else int(plan.number)
