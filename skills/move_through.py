"""Move the tool through a list of poses without stopping."""

from __future__ import annotations

from collections.abc import Iterator

from bt_dualarm import PortModel, PoseSpec, Skill, Speed, blended_path, follow_curve, port


class MoveThrough(Skill):
    """Move the tool along straight lines from pose to pose, rounding the corners."""

    class Ports(PortModel):
        poses: tuple[PoseSpec, ...] = port(
            ...,
            "tool poses in the world; turned as the one before if only xyz",
            min_length=1,
            max_length=200,
        )
        blend: float = port(
            0.02, "how near to a pose the tool may begin to round it", unit="m", ge=0.001, le=0.5
        )
        speed: Speed = port(0.5, "share of the arm's limits of velocity, acceleration and jerk")
        tolerance: float = port(
            0.005, "how far the tool may be from its plan at any time", unit="m", ge=1e-4, le=0.1
        )

    failures = {
        "INVALID_TARGET": "two poses in a row are alike",
        "SINGULAR": "the path leads through a singularity of the arm; nothing was executed",
        "PATH_BROKEN": "the arm can follow only a part of the path; nothing was executed",
        "IN_COLLISION": "the arm would touch something on the way",
        "TRACKING_ERROR": "the arm was blocked or left its plan by more than the tolerance",
        "BUSY": "another leaf moves the arm",
    }
    example = "move_through: {poses: [{xyz: [0.4, 0.0, 0.5]}, {xyz: [0.4, 0.2, 0.5]}], blend: 0.03}"
    needs = ("toppra",)
    ports: Ports

    def run(self) -> Iterator[float | None]:
        """Draw the path from where the tool is, follow it, measure."""
        ports = self.ports
        poses = [self.arm.commanded_tool_pose]
        for pose in ports.poses:
            poses.append(pose.pose_from(poses[-1]))
        path = blended_path(poses, ports.blend)
        self.metrics |= yield from follow_curve(
            self.arm, path, ports.speed, self.record, ports.tolerance
        )
