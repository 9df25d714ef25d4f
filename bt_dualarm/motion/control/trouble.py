"""What goes wrong with a motion, as far as an arm can sense it: reasons, with their numbers."""

from __future__ import annotations

from typing import Final

import numpy as np

from bt_dualarm.errors import Failure, HitFailure
from bt_dualarm.motion.hits.collision_watch import CollisionWatch
from bt_dualarm.pose import Matrix, Vector
from bt_dualarm.world.robots.robot import Robot

_FELT: Final = 0.5  # share of its threshold at which a joint feels a hit, once another one is sure


def left_behind(robot: Robot, error: Vector) -> Failure:
    """A joint is too far from its set-point; errors of shape (dof,), rad."""
    joint = int(np.argmax(np.abs(error)))
    worst = float(np.abs(error[joint]))
    return Failure(
        "TRACKING_ERROR",
        f"joint {robot.joints[joint]} is {np.degrees(worst):.1f}° behind its set-point: "
        "the arm is blocked or its torque does not suffice",
        joint_error_rad=worst,
    )


def too_fast(robot: Robot, shares: Vector) -> Failure:
    """A joint is faster than it may be; speeds of shape (dof,), as shares of their limits."""
    joint = int(np.argmax(shares))
    share = float(shares[joint])
    return Failure(
        "TRACKING_ERROR",
        f"joint {robot.joints[joint]} was {share:.2f} times as fast as the robot allows: "
        "the arm was pushed or its torque does not suffice",
        joint_speed_share=share,
    )


def hit(robot: Robot, watch: CollisionWatch, jacobian: Matrix) -> HitFailure:
    """The arm was hit.

    Joints before the link that was hit feel it, those behind it do not. The force is what explains
    the torques best if it acts on the tool: the least that it can be.

    Args:
        robot: Arm that was hit.
        watch: Torques that tell so, and the thresholds that they are above.
        jacobian: Jacobian of the tool's velocity, of shape (3, dof).
    """
    shares = np.abs(watch.change) / watch.threshold
    joint, last = int(np.argmax(shares)), int(np.flatnonzero(shares > _FELT)[-1])
    force = float(np.linalg.norm(np.linalg.pinv(jacobian.T) @ watch.change))
    torque, threshold = float(abs(watch.change[joint])), float(watch.threshold[joint])
    return HitFailure(
        f"joint {robot.joints[joint]} felt {torque:.1f} N m that nothing explains, {threshold:.1f} "
        f"are usual at most: the arm was hit, at {robot.joints[last]} or beyond, "
        f"by {force:.0f} N if at the tool",
        joint=robot.joints[joint],
        beyond=robot.joints[last],
        torque_nm=torque,
        threshold_nm=threshold,
        force_n=force,
    )
