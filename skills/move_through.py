"""Move the tool through a list of poses without stopping."""

from __future__ import annotations

from collections.abc import Iterator

from bt_dualarm import (
    FreeAxes,
    PathSkill,
    PortModel,
    Speed,
    ToolPose,
    blended_path,
    nearest_allowed,
    port,
)


class MoveThrough(PathSkill):
    """Move the tool along straight lines from pose to pose, rounding the corners."""

    class Ports(PortModel):
        poses: tuple[ToolPose, ...] = port(
            ...,
            "tool poses in the world; by default with the orientation of the previous one",
            min_length=1,
            max_length=200,
        )
        blend: float = port(
            0.02,
            "distance from a pose at which the rounded corner may begin",
            unit="m",
            ge=0.001,
            le=0.5,
        )
        speed: Speed = PathSkill.SPEED
        tolerance: float = PathSkill.TOLERANCE
        free: FreeAxes | None = PathSkill.FREE

    failures = PathSkill.failures | {
        "INVALID_TARGET": "two successive poses are equal",
    }
    example = "move_through: {poses: [{xyz: [0.4, 0.0, 0.5]}, {xyz: [0.4, 0.2, 0.5]}], blend: 0.03}"
    ports: Ports

    def run(self) -> Iterator[float | None]:
        """Build the path from the current tool pose, follow it, measure the error."""
        ports = self.ports
        free = ports.free or ()
        poses = [self.arm.commanded_tool_pose]
        for pose in ports.poses:
            before = poses[-1]
            poses.append(nearest_allowed(before, pose.pose_from(before), free))
        path = blended_path(poses, ports.blend)
        yield from self.along(path, free=free)
