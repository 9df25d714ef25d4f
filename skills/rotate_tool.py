"""Rotate the tool about an axis."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Literal

import numpy as np

from bt_dualarm import (
    Angle,
    Failure,
    ObjectName,
    PathSkill,
    PortModel,
    Speed,
    Vector,
    Vector3,
    into_held,
    object_in_tool,
    port,
    turned_path,
)


class RotateTool(PathSkill):
    """Rotate the tool about an axis of the tool, of the held object, or of the world."""

    class Ports(PortModel):
        angle: Angle = port(..., "angle of rotation, right-handed about the axis", ge=-720, le=720)
        axis: Literal["x", "y", "z"] | Vector3 = port("z", "x, y, z, or a direction [x, y, z]")
        frame: Literal["tool", "object", "world"] = port(
            "tool", "frame of the axis; object: that of the held object"
        )
        point: Vector3 = port(
            (0.0, 0.0, 0.0),
            "point on the axis, such as the lip of a held cup: in the frame of the held object "
            "with `frame: object`, otherwise in that of the tool",
            unit="m",
        )
        speed: Speed = PathSkill.SPEED
        tolerance: float = PathSkill.TOLERANCE
        into: ObjectName | None = PathSkill.INTO

    failures = PathSkill.failures | {
        "INVALID_TARGET": "the axis has no direction, the angle is 0, or `frame` is object and the "
        "arm does not hold one object",
    }
    example = "rotate_tool: {axis: z, angle: 90, point: [0, 0, 0.1]}"
    ports: Ports

    def run(self) -> Iterator[float | None]:
        """Build the path from the current tool pose, follow it, measure the error."""
        arm = self.arm
        tool = arm.commanded_tool_pose
        ports = self.ports
        axis = self._axis()
        frame = tool
        if ports.frame == "object":
            if len(arm.held) != 1:
                names = ", ".join(arm.held) or "nothing"
                raise Failure("INVALID_TARGET", f"frame: object, but {arm.name} holds {names}")
            frame = tool @ object_in_tool(arm.world, arm.name, arm.held[0])
        if ports.frame != "world":
            axis = frame.turn(axis)
        path = turned_path(tool, frame.apply(np.array(ports.point)), axis, ports.angle)
        goal = path.end
        with into_held(self.arm, ports.into):
            yield from self.along(path)
        self.metrics["angle_error_rad"] = self.arm.tool_pose.angle(goal)

    def _axis(self) -> Vector:
        """Direction of the axis in its frame, of shape (3,)."""
        axis = self.ports.axis
        direction = np.array(axis) if not isinstance(axis, str) else np.eye(3)["xyz".index(axis)]
        if float(np.linalg.norm(direction)) < 1e-6:
            raise Failure("INVALID_TARGET", "the axis has no direction: its length is 0")
        return direction
