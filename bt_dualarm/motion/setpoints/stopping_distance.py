"""Stopping feasibility: how far a joint goes when it brakes as hard as its limits allow."""

from __future__ import annotations

from typing import TypeAlias

import numpy as np
import numpy.typing as npt

from bt_dualarm.pose import Matrix, Vector
from bt_dualarm.world.robots.robot import JointLimits

Flags: TypeAlias = npt.NDArray[np.bool_]
"""One answer for each joint, of shape (dof,)."""


def limit_rows(limits: JointLimits) -> Matrix:
    """Limits of the joints as kernels have them, of shape (5, dof)."""
    rows = limits.lower, limits.upper, limits.velocity, limits.acceleration, limits.jerk
    return np.array(rows)


def feasible(limits: Matrix, q: Vector, v: Vector, a: Vector) -> Flags:
    """Whether each joint can keep its limits, of shape (5, dof), from here; the others (dof,)."""
    from bt_dualarm.motion.chains.limit_kernels import can_stop

    states = zip(q.tolist(), v.tolist(), a.tolist(), strict=True)
    return np.array([can_stop(limits, i, *state) for i, state in enumerate(states)])


def stopping_distance(v: Vector, a: Vector, acceleration: Vector, jerk: Vector) -> Vector:
    """Farthest that joints go in the positive direction before they can turn, of shape (dof,).

    Args:
        v: Velocity of shape (dof,), rad/s.
        a: Acceleration of shape (dof,), rad/s², within the limit.
        acceleration: Limit of the acceleration, of shape (dof,), rad/s².
        jerk: Limit of the jerk, of shape (dof,), rad/s³.
    """
    from bt_dualarm.motion.chains.limit_kernels import stopping_way

    joints = zip(v.tolist(), a.tolist(), acceleration.tolist(), jerk.tolist(), strict=True)
    return np.array([stopping_way(*joint) for joint in joints])


def every(flags: Flags) -> bool:
    """As ``flags.all()``, at a third of what that costs: it is asked at the control rate."""
    return b"\0" not in flags.tobytes()


def displacement_bound(v: Vector, a: Vector, limits: Matrix, seconds: float) -> Vector:
    """How far joints get at most that do as they like and brake then, of shape (dof,), rad.

    Args:
        v: Velocity of shape (dof,), rad/s.
        a: Acceleration of shape (dof,), rad/s², within the limit.
        limits: Limits that they keep meanwhile, of shape (5, dof), see `limit_rows`.
        seconds: Time after which they brake, s.
    """
    from bt_dualarm.motion.chains.limit_kernels import turn_and_stop

    joints = zip(v.tolist(), a.tolist(), strict=True)
    return np.array([turn_and_stop(limits, i, *joint, seconds) for i, joint in enumerate(joints)])
