"""Motions that begin before the one before has ended, so that the arm does not stop in between.

In the overlap the displacements add up (superposition of motions at via points: Siciliano et al.,
Robotics, 2009, section 4.2.2; Lloyd and Hayward, Trajectory generation for sensor-driven and
time-varying tasks, IJRR 1993). Velocities and accelerations add up as well; where they exceed the
limits, time is stretched, and the overlap with the shortest result is taken. Outside of the
overlap, the joints are on the path of one of the motions.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from bt_dualarm.core.pose import Matrix
from bt_dualarm.robots.robot import JointLimits
from bt_dualarm.trajectory.set_points import at_scale
from bt_dualarm.trajectory.trajectory import LONG, Trajectory, use_of_limits

_CANDIDATES = 24
"""Number of overlaps that are tried, the longest first: the next one is 4 % shorter."""

_MOST_REFUSED = 4
"""Number of overlaps that the caller may refuse until there is none."""

_MARGIN = 1.0 + 1e-3
"""Additional stretch of time, as set-points fall on other points after stretching."""


@dataclass(frozen=True, eq=False)
class OverlappedMotion:
    """Motions, each of which may begin before the one before has ended.

    Attributes:
        motion: All of them in one.
        ends_s: Time at which each of them has ended, s.
    """

    motion: Trajectory
    ends_s: tuple[float, ...]

    @classmethod
    def of(cls, motion: Trajectory) -> OverlappedMotion:
        """One motion."""
        return cls(motion, (motion.duration,))

    def then(
        self,
        motion: Trajectory,
        limits: JointLimits,
        longest_s: float,
        is_allowed: Callable[[Trajectory, int, int], bool],
    ) -> OverlappedMotion:
        """These motions and one more, with the allowed overlap that gives the shortest result.

        Args:
            motion: Motion that begins where these end.
            limits: Limits of the whole, which each of the motions keeps.
            longest_s: Longest overlap, s.
            is_allowed: Whether a whole may be executed, by its set-points and the first and last
                index of those that are on neither motion.
        """
        whole = self.motion
        last_end = self.ends_s[-1]
        before = self.ends_s[-2] if len(self.ends_s) > 1 else 0.0
        plain = OverlappedMotion(
            whole.then(motion), (*self.ends_s, whole.duration + motion.duration)
        )
        if len(plain.motion) >= LONG:
            return plain
        # Three motions at a time would add up to a path that nobody planned.
        longest = min(longest_s, last_end - before, motion.duration)
        most = int(longest / whole.dt + 1e-9)
        candidates = []
        for share in np.linspace(1.0, 0.0, _CANDIDATES, endpoint=False).tolist():
            count = int(share * most)
            if count < 1:
                break
            found = _overlapped(whole, motion, count)
            use = use_of_limits(found, limits)
            # A stretch by r divides velocity by r, acceleration by r² and jerk by r³.
            stretch = max(1.0, use.velocity, use.acceleration**0.5, use.jerk ** (1.0 / 3.0))
            if use.position_margin >= 0.0 and found.duration * stretch < plain.motion.duration:
                candidates.append((found.duration * stretch, count, stretch, found))
        candidates.sort(key=lambda one: one[:2])
        for _, count, stretch, found in candidates[:_MOST_REFUSED]:
            stretched, by = _stretched(found, stretch, limits)
            ends_s = (*(by * end for end in self.ends_s), stretched.duration)
            first = int(by * (len(whole) - 1 - count))
            last = min(int(np.ceil(by * (len(whole) - 1))), len(stretched) - 1)
            if is_allowed(stretched, first, last):
                return OverlappedMotion(stretched, ends_s)
        return plain


def _stretched(motion: Trajectory, stretch: float, limits: JointLimits) -> tuple[Trajectory, float]:
    """The motion at a constant time scale at which it keeps the limits, and the stretch of time."""
    while True:
        slower = motion if stretch == 1.0 else at_scale(motion, 1.0 / stretch)
        if use_of_limits(slower, limits).within:
            return slower, stretch
        stretch *= _MARGIN


def _overlapped(first: Trajectory, second: Trajectory, count: int) -> Trajectory:
    """The sum of two motions; the second begins ``count`` periods before the first ends."""
    start = len(first) - 1 - count
    length = max(start + len(second), len(first))
    whole: list[Matrix] = []
    for kind, other, offset in (
        (first.q, second.q, second.start),
        (first.v, second.v, 0.0),
        (first.a, second.a, 0.0),
    ):
        rows = np.vstack((kind, np.tile(kind[-1], (length - len(first), 1))))
        rows[start : start + len(second)] += other - offset
        whole.append(rows)
    return Trajectory(first.dt, *whole)
