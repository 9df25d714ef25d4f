"""From a path of the tool to a motion of the joints."""

from __future__ import annotations

import numpy as np

from bt_dualarm.motion.kinematics.arm_kinematics import Kinematics
from bt_dualarm.motion.kinematics.target import EXACT, Tolerance
from bt_dualarm.motion.paths.cartesian_path import CartesianPath
from bt_dualarm.motion.timing.point_to_point import TimedPath, timed_path
from bt_dualarm.pose import Matrix, Vector
from bt_dualarm.world.robots.robot import JointLimits


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


def trace(
    arm: Kinematics, path: CartesianPath, near: Vector, limits: JointLimits, dt: float
) -> TimedPath:
    """The motion of the joints that takes the tool along a path, from rest to rest.

    Its first set-point may be far from ``near``, in another branch: check before it is sent.

    Args:
        arm: Arm whose tool it is.
        path: Path of the tool, in the world.
        near: Configuration before the path, of shape (dof,).
        limits: Limits of the arm, scaled by the speed.
        dt: Time between set-points in seconds.

    Raises:
        Failure: ``UNREACHABLE``, ``PATH_BROKEN`` or ``SINGULAR``.
    """
    rows = joint_path(arm, path, near)
    return timed_path(rows, limits, dt, path.closed)
