"""Path constraints of a motion: what the planner has to keep, and whether the arm has kept it."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Final

import numpy as np

from bt_dualarm.arm.arm import Arm
from bt_dualarm.core.errors import Failure, Number
from bt_dualarm.core.pose import Pose
from bt_dualarm.planning.path_constraints import Cone, PathConstraint
from bt_dualarm.spec.path_keep import Keep

_UP: Final = np.array((0.0, 0.0, 1.0))


class KeptPath:
    """Path constraint of one motion, as requested, planned and measured.

    Args:
        arm: Arm that moves.
        keep: Limits of the tree file.
        of_tool: Pose in the tool of the object that is carried; None for the tool itself.

    Attributes:
        failures: Failure codes of a motion with a path constraint, and their meaning.
        constraint: What the planner has to keep.
    """

    failures: Final = {
        "KEEP_VIOLATED": "`keep` does not hold at the start or at the goal, or was violated",
    }

    def __init__(self, arm: Arm, keep: Keep, of_tool: Pose | None = None) -> None:
        self._arm = arm
        self._in_tool = Pose.identity() if of_tool is None else of_tool
        start = arm.commanded_tool_pose @ self._in_tool
        cones = []
        if keep.upright is not None:
            if of_tool is None:
                axis = start.inverse.turn(_UP)
            else:  # what stands on its head may stay so
                axis = math.copysign(1.0, float(start.rotation_matrix[2, 2])) * _UP
            cones.append(Cone("upright", axis, keep.upright, _UP))
        facing = keep.facing
        if facing is not None:
            direction = None
            if facing.direction is not None:
                direction = np.array(facing.direction) / float(np.linalg.norm(facing.direction))
            point = None if facing.toward is None else np.array(facing.toward.xyz)
            cones.append(Cone("facing", facing.unit_axis, facing.within, direction, point))
        lowest, highest = keep.height or (-math.inf, math.inf)
        self.constraint = PathConstraint(
            arm.robot, arm.kinematics.base, self._in_tool, tuple(cones), lowest, highest
        )
        self._largest = dict.fromkeys((cone.name for cone in cones), 0.0)
        self._lowest = math.inf
        self._highest = -math.inf
        self._worst_rad = -math.inf
        self._worst_m = -math.inf

    @property
    def metrics(self) -> dict[str, Number]:
        """Largest angles, and the range of heights, that were measured; and the worst violation."""
        found: dict[str, Number] = {
            f"{name}_max_rad": angle for name, angle in self._largest.items()
        }
        if self.constraint.highest < math.inf:
            found |= {"height_min_m": self._lowest, "height_max_m": self._highest}
            found["keep_violation_m"] = max(self._worst_m, 0.0)
        if self._largest:
            found["keep_violation_rad"] = max(self._worst_rad, 0.0)
        return found

    def refuse_ends(self, tool_goal: Pose) -> None:
        """Check the current pose and the goal, before anything moves.

        Args:
            tool_goal: Goal pose of the tool in the world.

        Raises:
            Failure: ``KEEP_VIOLATED``.
        """
        self._refuse(self._arm.commanded_tool_pose, "at the start")
        self._refuse(tool_goal, "at the goal")

    def refuse_path(self, tool: Sequence[Pose]) -> None:
        """Check poses of the tool in the world along a path, before anything moves.

        Raises:
            Failure: ``KEEP_VIOLATED``; the reason states where on the path it begins.
        """
        self.refuse_ends(tool[-1])
        for i, pose in enumerate(tool):
            self._refuse(pose, f"at {100 * i / (len(tool) - 1):.0f} % of the path")

    def through(
        self, going: Iterator[float | None], metrics: dict[str, Number]
    ) -> Iterator[float | None]:
        """Execute a motion, and measure from the encoders what it keeps; yields once per tick.

        Args:
            going: The motion.
            metrics: Metrics of the skill, to be filled.

        Raises:
            Failure: ``KEEP_VIOLATED`` as soon as a limit is exceeded; as the motion.
        """
        try:
            self._look()
            for progress in going:
                yield progress
                self._look()
            self._look()
        finally:
            metrics |= self.metrics

    def _look(self) -> None:
        tool = self._arm.tool_pose
        frame = tool @ self._in_tool
        for cone in self.constraint.cones:
            angle = cone.angle(frame)
            self._largest[cone.name] = max(self._largest[cone.name], angle)
        height = float(frame.position[2])
        self._lowest = min(self._lowest, height)
        self._highest = max(self._highest, height)
        violation = self.constraint.violation(frame)
        self._worst_rad = max(self._worst_rad, violation.rad)
        self._worst_m = max(self._worst_m, violation.m)
        self._refuse(tool, "during the motion")

    def _refuse(self, tool: Pose, when: str) -> None:
        violation = self.constraint.of_tool(tool)
        if violation:
            raise Failure(
                "KEEP_VIOLATED",
                f"{when} {violation.what}",
                keep_violation_rad=violation.rad,
                keep_violation_m=violation.m,
            )
