"""Places from which an arm's camera looks at one point, and how it gets there."""

from __future__ import annotations

from collections.abc import Generator, Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np

from bt_dualarm.arm.arm import Arm
from bt_dualarm.errors import Failure
from bt_dualarm.pose import Pose, Vector

_NO_WAY: Final = {
    "INVALID_TARGET",  # outside of the workspace
    "UNREACHABLE",
    "JOINT_LIMIT",
    "IN_COLLISION",
    "NO_PLAN",
    "SINGULAR",
}


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
    Side(across=10, roll=60),
    Side(across=-10, roll=-60),
    Side(along=10, roll=90),
    Side(along=-10, roll=-90),
    Side(across=8, along=-8, roll=20, share=0.8),
    Side(across=-8, along=8, roll=-20, share=0.8),
    Side(across=24, along=8, roll=45, share=1.2),
    Side(across=-24, along=8, roll=-45, share=1.2),
    Side(share=0.8),
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
    camera_in_tool = arm.tool_pose.inverse @ camera_now(arm)
    try:
        goals = arm.kinematics.solutions(camera @ camera_in_tool.inverse, arm.setpoint.q)
        yield from arm.travel(goals, speed, ignore)
    except Failure as failure:
        if failure.code not in _NO_WAY:
            raise
        yield None  # one try a tick: many in one would hold up everybody
        return False
    return True


def gazes(
    point: Vector, distance: float, direction: Vector, lean: float, near: Pose
) -> Iterator[Pose]:
    """Poses of a camera that looks at a point, those that are wanted most first.

    Args:
        point: Place in the middle of its image, of shape (3,), m.
        distance: Distance from it, m.
        direction: Line of sight in the world, of shape (3,), of any length but none.
        lean: Angle by which the line of sight may differ from that, rad.
        near: Pose of the camera now: of turns about the line of sight the nearest come first.
    """
    along = direction / np.linalg.norm(direction)
    side = np.cross(along, np.eye(3)[int(np.argmin(np.abs(along)))])
    side /= np.linalg.norm(side)
    for share, around in _LEANS:
        turn = np.cos(around) * side + np.sin(around) * np.cross(along, side)
        sight = np.cos(share * lean) * along + np.sin(share * lean) * turn
        rolled = [_gaze(point, distance, sight, side, roll) for roll in _ROLLS]
        yield from sorted(rolled, key=near.angle)


_ROLLS: Final = tuple(np.radians(np.arange(0, 360, 30)).tolist())
_LEANS: Final = (
    (0.0, 0.0),
    *((share, around) for share in (0.5, 1.0) for around in np.radians(np.arange(0, 360, 60))),
)
"""Shares of the angle by which it may lean, and to which side, rad."""


def _gaze(point: Vector, distance: float, sight: Vector, side: Vector, roll: float) -> Pose:
    x = side - (side @ sight) * sight
    x /= np.linalg.norm(x)
    matrix = np.eye(4)
    matrix[:3, :3] = np.column_stack((x, np.cross(sight, x), sight))
    matrix[:3, 3] = point - distance * sight
    return Pose.from_matrix(matrix) @ Pose.from_rpy((0, 0, 0), (0, 0, roll))


def look_at(
    arm: Arm,
    cameras: Iterator[Pose],
    speed: float,
    ignore: frozenset[str] = frozenset(),
) -> Generator[float | None, None, Pose | None]:
    """Bring the arm's own camera to the first of several poses to which there is a way.

    Args:
        arm: Arm with a camera of its own.
        cameras: Poses of the camera in the world, the one wanted most first.
        speed: Share of the limits, above 0 to 1.
        ignore: Names of objects that may be touched.

    Returns:
        The pose; None where there is no way to any of them.

    Raises:
        Failure: As `go_to_camera`.
    """
    for camera in cameras:
        if (yield from go_to_camera(arm, camera, speed, ignore)):
            return camera
    return None


def camera_now(arm: Arm) -> Pose:
    """Pose of the arm's own camera in the world, by its encoders and its page."""
    return arm.world.nominal[arm.name].camera_pose_at(arm.q)
