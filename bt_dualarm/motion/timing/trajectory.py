"""A motion of an arm in time: set-points of all joints on an even grid."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
import numpy.typing as npt

from bt_dualarm.pose import Matrix, Vector
from bt_dualarm.world.robots.robot import JointLimits

Index: TypeAlias = int | npt.NDArray[np.int_]
"""One row, or several."""

_ROUNDING = 1e-9
"""Share by which a set-point may pass a limit: floating point, not motion."""


@dataclass(frozen=True, eq=False)
class Trajectory:
    """Set-points every ``dt`` seconds; the first at time zero.

    Attributes:
        dt: Time between set-points, in seconds.
        q: Positions, of shape (n, dof), rad.
        v: Velocities, of shape (n, dof), rad/s.
        a: Accelerations, of shape (n, dof), rad/s².
    """

    dt: float
    q: Matrix
    v: Matrix
    a: Matrix

    def __post_init__(self) -> None:
        if not (self.q.ndim == 2 and len(self.q) and self.q.shape == self.v.shape == self.a.shape):
            raise ValueError(
                f"q, v, a must be of one shape (n, dof), n > 0; they are of "
                f"{self.q.shape}, {self.v.shape}, {self.a.shape}"
            )

    @classmethod
    def rest(cls, q: Vector, dt: float) -> Trajectory:
        """The motion that stays at ``q``, of shape (dof,): one set-point."""
        return cls(dt, q[None].copy(), np.zeros((1, len(q))), np.zeros((1, len(q))))

    def __len__(self) -> int:
        return len(self.q)

    @property
    def duration(self) -> float:
        """Time from the first set-point to the last, in seconds."""
        return (len(self) - 1) * self.dt

    @property
    def to_come(self) -> Matrix:
        """Positions after the first, of shape (n, dof); those at rest where there is no other."""
        return self.q[1:] if len(self) > 1 else self.q

    def at(self, time: float) -> tuple[Vector, Vector, Vector]:
        """Position, velocity and acceleration at a time; before and after it, those of the ends.

        Between set-points the position is the cubic that meets their positions and velocities.
        """
        place = min(max(time / self.dt, 0.0), len(self) - 1.0)
        i = min(int(place), max(len(self) - 2, 0))
        u = place - i
        if u < _ROUNDING:
            return self.q[i].copy(), self.v[i].copy(), self.a[i].copy()
        if u > 1.0 - _ROUNDING:
            return self.q[i + 1].copy(), self.v[i + 1].copy(), self.a[i + 1].copy()
        return self._between(i, i + 1, u)

    def sampled(self, times: Vector) -> tuple[Matrix, Matrix, Matrix]:
        """Positions, velocities and accelerations at times of shape (n,), each of shape (n, dof).

        As `at`, but what is before the beginning and after the end has the velocity and the
        acceleration of the first and the last set-point, which need not be zero.
        """
        count = len(self)
        index = np.clip(times / self.dt, 0.0, count - 1.0)
        low = np.minimum(index.astype(int), max(count - 2, 0))
        return self._between(low, np.minimum(low + 1, count - 1), (index - low)[:, None])

    def _between(self, i: Index, j: Index, u: float | Matrix) -> tuple[Matrix, Matrix, Matrix]:
        """Between set-points ``i`` and ``j``, the next, at the share ``u`` of the way.

        Positions by the cubic that meets positions and velocities (Hermite), velocities and
        accelerations by straight lines.
        """
        q0, q1, v0, v1 = self.q[i], self.q[j], self.v[i], self.v[j]
        step = q1 - q0
        bend = (1.0 - u) * (v0 * self.dt - step) - u * (v1 * self.dt - step)
        q = q0 + u * step + u * (1.0 - u) * bend
        return q, v0 + u * (v1 - v0), self.a[i] + u * (self.a[j] - self.a[i])

    def then(self, other: Trajectory) -> Trajectory:
        """This motion, then another that starts at its last set-point.

        Raises:
            ValueError: The other motion has another grid or starts elsewhere.
        """
        if other.dt != self.dt:
            raise ValueError(f"grids differ: {self.dt} s and {other.dt} s")
        if not np.allclose(self.q[-1], other.q[0], rtol=0.0, atol=1e-6):
            raise ValueError("the second motion does not start where the first ends")
        q, v, a = (
            np.vstack((getattr(self, name), getattr(other, name)[1:])) for name in ("q", "v", "a")
        )
        return Trajectory(self.dt, q, v, a)


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


def shares_of_limits(trajectory: Trajectory, limits: JointLimits) -> tuple[Vector, Vector, Vector]:
    """Shares of the velocity, acceleration and jerk limits at each set-point, of shape (n,).

    They are of the worst joint; differences count at the earlier set-point.
    """
    change = np.diff(trajectory.v, axis=0, append=trajectory.v[-1:]) / trajectory.dt
    jerk = np.diff(trajectory.a, axis=0, append=trajectory.a[-1:]) / trajectory.dt
    acceleration = np.maximum(np.abs(trajectory.a), np.abs(change))
    return (
        (np.abs(trajectory.v) / limits.velocity).max(axis=1),
        (acceleration / limits.acceleration).max(axis=1),
        (np.abs(jerk) / limits.jerk).max(axis=1),
    )
