"""A step from where the tool is."""

from __future__ import annotations

from typing import Literal

import numpy as np

from bt_dualarm.pose import Pose
from bt_dualarm.spec.ports import PortModel, port
from bt_dualarm.spec.values import Vector3


class Offset(PortModel):
    """A step from where the tool is."""

    xyz: Vector3 = port((0.0, 0.0, 0.0), "how far along x, y, z", unit="m")
    rpy: Vector3 = port((0.0, 0.0, 0.0), "roll, pitch, yaw", unit="deg")
    frame: Literal["world", "tool"] = port("world", "whose axes are meant")

    def applied_to(self, tool: Pose) -> Pose:
        """The tool's pose after the step."""
        step = Pose.from_rpy(self.xyz, tuple(np.deg2rad(self.rpy)))
        if self.frame == "tool":
            return tool @ step
        turned = Pose(np.zeros(3), step.quaternion) @ Pose(np.zeros(3), tool.quaternion)
        return Pose(tool.position + step.position, turned.quaternion)
