"""How much of an arm's limits a motion takes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from bt_dualarm.motion.timing.law import Law, Rows
from bt_dualarm.motion.timing.trajectory import Trajectory
from bt_dualarm.pose import Matrix, Vector
from bt_dualarm.world.robots.robot import JointLimits

_ROUNDING = 1e-9
"""Share by which a set-point may pass a limit: floating point, not motion."""


@dataclass(frozen=True)
class Use:
    """The largest shares of the limits that a motion takes; above one is a violation."""

    velocity: float
    acceleration: float
    jerk: float
    position_margin: float
    """Smallest distance to a position limit in rad; negative outside."""

    @property
    def within(self) -> bool:
        """Whether no set-point passes a limit."""
        worst = max(self.velocity, self.acceleration, self.jerk)
        return worst <= 1.0 + _ROUNDING and self.position_margin >= -_ROUNDING


def use_of_limits(trajectory: Trajectory, limits: JointLimits) -> Use:
    """How much of the limits a motion takes, over all its set-points.

    Acceleration counts both as given and as the difference of velocities over ``dt``; jerk is the
    difference of accelerations over ``dt``: what a controller that checks a stream can see.
    """
    velocity, acceleration, jerk = shares_of_limits(trajectory, limits)
    q = trajectory.q
    return Use(
        velocity=float(velocity.max()),
        acceleration=float(acceleration.max()),
        jerk=float(jerk.max()),
        position_margin=float(min((q - limits.lower).min(), (limits.upper - q).min())),
    )


SharesOfLimits: TypeAlias = tuple[Vector, Vector, Vector]
"""Shares of the velocity, acceleration and jerk limits, of shape (n,), of the worst joint."""


def shares_of_limits(trajectory: Trajectory, limits: JointLimits) -> SharesOfLimits:
    """Shares of the limits at each set-point; differences count at the earlier one."""
    return shares_of_motion(trajectory.v, trajectory.a, trajectory.dt, limits)


def shares_of_motion(v: Matrix, a: Matrix, dt: float, limits: JointLimits) -> SharesOfLimits:
    """The same, from velocities and accelerations of shape (n, dof) every ``dt`` seconds."""
    change = np.diff(v, axis=0, append=v[-1:]) / dt
    return _shares((v, a), (change, np.diff(a, axis=0, append=a[-1:]) / dt), limits)


def shares_at(motion: Law, index: Rows, dt: float, limits: JointLimits) -> SharesOfLimits:
    """The same as `shares_of_limits` at some set-points, each one looked at with the next."""
    _, v, a = motion.rows(index)
    _, v_next, a_next = motion.rows(np.minimum(index + 1, len(motion) - 1))
    return _shares((v, a), ((v_next - v) / dt, (a_next - a) / dt), limits)


def _shares(
    given: tuple[Matrix, Matrix], changes: tuple[Matrix, Matrix], limits: JointLimits
) -> SharesOfLimits:
    """From velocities and accelerations as given, and what they change a second, (n, dof) each."""
    (v, a), (change, jerk) = given, changes
    acceleration = np.maximum(np.abs(a), np.abs(change))
    return (
        (np.abs(v) / limits.velocity).max(axis=1),
        (acceleration / limits.acceleration).max(axis=1),
        (np.abs(jerk) / limits.jerk).max(axis=1),
    )
