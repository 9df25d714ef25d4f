"""Motions that the joints' torques suffice for: slowed if need be, refused if nothing helps."""

from __future__ import annotations

import numpy as np

from bt_dualarm.errors import Failure
from bt_dualarm.motion.control.dynamics import ArmDynamics
from bt_dualarm.motion.setpoints.time_scaling import at_scale
from bt_dualarm.motion.timing.trajectory import Trajectory
from bt_dualarm.pose import Matrix, Vector
from bt_dualarm.world.robots.robot import Robot

EFFORT_SHARE = 0.95
"""Share of a joint's effort that a motion may ask for: feedback needs the rest."""

SLOWEST = 0.1
"""Least time scale to which a load may slow a motion: slower, the arm can just hold it."""

_LOOK_S = 0.024  # between looks at a motion: half of the time that a joint takes to accelerate
_MOST_LOOKS = 500


def within_efforts(motion: Trajectory, robot: Robot, dynamics: ArmDynamics) -> Trajectory:
    """The same motion, as much slower as the joints' efforts ask for.

    At an even time scale r, torques beyond those that hold the arm at rest grow with r²: for each
    set-point and joint the largest r follows in closed form, and the least of them is taken.

    Args:
        motion: Motion from rest to rest.
        robot: Arm that moves.
        dynamics: Dynamics of it with all that it holds.

    Raises:
        Failure: ``OVERLOADED`` if it cannot even be held somewhere on the way, or no faster than
            at a tenth of its speed.
    """
    looks = min(int(motion.duration / _LOOK_S) + 2, _MOST_LOOKS)
    rows = np.unique(np.linspace(0, len(motion) - 1, looks).round().astype(int))
    looked_at = motion.rows(rows)
    rest = np.array([dynamics.at_rest(q) for q in looked_at[0]])
    refuse_overload(rest, robot)
    whole = np.array([dynamics.moving(*row) for row in zip(*looked_at, strict=True)])
    most = EFFORT_SHARE * robot.limits.effort
    if (np.abs(whole) <= most).all():
        return motion
    drive = whole - rest
    room = np.where(drive > 0.0, most - rest, most + rest)
    scales = np.sqrt(room / np.maximum(np.abs(drive), 1e-9))
    scale = float(scales.min())
    if scale < SLOWEST:
        joint = int(scales.min(axis=0).argmin())
        raise _overload(robot, joint, float(np.abs(rest[:, joint]).max()))
    return at_scale(motion, scale)


def refuse_overload(torques: Matrix, robot: Robot) -> None:
    """Check torques that are to hold an arm.

    Args:
        torques: Torques of shape (n, dof), N m.
        robot: Arm that they are to hold.

    Raises:
        Failure: ``OVERLOADED`` with the joint that needs most of its effort, or more than all.
    """
    worst: Vector = np.abs(torques).max(axis=0)
    shares = worst / robot.limits.effort
    joint = int(shares.argmax())
    if shares[joint] > EFFORT_SHARE:
        raise _overload(robot, joint, float(worst[joint]))


def _overload(robot: Robot, joint: int, torque: float) -> Failure:
    effort = float(robot.limits.effort[joint])
    return Failure(
        "OVERLOADED",
        f"joint {robot.joints[joint]} would have to bear {torque:.3g} N m at rest, "
        f"and has {effort:.3g} N m",
        joint=robot.joints[joint],
        torque_nm=torque,
        effort_nm=effort,
    )
