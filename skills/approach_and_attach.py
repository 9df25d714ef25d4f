"""Approach an object, touch it, and attach it to the tool."""

from __future__ import annotations

from collections.abc import Generator, Iterator
from dataclasses import dataclass

import numpy as np

from bt_dualarm import (
    Direction,
    Failure,
    Matrix,
    ObjectPose,
    PartName,
    PickedObjectName,
    PortModel,
    Pose,
    Skill,
    Speed,
    Trajectory,
    Vector,
    beginning_at,
    first_possible,
    make_room,
    nearest_to_success,
    port,
    unit_vector,
)

_ALONG = 0.7  # cosine above which an axis of the object counts as parallel to the approach
_SEARCH_M = 0.01  # search beyond the estimated surface, which may lie deeper
_SEARCH_SPEED = 0.2  # of that of the approach, as the arm is not yet slow when it touches
_TURNS = np.deg2rad([0, 90, -90, 180, 45, -45, 135, -135])  # about the tool axis, in order
_BRANCHES = 8  # branches of the inverse kinematics to try for each turn


@dataclass(frozen=True, eq=False)
class Approach:
    """Planned approach of an object.

    Attributes:
        to_standoff: Collision-free motion to the standoff.
        to_surface: Straight motion from there to the surface.
        line: Its configurations, of shape (n, dof), rad.
        standoff: Pose of the tool in the world at the standoff.
    """

    to_standoff: Trajectory
    to_surface: Trajectory
    line: Matrix
    standoff: Pose


class ApproachAndAttach(Skill):
    """Approach an object, touch it, and attach it to the tool at its current pose."""

    class Ports(PortModel):
        object: PickedObjectName = port(..., "object to attach")
        part: PartName | None = port(
            None,
            "part of a compound object at which it is touched; by default above its center, "
            "or at the edge of something open",
        )
        at: ObjectPose | None = port(
            None,
            "estimated pose of the object, as `locate` writes it; its true pose is then not used",
        )
        direction: Direction = port(
            (0.0, 0.0, -1.0), "direction of the straight approach, world axes"
        )
        standoff: float = port(
            0.10,
            "distance from the surface at which the straight part begins",
            unit="m",
            ge=0.01,
            le=0.5,
        )
        proximity: float = port(0.005, "largest gap at which to attach", unit="m", ge=1e-4, le=0.1)
        contact: bool = port(True, "also wait until tool and object touch")
        speed: Speed = port(0.5, "fraction of the arm's limits up to the standoff")
        approach_speed: Speed = port(0.1, "fraction of the arm's limits on the straight part")

    failures = {
        "INVALID_TARGET": "the object is fixed",
        "GRIPPER_FULL": "the gripper of the arm holds something else",
        "NOT_THERE": "the object is not in the world, or was removed meanwhile",
        "OUT_OF_REACH": "no approach of the object is both reachable and collision-free",
        "PROXIMITY_NOT_REACHED": "the tool did not come close enough, or did not touch the object",
        "TRACKING_ERROR": "the arm was blocked or could not follow",
        "BUSY": "another leaf moves the arm",
    }
    example = "approach_and_attach: {object: cube, standoff: 0.10}"
    begins_anywhere = True
    takes_hold = True
    ports: Ports

    def run(self) -> Iterator[float | None]:
        """Plan the whole approach before moving; attach only what is near and touched."""
        name = self._name
        if self.arm.name in self.arm.world.grippers:
            self.arm.gripper.refuse_other(name)
        if name in self.arm.held:
            return
        if self.arm.world.objects[name].fixed:
            raise Failure("INVALID_TARGET", self.arm.world.fixed_reason(name))
        yield from self._close_empty_fingers()
        approach = yield from self._go_to_standoff()
        try:
            yield from self._touch(approach)
            yield from self._attach()
        except Failure as failure:
            if failure.code != "INTERRUPTED":  # otherwise the arm was commanded to stop
                yield from self._retreat(approach)
            raise

    def _close_empty_fingers(self) -> Iterator[float | None]:
        """Close empty fingers to a tip: open ones would pass the object on both sides."""
        arm = self.arm
        if arm.name not in arm.world.grippers:
            return
        gripper = arm.gripper
        if not gripper.description.fingers or gripper.held or gripper.holding:
            return
        # What was let go of may still be between them: not what is to be attached.
        yield from make_room(arm, self.ports.approach_speed, 0.0, frozenset({self._name}))
        gripper.command(0.0, force=gripper.description.force.least)
        try:
            for progress in gripper.until_open():
                yield 0.1 * progress
        except Failure as failure:
            if failure.code != "NOT_OPEN":
                raise  # otherwise something is between them, and that will touch the object

    def _go_to_standoff(self) -> Generator[float, None, Approach]:
        """Move to the standoff of the first approach that is free; wait for arms in the way."""
        arm = self.arm
        approaches: list[Approach] = []

        def planned() -> Generator[None, None, Trajectory]:
            approaches[:] = [(yield from self._approach())]
            return approaches[0].to_standoff

        move = arm.past_others(self.ports.speed, self._unseen)
        touched = frozenset({self._name})
        for progress in move.to_line(planned, lambda: approaches[0].line, touched):
            yield 0.7 * (progress or 0.0)
            arm.world.objects.require(self._name)
        return approaches[0]

    def _touch(self, approach: Approach) -> Iterator[float | None]:
        """Move straight until the object is near, and stop there."""
        # A stiff arm would press an object on a table with 60 N for each 0.1 mm of its braking. For
        # a door or drawer, it is right: relaxing it turns the friction of its joints around, which
        # would otherwise count as force of the hand when `operate` begins to pull.
        compliant = self.ports.contact and self.arm.world.joint_of(self._name) is None
        motion = self.arm.begin(approach.to_surface, may_touch=True, compliant=compliant)
        while not motion.done and not self._near():
            yield 0.7 + 0.3 * motion.progress
            self.arm.check()
        yield from self.arm.halt()
        yield from self._settle_on_contact()
        if self.ports.contact and not self._touching():
            yield from self._search(compliant)

    def _search(self, compliant: bool) -> Iterator[float | None]:
        """Move on to the surface, if it lies a little deeper than it did when this was planned."""
        if self._gap() > self.ports.proximity:
            return
        arm = self.arm
        touched = frozenset({self._name})
        try:
            rows = arm.line_on(arm.commanded_tool_pose @ Pose.from_rpy((0, 0, _SEARCH_M)))
            arm.refuse_collision_along(rows, ignore=touched)
        except Failure:
            return  # the leaf fails because nothing was touched
        speed = _SEARCH_SPEED * self.ports.approach_speed
        motion = arm.begin(arm.time_path(rows, speed), may_touch=True, compliant=compliant)
        while not motion.done and not self._touching():
            yield 1.0
            arm.check()
        yield from arm.halt()
        yield from self._settle_on_contact()

    def _retreat(self, approach: Approach) -> Iterator[float]:
        """Retreat to the standoff: no later plan could start while the tool touches something."""
        arm = self.arm
        try:
            for _ in arm.halt():
                yield 1.0
            yield from arm.relax()
            rows = arm.line_on(approach.standoff)
            motion = arm.begin(arm.time_path(rows, self.ports.approach_speed), may_touch=True)
            while not motion.done:
                yield 1.0
                arm.check()
            yield from arm.settle()
        except Failure:
            return  # the leaf fails with the reason why nothing was attached

    def _approach(self) -> Generator[None, None, Approach]:
        """First approach that is reachable and free, over turns of the tool about its axis."""
        reasons = []
        for target in self._targets():
            try:
                return (yield from self._approach_of(target))
            except Failure as failure:
                if failure.code in ("BUSY", "OVERLOADED"):
                    raise
                reasons.append(
                    failure.with_traceback(None)
                )  # a traceback would keep this frame alive
        nearest = nearest_to_success(reasons)
        raise Failure(
            "OUT_OF_REACH",
            f"no path to {self._name!r}: {nearest.reason}",
            plans_tried=len(reasons),
            **nearest.numbers,
        ) from ExceptionGroup("no approach is free", reasons)

    def _targets(self) -> list[Pose]:
        """Poses of the tool on the object's surface, its z axis along the direction."""
        direction = unit_vector(self.ports.direction)
        world = self.arm.world
        name = self._name
        center = self._seen or world.object_pose(name)
        if self._seen is None and world.joint_of(name) is not None:
            center = self.arm.known.pose(name).pose
        surface = world.surface_point(name, -direction, center, self.ports.part)
        x, y, _ = center.rotation_matrix.T
        # Projected along its x axis, an object's small tilt alone would decide how the tool turns.
        side = y if abs(x @ direction) > _ALONG else x
        edge = world.edge_point(name, -direction, center, self.ports.part)
        if edge is not None:  # the surface is no solid wall there: the tool would pass the wall
            side = edge - surface  # both of two fingers then meet the wall
            surface = edge
        facing = _tool_axis_along(surface, direction, side)
        return [facing @ Pose.from_rpy((0, 0, 0), (0, 0, turn)) for turn in _TURNS]

    def _approach_of(self, surface: Pose) -> Generator[None, None, Approach]:
        arm = self.arm
        ports = self.ports
        surface = surface @ Pose.from_rpy((0, 0, -self._fingertip_offset()))
        standoff = surface @ Pose.from_rpy((0, 0, -ports.standoff))
        end = surface @ Pose.from_rpy((0, 0, self._depth()))
        q_line = yield from self._free_line(standoff, end)
        turned = arm.turned([q_line])
        with arm.avoiding({} if self._seen is None else {self._name: self._seen}):
            to_standoff = yield from arm.plan(
                [q_line[0]], ports.speed, turned=[rows[0] for rows in turned]
            )
        q_line = beginning_at(to_standoff.end, (q_line, *turned))
        to_surface = arm.time_path(q_line, ports.approach_speed)
        return Approach(to_standoff, to_surface, q_line, standoff)

    def _free_line(self, standoff: Pose, end: Pose) -> Generator[None, None, Matrix]:
        """Configurations along the straight part, in the first branch in which nothing is touched.

        Yields once for each branch that is refused.
        """
        arm = self.arm
        touched = frozenset({self._name})

        def attempt(lines: list[Matrix]) -> Matrix:
            (rows,) = lines
            arm.refuse_load(self._name, rows[-1], self._seen)
            arm.refuse_collision_along(rows, ignore=touched)
            return rows

        branches = arm.lines(standoff, end)
        return (
            yield from first_possible(branches, attempt, most=_BRANCHES, is_final=arm.is_of_hand)
        )

    def _fingertip_offset(self) -> float:
        """Distance, m, of the fingertips beyond the tool frame, which lies between the pads.

        They must meet the object at the end of the motion, where the arm is slow: in the middle of
        it a UR10 pressed with 290 N.
        """
        arm = self.arm
        if arm.name not in arm.world.grippers:
            return 0.0
        description = arm.gripper.description
        farthest = 0.0
        for finger in description.fingers:
            pad = description.tool.inverse @ finger.pose @ finger.pad.pose
            reach = 0.5 * float(np.abs(pad.rotation_matrix[2]) @ np.array(finger.pad.size))
            farthest = max(farthest, float(pad.position[2]) + reach)
        return farthest

    @property
    def _name(self) -> str:
        """Name of the object that has the part."""
        return self.arm.world.part_owner(self.ports.object, self.ports.part)

    @property
    def _seen(self) -> Pose | None:
        """Estimated pose of the object in the world, if it is given."""
        return None if self.ports.at is None else self.ports.at.pose

    @property
    def _unseen(self) -> frozenset[str]:
        """Objects whose true pose the motion must ignore, since only the estimated one is known."""
        return frozenset() if self._seen is None else frozenset({self._name})

    def _depth(self) -> float:
        """Distance, m, of the straight part's end beyond the surface; the tool stops before."""
        if self.ports.contact:
            return 0.002 if self._seen is None else _SEARCH_M  # so that it does touch
        return -min(0.8 * self.ports.proximity, 0.5 * self.ports.standoff)

    def _gap(self) -> float:
        return self.arm.world.tool_gap(self.arm.name, self._name)

    def _touching(self) -> bool:
        return self.arm.world.touches(self.arm.name, self._name)

    def _near(self) -> bool:
        return self._touching() if self.ports.contact else self._gap() <= self.ports.proximity

    def _settle_on_contact(self) -> Iterator[None]:
        """Wait for an object that has bounced off to come to rest."""
        began = self.arm.time
        while self.ports.contact and not self._touching() and self.arm.time - began < 0.2:
            yield

    def _attach(self) -> Iterator[float]:
        gap = self._gap()
        touching = self._touching()
        if gap > self.ports.proximity or (self.ports.contact and not touching):
            raise Failure(
                "PROXIMITY_NOT_REACHED",
                f"the tool is {1000 * gap:.1f} mm from {self._name!r}"
                + ("" if touching else " and does not touch it"),
                gap_m=gap,
                touching=touching,
            )
        name = self._name
        self.arm.attach(name, self._seen)
        self.metrics["gap_m"] = gap
        held = self.arm.world.attachments.find(self.arm.name, name)
        self.arm.controller.compliance.active = False  # it would sink with each step of relaxing
        try:
            yield from self.arm.relax()
        except Failure:
            self.arm.detach(name)  # after a failure nothing stays attached
            raise
        if self.arm.world.attachments.find(self.arm.name, name) is not held:
            raise Failure("NOT_THERE", f"object {name!r} was detached from the tool")


def _tool_axis_along(position: Vector, direction: Vector, side: Vector) -> Pose:
    """Pose with its z axis along ``direction`` and its x axis as near to ``side`` as possible."""
    x = side - (side @ direction) * direction
    if np.linalg.norm(x) < 1e-3:
        x = np.cross(direction, np.eye(3)[int(np.argmin(np.abs(direction)))])
    x /= np.linalg.norm(x)
    axes = np.column_stack((x, np.cross(direction, x), direction))
    return Pose.from_axes(position, axes.tolist())
