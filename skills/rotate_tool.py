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
    port,
    turned_path,
)


class RotateTool(PathSkill):
    """Rotate the tool about an axis of the tool or the world, through a point on the tool."""

    class Ports(PortModel):
        angle: Angle = port(..., "angle of rotation, right-handed about the axis", ge=-720, le=720)
        axis: Literal["x", "y", "z"] | Vector3 = port("z", "x, y, z, or a direction [x, y, z]")
        frame: Literal["tool", "world"] = port("tool", "frame of the axis")
        point: Vector3 = port((0.0, 0.0, 0.0), "point on the axis, in the tool frame", unit="m")
        speed: Speed = PathSkill.SPEED
        tolerance: float = PathSkill.TOLERANCE
        into: ObjectName | None = PathSkill.INTO

    failures = PathSkill.failures | {
        "INVALID_TARGET": "the axis has no direction, or the angle is 0",
    }
    example = "rotate_tool: {axis: z, angle: 90, point: [0, 0, 0.1]}"
    ports: Ports

    def run(self) -> Iterator[float | None]:
        """Build the path from the current tool pose, follow it, measure the error."""
        tool = self.arm.commanded_tool_pose
        ports = self.ports
        axis = self._axis()
        if ports.frame == "tool":
            axis = tool.turn(axis)
        path = turned_path(tool, tool.apply(np.array(ports.point)), axis, ports.angle)
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
