"""Move the tool to a pose, by an offset, or the joints to a named posture."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Literal

from bt_dualarm import (
    Angle,
    Duration,
    FreeAxes,
    Keep,
    KeptPath,
    Offset,
    Planner,
    PortModel,
    Pose,
    PostureName,
    Skill,
    SkillContext,
    Speed,
    ToolPose,
    Vector,
    check_arrival,
    port,
)


class ReachToPose(Skill):
    """Move the tool to a pose, by an offset, or the joints to a named posture."""

    class Ports(PortModel):
        exactly_one_of = ("to", "offset", "posture")
        at_most_one_of = ("free", "keep")

        to: ToolPose | None = port(
            None, "tool pose in the world; by default with its current orientation"
        )
        offset: Offset | None = port(None, "step from the current tool pose")
        posture: PostureName | None = port(None, "named posture of the robot, such as home")
        prefer: Literal["nearest", "conditioned"] = port(
            "nearest",
            "choice of the configuration: nearest, or farthest from singularities",
        )
        patience: Duration = port(60.0, "longest wait for another arm that blocks the path", le=600)
        give_way: bool = port(
            True, "move aside for another arm that has waited longer, instead of waiting in place"
        )
        speed: Speed = port(0.5, "fraction of the arm's limits")
        planner: Planner = port("RRTConnect", "planner to use if the straight path is blocked")
        free: FreeAxes | None = port(
            None, "rotations about the tool's own axes that `to` or `offset` leaves free"
        )
        keep: Keep | None = port(None, "limits that the planner keeps along the whole path")
        tolerance: float = port(
            0.001, "largest position error at the end", unit="m", ge=1e-4, le=0.1
        )
        angle_tolerance: Angle = port(0.5, "largest angle error at the end", ge=0.01, le=30)

    failures = {
        "INVALID_TARGET": "no such posture, or a target outside the workspace",
        "UNREACHABLE": "no configuration of the arm puts the tool there",
        "IN_COLLISION": "the arm would be in collision at the target",
        "NO_PLAN": "no collision-free path was found",
        "NOT_REACHED": "the tool ended farther away than the tolerance",
        "TRACKING_ERROR": "the arm was blocked or could not follow",
        "BUSY": "another leaf moves the arm",
        **KeptPath.failures,
    }
    example = "reach_to_pose: {to: {xyz: [0.4, 0.2, 0.6], rpy: [180, 0, 0]}, speed: 0.5}"
    ports: Ports

    def __init__(
        self, ports: PortModel, context: SkillContext, write: Callable[[str, object], None]
    ) -> None:
        super().__init__(ports, context, write)
        self.begins_anywhere = self.ports.offset is None

    def run(self) -> Iterator[float | None]:
        """Solve the inverse kinematics, move, verify the arrival."""
        goals, target = self._goals()
        kept = None
        if self.ports.keep is not None:
            kept = KeptPath(self.arm, self.ports.keep)
            kept.refuse_ends(target)
        motion = self.arm.travel(
            goals,
            self.ports.speed,
            give_way=self.ports.give_way,
            patience=self.ports.patience,
            planner=self.ports.planner,
            keep=None if kept is None else kept.constraint,
            turns=self.ports.posture is None,
        )
        if kept is None:
            yield from motion
        else:
            yield from kept.through(motion, self.metrics)
        self.metrics |= check_arrival(
            "the tool",
            self.arm.tool_pose,
            target,
            self.ports.tolerance,
            self.ports.angle_tolerance,
            self.ports.free or (),
        )

    def _goals(self) -> tuple[list[Vector], Pose]:
        """Goal configurations, the preferred one first, and their common tool pose."""
        ports = self.ports
        arm = self.arm
        if ports.posture is not None:
            q = arm.posture(ports.posture)
            return [q], arm.kinematics.forward(q)
        tool = arm.commanded_tool_pose
        target = ports.to.pose_from(tool) if ports.to else ports.offset.applied_to(tool)  # type: ignore[union-attr]  # one of the three is given
        goals = arm.configurations(target, prefer=ports.prefer, free=ports.free or ())
        return goals, target
