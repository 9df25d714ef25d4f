"""Set down what the gripper holds, by touch, and let go of it."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from bt_dualarm import (
    CarriedPose,
    Failure,
    Grip,
    ObjectName,
    Planner,
    PortModel,
    Pose,
    Skill,
    Speed,
    guarded_descent,
    port,
)

_ROOM_M = 0.01  # that the fingers open beside the object at least
_FREE_M = 0.004  # above the goal, down to where nothing may be in the way
_OFF_M = 0.003  # back, until it leans on nothing
_LOWERING = 0.3  # of the speed, down to there


class Place(Skill):
    """Set an object that the gripper holds down where it is to stand, let go, go away."""

    class Ports(PortModel):
        object: ObjectName | None = port(
            None, "object to set down; by default what the gripper holds"
        )
        at: CarriedPose = port(..., "pose of the object then; turned as now if only xyz")
        height: float = port(0.05, "height from which it is lowered", unit="m", ge=0.01, le=0.3)
        force: float = port(5.0, "force by which the ground is felt", unit="N", ge=1, le=100)
        search: float = port(0.015, "how much lower the ground may be", unit="m", ge=0.001, le=0.1)
        retreat: float = port(0.08, "how far the gripper goes back", unit="m", ge=0.01, le=0.3)
        tolerance: float = port(
            0.008, "largest difference in height at the touch", unit="m", ge=1e-3, le=0.1
        )
        speed: Speed = port(0.5, "share of the arm's limits on the way there")
        down_speed: Speed = port(0.003, "share of the arm's limits where it may touch")
        planner: Planner = port("RRTConnect", "searches where the straight way is not free")

    failures = {
        "NOT_HELD": "the gripper does not hold the object",
        "NOT_REACHED": "it touched something before it was down",
        "NO_CONTACT": "nothing was felt below it",
        "NOT_OPEN": "the fingers did not open",
        "SLIPPED": "the object slid between the fingers on the way",
        "DROPPED": "the object was lost on the way",
    }
    example = "place: {object: cube, at: {xyz: [0.35, -0.45, 0.425]}}"
    needs = ("scipy.interpolate",)
    needs_gripper = True
    ports: Ports

    def run(self) -> Iterator[float | None]:
        """Plan all of it before moving; lower until it touches; open; go back."""
        arm = self.arm
        name = self.ports.object or next(iter(arm.gripper.held), "")
        held = arm.world.attachments.find(arm.name, name)
        if held is None or not held.by_gripper:
            what = repr(name) if name else "anything"
            raise Failure("NOT_HELD", f"{arm.name} does not hold {what}")
        in_tool = arm.robot.tool.inverse @ held.relative
        goal = self.ports.at.pose_from(arm.commanded_tool_pose @ in_tool)
        tool = goal @ in_tool.inverse
        grip = Grip(arm, name)
        grip.look()
        above = _raised(tool, self.ports.height)
        arm.refuse_collision_along(arm.line(above, _raised(tool, _FREE_M)))
        try:
            yield from self._go_above(above, grip)
            yield from self._lower(tool, grip)
        except Failure as failure:
            if failure.code == "SLIPPED":
                yield from grip.judge(failure)
            raise
        yield from self._release(name)
        self._note(name, goal)

    def _go_above(self, above: Pose, grip: Grip) -> Iterator[float]:
        arm, ports = self.arm, self.ports
        goals = arm.kinematics.solutions(above, arm.setpoint.q)
        for progress in arm.travel(goals, ports.speed, planner=ports.planner):
            yield 0.5 * (progress or 0.0)
            grip.look()

    def _lower(self, tool: Pose, grip: Grip) -> Iterator[float | None]:
        """Go down until the ground is felt, and press no harder on it."""
        arm, ports = self.arm, self.ports
        low = _raised(tool, _FREE_M)
        way = arm.line(arm.commanded_tool_pose, low)
        for progress in arm.follow(arm.time_path(way, _LOWERING * ports.speed)):
            yield 0.5 + 0.1 * progress
            grip.look()
        low, force = _raised(tool, -ports.search), grip.firm_for(ports.force)
        felt, most = yield from guarded_descent(
            arm, low, ports.down_speed, force, grip.look, lightly=True
        )
        if not felt:
            yield from arm.settle()
            raise Failure(
                "NO_CONTACT", f"nothing is felt {1e3 * ports.search:.0f} mm below where it stands"
            )
        height = float(arm.tool_pose.position[2] - tool.position[2])
        self.metrics |= {"impact_n": most, "height_off_m": height}
        if abs(height) > ports.tolerance:
            raise Failure(
                "NOT_REACHED",
                f"it touched something {1e3 * height:.1f} mm above where it was to stand",
                height_off_m=height,
                force_n=most,
            )

    def _release(self, name: str) -> Iterator[float | None]:
        """Open, and go back out of the fingers' way."""
        arm, ports = self.arm, self.ports
        gripper, page = arm.gripper, arm.gripper.page
        wide = gripper.width + 2.0 * _ROOM_M
        gripper.command(min(wide, page.stroke) if page.fingers else 1.0)
        for _ in gripper.until_open():
            yield 0.85
        gripper.let_go(name)
        yield from self._come_off()
        back = arm.commanded_tool_pose @ Pose.from_rpy((0, 0, -ports.retreat))
        rows = arm.line(arm.commanded_tool_pose, back)
        arm.refuse_collision_along(rows, ignore=frozenset({name}))
        touching = frozenset({name})
        for progress in arm.follow(arm.time_path(rows, 0.3 * ports.speed), touching):
            yield 0.85 + 0.15 * progress

    def _come_off(self) -> Iterator[float]:
        """A little way back, giving way still: it leans on what it has let go of."""
        arm = self.arm
        off = arm.commanded_tool_pose @ Pose.from_rpy((0.0, 0.0, -_OFF_M))
        rows = arm.line(arm.commanded_tool_pose, off)
        motion = arm.begin(arm.time_path(rows, _LOWERING), may_touch=True, compliant=True)
        while not motion.done:
            yield 0.85
            arm.check()

    def _note(self, name: str, goal: Pose) -> None:
        """Where it truly stands, beside what the arm felt."""
        pose = self.arm.world.object_pose(name)
        self.metrics |= {
            "placed_error_m": pose.distance(goal),
            "placed_turned_rad": pose.angle(goal),
        }


def _raised(pose: Pose, height: float) -> Pose:
    return Pose(pose.position + np.array((0.0, 0.0, height)), pose.quaternion)
