"""Pick an object with the gripper and verify that it is held."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from itertools import islice

import numpy as np

from bt_dualarm import (
    Failure,
    GripWidth,
    JointPath,
    JointPosition,
    KnownShape,
    MovedAwayFailure,
    MovedPart,
    ObjectPose,
    PickedObjectName,
    PortModel,
    Pose,
    Skill,
    Taking,
    TakingPorts,
    UnsuitedGoalFailure,
    Vector3,
    WantedGrasp,
    grasps_on,
    half_open,
    object_at,
    other_headings,
    port,
    refuse_too_frail,
    twin_at,
)

_NO_GRASP = ("OUT_OF_REACH", "TOO_HEAVY")  # what another opening or direction may avoid
_UNKNOWN_FRICTION = 0.5  # assumed for an object that is not declared

# Rest of the object before the grasp is planned
_STILL_M_S = 0.02
_LASTS_S = 0.1  # time for which an object that has moved must rest: it may bounce
_LONGEST_S = 2.0  # longest wait

_HEADINGS = 12  # further headings at `then_at` that are tried, each with many grasps

_PURSUITS = 3  # plans for an object that other arms move before the gripper is there


class _ObjectPorts(PortModel):
    object: PickedObjectName | None = port(None, "object to pick; the file declares its shape")
    at: ObjectPose | None = port(
        None, "estimated pose of the object, as `locate` writes it; its true pose is then not used"
    )
    point: Vector3 | None = port(
        None,
        "point of the object, in its frame, at which the fingers close or over which the cup sits; "
        "by default the best one",
        unit="m",
    )
    open_to: GripWidth | None = port(
        None,
        "opening of the fingers during the approach; by default the widest",
        unit="m",
        gt=0,
        le=1,
    )
    then_to: JointPosition | None = port(
        None,
        "position to which `operate` will move the joint of the part: grasps with which the arm "
        "can follow it are chosen",
    )
    then_at: ObjectPose | None = port(
        None,
        "pose at which `place` will set the object down: grasps with which the arm can do that are "
        "chosen; without an orientation it keeps its current one, or is rotated about the vertical "
        "if it cannot be set down so",
    )
    width: float | None = port(
        None,
        "extent of an undeclared object `at` that pose along its y axis, in which fingers close",
        unit="m",
        ge=1e-3,
        le=1,
    )
    depth: float | None = port(
        None, "extent along its x axis; by default the width", unit="m", ge=1e-3, le=1
    )
    height: float | None = port(
        None, "extent along its z axis; by default the width", unit="m", ge=1e-3, le=1
    )
    friction: float | None = port(
        None,
        "its coefficient of sliding friction; by default 0.5",
        unit="times the pressure",
        gt=0,
        le=10,
    )


class Grasp(Skill):
    """Pick an object with the gripper, lift it a little and verify that it is held."""

    class Ports(TakingPorts, _ObjectPorts):
        exactly_one_of = ("object", "width")
        goes_with = {
            "width": "at",
            "depth": "width",
            "height": "width",
            "friction": "width",
            "part": "object",
            "then_to": "object",
            "then_at": "object",
        }

    failures = Taking.failures
    example = "grasp: {object: cube}"
    begins_anywhere = True
    needs = ("bt_dualarm.skill.preload_grasping",)
    needs_gripper = True
    takes_hold = True
    ports: Ports

    def run(self) -> Iterator[float | None]:
        """Select a grasp before moving; approach, close with the force needed, lift, verify."""
        name = self.ports.object
        if name is not None:
            name = self.arm.world.part_owner(name, self.ports.part)
        gripper = self.arm.gripper
        yield from gripper.until_decided()
        if name is not None and self.ports.at is not None:
            name = next((held for held in gripper.held if self._alike(held, name)), name)
        gripper.refuse_full(name)
        if gripper.held:  # this object, see `refuse_full`
            if gripper.holding:
                return
            yield from Taking.open(self.arm)
        for _ in range(_PURSUITS):
            try:
                yield from self._pick(name)
            except MovedAwayFailure as failure:
                moved = failure.with_traceback(None)
            else:
                return
        raise moved

    def _pick(self, name: str | None) -> Iterator[float | None]:
        """Plan a grasp of the object where it is now, and execute it."""
        gripper = self.arm.gripper
        object_pose = None if self.ports.at is None else self.ports.at.pose
        if name is not None:
            if object_pose is None:
                yield from self._wait_for_rest(name)
            else:
                object_pose = self._part_at(name, object_pose)
                name = self.metrics["taken"] = twin_at(self.arm.world, name, object_pose)
            self._refuse_held_elsewhere(name)
        wanted = (
            WantedGrasp.named(self.arm, name, self.ports, object_pose) if name else self._unnamed()
        )
        if self.ports.open_to is not None and not gripper.description.fingers:
            raise Failure(
                "INVALID_TARGET", f"{gripper.description.name} has no fingers to `open_to`"
            )
        then_at = self.ports.then_at
        wanted = replace(
            wanted,
            point=None if self.ports.point is None else np.array(self.ports.point),
            opening=self.ports.open_to,
            onward=None if name is None else self._onward(name),
            goal=None if then_at is None else then_at.pose_from(wanted.object_pose),
        )
        refuse_too_frail(self.arm, wanted.label, self.ports.most_force)
        try:
            yield from self._take(wanted)
        except Failure as failure:
            # A traceback would keep this frame alive.
            refusal = failure.with_traceback(None)
        else:
            return
        for other in self._others(wanted, refusal):
            try:
                yield from self._take(other)
            except Failure as failure:
                if failure.code not in (*_NO_GRASP, "DEADLOCK"):
                    raise
            else:
                if other.opening != wanted.opening:
                    self.metrics["opening_m"] = other.opening or 0.0
                return
        raise refusal

    def _take(self, wanted: WantedGrasp) -> Iterator[float | None]:
        taking = Taking(self.arm, self.ports, wanted, self.ports.at is not None, self.metrics)
        yield from taking.through(grasps_on(self.arm, wanted))

    def _others(self, wanted: WantedGrasp, refusal: Failure) -> Iterator[WantedGrasp]:
        """Grasps to try where the usual ones are impossible.

        For another heading of the object at `then_at`, half open, and from other directions.

        Args:
            wanted: The usual ones.
            refusal: Why none of them is possible.
        """
        if isinstance(refusal, UnsuitedGoalFailure) and "reach_m" not in refusal.numbers:
            yield from self._rotated(wanted)  # beyond reach, they would be so, too
        if not self.arm.gripper.description.fingers:
            return
        if refusal.code != "DEADLOCK":
            is_waited_for = self.arm.past_others(self.ports.speed).blockers(refusal)
            if refusal.code not in _NO_GRASP or is_waited_for:
                return
            narrow = half_open(self.arm, wanted) if self._is_cramped(refusal) else None
            if narrow is not None:
                yield narrow
        yield replace(wanted, between=True)

    def _rotated(self, wanted: WantedGrasp) -> Iterator[WantedGrasp]:
        """The same with other headings of the object at `then_at`, if that leaves it to `place`."""
        goal = wanted.goal
        then_at = self.ports.then_at
        if goal is None or then_at is None or then_at.is_oriented:
            return
        for other in islice(
            other_headings(self.arm.world, wanted.name or "", goal, (goal,)), _HEADINGS
        ):
            yield replace(wanted, goal=other)

    @staticmethod
    def _is_cramped(refusal: Failure) -> bool:
        """Whether no grasp is possible because of something beside the object."""
        cause = refusal.__cause__
        attempts = cause.exceptions if isinstance(cause, ExceptionGroup) else ()
        codes = {one.code for one in attempts if isinstance(one, Failure)}
        return not attempts or "IN_COLLISION" in codes

    def _part_at(self, name: str, pose: Pose) -> Pose:
        """Pose of what is picked where the named object is given.

        A part that moves on a joint is somewhere else. Where the object is, the arm knows from now
        on: the path of the part depends on it.
        """
        hung = self.arm.world.objects[name].joint
        if hung is None or name == self.ports.object:
            return pose
        known = self.arm.known
        position = known.joint_position(name)
        known.put(hung.owner, pose)
        part = pose @ hung.spec.displacement(position)
        if self.arm.world.joint_reading(name) is None:
            known.put(name, part)
        return part

    def _onward(self, name: str) -> JointPath | None:
        """Path of a part on its joint to where it will be moved, if that is given."""
        if self.ports.then_to is None:
            return None
        hung = self.arm.world.objects[name].joint
        if hung is None:
            raise Failure("INVALID_TARGET", f"{name!r} moves on no joint: `then_to` needs one")
        moved = MovedPart(self.arm, hung.owner, hung.name)
        return moved.path(moved.target(self.ports.then_to))

    def _wait_for_rest(self, name: str) -> Iterator[None]:
        """Wait for an object that falls or slides, since the arm would find it elsewhere."""
        world = self.arm.world
        began = self.time
        moved = -math.inf
        while self.time - began < _LONGEST_S:
            if float(np.linalg.norm(world.object_velocity(name)[3:])) > _STILL_M_S:
                moved = self.time
            if self.time - moved >= _LASTS_S:
                return
            yield None

    def _refuse_held_elsewhere(self, name: str) -> None:
        """Refuse to lift an object out of another arm's hand: they would tear at it."""
        world = self.arm.world
        if world.objects[name].joint is not None:
            return
        holders = world.attachments.holders(name)
        if holders and self.ports.lift > 0.0:
            by = " and ".join(holders)
            raise Failure(
                "INVALID_TARGET",
                f"{name!r} is held by {by}: `take_over` or `carry_together` grasps it as well, or "
                "`lift: 0` holds it where it is",
            )

    def _alike(self, one: str, other: str) -> bool:
        """Whether two objects have the same shape and size: no camera can tell them apart."""
        first, second = (self.arm.world.declared_objects[name] for name in (one, other))
        return KnownShape.of(first) == KnownShape.of(second)

    def _unnamed(self) -> WantedGrasp:
        """Requested grasp of an undeclared object: a box of the given extent at the given pose."""
        ports = self.ports
        if ports.at is None or ports.width is None:
            raise Failure("INVALID_TARGET", "neither `object` nor `at` and `width` are given")
        width = ports.width
        object_pose = ports.at.pose
        edges = (ports.depth or width, width, ports.height or width)
        name = object_at(self.arm.world, object_pose.position, 0.5 * float(np.linalg.norm(edges)))
        mass = ports.mass_of(None)
        most_force = ports.most_force or math.inf
        friction = ports.friction or _UNKNOWN_FRICTION
        return WantedGrasp(
            name,
            object_pose,
            mass,
            ports.shake,
            ports.margin,
            most_force,
            edges,
            friction,
            ports.along,
            mass_is_assumed=ports.mass is None,
        )
