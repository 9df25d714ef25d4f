"""Bounded jerk without leaving a path: the path parameter averaged over time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy

from bt_dualarm.motion.timing.kernel_arrays import Parabolas, Spline
from bt_dualarm.motion.timing.law import Rows, SetPoints
from bt_dualarm.motion.timing.limit_use import SharesOfLimits, shares_at, shares_of_limits
from bt_dualarm.motion.timing.profile import Profile
from bt_dualarm.motion.timing.time_optimal import TimeOptimal
from bt_dualarm.motion.timing.trajectory import LONG, Trajectory
from bt_dualarm.pose import Matrix, Vector
from bt_dualarm.world.robots.robot import JointLimits

_WIDTHS = (14, 7)
"""Numbers of widths of the average that are tried: first of all, then around the best."""

_RAMP = 1.1
"""Another width, in times that a joint takes to its full acceleration: too narrow for places where
the acceleration changes sides, but it gives little away where a motion begins and ends."""

_NODES = 4000
"""Most places in time at which a motion is judged; else there are two for each set-point, as the
set-points will fall elsewhere once time is stretched."""

_NARROWEST = 2.0 / _NODES
"""Least width of the average over a long motion, as a share of its duration: places at which it is
judged must not step over what happens within a width."""

_ROUNDS = 10
"""Most times that the acceleration is redistributed along a path."""

_IDLE = 3
"""Rounds without a gain after which nobody looks for more."""

_GAIN = 0.55
"""Exponent of a redistribution: with more it swings, with less it takes more rounds."""

_BACK = 1.15
"""Most that a place gets back of its acceleration in one round."""

_SHORT = 1.01
"""Of the shortest time without jerk limits: no search for less."""

_JUDGED = 30_000
"""Set-points of a long motion that are judged once its stretch is known."""


@dataclass(frozen=True, eq=False)
class AveragedMotion:
    """A path, a profile along it, and the width of the average over the profile in seconds."""

    path: scipy.interpolate.CubicSpline
    profile: Profile
    width: float

    @property
    def unstretched(self) -> float:
        """Duration before time is stretched, in seconds."""
        return self.profile.duration + self.width

    def derivatives(self, s: Vector, rate: Matrix, bend: Matrix) -> tuple[Matrix, Matrix]:
        """Velocities and accelerations of the joints, of shape (n, dof).

        Args:
            s: Places along the path, of shape (n,).
            rate: Derivatives of the place by time, of shape (n, 1).
            bend: Second derivatives, of shape (n, 1).
        """
        q1, q2 = self.path(s, 1), self.path(s, 2)
        return q1 * rate, q1 * bend + q2 * rate**2


@dataclass(frozen=True, eq=False)
class StretchedMotion:
    """The law of an averaged motion on a grid.

    Attributes:
        motion: The motion.
        dt: Time between set-points, in seconds.
        stretch: Factor by which it is slower.
    """

    motion: AveragedMotion
    dt: float
    stretch: float

    def __len__(self) -> int:
        duration = self.motion.unstretched * self.stretch
        return max(int(np.ceil(duration / self.dt - 1e-9)), 1) + 1

    def rows(self, index: Rows) -> SetPoints:
        """Positions, velocities and accelerations of some set-points, each of shape (n, dof)."""
        motion, stretch = self.motion, self.stretch
        times = np.minimum(index * self.dt / stretch, motion.unstretched)
        s, rate, bend = motion.profile.smoothed(times, motion.width)
        rate, bend = rate[:, None] / stretch, bend[:, None] / stretch**2
        ends = (index == 0) | (index == len(self) - 1)
        rate[ends] = bend[ends] = 0.0  # rounding of the average
        return (motion.path(s), *motion.derivatives(s, rate, bend))

    def whole(self) -> Trajectory:
        """All set-points at once."""
        return Trajectory(self.dt, *self.rows(np.arange(len(self))))


def shortest_motion(
    optimal: TimeOptimal, limits: JointLimits, dt: float
) -> tuple[AveragedMotion, float]:
    """The shortest motion found, and the stretch of time that it needs.

    Where a place on the path would make all of it slow, as the tip of a narrow curve does, or a
    change from speeding up to slowing down, the acceleration is lowered there and the fastest
    motion sought again.

    Args:
        optimal: The fastest motions along the path, whose jerk is not bounded.
        limits: Velocity, acceleration and jerk to keep.
        dt: Time between set-points in seconds.
    """
    return _Search(optimal, limits, dt).shortest()


class _Search:
    """The motions along one path that are tried."""

    def __init__(self, optimal: TimeOptimal, limits: JointLimits, dt: float) -> None:
        self._optimal, self._dt = optimal, dt
        self._path = path = optimal.path
        period = float(path.x[-1]) if path.extrapolate == "periodic" else 0.0
        self._spline = Spline(path.x, np.ascontiguousarray(path.c.swapaxes(0, 1)), period)
        self._limits = np.array((limits.velocity, limits.acceleration, limits.jerk))
        self._ramp = float((limits.acceleration / limits.jerk).max())

    def shortest(self) -> tuple[AveragedMotion, float]:
        """As `shortest_motion`."""
        fastest = self._optimal.fastest
        best, stretch = self._best_width(fastest)
        narrowest = self._narrowest(fastest)
        for width in (max(_RAMP * self._ramp, narrowest), best.width):
            if best.unstretched * stretch < _SHORT * fastest.duration:
                break
            tried, needed = self._redistributed(AveragedMotion(self._path, fastest, width))
            if tried.unstretched * needed < best.unstretched * stretch:
                return tried, needed
        return best, stretch

    def _best_width(self, profile: Profile) -> tuple[AveragedMotion, float]:
        """The width whose motion is the shortest, and the stretch of time that it needs."""
        low, high = min(self._narrowest(profile), 0.1 * profile.duration), 2.0 * profile.duration
        best, stretch, least = AveragedMotion(self._path, profile, high), np.inf, np.inf
        for count in _WIDTHS:
            for width in np.geomspace(low, high, count).tolist():
                motion = AveragedMotion(self._path, profile, width)
                needed = float(self._judged(motion, least / motion.unstretched)[1].max())
                if motion.unstretched * needed < least:
                    best, stretch, least = motion, needed, motion.unstretched * needed
            reach = (high / low) ** (1.0 / (count - 1))
            low, high = best.width / reach, best.width * reach
        return best, stretch

    def _narrowest(self, profile: Profile) -> float:
        """Least width of the average in seconds: a step between set-points, else more."""
        dt, duration = self._dt, profile.duration
        return dt if duration <= LONG * dt else max(dt, _NARROWEST * duration)

    def _redistributed(self, motion: AveragedMotion) -> tuple[AveragedMotion, float]:
        """The shortest motion of the same width, and the stretch of time that it needs."""
        share = np.ones_like(self._optimal.grid)
        best, least, since = motion, float("inf"), 0
        for _ in range(_ROUNDS):
            places, needed = self._judged(motion)
            stretch = float(needed.max())
            since += 1
            if motion.unstretched * stretch < 0.998 * best.unstretched * least:
                best, least, since = motion, stretch, 0
            if since == _IDLE:
                break
            share = np.clip(share * self._shares_needed(motion, places, needed), 1e-2, 1.0)
            motion = AveragedMotion(self._path, self._optimal.profile(share), motion.width)
        return best, least

    def _judged(self, motion: AveragedMotion, most: float = np.inf) -> tuple[Vector, Vector]:
        """Places along the path, and by how much time must be stretched there: (n,) each.

        No further than to where that is more than ``most``.
        """
        from bt_dualarm.motion.timing.average_kernels import (
            enter_average,
            enter_joints,
            enter_shares,
        )

        step = min(max(0.5 * self._dt, motion.unstretched / _NODES), motion.width)
        count = len(StretchedMotion(motion, step, 1.0))
        course, shares = np.empty((2, 3, count))
        v, a = np.empty((2, count, self._limits.shape[1]))
        profile = motion.profile
        parabolas = Parabolas(profile.time, profile.place, profile.rate, *profile.pieces)
        enter_average(parabolas, motion.width, step, course)
        enter_joints(self._spline, course, v, a)
        count = enter_shares(v, a, step, self._limits, most, shares)
        velocity, acceleration, jerk = shares[:, :count]
        return course[0, :count], _needed((velocity, acceleration, jerk))

    def _shares_needed(self, motion: AveragedMotion, places: Vector, needed: Vector) -> Vector:
        """By what the acceleration at each place of the grid should be multiplied, (n,)."""
        # A set-point is an average over the width: whatever lies within it is to blame.
        reach = max(int(0.5 * motion.width / motion.unstretched * len(needed)), 1)
        blamed = scipy.ndimage.maximum_filter1d(needed, 2 * reach + 1)
        # Stretching time by r takes r² from the acceleration.
        shares: Vector = np.interp(self._optimal.grid, places, blamed) ** (-2.0 * _GAIN)
        return np.clip(shares, 1e-2, _BACK)


def stretch_of(motion: StretchedMotion, limits: JointLimits) -> float:
    """By how much time must be stretched once more to keep the limits; at most 1 if it keeps them.

    Of a long motion so many set-points are judged, each with the next: it is smooth between them.
    """
    if len(motion) <= LONG:
        return float(stretches(motion.whole(), limits).max())
    index = np.linspace(0, len(motion) - 1, _JUDGED).astype(int)
    return float(_needed(shares_at(motion, index, motion.dt, limits)).max())


def stretches(motion: Trajectory, limits: JointLimits) -> Vector:
    """By how much time must be stretched at each set-point to keep the limits, of shape (n,)."""
    return _needed(shares_of_limits(motion, limits))


def _needed(shares: SharesOfLimits) -> Vector:
    velocity, acceleration, jerk = shares
    needed: Vector = np.maximum(np.maximum(velocity, np.sqrt(acceleration)), np.cbrt(jerk))
    return needed
