"""A motion of an arm in time: set-points of all joints on an even grid."""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np

from bt_dualarm.motion.timing.law import Law, Rows, SetPoints
from bt_dualarm.pose import Matrix, Vector

LONG = 8192
"""Set-points above which they are worked out as they are asked for: half a minute at 250 Hz."""

_BLOCK = 1024
"""Set-points that are worked out at a time."""

_ROUNDING = 1e-9
"""Share of a step below which a time is that of a set-point."""


class Trajectory:
    """Set-points every ``dt`` seconds; the first at time zero.

    One that takes long is a `LongTrajectory`, whose set-points are worked out as they are asked
    for: take a `piece` of it rather than all of ``q``, ``v`` or ``a``.

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
        """The motion that stays at ``q``, of shape (dof,): one set-point."""
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
        """Positions, velocities and accelerations of some set-points, each of shape (n, dof)."""
        q, v, a = self._held
        return q[index], v[index], a[index]

    def piece(self, first: int, end: int) -> Trajectory:
        """Set-points from ``first`` to before ``end``: one at least, and no more than there are."""
        q, v, a = self._held
        return Trajectory(self.dt, q[first:end], v[first:end], a[first:end])

    def set_point(self, i: int) -> SetPoints:
        """Position, velocity and acceleration at a set-point, each of shape (dof,)."""
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
        """Time from the first set-point to the last, in seconds."""
        return (len(self) - 1) * self.dt

    @property
    def to_come(self) -> Matrix:
        """Positions after the first, of shape (n, dof); those at rest where there is no other."""
        return self.q[1:] if len(self) > 1 else self.q

    def at(self, time: float) -> SetPoints:
        """Position, velocity and acceleration at a time; before and after it, those of the ends.

        Between set-points the position is the cubic that meets their positions and velocities.
        """
        place = min(max(time / self.dt, 0.0), len(self) - 1.0)
        i = min(int(place), max(len(self) - 2, 0))
        u = place - i
        if _ROUNDING <= u <= 1.0 - _ROUNDING:
            return self._between(self.set_point(i), self.set_point(i + 1), u)
        q, v, a = self.set_point(i if u < _ROUNDING else i + 1)
        return q.copy(), v.copy(), a.copy()

    def around(self, times: Vector) -> tuple[int, SetPoints]:  # noqa: ARG002 - all are at hand
        """The set-points between which some times lie, in one piece.

        Args:
            times: Times of shape (n,), s; before the beginning and after the end, those of the ends
                are meant.

        Returns:
            Number of the first of them; positions, velocities, accelerations, each (m, dof).
        """
        q, v, a = map(np.ascontiguousarray, self._held)
        return 0, (q, v, a)

    def _between(self, before: SetPoints, after: SetPoints, u: float) -> SetPoints:
        """Between set-points and the next ones, at the share ``u`` of the way.

        Positions by the cubic that meets positions and velocities (Hermite), velocities and
        accelerations by straight lines.
        """
        (q0, v0, a0), (q1, v1, a1) = before, after
        step = q1 - q0
        bend = (1.0 - u) * (v0 * self.dt - step) - u * (v1 * self.dt - step)
        q = q0 + u * step + u * (1.0 - u) * bend
        return q, v0 + u * (v1 - v0), a0 + u * (a1 - a0)

    def then(self, other: Trajectory) -> Trajectory:
        """This motion, then another that starts at its last set-point.

        Raises:
            ValueError: The other motion has another grid or starts elsewhere.
        """
        if other.dt != self.dt:
            raise ValueError(f"grids differ: {self.dt} s and {other.dt} s")
        return joined(self.dt, (*_parts_of(self), *_parts_of(other)))


class LongTrajectory(Trajectory):
    """A trajectory whose set-points are worked out as they are asked for, a block at a time.

    So what a motion takes in memory does not depend on how long it lasts.

    Args:
        dt: Time between set-points, in seconds.
        parts: Laws of its parts; the last set-point of one is the first of the next.
    """

    def __init__(self, dt: float, parts: Sequence[Law]) -> None:
        self.dt = dt
        self.parts = tuple(parts)
        self._starts = np.cumsum([0, *(len(part) - 1 for part in parts)])
        self._block: tuple[int, Trajectory] | None = None

    def __len__(self) -> int:
        return int(self._starts[-1]) + 1

    def rows(self, index: Rows) -> SetPoints:
        """Positions, velocities and accelerations of some set-points, each of shape (n, dof)."""
        first, last = int(index.min()), int(index.max())
        if last - first >= _BLOCK:
            return self._rows(index)
        begin, block = self._block_of(first, last + 1)
        return block.rows(index - begin)

    def piece(self, first: int, end: int) -> Trajectory:
        """Set-points from ``first`` to before ``end``: one at least, and no more than there are."""
        if end - first > _BLOCK:
            return self._worked_out(first, end)
        begin, block = self._block_of(first, end)
        return block.piece(first - begin, end - begin)

    def around(self, times: Vector) -> tuple[int, SetPoints]:
        """The set-points between which some times, of shape (n,), s, lie, in one piece."""
        ends = np.clip((times.min() / self.dt, times.max() / self.dt), 0.0, len(self) - 1.0)
        first, last = ends.astype(int).tolist()
        first = min(first, len(self) - 2)
        return first, self.piece(first, min(last + 2, len(self))).around(times)[1]

    def set_point(self, i: int) -> SetPoints:
        """Position, velocity and acceleration at a set-point, each of shape (dof,)."""
        begin, block = self._block_of(i, i + 1)
        return block.set_point(i - begin)

    def _block_of(self, first: int, end: int) -> tuple[int, Trajectory]:
        """A block that has set-points ``first`` to before ``end``, and its first number."""
        if self._block is not None:
            begin, block = self._block
            if begin <= first and end <= begin + len(block):
                return self._block
        self._block = (first, self._worked_out(first, first + _BLOCK))
        return self._block

    def _rows(self, index: Rows) -> SetPoints:
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

    def _worked_out(self, first: int, end: int) -> Trajectory:
        return Trajectory(self.dt, *self._rows(np.arange(first, min(end, len(self)))))


def joined(dt: float, parts: Sequence[Law]) -> Trajectory:
    """The trajectory through several parts, each of which begins where the one before it ends.

    Args:
        dt: Time between set-points, in seconds.
        parts: One at least; the first set-point of each but the first is left out.

    Raises:
        ValueError: One starts elsewhere.
    """
    for before, after in itertools.pairwise(parts):
        (end, *_), (start, *_) = before.rows(np.array([len(before) - 1])), after.rows(np.array([0]))
        if not np.allclose(end, start, rtol=0.0, atol=1e-6):
            raise ValueError("the second motion does not start where the first ends")
    if sum(len(part) - 1 for part in parts) >= LONG:
        return LongTrajectory(dt, parts)
    pieces = [part.rows(np.arange(min(i, 1), len(part))) for i, part in enumerate(parts)]
    q, v, a = (np.vstack(kind) for kind in zip(*pieces, strict=True))
    return Trajectory(dt, q, v, a)


def _parts_of(motion: Trajectory) -> Sequence[Law]:
    return motion.parts if isinstance(motion, LongTrajectory) else (motion,)
