"""Turns of the tool about a line in space."""

from __future__ import annotations

import math

import numpy as np
import scipy

from bt_dualarm.errors import Failure
from bt_dualarm.motion.paths.cartesian_path import CartesianPath
from bt_dualarm.pose import Pose, Vector

_SPACING = 0.03  # radians between two samples
_WAYPOINT = math.radians(15.0)


def turned_about(tool: Pose, point: Vector, axis: Vector, angle: float) -> CartesianPath:
    """The tool going around a line in space as if fixed to it.

    Args:
        tool: Pose at which it begins.
        point: Point of the line, in the world, of shape (3,), m.
        axis: Direction of the line in the world, of shape (3,) and any length but 0.
        angle: Angle in radians, right-handed about the axis; more than a whole turn is possible.

    Raises:
        Failure: ``INVALID_TARGET`` for an axis or an angle of 0.
    """
    length = float(np.linalg.norm(axis))
    if not (length > 1e-9 and abs(angle) > 1e-9):
        raise Failure("INVALID_TARGET", "a turn needs an axis and an angle other than 0")
    count = max(math.ceil(abs(angle) / _SPACING), 8)
    turns = scipy.spatial.transform.Rotation.from_rotvec(
        np.linspace(0.0, angle, count + 1)[:, None] * np.asarray(axis) / length
    )
    positions = point + turns.apply(tool.position - point)
    quaternions = (turns * tool.rotation).as_quat(scalar_first=True)
    every = max(round(count * _WAYPOINT / abs(angle)), 1)
    return CartesianPath(positions, quaternions, positions[::every])
