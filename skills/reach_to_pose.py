"""Move the tool to a pose, by an offset, or the joints to a named posture."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Literal

from bt_dualarm import (
    Angle,
    Duration,
    Offset,
    Planner,
    PortModel,
    Pose,
    PostureName,
    Skill,
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

        to: ToolPose | None = port(None, "tool pose in the world; turned as now if only xyz")
        offset: Offset | None = port(None, "step from the current tool pose")
        posture: PostureName | None = port(None, "a posture of the robot, such as home")
        prefer: Literal["nearest", "conditioned"] = port(
            "nearest",
            "of several configurations: the nearest, or the one farthest from singularities",
        )
        patience: Duration = port(5.0, "how long to wait for an arm that is in the way", le=600)
        give_way: bool = port(
            False, "wait out of the way while another arm is in the way, not where the arm is"
        )
        speed: Speed = port(0.5, "share of the arm's limits")
        planner: Planner = port("RRTConnect", "searches where the straight way is not free")
        tolerance: float = port(0.001, "largest distance at the end", unit="m", ge=1e-4, le=0.1)
        angle_tolerance: Angle = port(0.5, "largest turn at the end", ge=0.01, le=30)

    failures = {
        "INVALID_TARGET": "no such posture, or a target outside of the workspace",
        "UNREACHABLE": "no configuration of the arm puts the tool there",
        "IN_COLLISION": "the arm would touch something there",
        "NO_PLAN": "no way there free of collisions was found",
        "NOT_REACHED": "the tool ended farther away than the tolerance",
        "TRACKING_ERROR": "the arm was blocked or could not follow",
        "BUSY": "another leaf moves the arm",
    }
    example = "reach_to_pose: {to: {xyz: [0.4, 0.2, 0.6], rpy: [180, 0, 0]}, speed: 0.5}"
    ports: Ports

    def run(self) -> Iterator[float | None]:
        """Refuse what cannot be reached, go there, verify."""
        goal, target = self._goal()
        yield from self.arm.travel(
            goal,
            self.ports.speed,
            give_way=self.ports.give_way,
            patience=self.ports.patience,
            planner=self.ports.planner,
        )
        self._verify(target)

    def _goal(self) -> tuple[list[Vector], Pose]:
        """Configurations to choose from, nearest first, and the pose they put the tool at."""
        ports, arm = self.ports, self.arm
        if ports.posture is not None:
            q = arm.posture(ports.posture)
            return [q], arm.kinematics.forward(q)
        tool = arm.commanded_tool_pose
        target = ports.to.pose_from(tool) if ports.to else ports.offset.applied_to(tool)  # type: ignore[union-attr]  # one of the three is given
        return arm.kinematics.solutions(target, arm.setpoint.q, prefer=ports.prefer), target

    def _verify(self, target: Pose) -> None:
        self.metrics |= check_arrival(
            "the tool",
            self.arm.tool_pose,
            target,
            self.ports.tolerance,
            self.ports.angle_tolerance,
        )
