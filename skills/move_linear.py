"""Move the tool along a straight line."""

from __future__ import annotations

from collections.abc import Iterator

from bt_dualarm import (
    Offset,
    PortModel,
    Pose,
    Skill,
    Speed,
    ToolPose,
    follow_curve,
    line_path,
    port,
)


class MoveLinear(Skill):
    """Move the tool along a straight line to a pose or by an offset, turning evenly."""

    class Ports(PortModel):
        exactly_one_of = ("to", "offset")

        to: ToolPose | None = port(None, "tool pose in the world; turned as now if only xyz")
        offset: Offset | None = port(None, "step from the current tool pose")
        speed: Speed = port(0.5, "share of the arm's limits of velocity, acceleration and jerk")
        tolerance: float = port(
            0.005, "how far the tool may be from its plan at any time", unit="m", ge=1e-4, le=0.1
        )

    failures = {
        "SINGULAR": "the line leads through a singularity of the arm; nothing was executed",
        "PATH_BROKEN": "the arm can follow only a part of the line; nothing was executed",
        "IN_COLLISION": "the arm would touch something on the way",
        "TRACKING_ERROR": "the arm was blocked or left its plan by more than the tolerance",
        "BUSY": "another leaf moves the arm",
    }
    example = "move_linear: {offset: {xyz: [0, 0, 0.10], frame: tool}, speed: 0.3}"
    needs = ("toppra",)
    ports: Ports

    def run(self) -> Iterator[float | None]:
        """Draw the line from where the tool is, follow it, measure."""
        tool, ports = self.arm.commanded_tool_pose, self.ports
        path = line_path(tool, self._goal(tool))
        self.metrics |= yield from follow_curve(
            self.arm, path, ports.speed, self.record, ports.tolerance
        )

    def _goal(self, tool: Pose) -> Pose:
        to, offset = self.ports.to, self.ports.offset
        return to.pose_from(tool) if to else offset.applied_to(tool)  # type: ignore[union-attr]  # one is given
