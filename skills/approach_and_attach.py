"""Go to an object, touch it, and attach it to the tool."""

from __future__ import annotations

from collections.abc import Generator, Iterator
from dataclasses import dataclass

import numpy as np

from bt_dualarm import (
    Failure,
    ObjectName,
    PortModel,
    Pose,
    PoseSpec,
    Skill,
    Speed,
    Trajectory,
    Vector,
    Vector3,
    port,
    unit_vector,
)

_ALONG = 0.7  # cosine
_SEARCHED = 0.01  # m beyond where the surface was seen: it may lie lower
_TURNS = np.deg2rad([0, 90, -90, 180, 45, -45, 135, -135])


@dataclass(frozen=True, eq=False)
class Approach:
    """A way to the object: a motion to the standoff, then a straight one to the surface."""

    to_standoff: Trajectory
    to_surface: Trajectory


class ApproachAndAttach(Skill):
    """Go to an object, touch it, and attach it to the tool where it is."""

    class Ports(PortModel):
        object: ObjectName = port(..., "object to attach")
        at: PoseSpec | None = port(
            None, "pose of the object, as `locate` writes it; its true one is then not looked at"
        )
        direction: Vector3 = port((0.0, 0.0, -1.0), "way of the straight approach, world axes")
        standoff: float = port(0.10, "distance before the straight part", unit="m", ge=0.01, le=0.5)
        proximity: float = port(0.005, "gap at which to attach", unit="m", ge=1e-4, le=0.1)
        contact: bool = port(True, "also wait until tool and object touch")
        speed: Speed = port(0.5, "share of the arm's limits on the way to the standoff")
        approach_speed: Speed = port(0.1, "share of the arm's limits on the straight part")

    failures = {
        "INVALID_TARGET": "the direction has no length, or the object is fixed",
        "GRIPPER_FULL": "the gripper of the arm holds something else",
        "NOT_THERE": "the object is not in the world, or was taken away meanwhile",
        "OUT_OF_REACH": "no way of the arm to the object: unreachable or in collision",
        "PROXIMITY_NOT_REACHED": "the tool did not come near enough, or never touched",
        "TRACKING_ERROR": "the arm was blocked or could not follow",
        "BUSY": "another leaf moves the arm",
    }
    example = "approach_and_attach: {object: cube, standoff: 0.10}"
    needs = ("scipy.interpolate",)
    ports: Ports

    def run(self) -> Iterator[float | None]:
        """Plan the whole way before moving; attach only what is near and touched."""
        name = self.ports.object
        if self.arm.name in self.arm.world.grippers:
            self.arm.gripper.refuse_other(name)
        if name in self.arm.held:
            return
        self._refuse_if_gone()
        if self.arm.world.objects[name].fixed:
            raise Failure("INVALID_TARGET", f"object {name!r} is fixed: no arm can carry it")
        yield from self._shut_empty_fingers()
        for progress in self._go():
            yield progress
            self._refuse_if_gone()
        self._attach()
        held = self.arm.world.attachments.find(self.arm.name, name)
        try:
            yield from self.arm.relax()
        except Failure:
            self.arm.detach(name)  # what is not carried safely is not held at all
            raise
        if self.arm.world.attachments.find(self.arm.name, name) is not held:
            raise Failure("NOT_THERE", f"object {name!r} was taken out of the tool")

    def _shut_empty_fingers(self) -> Iterator[float]:
        """Make a tip of open fingers: they would go down beside the object and never touch it."""
        arm = self.arm
        if arm.name not in arm.world.grippers:
            return
        gripper = arm.gripper
        if not gripper.page.fingers or gripper.held or gripper.holding:
            return
        gripper.command(0.0, force=gripper.page.force.least)
        try:
            for progress in gripper.until_open():  # until they stand where they were told to go
                yield 0.1 * progress
        except Failure as failure:
            if failure.code != "NOT_OPEN":
                raise  # something is between them: that is what touches the object then

    def _refuse_if_gone(self) -> None:
        if self.ports.object not in self.arm.world.objects:
            raise Failure("NOT_THERE", f"object {self.ports.object!r} is not in the world")

    def _go(self) -> Iterator[float | None]:
        """Move until the object is near, and stop there."""
        approach = yield from self._approach()
        for progress in self.arm.follow(approach.to_standoff, self._unseen):
            yield 0.7 * progress
        motion = self.arm.begin(approach.to_surface, may_touch=True)
        while not motion.done and not self._near():
            yield 0.7 + 0.3 * motion.progress
            self.arm.check()
        yield from self.arm.halt()
        yield from self._settle_on_contact()

    def _approach(self) -> Generator[None, None, Approach]:
        """The first way that is reachable and free, turning the tool about its axis."""
        reasons = []
        for target in self._targets():
            try:
                return (yield from self._way_to(target))
            except Failure as failure:
                if failure.code in ("BUSY", "OVERLOADED"):
                    raise
                reasons.append(failure.with_traceback(None))  # that refers to this frame
        last = reasons[0]
        raise Failure(
            "OUT_OF_REACH",
            f"no way to {self.ports.object!r}: {last.reason}",
            ways_tried=len(reasons),
            **last.numbers,
        )

    def _targets(self) -> list[Pose]:
        """Tool poses on the object's surface, tool axis along the direction."""
        direction = unit_vector(self.ports.direction)
        center = self._seen or self.arm.world.object_pose(self.ports.object)
        surface = self.arm.world.surface_point(self.ports.object, -direction, center)
        x, y, _ = center.rotation_matrix.T
        # Seen along its x axis, an object's own small tilt would be all that tells a side.
        side = y if abs(x @ direction) > _ALONG else x
        facing = _tool_axis_along(surface, direction, side)
        return [facing @ Pose.from_rpy((0, 0, 0), (0, 0, turn)) for turn in _TURNS]

    def _way_to(self, surface: Pose) -> Generator[None, None, Approach]:
        arm, ports = self.arm, self.ports
        surface = surface @ Pose.from_rpy((0, 0, -self._tips_beyond()))
        standoff = surface @ Pose.from_rpy((0, 0, -ports.standoff))
        q_line = arm.line(standoff, surface @ Pose.from_rpy((0, 0, self._depth())))
        arm.refuse_load(ports.object, q_line[-1], self._seen)
        touched = frozenset({ports.object})
        arm.refuse_collision_along(q_line, ignore=touched)
        to_standoff = yield from arm.plan([q_line[0]], ports.speed, self._unseen)
        self._keep_off(to_standoff)
        return Approach(to_standoff, arm.time_path(q_line, ports.approach_speed))

    def _tips_beyond(self) -> float:
        """Metres by which fingertips reach beyond the tool frame, which lies between the pads.

        They are to meet the object at the end of the way, where the arm is slow: in the middle of
        it a UR10 pressed with 290 N.
        """
        arm = self.arm
        if arm.name not in arm.world.grippers:
            return 0.0
        page, farthest = arm.gripper.page, 0.0
        for finger in page.fingers:
            pad = page.tool.inverse @ finger.pose @ finger.pad.pose
            reach = 0.5 * float(np.abs(pad.rotation_matrix[2]) @ np.array(finger.pad.size))
            farthest = max(farthest, float(pad.position[2]) + reach)
        return farthest

    @property
    def _seen(self) -> Pose | None:
        """Where it lies by sight, where the port says so."""
        return None if self.ports.at is None else self.ports.at.pose

    @property
    def _unseen(self) -> frozenset[str]:
        """What a plan does not know the place of: by sight the object is where it was seen."""
        return frozenset() if self._seen is None else frozenset({self.ports.object})

    def _keep_off(self, motion: Trajectory) -> None:
        """Refuse a way of the tool through what was seen, which the plan does not know of."""
        if self._seen is None:
            return
        away = np.linalg.norm(self.arm.planned_tool_positions(motion) - self._seen.position, axis=1)
        nearest, end = float(away.min()), float(away[-1])
        if nearest < min(float(away[0]), end) - self.ports.standoff:
            raise Failure("NO_PLAN", "the way to the object leads through it", nearest_m=nearest)

    def _depth(self) -> float:
        """Metres by which the straight part leads beyond the surface; the tool stops before."""
        if self.ports.contact:
            return 0.002 if self._seen is None else _SEARCHED  # so that it does touch
        return -min(0.8 * self.ports.proximity, 0.5 * self.ports.standoff)

    def _gap(self) -> float:
        return self.arm.world.tool_gap(self.arm.name, self.ports.object)

    def _touching(self) -> bool:
        return self.arm.world.touches(self.arm.name, self.ports.object)

    def _near(self) -> bool:
        return self._touching() if self.ports.contact else self._gap() <= self.ports.proximity

    def _settle_on_contact(self) -> Iterator[None]:
        """A light object may bounce at the touch: give it a moment to come to rest."""
        began = self.arm.time
        while self.ports.contact and not self._touching() and self.arm.time - began < 0.2:
            yield

    def _attach(self) -> None:
        gap, touching = self._gap(), self._touching()
        if gap > self.ports.proximity or (self.ports.contact and not touching):
            raise Failure(
                "PROXIMITY_NOT_REACHED",
                f"the tool is {1000 * gap:.1f} mm from {self.ports.object!r}"
                + ("" if touching else " and does not touch it"),
                gap_m=gap,
                touching=touching,
            )
        self.arm.attach(self.ports.object, self._seen)
        self.metrics["gap_m"] = gap


def _tool_axis_along(place: Vector, direction: Vector, side: Vector) -> Pose:
    """A pose at ``place``: z along ``direction``, x as near to ``side`` as that allows."""
    x = side - (side @ direction) * direction
    if np.linalg.norm(x) < 1e-3:
        x = np.cross(direction, np.eye(3)[int(np.argmin(np.abs(direction)))])
    x /= np.linalg.norm(x)
    matrix = np.eye(4)
    matrix[:3] = np.column_stack((x, np.cross(direction, x), direction, place))
    return Pose.from_matrix(matrix)
