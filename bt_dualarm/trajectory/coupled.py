"""One motion of several arms that hold one object: a common path parameter for all of them.

The trajectory has the joints of all arms side by side. Each arm follows its columns through a
`CoupledSource` of its own, as it follows any other trajectory, but time scale, stops and progress
are those of the common motion: what slows one arm slows all, so that they never pull the object
apart. The motion begins once every arm follows it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from bt_dualarm.core.pose import Vector
from bt_dualarm.robots.robot import JointLimits
from bt_dualarm.trajectory.set_points import PathParameter, ScaledPiece, SetPoint, TrajectorySource
from bt_dualarm.trajectory.trajectory import Rows, SetPoints, Trajectory, joined

_NEXT: float = 0.75
"""Fraction of a period after which the motion advances: controllers may be half a period apart."""

_FADED: float = 1e-2
"""Fraction of the limits below which what is left of a correction ends at once."""

_ROOM_RAD: float = 0.01
"""Distance from a position limit within which no correction goes on toward it, rad."""

_LEAST_JERK: float = 0.02
"""Fraction of the jerk limits that a correction always has: otherwise it could not end."""

_LONGEST_S: float = 1.0
"""Longest time for which a correction continues at the end of the trajectory, s."""

Correction = Callable[[float], Vector]
"""Returns the velocity, of shape (n,), rad/s, that all joints should have in addition to the
motion, at a simulated time in s."""


def stacked_limits(limits: Mapping[str, JointLimits]) -> JointLimits:
    """Limits of several arms' joints side by side, in the order of the mapping."""
    each = list(limits.values())
    return JointLimits(
        *(
            np.concatenate([getattr(one, name) for one in each])
            for name in ("lower", "upper", "velocity", "acceleration", "jerk", "effort")
        )
    )


class CoupledMotion:
    """A motion that several arms execute as one mechanism.

    Args:
        trajectory: Motion of all joints, side by side, from rest to rest.
        parts: Columns of each arm's joints.
        limits: Limits of all joints, side by side, which changes of the time scale keep.
        correction: Correction of the motion, called once per period while the arms follow it; None
            for none. It begins at zero, and sets in as fast as the motion leaves room within the
            limits: by noise of the sensors, it would break the jerk limits of a slow arm.
        is_needed: Whether the correction must continue at the end of the trajectory, before the
            motion has ended; for `_LONGEST_S` at most.
    """

    def __init__(
        self,
        trajectory: Trajectory,
        parts: Mapping[str, slice],
        limits: JointLimits,
        correction: Correction | None = None,
        is_needed: Callable[[], bool] | None = None,
    ) -> None:
        self.trajectory = trajectory
        self.common = TrajectorySource(trajectory)
        self.limits = limits
        self.is_braking = False
        self._parts = dict(parts)
        self.correction = correction
        self._is_needed = is_needed
        self._ended_at: float | None = None
        self._sources = {arm: CoupledSource(self, arm) for arm in parts}
        self._following: set[str] = set()
        self._scales = dict.fromkeys(parts, 1.0)
        rest = np.zeros_like(trajectory.start)
        self._sent = SetPoint(trajectory.start.copy(), rest, rest)
        self._last = SetPoint(trajectory.end.copy(), rest, rest)
        # Highest and lowest positions from each row of the motion on, of shape (n, dof), rad.
        self._highest = np.maximum.accumulate(trajectory.q[::-1])[::-1]
        self._lowest = np.minimum.accumulate(trajectory.q[::-1])[::-1]
        self._plain = self._sent  # set-point without correction
        self._added = SetPoint(rest, rest, rest)
        self._fading: list[SetPoint] | None = None
        self._is_cancelled = False
        self._sent_at = -np.inf

    @property
    def has_begun(self) -> bool:
        """Whether all arms follow it."""
        return len(self._following) == len(self._parts)

    @property
    def is_at_rest(self) -> bool:
        """Whether it has ended, or has braked to rest on its path, with its correction at rest."""
        has_ended = self.common.done or self.is_braking
        return has_ended and not (self._sent.v.any() or self._sent.a.any())

    @property
    def reached(self) -> float:
        """Fraction of the motion that was sent, in [0, 1]; 0 before it begins."""
        return self.common.progress if self.has_begun else 0.0

    def source(self, arm: str) -> CoupledSource:
        """Set-points of one arm."""
        return self._sources[arm]

    def part(self, arm: str) -> slice:
        """Columns of an arm's joints."""
        return self._parts[arm]

    def next(self, arm: str, time: float) -> SetPoint:
        """Next set-point of an arm; the first call in a period advances the common motion.

        Args:
            arm: Name of the arm.
            time: Simulated time, s.
        """
        if not self.has_begun:
            self._following.add(arm)
            # All begin in the next period: arms that were updated before would miss a set-point.
            self._sent_at = time
        is_due = time - self._sent_at > _NEXT * self.trajectory.dt
        if is_due and self.has_begun and not self._is_cancelled:
            self._sent_at = time
            sent = self._last if self.common.done else self.common.next(time)
            if self.common.done:
                sent = self._last = SetPoint(sent.q, 0.0 * sent.v, 0.0 * sent.a)
                self._ended_at = time if self._ended_at is None else self._ended_at
                is_late = time - self._ended_at >= _LONGEST_S
                if self._is_needed is None or is_late or not self._is_needed():
                    self._fade([sent])
            if self._fading is not None:
                self._added = self._fading.pop(0) if self._fading else self._rested()
            elif self.correction is not None:
                wanted = self._within_positions(self.correction(time))
                self._added = self._toward(wanted, self._added, self._plain, sent)
            self._plain = sent
            more = self._added
            self._sent = SetPoint(sent.q + more.q, sent.v + more.v, sent.a + more.a)
        part = self._parts[arm]
        return SetPoint(self._sent.q[part], self._sent.v[part], self._sent.a[part])

    def scale_for(self, arm: str, scale: float) -> float:
        """Note the time scale that one arm allows; returns the least of all."""
        self._scales[arm] = scale
        return 0.0 if self.is_braking else min(self._scales.values())

    def brake(self) -> None:
        """Bring all arms to rest on the path, as fast as the limits of all joints allow."""
        if self.is_braking:
            return
        self.is_braking = True
        self._is_cancelled = not self.has_begun
        ahead = None if self._is_cancelled else self.common.to_rest_after(0, 0.0, self.limits)
        if ahead is not None:
            self.common.take(ahead)
        rows = None if ahead is None else ahead.motion
        self._fade(
            [self._plain]
            if rows is None
            else [SetPoint(*one) for one in zip(rows.q[1:], rows.v[1:], rows.a[1:], strict=True)]
        )

    def remaining(self, arm: str) -> Trajectory | None:
        """Set-points of an arm from the last one on while all brake; None if none are known."""
        part = self._parts[arm]
        braking = self.common.braking
        if self._is_cancelled or (self.is_at_rest and braking is None):
            return Trajectory.rest(self._sent.q[part], self.trajectory.dt)
        if braking is None:
            return None
        added = [self._added, *(self._fading or ())]
        count = max(len(braking), len(added))
        added += [self._rested()] * (count - len(added))
        index = np.minimum(np.arange(count), len(braking) - 1)
        rows = (
            along[index][:, part] + np.array([getattr(one, name)[part] for one in added])
            for along, name in ((braking.q, "q"), (braking.v, "v"), (braking.a, "a"))
        )
        return Trajectory(braking.dt, *rows)

    def _fade(self, ahead: Sequence[SetPoint]) -> None:
        """Let the correction come to rest.

        Args:
            ahead: Set-points of the motion without correction from the next one on; the motion
                stays at the last one.
        """
        if self._fading is not None:
            return
        self._fading = []
        dt = self.trajectory.dt
        limits = self.limits
        now = self._added
        rest = np.zeros_like(now.v)
        before = self._plain
        while (np.abs(now.v) > _FADED * limits.acceleration * dt).any() or (
            np.abs(now.a) > _FADED * limits.jerk * dt
        ).any():
            after = ahead[min(len(self._fading), len(ahead) - 1)]
            now = self._toward(rest, now, before, after)
            before = after
            self._fading.append(now)

    def _within_positions(self, wanted: Vector) -> Vector:
        """Wanted velocities of a correction, zero for an arm that it would lead to a joint limit.

        The positions that are still to come count: the motion goes there with the correction.
        """
        row = min(int(self.common.parameter.s / self.trajectory.dt), len(self._highest) - 1)
        above = self.limits.upper - self._highest[row] - self._added.q
        below = self._lowest[row] + self._added.q - self.limits.lower
        blocked = (np.where(wanted > 0.0, above, below) < _ROOM_RAD) & (wanted != 0.0)
        if blocked.any():
            wanted = wanted.copy()
            for part in self._parts.values():
                if blocked[part].any():
                    wanted[part] = 0.0
        return wanted

    def _toward(self, wanted: Vector, now: SetPoint, before: SetPoint, after: SetPoint) -> SetPoint:
        """The correction one period later, as near to a velocity as the limits allow.

        All joints of an arm change in proportion, so that its tool moves as wanted. The change of
        velocity is one that can end at the wanted velocity, within the jerk that is left.

        Args:
            wanted: Wanted velocity, of shape (n,), rad/s.
            now: The correction now.
            before: Set-point of the motion without correction now.
            after: The same one period later.
        """
        dt = self.trajectory.dt
        limits = self.limits
        jerk = np.maximum(limits.jerk - np.abs(after.a - before.a) / dt, _LEAST_JERK * limits.jerk)
        # Between two set-points a motion that is slowed down may accelerate more than at either.
        used = np.abs((before.a, after.a, (after.v - before.v) / dt)).max(axis=0)
        most = np.maximum(limits.acceleration - used, 1e-9)
        missing = wanted - now.v
        a = np.empty_like(now.a)
        for part in self._parts.values():
            ratio = float((np.abs(missing[part]) / jerk[part]).max())
            rate = min(1.0 / dt, 1.0 / np.sqrt(max(ratio, 1e-12)))
            aimed = rate * missing[part]
            aimed /= max(float((np.abs(aimed) / most[part]).max()), 1.0)
            change = aimed - now.a[part]
            a[part] = now.a[part] + change / max(
                float((np.abs(change) / (dt * jerk[part])).max()), 1.0
            )
        # A joint that has no acceleration left any more does not wait for the others of its arm.
        a = np.clip(np.clip(a, -most, most), now.a - dt * jerk, now.a + dt * jerk)
        v = now.v + dt * a
        return SetPoint(now.q + 0.5 * dt * (now.v + v), v, a)

    def _rested(self) -> SetPoint:
        """The correction once it has faded."""
        last = self._fading[-1] if self._fading else self._added
        return SetPoint(last.q, 0.0 * last.v, 0.0 * last.a)

    def columns(self, piece: ScaledPiece, arm: str) -> ScaledPiece:
        """Part of a piece of the common motion that belongs to an arm."""
        part = self._parts[arm]
        rows = piece.motion
        own = Trajectory(rows.dt, rows.q[:, part], rows.v[:, part], rows.a[:, part])
        return _ArmPiece(piece.parameters, own, piece.goal, piece)


@dataclass(frozen=True, eq=False)
class _ArmPiece(ScaledPiece):
    """Piece of one arm, with that of the common motion."""

    common: ScaledPiece


@dataclass(frozen=True, eq=False)
class _Columns:
    """Some joints of a motion, see `TrajectoryProtocol`."""

    motion: Trajectory
    part: slice

    def __len__(self) -> int:
        return len(self.motion)

    def rows(self, index: Rows) -> SetPoints:
        """Positions, velocities and accelerations of some set-points, each of shape (n, dof)."""
        q, v, a = self.motion.rows(index)
        return q[:, self.part], v[:, self.part], a[:, self.part]


def columns_of(motion: Trajectory, part: slice) -> Trajectory:
    """Motion of some joints of a motion of many."""
    return joined(motion.dt, (_Columns(motion, part),))


class CoupledSource(TrajectorySource):
    """Set-points of one arm of a coupled motion.

    Arguments named ``limits`` are ignored: the limits of all arms count.

    Args:
        motion: The coupled motion.
        arm: Name of the arm.
    """

    def __init__(self, motion: CoupledMotion, arm: str) -> None:
        super().__init__(columns_of(motion.trajectory, motion.part(arm)))
        self._coupled = motion
        self._arm = arm
        self._is_done = False

    @property
    def coupled(self) -> CoupledMotion:
        """The motion of all arms."""
        return self._coupled

    @property
    def done(self) -> bool:
        """Whether this arm has been sent the last set-point, at the end or after braking."""
        return self._is_done

    @property
    def progress(self) -> float:
        """Fraction of the motion that was sent, in [0, 1]."""
        return self._coupled.common.progress

    @property
    def parameter(self) -> PathParameter:
        """Path parameter of the last set-point."""
        return self._coupled.common.parameter

    @property
    def braking(self) -> Trajectory | None:
        """Reserved braking trajectory from the last set-point on; None if there is none."""
        reserved = self._coupled.common.braking
        return None if reserved is None else columns_of(reserved, self._coupled.part(self._arm))

    def next(self, time: float) -> SetPoint:
        """Next set-point."""
        sent = self._coupled.next(self._arm, time)
        self._is_done = self._coupled.is_at_rest
        self._note(self.parameter.s)
        return sent

    def change_scale(self, scale: float, limits: JointLimits) -> bool:  # noqa: ARG002
        """Change the time scale of all arms to the least that each allows."""
        least = self._coupled.scale_for(self._arm, scale)
        self.goal_scale = scale
        common = self._coupled.common
        return common.goal_scale == least or common.change_scale(least, self._coupled.limits)

    def to_rest_after(self, count: int, scale: float, limits: JointLimits) -> ScaledPiece | None:  # noqa: ARG002
        """The next set-points of this arm, then rest on the path with all others."""
        coupled = self._coupled
        least = coupled.scale_for(self._arm, scale)
        ahead = coupled.common.to_rest_after(count, least, coupled.limits)
        return None if ahead is None else coupled.columns(ahead, self._arm)

    def to_brake_after(self, count: int, limits: JointLimits) -> ScaledPiece | None:  # noqa: ARG002
        """None: no arm leaves the path without the others."""
        return None

    def take(self, ahead: ScaledPiece, *, leaves_path: bool = False) -> None:  # noqa: ARG002
        """Follow a reserved piece with all arms; while they brake they keep to one plan.

        An arm that was halted follows a copy of that plan: with a new one for the others, the arms
        came to rest 1 mm apart, and pulled at the object with 75 N.
        """
        if isinstance(ahead, _ArmPiece) and not self._coupled.is_braking:
            self._coupled.common.take(ahead.common)
            self.goal_scale = ahead.goal

    def halt(self, limits: JointLimits) -> Trajectory | None:  # noqa: ARG002
        """Bring all arms to rest on the path; returns this arm's part."""
        coupled = self._coupled
        coupled.brake()
        return coupled.remaining(self._arm)
