"""Move the tool along a straight line."""

from __future__ import annotations

from collections.abc import Iterator

from bt_dualarm import (
    FreeAxes,
    Keep,
    KeptPath,
    ObjectName,
    Offset,
    PathSkill,
    PortModel,
    Pose,
    Speed,
    ToolPose,
    into_held,
    line_path,
    nearest_allowed,
    port,
)


class MoveLinear(PathSkill):
    """Move the tool along a straight line to a pose or by an offset, rotating uniformly."""

    class Ports(PortModel):
        exactly_one_of = ("to", "offset")
        at_most_one_of = ("free", "keep")

        to: ToolPose | None = port(
            None, "tool pose in the world; by default with its current orientation"
        )
        offset: Offset | None = port(None, "step from the current tool pose")
        speed: Speed = PathSkill.SPEED
        tolerance: float = PathSkill.TOLERANCE
        free: FreeAxes | None = PathSkill.FREE
        keep: Keep | None = port(None, "limits that have to hold along the whole line")
        into: ObjectName | None = PathSkill.INTO

    failures = {**PathSkill.failures, **KeptPath.failures}
    example = "move_linear: {offset: {xyz: [0, 0, 0.10], frame: tool}, speed: 0.3}"
    ports: Ports

    def run(self) -> Iterator[float | None]:
        """Build the line from the current tool pose, follow it, measure the error."""
        tool = self.arm.commanded_tool_pose
        free = self.ports.free or ()
        path = line_path(tool, nearest_allowed(tool, self._goal(tool), free))
        with into_held(self.arm, self.ports.into):
            if self.ports.keep is None:
                yield from self.along(path, free=free)
                return
            kept = KeptPath(self.arm, self.ports.keep)
            kept.refuse_path(path.poses)
            # Nothing would keep the limits on a motion to another branch.
            yield from kept.through(self.along(path, from_here=True), self.metrics)

    def _goal(self, tool: Pose) -> Pose:
        to = self.ports.to
        offset = self.ports.offset
        return to.pose_from(tool) if to else offset.applied_to(tool)  # type: ignore[union-attr]  # one is given
