"""What an arm's joints allow its tool in a plane."""

from __future__ import annotations

import numpy as np

from bt_dualarm.motion.kinematics.arm_kinematics import Kinematics
from bt_dualarm.motion.setpoints.following_law import Reach
from bt_dualarm.pose import Matrix, Vector
from bt_dualarm.world.robots.robot import JointLimits

_DAMPING = 1e-6  # of the pseudo-inverse: keeps it finite at a singularity


def plane_reach(kinematics: Kinematics, limits: JointLimits, q: Vector, axes: Matrix) -> Reach:
    """What the joints allow the tool in the worst direction of a plane, all else held.

    Args:
        kinematics: Kinematics of the arm.
        limits: Limits of the joints.
        q: Configuration of shape (dof,), rad.
        axes: Unit vectors of the plane in the world, of shape (2, 3).
    """
    return reach_by_rates(limits, pseudo_inverse(kinematics.jacobian(q))[:, :3] @ axes.T)


def reach_by_rates(limits: JointLimits, rates: Matrix) -> Reach:
    """The same by the joint rates, of shape (dof, 2), that move the tool by one along each axis."""
    per_unit = np.maximum(np.hypot(rates[:, 0], rates[:, 1]), 1e-6)
    acceleration, jerk = limits.acceleration / per_unit, limits.jerk / per_unit
    return Reach(min(acceleration.tolist()), min(jerk.tolist()))


def pseudo_inverse(jacobian: Matrix) -> Matrix:
    """The damped right inverse, of shape (dof, 6)."""
    square = jacobian @ jacobian.T
    square.flat[::7] += _DAMPING
    inverse: Matrix = np.linalg.solve(square, jacobian).T.astype(float, copy=False)
    return inverse
