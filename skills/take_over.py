"""Take an object from another arm."""

from __future__ import annotations

import math
from collections.abc import Callable, Generator, Iterator, Sequence
from functools import partial
from typing import Any, ClassVar, Self

import numpy as np
from pydantic import create_model, model_validator

from bt_dualarm import (
    ArmName,
    Counterpart,
    Failure,
    Grip,
    HandoverPlan,
    HandoverSearch,
    JointPart,
    LoadSense,
    ObjectName,
    ObjectPose,
    PassengerCheck,
    PortModel,
    Pose,
    Skill,
    Speed,
    TouchSense,
    Vector,
    handover_label,
    let_go_of,
    let_leave,
    object_in_hand,
    port,
    shared_grasp,
    tool_pose_of,
    true_error,
)

_MOTIONS = frozenset({"NO_PLAN", "IN_COLLISION", "TIMED_OUT", "DEADLOCK", "UNREACHABLE"})
_ELSEWHERE = _MOTIONS | {
    "NOT_GRASPED",
    "NOT_CARRIED",
    "PATH_BROKEN",
    "SINGULAR",
    "COLLISION",
}
_OPENS_S = 2.0  # time in which a giver opens its gripper
_HELD_UP_S = 2.0  # wait where the guard has stopped the approach
_HOLD_S = 0.12  # time for which the pads must press
_CLOSING_S = 2.5
_TRANSFER_S = 0.4  # time over which the weight is taken over
_STEPS = 8
_CARRIES = 0.5  # fraction of the weight that the taker's pads must measure
_FELT_N = 0.6
_MET_N = 1.5  # load on the pads that shows a contact
_WIDTH_M = 0.006
_PRESSED_M = 0.006
_PRESSED_N = 12.0
_PUSHES_N = 20.0  # contact force that the joints feel, at which the approach ends
_EARLY_M = 0.015  # before the goal, where fingers still reach around the object
_TOUCH_M = 0.004  # distance at which a bare tool can be attached to the object
_NEAR_M = 0.001
_NEARING_M_S = 0.02  # speed of a bare tool where it may touch the object, and its distance then
_NEARING_M = 0.01
_STEP_M = 0.0005  # longest step of the set-point along a pull
_MOST_STEPS = 24
_RAISE_M = 0.00025  # step of a hand without pads, and their number
_MOST_RAISES = 12
_MOST_LEVEL = 4  # a horizontal pull is accepted after this many steps
_LEVEL_N = 10.0  # horizontal pull that is not followed: the arms' friction would reverse it
_STIFFNESS = (8e3, 4e4, 2e5)  # of two arms at one object: least, first guess, most, N/m
_HELD_M = 0.03
_THERE_RAD = 1e-6
_LIFT_ROOM_M = 0.005  # distance that the lifted object keeps from everything but arms
_TOWARD = 0.2  # cosine beyond which a lift leads toward the giver
_LIFT_WAIT_S = 0.5
_EARLY_S = 2.0  # time to wait for the giver on the way to the standoff before it has arrived
_PATIENCE_S = 60.0  # the same once it has arrived
_HELD_UP = frozenset({"DEADLOCK", "TIMED_OUT"})  # failures of motions that another arm holds up
_EDGE_S = 0.3  # start of the approach to ignore: joints that break away changed a UR5e's by 48 N
_TRIES = 3  # maximum number of motions to the standoff


class _Ports(PortModel):
    object: ObjectName = port(..., "object to take over")
    then_at: ObjectPose | None = port(
        None,
        "pose at which `place` will set the object down, with an orientation: grasps with which "
        "this arm can do that are chosen",
    )
    standoff: float = port(0.1, "length of the straight approach", unit="m", ge=0.04, le=0.3)
    lift: float = port(0.03, "height of the lift that tests the grip", unit="m", ge=0, le=0.5)
    force: float | None = port(
        None,
        "force of each pad, or of a cup; by default what the load needs",
        unit="N",
        gt=0,
        le=5000,
    )
    most_force: float | None = port(
        None,
        "largest force of each pad, or of a cup, that the object withstands",
        unit="N",
        gt=0,
        le=5000,
    )
    mass: float | None = port(
        None, "assumed mass; by default the giver's estimate", unit="kg", gt=0, le=100
    )
    shake: float = port(
        8.0, "acceleration of the tool that the grip must withstand", unit="m/s²", ge=0, le=50
    )
    margin: float = port(1.5, "safety factor of the grip", unit="times the load", ge=1, le=10)
    speed: Speed = port(0.5, "fraction of the arm's limits up to the standoff")
    approach_speed: Speed = port(0.3, "fraction of the arm's limits on the straight parts")

    @model_validator(mode="after")
    def _goal_has_an_orientation(self) -> Self:
        if self.then_at is not None and not self.then_at.is_oriented:
            raise ValueError(
                "then_at needs an orientation, such as rpy: [0, 0, 0]: the one at the handover is "
                "not known yet"
            )
        return self


class TakeOver(Skill):
    """Take an object out of the hand of another arm, without a moment in which nobody holds it."""

    # `from` is a keyword of Python: it cannot be written as an attribute of a class.
    _giver: ClassVar[dict[str, Any]] = {
        "from": (ArmName, port(..., "arm that hands it over, with `hand_over`"))
    }
    Ports = create_model("Ports", __base__=_Ports, **_giver)

    failures = {
        "GRIPPER_FULL": "the gripper holds something else, or something is attached to the tool",
        "NOT_THERE": "the object is not in the world",
        "INVALID_TARGET": "the arm takes over from itself, or the object is fixed",
        "PARTNER_GONE": "the other arm has given up, ended or was removed",
        "OUT_OF_REACH": "there is no place at which one arm can present it and the other take it",
        "SLIPPED": "the object slid between the fingers",
        "DROPPED": "the object was lost",
        "SPILLED": "what stood on the object fell off",
    }
    example = "take_over: {object: cube, from: arm2}"
    begins_anywhere = True
    takes_hold = True
    counterpart = Counterpart("hand_over", partner="from", its_partner="to")
    needs = ("bt_dualarm.skill.preload_grasping",)
    ports: Any
    _met_q: Vector | None = None  # where the fingers began to close

    def run(self) -> Iterator[float | None]:
        """Meet the giver; choose place and grasp; close next to its fingers; take the weight."""
        arm = self.arm
        name = self.ports.object
        giver = getattr(self.ports, "from")
        if giver == arm.name:
            raise Failure("INVALID_TARGET", f"{arm.name} cannot take over from itself")
        arm.world.objects.require(name)
        if arm.name in arm.world.grippers:
            yield from arm.gripper.until_decided()
        if (yield from self._has_taken(giver)):
            for _ in let_leave(arm, giver, name):
                yield 0.9
            return
        if arm.name in arm.world.grippers:
            arm.gripper.refuse_full()
            self._open()
        label = handover_label(name, giver, arm.name)
        with JointPart(self.context, label, (giver, arm.name)) as joint:
            yield from joint.meet()
            # The giver may have to raise the object first, to weigh it.
            move = arm.past_others(self.ports.speed)
            for _ in joint.until(lambda: "wish" in joint.messages(giver), moves_aside=True):
                yield from move.make_way()
                yield 0.0
            try:
                yield from self._take(joint, giver)
            except Failure as failure:
                if failure.code == "SLIPPED":  # or is it lost?
                    for _ in self._grip.judge(failure):
                        yield 0.9
                raise
            self.metrics["handover_s"] = self.time - float(joint.messages(giver)["arrived_s"])

    def _has_taken(self, giver: str) -> Generator[float | None, None, bool]:
        """Whether this arm has the object already: a former attempt was halted near its end.

        From the moment in which it has confirmed that it keeps the object, the giver opens.
        """
        held = self.arm.world.attachments
        name = self.ports.object
        began = self.time
        while held.find(self.arm.name, name) is not None:
            if held.find(giver, name) is None:
                return True
            if self.time - began > _OPENS_S:
                return False
            yield 0.7
        return False

    def _take(self, joint: JointPart, giver: str) -> Iterator[float | None]:
        """Choose a place and a grasp, and take the object there; elsewhere if that fails."""
        arm = self.arm
        ports = self.ports
        name = ports.object
        search = HandoverSearch(
            arm,
            giver,
            name,
            joint.messages(giver)["wish"],
            standoff=ports.standoff,
            margin=ports.margin,
            shake=ports.shake,
            most_force=ports.most_force or math.inf,
            mass=ports.mass,
            goal=None if ports.then_at is None else ports.then_at.pose,
        )
        reasons = list[str]()
        for plan in search.find():
            joint.check()
            if plan is None:
                yield 0.0
                continue
            self.metrics |= {"plan": plan.number, "tries": search.tries}
            joint.send(plan=plan)
            passengers = PassengerCheck(arm.world, name, [plan.object_pose])
            reason = yield from self._meet_at(joint, giver, plan)
            if not reason:
                with shared_grasp(arm, giver, name):
                    reason = yield from self._try(joint, giver, plan)
            if not reason:
                yield from self._lift(name, giver)
                arm.known.weighed(name, search.known_mass)
                passengers.refuse_spilled()
                return
            reasons.append(reason)
            yield from arm.halt()
        if reasons:
            raise Failure(
                "OUT_OF_REACH",
                f"no handover was possible ({len(reasons)} tried); the first: {reasons[0]}",
                tries=search.tries,
            )
        raise search.refusal()

    def _meet_at(
        self, joint: JointPart, giver: str, plan: HandoverPlan
    ) -> Generator[float | None, None, str]:
        """Go to the standoff while the giver presents the object; returns why not, or nothing."""
        arm = self.arm
        messages = joint.messages

        def refused() -> str:
            refusal = messages(giver).get("refused")
            return "" if refusal is None or refusal[0] != plan.number else f"{giver}: {refusal[1]}"

        def arrived() -> bool:
            return messages(giver).get("arrived") == plan.number or bool(refused())

        try:
            move = arm.past_others(self.ports.speed)
            trail = [arm.setpoint.q]
            try:
                # At the same time as the giver, but not in its way.
                for progress in self._go(joint, plan, lambda: bool(refused()), _EARLY_S):
                    trail.append(arm.setpoint.q)
                    yield progress
            except Failure as failure:
                # The giver could wait for this arm, and this arm for the giver: let it pass first.
                if failure.code not in _HELD_UP and giver not in move.blockers(failure):
                    raise
                yield from self._go_back(joint, trail, arrived)
            for _ in joint.until(arrived, moves_aside=True):
                yield from move.make_way()
                yield 0.3
            if not refused():
                yield from self._go(joint, plan, lambda: bool(refused()))
            if not refused():
                joint.send(at=plan.number)
                for _ in joint.until(
                    lambda: messages(giver).get("ready") == plan.number or bool(refused())
                ):
                    yield 0.3
        except Failure as failure:
            if failure.code not in _MOTIONS:
                raise
            return f"{arm.name}: {failure.code}: {failure.reason}"
        return refused()

    def _go_back(
        self, joint: JointPart, trail: Sequence[Vector], is_over: Callable[[], bool]
    ) -> Iterator[float | None]:
        """Go back the way that the arm has come: from next to the object no plan might begin.

        Args:
            joint: The handover.
            trail: Set-points on that way, each of shape (dof,), rad.
            is_over: Whether the giver has passed, and the arm need not go farther.
        """
        arm = self.arm
        yield from arm.halt()
        rows = np.array([arm.setpoint.q, *trail[::-1]])
        moves = np.abs(np.diff(rows, axis=0)).max(axis=1) > _THERE_RAD
        rows = rows[np.insert(moves, 0, True)]
        if len(rows) < 2:
            return
        motion = arm.begin(arm.time_path(rows, self.ports.speed), may_touch=True)
        while not motion.done:
            if is_over():
                yield from arm.halt()
                return
            yield None
            joint.check()
            arm.check()
            arm.refuse_when_held_up(motion, _HELD_UP_S)
        yield from arm.settle()

    def _go(
        self,
        joint: JointPart,
        plan: HandoverPlan,
        is_over: Callable[[], bool],
        patience: float = _PATIENCE_S,
    ) -> Iterator[float | None]:
        """Go to the standoff, until something else is over; wait for so many s on the way."""
        arm = self.arm
        tries = _TRIES
        while not is_over() and np.abs(arm.setpoint.q - plan.taker_q).max() > _THERE_RAD:
            tries -= 1
            try:
                for progress in arm.travel([plan.taker_q], self.ports.speed, patience=patience):
                    joint.check()
                    if is_over():
                        yield from arm.halt()
                        return
                    yield None if progress is None else 0.3 * progress
            except Failure as failure:
                # The giver has come to stand in the path, and waits for this arm: plan around it.
                if failure.code != "DEADLOCK" or tries <= 0:
                    raise
                yield from arm.halt()

    def _try(
        self, joint: JointPart, giver: str, plan: HandoverPlan
    ) -> Generator[float | None, None, str]:
        """Grasp the object, take over the weight, and keep it.

        Returns:
            Why it could not be grasped here; empty if this arm has the object.
        """
        arm = self.arm
        name = self.ports.object
        keeps = False
        out = arm.commanded_tool_pose
        try:
            try:
                object_pose = tool_pose_of(arm.world, giver) @ object_in_hand(arm, giver, name)
                yield from self._approach(joint, giver, plan.number, object_pose @ plan.grasp.tool)
                yield from self._close(joint, plan)
                object_pose = tool_pose_of(arm.world, giver) @ object_in_hand(arm, giver, name)
                self._hold(name, object_pose, plan.grasp.tool)
                felt = yield from self._relax(joint)
                joint.send(grasped=plan.number)
                yield from self._bear(joint, giver, name, felt, plan.number)
            except Failure as failure:
                if failure.code not in _ELSEWHERE or self._keeps(joint, giver, promised=False):
                    raise
                yield from self._let_go(name, out)
                return f"{arm.name}: {failure.code}: {failure.reason}"
            joint.send(carries=plan.number)
            yield from self._until_released(joint, giver, plan.number)
            joint.send(keeps=True)
            keeps = True
            yield 0.7
            for _ in joint.until(lambda: "released" in joint.messages(giver)):
                self._watch()
                yield 0.75
            for _ in joint.until(lambda: "clear" in joint.messages(giver)):
                self._watch()
                yield 0.8
        except Failure:
            if not self._keeps(joint, giver, promised=keeps):
                yield from self._let_go(name, out)
            raise
        except GeneratorExit:
            if not self._keeps(joint, giver, promised=keeps):
                self._drop_belief(name)
            raise
        return ""

    def _keeps(self, joint: JointPart, giver: str, *, promised: bool) -> bool:
        """Whether this arm has to keep the object, because the giver does not, or is about to open.

        Args:
            joint: The handover.
            giver: Name of the giver.
            promised: Whether this arm has confirmed to the giver that it keeps it.
        """
        held = self.arm.world.attachments
        name = self.ports.object
        if held.find(self.arm.name, name) is None:
            return False
        if held.find(giver, name) is None or giver not in self.arm.world.arms:
            return True
        return promised and not joint.left(giver)  # one that left did not open its gripper

    # Steps of taking over

    def _open(self) -> None:
        gripper = self.arm.gripper
        gripper.command(gripper.description.stroke if gripper.description.fingers else 1.0)

    def _approach(
        self, joint: JointPart, giver: str, number: int, goal: Pose
    ) -> Iterator[float | None]:
        """Move straight to the grasp, compliant, so that a contact presses little.

        Raises:
            Failure: ``NOT_GRASPED``: something is in the way; ``IN_COLLISION``; as motions.
        """
        arm = self.arm
        name = self.ports.object
        rows = arm.line_on(goal)
        arm.refuse_collision_along(rows, frozenset({name}))
        along = goal.rotation_matrix[:, 2]
        sense = TouchSense(arm, along, alone=True)
        path = arm.time_path(rows, self.ports.approach_speed)
        if self._is_bare:
            # It stops in contact, not before: a faster one would turn the object in the fingers.
            fast = arm.commanded_tool_pose.distance(goal) - self._tip_m() - _NEARING_M
            path = arm.slowing_path(
                rows,
                self.ports.approach_speed,
                lambda lengths: np.where(lengths < fast, np.inf, _NEARING_M_S),
            )
        motion = arm.begin(path, may_touch=True, compliant=True)
        began = arm.time
        while not motion.done:
            yield 0.3 + 0.2 * motion.progress
            arm.check()
            joint.check()
            arm.refuse_when_held_up(motion, _HELD_UP_S)
            pushes = False
            if arm.time - began > _EDGE_S:
                pushes = sense.exceeds(_PUSHES_N)
            else:
                sense.listen()
            # The giver's pads detect a push at once, its joints only later.
            if joint.messages(giver).get("pushed") == number or pushes:
                yield from arm.halt(give_way=True)
                for _ in arm.relax(stays_compliant=True):
                    yield 0.5
                break
            if self._is_bare and arm.world.tool_gap(arm.name, name) < _NEAR_M:
                break
        yield from arm.halt()  # the compensation is frozen: contact force does not build up
        self.metrics["approach_force_n"] = sense.most
        left = float((goal.position - arm.tool_pose.position) @ along)
        if left > _EARLY_M:
            raise Failure(
                "NOT_GRASPED",
                f"the hand touched something {1e3 * left:.0f} mm before its goal",
                left_m=left,
            )
        if not (self._has_fingers or self._is_bare):
            yield from self._press(joint, goal, along)

    @property
    def _is_bare(self) -> bool:
        """Whether the tool has no gripper: it is attached to the object by a weld."""
        return self.arm.name not in self.arm.world.grippers

    def _tip_m(self) -> float:
        """Distance, m, by which the bare tool reaches beyond its frame: that of boxes around it."""
        world = self.arm.world
        tool = world.nominal[self.arm.name].tool_pose_at(self.arm.q)
        into = tool.rotation_matrix[:, 2]
        farthest = 0.0
        for geom in world.arms[self.arm.name].tool_geom_ids:
            rotation = world.sensed.geom_xmat[geom].reshape(3, 3)
            center, half = world.model.geom_aabb[geom].reshape(2, 3)
            tip = world.sensed.geom_xpos[geom] + rotation @ center - tool.position
            farthest = max(farthest, float(tip @ into + half @ np.abs(into @ rotation)))
        return farthest

    @property
    def _has_fingers(self) -> bool:
        arm = self.arm
        return arm.name in arm.world.grippers and bool(arm.gripper.description.fingers)

    def _press(self, joint: JointPart, goal: Pose, along: np.ndarray) -> Iterator[float | None]:
        """Press a cup on slowly, beyond the estimated face, until it seals or presses firmly.

        Far from the giver's fingers, a cup that goes on pressing turns the object in them.
        """
        arm = self.arm
        arm.gripper.command(force=self._force(arm.gripper.description.force.most))
        sense = TouchSense(arm, along)
        rows = arm.line_on(goal.shifted(_PRESSED_M * along))
        motion = arm.begin(arm.time_path(rows, 0.01), may_touch=True, compliant=True)
        while not (motion.done or arm.gripper.holding) and sense.force() < _PRESSED_N:
            yield 0.5
            arm.check()
            joint.check()
        yield from arm.halt()

    def _force(self, needed: float) -> float:
        """Force of each pad, or of a cup, for one that the load needs, N."""
        force = self.arm.gripper.description.force.clipped(self.ports.force or needed)
        return min(force, self.ports.most_force or math.inf)

    def _close(self, joint: JointPart, plan: HandoverPlan) -> Iterator[float | None]:
        """Close gently, yield to the object, then grip it with the required force."""
        arm = self.arm
        name = self.ports.object
        if arm.name not in arm.world.grippers:
            gap = arm.world.tool_gap(arm.name, name)
            if gap > _TOUCH_M:
                raise Failure("NOT_GRASPED", f"the tool is {1e3 * gap:.0f} mm from {name!r}")
            return
        self._met_q = arm.setpoint.q
        gripper = arm.gripper
        description = gripper.description
        grasp = plan.grasp
        force = self._force(grasp.force if description.fingers else description.force.most)
        gentle = min(description.force.least, force) if description.fingers else force
        gripper.command(force=gentle)
        yield from self._until_holding(joint, yields=bool(description.fingers))
        if description.fingers:
            error = abs(gripper.width - grasp.width)
            if error > _WIDTH_M:
                raise Failure(
                    "NOT_GRASPED",
                    f"the fingers are {1e3 * gripper.width:.1f} mm apart instead of "
                    f"{1e3 * grasp.width:.1f} mm",
                    width_m=gripper.width,
                    expected_m=grasp.width,
                )
        gripper.command(force=force)
        yield from self._until_holding(joint, yields=bool(description.fingers))
        self.metrics |= {"width_m": gripper.width, "grip_force_n": force}
        self.metrics["grasp_margin"] = force / max(grasp.force, 1e-9)

    def _until_holding(self, joint: JointPart, *, yields: bool = False) -> Iterator[float | None]:
        """Wait until the gripper holds; meanwhile follow a finger that has met the object first."""
        arm = self.arm
        latest = arm.time + arm.gripper.closing_limit_s(_CLOSING_S)
        since: float | None = None
        sense = LoadSense(arm)
        relaxing: Iterator[float] = iter(())
        is_met = False
        while since is None or arm.time - since < _HOLD_S:
            if yields and sense.is_tactile:
                is_met = is_met or float(np.linalg.norm(sense.look())) > _MET_N
            if yields and is_met and next(relaxing, None) is None:
                relaxing = arm.relax(stays_compliant=True, near=self._met_q)
            yield 0.5
            arm.check()
            joint.check()
            since = None if not arm.gripper.holding else arm.time if since is None else since
            if since is None and arm.time > latest:
                raise Failure(
                    "NOT_GRASPED",
                    "the gripper closed on something else or nothing",
                    width_m=arm.gripper.width,
                    force_n=arm.gripper.force,
                )
        # It yields to the end: the next motion begins at rest.
        for _ in relaxing if arm.controller.motion is not None else ():
            yield 0.5
            joint.check()
        while arm.controller.motion is not None:
            yield 0.5
            arm.check()
            joint.check()

    def _relax(self, joint: JointPart) -> Generator[float | None, None, float]:
        """Yield to the forces between the arms; returns the load on the pads then, N."""
        sense = LoadSense(self.arm)
        felt = -float(sense.look()[2])
        for _ in self.arm.relax(stays_compliant=True, near=self._met_q):
            yield 0.55
            joint.check()
            felt = -float(sense.look()[2])
        while not sense.is_settled:
            yield 0.55
            felt = -float(sense.look()[2])
        return felt

    def _hold(self, name: str, object_pose: Pose, meant: Pose) -> None:
        """Believe that the object is held, as well as by the giver, which bears its weight.

        Args:
            name: Name of the object.
            object_pose: Its estimated pose in the world.
            meant: Planned pose of the tool in its frame.
        """
        arm = self.arm
        if arm.name not in arm.world.grippers:
            arm.attach(name, object_pose, share=0.0)
            return
        most = self.ports.most_force or math.inf
        arm.gripper.hold(name, arm.gripper.between_the_pads(object_pose, meant), most, share=0.0)
        self._grip = Grip(arm, name)

    def _watch(self) -> None:
        """Check the grip."""
        self.arm.check()
        if self.arm.name in self.arm.world.grippers:
            self._grip.look()

    def _bear(
        self, joint: JointPart, giver: str, name: str, before: float, number: int
    ) -> Iterator[float | None]:
        """Take over the weight: in the model, then by lifting until the pads feel it.

        Args:
            joint: The handover.
            giver: Name of the giver.
            name: Name of the object.
            before: Load on the pads while the giver bears the weight, N. Gain errors of the pads
                under the grip force are part of it.
            number: Number of the plan.
        """
        arm = self.arm
        bear = arm.world.attachments.bear
        for step in range(1, _STEPS + 1):
            if giver in arm.world.attachments.holders(name):  # a removed arm left all of it
                bear(arm.name, name, step / _STEPS)
            until = arm.time + _TRANSFER_S / _STEPS
            while arm.time < until:
                self._watch()
                joint.check()
                yield 0.6
        sense = LoadSense(arm)
        weight = joint.messages(giver).get("weight_n")
        if not sense.is_tactile:
            yield from self._raise_until_lighter(joint, giver, number)
            return
        if weight is None or weight < _FELT_N:
            return
        # Because of the pads' gain errors, the grip force appears as a load, too.
        description = arm.gripper.description
        gain = 0.0 if description.tactile is None else description.tactile.gain
        axis = arm.tool_pose.rotation_matrix[:, 1]
        along = 2.0 * gain * arm.gripper.commanded.force
        doubt = along * abs(float(axis[2]))
        steps = 0
        stiffness = _STIFFNESS[1]
        shift = load_before = np.zeros(3)
        while True:
            load = sense.look()
            while not sense.is_settled:
                self._watch()
                joint.check()
                yield 0.65
                load = sense.look()
            felt = -float(load[2])
            carries = max(felt - doubt, felt - before) >= _CARRIES * weight
            if steps:
                # The arms are stiffer than they seem where the step has ended their friction.
                stiffness = _measured_stiffness(load_before - load, shift, stiffness)
            load_before = load.copy()
            closing = float(load @ axis)
            load = load - float(np.clip(closing, -along, along)) * axis
            level = float(np.linalg.norm(load[:2]))
            if carries and (level < _LEVEL_N or steps >= _MOST_LEVEL):
                break
            if steps >= _MOST_STEPS:
                raise Failure(
                    "NOT_CARRIED",
                    f"the pads feel {felt:.1f} N of {weight:.1f} N",
                    weight_n=weight,
                    felt_n=felt,
                )
            steps += 1
            # The hand follows a pull, upward until it bears the weight.
            pull = load + np.array((0.0, 0.0, max(felt, weight)))
            if level < _LEVEL_N:
                pull[:2] = 0.0
            if not carries:
                pull[2] += weight + doubt
            shift = pull / stiffness
            shift *= min(1.0, _STEP_M / max(float(np.linalg.norm(shift)), 1e-9))
            yield from self._shift(joint, shift)
            sense = LoadSense(arm)
        self.metrics |= {"weight_n": weight, "felt_n": felt, "steps": steps}

    def _raise_until_lighter(
        self, joint: JointPart, giver: str, number: int
    ) -> Iterator[float | None]:
        """Raise the object by the feeling of the giver's pads, as this hand has none.

        Friction in the joints can hide that this arm does not bear what its model says.
        """
        if not joint.messages(giver).get("feels"):
            return
        for step in range(_MOST_RAISES + 1):
            if step:
                yield from self._shift(joint, np.array((0.0, 0.0, _RAISE_M)))
            question = (number, step)
            joint.send(raised=question)
            for _ in joint.until(partial(_has_answered, joint, giver, question)):
                self._watch()
                yield 0.65
            if joint.messages(giver)["lighter"][1]:
                self.metrics["raised_m"] = step * _RAISE_M
                return
        raise Failure(
            "NOT_CARRIED",
            f"{giver} feels no loss of weight after {1e3 * _MOST_RAISES * _RAISE_M:.0f} mm",
        )

    def _until_released(
        self, joint: JointPart, giver: str, number: int
    ) -> Generator[float | None, None, None]:
        """Wait for the giver to announce the release; raise the object where it asks for that."""
        raises = 0
        while "releasing" not in joint.messages(giver):
            question = (number, raises + 1)
            if joint.messages(giver).get("heavy") == question:
                yield from self._shift(joint, np.array((0.0, 0.0, _RAISE_M)))
                raises += 1
                joint.send(raised_more=question)
            for _ in joint.until(partial(_is_asked, joint, giver, (number, raises + 1))):
                self._watch()
                yield 0.7

    def _shift(self, joint: JointPart, shift: Vector) -> Iterator[float | None]:
        """Move the set-point of the compliant arm a little, by a vector of shape (3,), m."""
        arm = self.arm
        here = arm.commanded_tool_pose
        rows = arm.line_on(here.shifted(shift))
        motion = arm.begin(arm.time_path(rows, 0.05), may_touch=True, compliant=True)
        while not motion.done:
            yield 0.65
            self._watch()
            joint.check()

    def _let_go(self, name: str, out: Pose) -> Iterator[float | None]:
        """Leave the object to the giver and retreat; the leaf fails with another reason."""
        arm = self.arm
        try:
            for _ in arm.halt():
                yield None
            if arm.world.attachments.find(arm.name, name) is not None:
                for _ in let_go_of(arm, name):
                    yield None
            elif arm.name in arm.world.grippers:
                self._open()
                for _ in arm.gripper.until_open():
                    yield None
            rows = arm.line_on(out)
            motion = arm.begin(arm.time_path(rows, 0.5 * self.ports.approach_speed), may_touch=True)
            while not motion.done:
                yield None
                arm.check()
                arm.refuse_when_held_up(motion, _HELD_UP_S)
            yield from arm.settle()
        except Failure:
            # The hands may be too near to each other to retreat, if the giver's leaf has ended.
            arm.release()

    def _drop_belief(self, name: str) -> None:
        """Open at once, without a tick: the giver keeps the object."""
        arm = self.arm
        if not arm.is_present:
            return
        if arm.name not in arm.world.grippers:
            arm.detach(name)
            return
        self._open()
        arm.gripper.let_go(name)

    def _lift(self, name: str, giver: str) -> Iterator[float | None]:
        """Lift the object a little, or move it away from the giver, and check that it is held."""
        arm = self.arm
        try:
            for _ in arm.relax(stays_compliant=True):
                yield 0.9
        except Failure as failure:
            if failure.code not in _ELSEWHERE:
                raise
            yield from arm.halt()  # the giver has retreated less than arms keep from each other
        here = arm.commanded_tool_pose
        up = np.array((0.0, 0.0, 1.0))
        away = np.zeros(3)
        if giver in arm.world.arms:
            away = here.position - tool_pose_of(arm.world, giver).position
            away /= max(float(np.linalg.norm(away)), 1e-9)
        # Not toward the giver's hand, which is still near.
        directions = [up, -here.rotation_matrix[:, 2], up + away, away]
        for direction in sorted(directions, key=lambda one: float(one @ away) < -_TOWARD):
            goal = here.shifted(self.ports.lift * direction)
            try:
                rows = arm.line_on(goal)
                arm.refuse_collision_along(rows)
                # Where it would just not touch something, it may press onto it: it is held
                # somewhat elsewhere than estimated.
                room = arm.checker()
                room.keep_clear(_LIFT_ROOM_M)
                found = room.first_contact(rows)
                if found is not None:
                    raise found[1].failure()
                motion = arm.time_path(rows, self.ports.approach_speed)
                for progress in arm.follow(motion, wait_s=_LIFT_WAIT_S):
                    self._watch()
                    yield 0.9 + 0.1 * progress
            except Failure as failure:
                if failure.code not in _ELSEWHERE:
                    raise
                yield from arm.halt()  # no room there
                continue
            self.metrics["lifted_m"] = self.ports.lift
            break
        began = arm.time
        while arm.name in arm.world.grippers and not arm.gripper.holding:
            self._watch()
            if arm.time - began > 1.0:
                raise Failure("DROPPED", f"{name!r} is no longer held")
            yield 1.0
        held = arm.world.attachments.find(arm.name, name)
        if held is None:
            raise Failure("DROPPED", f"{name!r} is no longer held")
        # The true pose, as a referee only.
        estimate = arm.tool_pose @ arm.robot.tool.inverse @ held.relative
        error, _ = true_error(arm.world, name, estimate)
        self.metrics["held_error_m"] = error
        if error > _HELD_M:
            if arm.name in arm.world.grippers:
                arm.gripper.let_go(name)  # a bare tool would let it fall
            raise Failure(
                "DROPPED",
                f"{name!r} is {1e3 * error:.0f} mm from where {arm.name} should hold it",
                held_error_m=error,
            )


def _is_asked(joint: JointPart, giver: str, question: tuple[int, int]) -> bool:
    """Whether the giver announces the release, or asks to raise the object."""
    messages = joint.messages(giver)
    return "releasing" in messages or messages.get("heavy") == question


def _has_answered(joint: JointPart, giver: str, question: tuple[int, int]) -> bool:
    """Whether the giver has said if the object is lighter after a step of a plan."""
    answer = joint.messages(giver).get("lighter")
    return answer is not None and answer[0] == question


def _measured_stiffness(decrease: Vector, shift: Vector, before: float) -> float:
    """Stiffness along a shift by the decrease of the load in N, both of shape (3,), in N/m.

    One that has not decreased the load was lost in friction: the next one is twice as long.
    """
    measured = float(decrease @ shift) / max(float(shift @ shift), 1e-12)
    return float(np.clip(measured if measured > 0.0 else 0.5 * before, *_STIFFNESS[::2]))
