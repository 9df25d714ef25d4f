"""Motions that begin before the one before has ended, so that the arm does not stop in between.

In the overlap the displacements add up (superposition of motions at via points: Siciliano et al.,
Robotics, 2009, section 4.2.2; Lloyd and Hayward, Trajectory generation for sensor-driven and
time-varying tasks, IJRR 1993). Velocities and accelerations add up as well, so that an overlap is as
long as the limits allow. Outside of it, every set-point is that of one of the motions.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from bt_dualarm.core.pose import Matrix
from bt_dualarm.robots.robot import JointLimits
from bt_dualarm.trajectory.trajectory import LONG, Trajectory, use_of_limits

_CANDIDATES = 24
"""Number of overlaps that are tried, the longest first: the next one is 4 % shorter."""

_MOST_REFUSED = 4
"""Number of overlaps within the limits that the caller may refuse until there is none."""


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
        """These motions and one more, with the longest allowed overlap.

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
        refused = 0
        for share in np.linspace(1.0, 0.0, _CANDIDATES, endpoint=False).tolist():
            count = int(share * most)
            if count < 1 or refused == _MOST_REFUSED:
                break
            found = _overlapped(whole, motion, count)
            if not use_of_limits(found, limits).within:
                continue
            if is_allowed(found, len(whole) - 1 - count, len(whole) - 1):
                end = found.duration
                return OverlappedMotion(found, (*self.ends_s, end))
            refused += 1
        return plain


def _overlapped(first: Trajectory, second: Trajectory, count: int) -> Trajectory:
    """The sum of two motions, the second of which begins ``count`` periods before the first ends."""
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
