"""Take an object with the gripper and see that it hangs in it."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from bt_dualarm import (
    Failure,
    Grip,
    ObjectName,
    PortModel,
    Pose,
    PoseSpec,
    Skill,
    Speed,
    TouchSense,
    Vector,
    WantedGrasp,
    WayToGrasp,
    first_way,
    grasps_on,
    port,
)

_HOLD_S = 0.15  # that pads have to press
_CLOSING_S = 1.5
_ELSE_M = 0.006  # by which the opening may be off: more is something else
_PRESSED_M = 0.006  # that a cup may be pressed on deeper than the face was thought to be
_PRESSED_N = 12.0
_PRESSING = 0.01  # share of the limits
_EARLY_M = 0.012
_EDGE_S = 0.3  # at the beginning of the way, where joints break loose: no force counts
_UNKNOWN_KG = 1.0


class Grasp(Skill):
    """Take an object with the gripper, lift it a little and see that it hangs there."""

    class Ports(PortModel):
        object: ObjectName = port(..., "object to take; the file says its shape")
        at: PoseSpec | None = port(
            None, "pose of the object, as `locate` writes it; its true one is then not looked at"
        )
        standoff: float = port(0.08, "length of the straight approach", unit="m", ge=0.01, le=0.3)
        lift: float = port(0.04, "height of the lift that tests the hold", unit="m", ge=0, le=0.5)
        force: float | None = port(
            None,
            "force of each pad, or of a cup; by default what the load asks for",
            unit="N",
            gt=0,
            le=5000,
        )
        most_force: float | None = port(
            None, "force of each pad, or of a cup, that the object bears", unit="N", gt=0, le=5000
        )
        mass: float | None = port(
            None, "mass to reckon with; by default what is known of it", unit="kg", gt=0, le=100
        )
        shake: float = port(
            8.0, "acceleration of the tool that the grip has to bear", unit="m/s²", ge=0, le=50
        )
        margin: float = port(
            1.5, "load that the grip has to bear", unit="times the load", ge=1, le=10
        )
        touch: float = port(40.0, "force that ends the approach", unit="N", ge=1, le=200)
        speed: Speed = port(0.5, "share of the arm's limits on the way there")
        approach_speed: Speed = port(0.15, "share of the arm's limits on the straight parts")

    failures = {
        "INVALID_TARGET": "the object is fixed, or bears less than the gripper's least force",
        "NOT_THERE": "the object is not in the world",
        "TOO_WIDE": "the fingers do not open that far",
        "TOO_HEAVY": "no grasp of this gripper bears its weight",
        "NO_FACE": "the object has no sides for the fingers, or no face for the cup",
        "OUT_OF_REACH": "no way of the arm to any grasp: unreachable or in collision",
        "NOT_GRASPED": "the gripper closed on nothing, or on something else",
        "SLIPPED": "the object slid between the fingers",
        "DROPPED": "the object was lost",
    }
    example = "grasp: {object: cube}"
    needs = ("scipy.interpolate", "bt_dualarm.skill.grasps_prepared")
    needs_gripper = True
    ports: Ports

    def run(self) -> Iterator[float | None]:
        """Choose before moving; go, close with the force that is needed, lift, look."""
        name, gripper = self.ports.object, self.arm.gripper
        if name in gripper.held and gripper.holding:
            return
        self._refuse_invalid()
        wanted = self._wanted()
        order = grasps_on(self.arm, wanted)
        yield from self._open()
        seen = None if self.ports.at is None else self.ports.at.pose
        way = yield from first_way(
            self.arm, order, self.ports.object, self.ports.standoff, self.ports.speed, seen
        )
        for progress in self.arm.follow(way.to_standoff, self._unseen):
            yield 0.5 * progress
        yield from self._approach(way)
        try:
            yield from self._close(way, wanted)
            grip = Grip(self.arm, name)
            try:
                yield from self._lift(wanted, grip)
            except Failure as failure:
                if failure.code == "SLIPPED":
                    yield from grip.judge(failure)
                raise
        except Failure:
            gripper.let_go(name)
            raise

    def _refuse_invalid(self) -> None:
        name, world = self.ports.object, self.arm.world
        if name not in world.objects:
            raise Failure("NOT_THERE", f"object {name!r} is not in the world")
        if world.objects[name].fixed:
            raise Failure("INVALID_TARGET", f"object {name!r} is fixed: no arm can carry it")
        bears, least = self.ports.most_force, self.arm.gripper.page.force.least
        if bears is not None and bears < least:
            reason = f"{name!r} bears {bears:g} N; the least that the gripper does is {least:g} N"
            raise Failure("INVALID_TARGET", reason, most_force_n=bears, least_n=least)

    def _wanted(self) -> WantedGrasp:
        ports, world = self.ports, self.arm.world
        told = None if world.nominal[self.arm.name].weighs else world.objects[ports.object].mass
        mass = ports.mass or told or _UNKNOWN_KG
        lies = world.object_pose(ports.object) if ports.at is None else ports.at.pose
        bears = ports.most_force or math.inf
        return WantedGrasp(ports.object, lies, mass, ports.shake, ports.margin, bears)

    @property
    def _unseen(self) -> frozenset[str]:
        """What a plan does not know the place of: by sight the object is where it was seen."""
        return frozenset() if self.ports.at is None else frozenset({self.ports.object})

    def _open(self) -> Iterator[None]:
        gripper = self.arm.gripper
        gripper.command(gripper.page.stroke if gripper.page.fingers else 1.0)
        began, way = self.time, gripper.page.stroke - gripper.width
        while self.time - began < 1.0 + way / max(gripper.page.speed.most, 1e-3):
            if gripper.at_rest and abs(gripper.width - gripper.page.stroke) < 2e-3:
                return
            yield

    def _approach(self, way: WayToGrasp) -> Iterator[float | None]:
        """Go straight to the grasp, and stop where the tool touches something."""
        arm, along = self.arm, way.ranked.tool.rotation_matrix[:, 2]
        sense = TouchSense(arm, along)
        motion = arm.begin(arm.time_path(way.rows, self.ports.approach_speed), may_touch=True)
        began = self.time
        while not motion.done:
            yield 0.5 + 0.2 * motion.progress
            arm.check()
            if sense.force() > self.ports.touch and self.time - began > _EDGE_S:
                yield from arm.halt()
                yield from arm.relax()
                break
        if not arm.gripper.page.fingers:
            yield from self._press(way, along)
        left = float((way.ranked.tool.position - arm.tool_pose.position) @ along)
        self.metrics["approach_force_n"] = sense.most
        if left > _EARLY_M:
            yield from way.back_out(self.arm, self.ports.approach_speed)
            raise Failure(
                "NOT_GRASPED",
                f"the gripper touched something {1e3 * left:.0f} mm before it was there",
                left_m=left,
                force_n=sense.most,
            )

    def _press(self, way: WayToGrasp, along: Vector) -> Iterator[float | None]:
        """Press a cup on, slowly: its rim lies where the face was thought to be, or lower."""
        arm, tool = self.arm, way.ranked.tool
        sense = TouchSense(arm, along)
        deeper = Pose(tool.position + _PRESSED_M * along, tool.quaternion)
        rows = arm.line(arm.commanded_tool_pose, deeper)
        motion = arm.begin(arm.time_path(rows, _PRESSING), may_touch=True)
        while not motion.done and sense.force() < _PRESSED_N:
            yield 0.7
            arm.check()
        yield from arm.halt()

    def _close(self, way: WayToGrasp, wanted: WantedGrasp) -> Iterator[float | None]:
        """Close with the force that the load asks for, and see that it is the object."""
        gripper, grasp = self.arm.gripper, way.ranked.grasp
        page = gripper.page
        needed = grasp.force if page.fingers else page.force.most  # a vacuum crushes nothing
        force = min(page.force.clipped(self.ports.force or needed), wanted.most_force)
        gripper.command(force=force, speed=page.speed.least if not page.fingers else None)
        began, since = self.time, None
        while since is None or self.time - since < _HOLD_S:
            yield None
            since = None if not gripper.holding else self.time if since is None else since
            if since is None and self.time - began > _CLOSING_S:
                break
        self.metrics |= {"width_m": gripper.width, "grip_force_n": force}
        self.metrics |= {"grasp_margin": grasp.margin * force / page.force.most}
        off = abs(gripper.width - grasp.width)
        if since is None or (page.fingers and off > _ELSE_M):
            numbers = {"width_m": gripper.width, "expected_m": grasp.width}
            gripper.command(page.stroke if page.fingers else 1.0)
            yield from way.back_out(self.arm, self.ports.approach_speed)
            raise Failure(
                "NOT_GRASPED", "the gripper closed on something else or nothing", **numbers
            )
        gripper.hold(wanted.name, self._lies(way, wanted), wanted.most_force)

    def _lies(self, way: WayToGrasp, wanted: WantedGrasp) -> Pose:
        """Pose of the object now: the pads have moved it to their middle."""
        tool = self.arm.tool_pose
        if not self.arm.gripper.page.fingers:
            return wanted.lies
        in_tool, meant = tool.inverse @ wanted.lies, way.ranked.grasp.tool.inverse
        x, _, z = in_tool.position
        return tool @ Pose(np.array((x, meant.position[1], z)), in_tool.quaternion)

    def _lift(self, wanted: WantedGrasp, grip: Grip) -> Iterator[float]:
        """Raise it a little: what hangs in the fingers keeps them apart, and weighs."""
        arm, start = self.arm, self.arm.commanded_tool_pose
        height = float(arm.world.object_pose(wanted.name).position[2])
        up = Pose(start.position + np.array((0.0, 0.0, self.ports.lift)), start.quaternion)
        for progress in arm.follow(arm.time_path(arm.line(start, up), self.ports.approach_speed)):
            yield 0.8 + 0.2 * progress
            grip.look()
        began = self.time
        while self.time - began < _HOLD_S:
            yield 1.0
            grip.look()
        while not arm.gripper.holding:
            if self.time - began > 1.0:
                raise Failure("DROPPED", f"{wanted.name!r} is no longer held")
            yield 1.0
            grip.look()
        rose = float(arm.world.object_pose(wanted.name).position[2]) - height
        self.metrics["lifted_m"] = rose  # the truth, beside what the arm senses
