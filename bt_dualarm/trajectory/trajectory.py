"""Trajectories: set-points of all joints on an even time grid, and their use of the limits."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol, TypeAlias

import numpy as np
import numpy.typing as npt

from bt_dualarm.core.pose import Matrix, Vector
from bt_dualarm.robots.robot import JointLimits

Rows: TypeAlias = npt.NDArray[np.int_]
"""Indices of set-points, of shape (n,)."""

SetPoints: TypeAlias = tuple[Matrix, Matrix, Matrix]
"""Positions, velocities, accelerations."""

SharesOfLimits: TypeAlias = tuple[Vector, Vector, Vector]
"""Shares of the velocity, acceleration and jerk limits, of shape (n,), of the worst joint."""

LONG = 8192
"""Number of set-points above which they are computed on demand: half a minute at 250 Hz."""

_BLOCK = 1024
"""Number of set-points that are computed at a time."""

_ROUNDING = 1e-9
"""Fraction of a period below which a time is that of a set-point."""

_SHARE_ROUNDING = 1e-9
"""Relative tolerance of a limit for floating-point rounding."""


class TrajectoryProtocol(Protocol):
    """Motion whose set-points can be computed from their indices."""

    def __len__(self) -> int:
        """Number of set-points."""

    def rows(self, index: Rows, /) -> SetPoints:
        """Set-points at some indices, as `Trajectory.rows`."""


class Trajectory:
    """Set-points every ``dt`` seconds; the first one at time zero.

    A long motion is a `LongTrajectory`, whose set-points are computed on demand: use `piece` rather
    than all of ``q``, ``v`` or ``a``.

    Args:
        dt: Time between set-points, in seconds.
        q: Positions, of shape (n, dof), rad.
        v: Velocities, of shape (n, dof), rad/s.
        a: Accelerations, of shape (n, dof), rad/s².

    Raises:
        ValueError: The shapes differ, or there is no set-point.
    """

    def __init__(self, dt: float, q: Matrix, v: Matrix, a: Matrix) -> None:
        if not (q.ndim == 2 and len(q) and q.shape == v.shape == a.shape):
            raise ValueError(
                f"q, v, a must be of one shape (n, dof), n > 0; they are of "
                f"{q.shape}, {v.shape}, {a.shape}"
            )
        self.dt = dt
        self._held = (q, v, a)

    @classmethod
    def rest(cls, q: Vector, dt: float) -> Trajectory:
        """Trajectory that stays at ``q``, of shape (dof,), rad: one set-point."""
        return Trajectory(dt, q[None].copy(), np.zeros((1, len(q))), np.zeros((1, len(q))))

    def __len__(self) -> int:
        return len(self._held[0])

    @property
    def q(self) -> Matrix:
        """Positions, of shape (n, dof), rad."""
        return self.piece(0, len(self))._held[0]

    @property
    def v(self) -> Matrix:
        """Velocities, of shape (n, dof), rad/s."""
        return self.piece(0, len(self))._held[1]

    @property
    def a(self) -> Matrix:
        """Accelerations, of shape (n, dof), rad/s²."""
        return self.piece(0, len(self))._held[2]

    def rows(self, index: Rows) -> SetPoints:
        """Positions, velocities and accelerations at some indices, each of shape (n, dof)."""
        q, v, a = self._held
        return q[index], v[index], a[index]

    def piece(self, first: int, end: int) -> Trajectory:
        """Set-points from ``first`` up to, not including, ``end``; at least one."""
        q, v, a = self._held
        return Trajectory(self.dt, q[first:end], v[first:end], a[first:end])

    def set_point(self, i: int) -> SetPoints:
        """Position, velocity and acceleration of a set-point, each of shape (dof,)."""
        q, v, a = self._held
        return q[i], v[i], a[i]

    @property
    def start(self) -> Vector:
        """Position at the first set-point, of shape (dof,), rad."""
        return self.set_point(0)[0]

    @property
    def end(self) -> Vector:
        """Position at the last set-point, of shape (dof,), rad."""
        return self.set_point(len(self) - 1)[0]

    @property
    def duration(self) -> float:
        """Time from the first set-point to the last, s."""
        return (len(self) - 1) * self.dt

    @property
    def to_come(self) -> Matrix:
        """Positions after the first one, of shape (n, dof), rad; the only one if there is one."""
        return self.q[1:] if len(self) > 1 else self.q

    def at(self, time: float) -> SetPoints:
        """Position, velocity and acceleration at a time in s; outside, those of the ends.

        Between set-points, the position is on the cubic that matches positions and velocities.
        """
        row = min(max(time / self.dt, 0.0), len(self) - 1.0)
        i = min(int(row), max(len(self) - 2, 0))
        u = row - i
        # On a set-point, its own values: interpolation would leave a rounding error.
        if _ROUNDING <= u <= 1.0 - _ROUNDING:
            return self._between(self.set_point(i), self.set_point(i + 1), u)
        q, v, a = self.set_point(i if u < _ROUNDING else i + 1)
        return q.copy(), v.copy(), a.copy()

    def around(self, times: Vector) -> tuple[int, SetPoints]:  # noqa: ARG002 - all are at hand
        """Contiguous set-points that enclose some times.

        Args:
            times: Times of shape (n,), s; clipped to the duration.

        Returns:
            Index of the first set-point; positions, velocities, accelerations, each (m, dof).
        """
        q, v, a = map(np.ascontiguousarray, self._held)
        return 0, (q, v, a)

    def _between(self, before: SetPoints, after: SetPoints, u: float) -> SetPoints:
        """Interpolation between two set-points at the share ``u``.

        Positions by the cubic that matches positions and velocities (Hermite), velocities and
        accelerations linearly.
        """
        q0, v0, a0 = before
        q1, v1, a1 = after
        step = q1 - q0
        bend = (1.0 - u) * (v0 * self.dt - step) - u * (v1 * self.dt - step)
        q = q0 + u * step + u * (1.0 - u) * bend
        return q, v0 + u * (v1 - v0), a0 + u * (a1 - a0)

    def then(self, other: Trajectory) -> Trajectory:
        """This motion followed by another one that starts at its last set-point.

        Raises:
            ValueError: The other motion has another ``dt`` or starts elsewhere.
        """
        if other.dt != self.dt:
            raise ValueError(f"grids differ: {self.dt} s and {other.dt} s")
        return joined(self.dt, (*_parts_of(self), *_parts_of(other)))


class LongTrajectory(Trajectory):
    """Trajectory whose set-points are computed on demand, a block at a time.

    Memory use therefore does not depend on the duration.

    Args:
        dt: Time between set-points, s.
        parts: Consecutive motions; the last set-point of one is the first of the next.
    """

    def __init__(self, dt: float, parts: Sequence[TrajectoryProtocol]) -> None:
        self.dt = dt
        self.parts = tuple(parts)
        self._starts = np.cumsum([0, *(len(part) - 1 for part in parts)])
        self._block: tuple[int, Trajectory] | None = None

    def __len__(self) -> int:
        return int(self._starts[-1]) + 1

    def rows(self, index: Rows) -> SetPoints:
        """Positions, velocities and accelerations at some indices, each of shape (n, dof)."""
        # Nearby set-points come from one block, which the next call may need again.
        first = int(index.min())
        last = int(index.max())
        if last - first >= _BLOCK:
            return self._rows(index)
        begin, block = self._block_of(first, last + 1)
        return block.rows(index - begin)

    def piece(self, first: int, end: int) -> Trajectory:
        """Set-points from ``first`` up to, not including, ``end``; at least one."""
        if end - first > _BLOCK:
            return self._computed(first, end)
        begin, block = self._block_of(first, end)
        return block.piece(first - begin, end - begin)

    def around(self, times: Vector) -> tuple[int, SetPoints]:
        """Contiguous set-points that enclose some times, of shape (n,), s."""
        ends = np.clip((times.min() / self.dt, times.max() / self.dt), 0.0, len(self) - 1.0)
        first, last = ends.astype(int).tolist()
        first = min(first, len(self) - 2)
        return first, self.piece(first, min(last + 2, len(self))).around(times)[1]

    def set_point(self, i: int) -> SetPoints:
        """Position, velocity and acceleration of a set-point, each of shape (dof,)."""
        begin, block = self._block_of(i, i + 1)
        return block.set_point(i - begin)

    def _block_of(self, first: int, end: int) -> tuple[int, Trajectory]:
        """Index of the first set-point of a block that has ``first`` to ``end - 1``; the block."""
        if self._block is not None:
            begin, block = self._block
            if begin <= first and end <= begin + len(block):
                return self._block
        self._block = (first, self._computed(first, first + _BLOCK))
        return self._block

    def _rows(self, index: Rows) -> SetPoints:
        # A shared set-point belongs to the earlier part, whose last row it is.
        owner = np.searchsorted(self._starts[1:-1], index)
        found = [
            (owner == k, self.parts[k].rows(index[owner == k] - self._starts[k]))
            for k in np.unique(owner).tolist()
        ]
        whole = [np.empty((len(index), found[0][1][0].shape[1])) for _ in range(3)]
        for mine, values in found:
            for kind, value in zip(whole, values, strict=True):
                kind[mine] = value
        q, v, a = whole
        return q, v, a

    def _computed(self, first: int, end: int) -> Trajectory:
        return Trajectory(self.dt, *self._rows(np.arange(first, min(end, len(self)))))


def joined(dt: float, parts: Sequence[TrajectoryProtocol]) -> Trajectory:
    """Trajectory of consecutive motions, each of which begins where the previous one ends.

    Args:
        dt: Time between set-points, s.
        parts: Motions, at least one; the shared set-points appear once.

    Raises:
        ValueError: A motion starts elsewhere.
    """
    for before, after in itertools.pairwise(parts):
        end, *_ = before.rows(np.array([len(before) - 1]))
        start, *_ = after.rows(np.array([0]))
        if not np.allclose(end, start, rtol=0.0, atol=1e-6):
            raise ValueError("the second motion does not start where the first ends")
    if sum(len(part) - 1 for part in parts) >= LONG:
        return LongTrajectory(dt, parts)
    pieces = [part.rows(np.arange(min(i, 1), len(part))) for i, part in enumerate(parts)]
    q, v, a = (np.vstack(kind) for kind in zip(*pieces, strict=True))
    return Trajectory(dt, q, v, a)


def _parts_of(motion: Trajectory) -> Sequence[TrajectoryProtocol]:
    return motion.parts if isinstance(motion, LongTrajectory) else (motion,)


@dataclass(frozen=True)
class LimitUse:
    """Largest shares of the limits that a motion uses; more than 1 is a violation."""

    velocity: float
    acceleration: float
    jerk: float
    position_margin: float
    """Smallest distance to a position limit in rad; negative outside."""

    @property
    def within(self) -> bool:
        """Whether no set-point exceeds a limit."""
        worst = max(self.velocity, self.acceleration, self.jerk)
        return worst <= 1.0 + _SHARE_ROUNDING and self.position_margin >= -_SHARE_ROUNDING


def use_of_limits(trajectory: Trajectory, limits: JointLimits) -> LimitUse:
    """Largest shares of the limits over all set-points of a motion.

    Acceleration counts both as given and as the difference of velocities over ``dt``; jerk is the
    difference of accelerations over ``dt``: what a controller that checks set-points can observe.
    """
    velocity, acceleration, jerk = shares_of_limits(trajectory, limits)
    q = trajectory.q
    return LimitUse(
        velocity=float(velocity.max()),
        acceleration=float(acceleration.max()),
        jerk=float(jerk.max()),
        position_margin=float(min((q - limits.lower).min(), (limits.upper - q).min())),
    )


def shares_of_limits(trajectory: Trajectory, limits: JointLimits) -> SharesOfLimits:
    """Shares of the limits at each set-point; differences belong to the earlier one."""
    return shares_of_motion(trajectory.v, trajectory.a, trajectory.dt, limits)


def shares_of_motion(v: Matrix, a: Matrix, dt: float, limits: JointLimits) -> SharesOfLimits:
    """Shares of the limits from velocities and accelerations, of shape (n, dof), every ``dt`` s."""
    change = np.diff(v, axis=0, append=v[-1:]) / dt
    return _shares((v, a), (change, np.diff(a, axis=0, append=a[-1:]) / dt), limits)


def shares_at(
    motion: TrajectoryProtocol, index: Rows, dt: float, limits: JointLimits
) -> SharesOfLimits:
    """Result of `shares_of_limits` at some set-points only, each compared with the next one."""
    _, v, a = motion.rows(index)
    _, v_next, a_next = motion.rows(np.minimum(index + 1, len(motion) - 1))
    return _shares((v, a), ((v_next - v) / dt, (a_next - a) / dt), limits)


def _shares(
    given: tuple[Matrix, Matrix], changes: tuple[Matrix, Matrix], limits: JointLimits
) -> SharesOfLimits:
    """Shares from velocities and accelerations, and from their rates of change, each (n, dof)."""
    v, a = given
    change, jerk = changes
    acceleration = np.maximum(np.abs(a), np.abs(change))
    return (
        (np.abs(v) / limits.velocity).max(axis=1),
        (acceleration / limits.acceleration).max(axis=1),
        (np.abs(jerk) / limits.jerk).max(axis=1),
    )
