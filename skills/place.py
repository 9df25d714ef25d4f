"""Set down what the gripper holds, by touch, and let go of it."""

from __future__ import annotations

from collections.abc import Iterator

from bt_dualarm import (
    CarriedPose,
    Failure,
    ObjectName,
    PortModel,
    SettingDown,
    SettingDownPorts,
    Skill,
    port,
)


class _What(PortModel):
    object: ObjectName | None = port(None, "object to set down; by default what the gripper holds")
    at: CarriedPose = port(..., "pose of the object then; turned as now if only xyz")


class Place(Skill):
    """Set an object that the gripper holds down where it is to stand, let go, go away."""

    class Ports(SettingDownPorts, _What):
        pass

    failures = {
        "NOT_HELD": "the gripper does not hold the object",
        **SettingDown.failures,
    }
    example = "place: {object: cube, at: {xyz: [0.35, -0.45, 0.425]}}"
    needs = ("scipy.interpolate", "scipy.spatial")
    needs_gripper = True
    ports: Ports

    def run(self) -> Iterator[float | None]:
        """Plan all of it before moving; lower until it touches; open; go back; see it stay."""
        arm = self.arm
        name = self.ports.object or next(iter(arm.gripper.held), "")
        held = arm.world.attachments.find(arm.name, name)
        if held is None or not held.by_gripper:
            what = repr(name) if name else "anything"
            raise Failure("NOT_HELD", f"{arm.name} does not hold {what}")
        in_tool = arm.robot.tool.inverse @ held.relative
        goal = self.ports.at.pose_from(arm.commanded_tool_pose @ in_tool)
        yield from SettingDown(arm, self.ports, held, self.metrics).through(goal)
