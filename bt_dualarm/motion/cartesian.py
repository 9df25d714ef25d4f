"""From a path of the tool to a motion of the joints."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from bt_dualarm.motion.ik import Kinematics
from bt_dualarm.motion.paths import CartesianPath
from bt_dualarm.motion.target import EXACT, Tolerance
from bt_dualarm.motion.timing import shortest_time, time_path
from bt_dualarm.motion.trajectory import Trajectory
from bt_dualarm.pose import Matrix, Vector
from bt_dualarm.world.catalogue import JointLimits


def joint_path(
    arm: Kinematics, path: CartesianPath, near: Vector, tolerance: Tolerance = EXACT
) -> Matrix:
    """Configurations along all passes of a path, of shape (n, dof), without a jump.

    A pass of a closed path is solved once and repeated.

    Raises:
        Failure: As ``Kinematics.follow``.
    """
    once = arm.follow(path.poses, near, tolerance)
    if path.closed:
        once[-1] = once[0]  # as the poses do; the solver's rounding is below 1e-9 rad
    return np.vstack((once, *(once[1:] for _ in range(path.repeats - 1))))


class Traced(NamedTuple):
    """A motion of the joints that takes the tool along a path.

    Attributes:
        motion: From rest to rest.
        shortest_s: What no motion along the path can go below, by TOPP-RA: jerk is not looked at.
    """

    motion: Trajectory
    shortest_s: float


def trace(
    arm: Kinematics, path: CartesianPath, near: Vector, limits: JointLimits, dt: float
) -> Traced:
    """The motion of the joints that takes the tool along a path, from rest to rest.

    Its first set-point may be far from ``near``, in another branch: check before it is sent.

    Args:
        arm: Whose tool it is.
        path: Of the tool, in the world.
        near: Configuration before the path, of shape (dof,).
        limits: The arm's, scaled by the speed.
        dt: Time between set-points in seconds.

    Raises:
        Failure: ``UNREACHABLE``, ``PATH_BROKEN`` or ``SINGULAR``.
    """
    rows = joint_path(arm, path, near)
    return Traced(
        time_path(rows, limits, dt, path.closed), shortest_time(rows, limits, path.closed)
    )
