"""Bounded jerk without leaving a path: the path parameter averaged over time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy

from bt_dualarm.motion.timing.law import Rows, SetPoints
from bt_dualarm.motion.timing.limit_use import (
    SharesOfLimits,
    shares_at,
    shares_of_limits,
    shares_of_motion,
)
from bt_dualarm.motion.timing.profile import Profile
from bt_dualarm.motion.timing.time_optimal import fastest_profile, grid_of
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

_JUDGED = 30_000
"""Set-points of a long motion that are judged once its stretch is known."""

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


@dataclass(frozen=True, eq=False)
class AveragedMotion:
    """A path, a profile along it, and the width of the average over the profile in seconds."""

    path: scipy.interpolate.CubicSpline
    profile: Profile
    width: float
    limits: JointLimits

    @property
    def unstretched(self) -> float:
        """Duration before time is stretched, in seconds."""
        return self.profile.duration + self.width

    def judged(self, dt: float) -> tuple[Vector, Vector]:
        """Places along the path, and by how much time there must be stretched: (n,) each."""
        step = min(max(0.5 * dt, self.unstretched / _NODES), self.width)
        index = np.arange(len(StretchedMotion(self, step, 1.0)))
        s, rate, bend = self.profile.smoothed(
            np.minimum(index * step, self.unstretched), self.width
        )
        v, a = self.derivatives(s, rate[:, None], bend[:, None])
        v[[0, -1]] = a[[0, -1]] = 0.0  # rounding of the average
        return s, _needed(shares_of_motion(v, a, step, self.limits))

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


def shortest_motion(
    path: scipy.interpolate.CubicSpline, limits: JointLimits, dt: float
) -> tuple[AveragedMotion, float]:
    """The shortest motion found, and the stretch of time that it needs.

    Where a place on the path would make all of it slow, as the tip of a narrow curve does, or a
    change from speeding up to slowing down, the acceleration is lowered there and the fastest
    motion sought again.
    """
    fastest = fastest_profile(path, limits)
    best, stretch = _best_width(path, fastest, limits, dt)
    ramp = float((limits.acceleration / limits.jerk).max())
    for width in (max(_RAMP * ramp, _narrowest(fastest, dt)), best.width):
        if best.unstretched * stretch < _SHORT * fastest.duration:
            break
        tried, needed = _redistributed(AveragedMotion(path, fastest, width, limits), dt)
        if tried.unstretched * needed < best.unstretched * stretch:
            return tried, needed
    return best, stretch


def _redistributed(motion: AveragedMotion, dt: float) -> tuple[AveragedMotion, float]:
    """The shortest motion of the same width, and the stretch of time that it needs."""
    path, limits, width = motion.path, motion.limits, motion.width
    share = np.ones_like(grid_of(path))
    best, least, since = motion, float("inf"), 0
    for _ in range(_ROUNDS):
        places, needed = motion.judged(dt)
        stretch = float(needed.max())
        since += 1
        if motion.unstretched * stretch < 0.998 * best.unstretched * least:
            best, least, since = motion, stretch, 0
        if since == _IDLE:
            break
        share = np.clip(share * _shares_needed(motion, places, needed), 1e-2, 1.0)
        motion = AveragedMotion(path, fastest_profile(path, limits, share), width, limits)
    return best, least


def _best_width(
    path: scipy.interpolate.CubicSpline, profile: Profile, limits: JointLimits, dt: float
) -> tuple[AveragedMotion, float]:
    """The width whose motion is the shortest, and the stretch of time that it needs."""
    low, high = min(_narrowest(profile, dt), 0.1 * profile.duration), 2.0 * profile.duration
    tried: list[tuple[float, AveragedMotion, float]] = []
    for count in _WIDTHS:
        for width in np.geomspace(low, high, count).tolist():
            motion = AveragedMotion(path, profile, width, limits)
            stretch = float(motion.judged(dt)[1].max())
            tried.append((motion.unstretched * stretch, motion, stretch))
        _, best, stretch = min(tried, key=lambda one: one[0])
        reach = (high / low) ** (1.0 / (count - 1))
        low, high = best.width / reach, best.width * reach
    return best, stretch


def _narrowest(profile: Profile, dt: float) -> float:
    """Least width of the average in seconds: a step between set-points, more on long motions."""
    duration = profile.duration
    return dt if duration <= LONG * dt else max(dt, _NARROWEST * duration)


def _shares_needed(motion: AveragedMotion, places: Vector, needed: Vector) -> Vector:
    """By what the acceleration at each place of the grid should be multiplied, of shape (n,)."""
    # A set-point is an average over the width: whatever lies within it is to blame.
    reach = max(int(0.5 * motion.width / motion.unstretched * len(needed)), 1)
    blamed = scipy.ndimage.maximum_filter1d(needed, 2 * reach + 1)
    # Stretching time by r takes r² from the acceleration.
    shares: Vector = np.interp(grid_of(motion.path), places, blamed) ** (-2.0 * _GAIN)
    return np.clip(shares, 1e-2, _BACK)
