"""Places from which an arm's camera looks at one point from around it."""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import dataclass
from typing import Final

import numpy as np

from bt_dualarm.arm.arm import Arm
from bt_dualarm.errors import Failure
from bt_dualarm.pose import Pose, Vector

_NO_WAY: Final = {"UNREACHABLE", "JOINT_LIMIT", "IN_COLLISION", "NO_PLAN", "SINGULAR"}


@dataclass(frozen=True)
class Side:
    """Where a camera looks from, beside the direction from which it looked first.

    Attributes:
        across: Turn about the point, across the image, degrees.
        along: The same, along the image.
        roll: Turn about the line of sight, degrees.
        share: Distance, as a share of what was asked for.
    """

    across: float = 0.0
    along: float = 0.0
    roll: float = 0.0
    share: float = 1.0

    def camera(self, point: Vector, looking: Vector, distance: float) -> Pose:
        """Pose of the camera in the world.

        Args:
            point: Place in the world in the middle of its image, of shape (3,), m.
            looking: Quaternion of the camera that looked first, of shape (4,).
            distance: Distance from the point, m.
        """
        across, along, roll = np.radians((self.across, self.along, self.roll))
        around = Pose.from_rpy((0, 0, 0), (across, along, roll))
        back = Pose.from_rpy((0, 0, -self.share * distance))
        return Pose(point, looking) @ around @ back


SIDES: Final = (
    Side(across=14, roll=30),
    Side(across=-14, roll=-30),
    Side(along=14, share=0.85),
    Side(along=-14),
    Side(across=10, along=10, roll=-40),
    Side(across=-10, along=-10, roll=40),
    Side(across=20, share=1.2),
    Side(across=-20, share=1.2),
    Side(along=20, share=1.2),
    Side(along=-20, share=1.2),
    Side(),
    Side(share=1.4, roll=20),
)
"""Turns to either side, so that what is not known of the camera's mount shows in the pictures."""


def go_to_camera(
    arm: Arm, camera: Pose, speed: float, ignore: frozenset[str] = frozenset()
) -> Generator[float | None, None, bool]:
    """Bring the arm's own camera to a pose in the world; yields once a tick.

    Args:
        arm: Arm with a camera of its own.
        camera: Pose of the camera (x right, y down, z forward).
        speed: Share of the limits, above 0 to 1.
        ignore: Names of objects that may be touched.

    Returns:
        Whether there is a way; the arm has not moved where there is none.

    Raises:
        Failure: As `Arm.travel`, but for a pose that cannot be reached.
    """
    nominal, q = arm.world.nominal[arm.name], arm.q
    camera_in_tool = nominal.tool_pose_at(q).inverse @ nominal.camera_pose_at(q)
    try:
        goals = arm.kinematics.solutions(camera @ camera_in_tool.inverse, arm.setpoint.q)
        yield from arm.travel(goals, speed, ignore)
    except Failure as failure:
        if failure.code not in _NO_WAY:
            raise
        return False
    return True
