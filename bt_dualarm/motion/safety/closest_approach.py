"""How near an arm comes to others while all move: distances at some times, bounds in between."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from bt_dualarm.motion.collision.arm_distance import HORIZON, ArmDistance, Gap
from bt_dualarm.motion.collision.bounding_spheres import BoundingSpheres
from bt_dualarm.pose import Matrix, Vector

SAMPLE_S = 0.032
"""Seconds between two measured distances; less where they do not clear what is between.

In that time a point leaves the straight line by about a millimetre at 10 m/s².
"""

_BEYOND = 0.07  # metres beyond what is asked for in which things are measured


@dataclass(frozen=True, eq=False)
class _Sample:
    """The arms at one time to come.

    Attributes:
        gaps: Distances by other arm, infinite beyond the horizon.
        metres: The same, but never more than the horizon.
        q: Configurations by arm, each of shape (dof,), rad.
        centers: Centres of the arms' shapes, each of shape (m, 3), m.
    """

    gaps: Mapping[str, Gap]
    metres: Mapping[str, float]
    q: Mapping[str, Vector]
    centers: Mapping[str, Matrix]


@dataclass(frozen=True, eq=False)
class Approach:
    """How near an arm comes to others.

    Attributes:
        gaps: Smallest distances by other arm; infinite beyond the horizon.
        spread: Farthest that any point of the arm gets from where it began, in metres.
    """

    gaps: Mapping[str, Gap]
    spread: float


class ClosestApproach:
    """Measures one arm's trajectories against those of others; made anew after a recompilation.

    Between two samples an arm is never nearer to another one than half of the sum of both
    distances, less half of what the two move meanwhile.

    Args:
        arm: Name of the arm.
        separation: Distances of the arm.
        hulls: Spheres of all arms, by name.
        period: Seconds from row to row of a trajectory.
    """

    def __init__(
        self, arm: str, separation: ArmDistance, hulls: Mapping[str, BoundingSpheres], period: float
    ) -> None:
        self._arm, self._separation, self._hulls = arm, separation, hulls
        self._stride = max(round(SAMPLE_S / period), 1)

    def measure(self, rows: Mapping[str, Matrix], enough: Mapping[str, float]) -> Approach:
        """Measure until the end, or until one is nearer than what is enough.

        Args:
            rows: Configurations from now on by arm, this one's too, all of shape (n, dof), rad.
            enough: Distances in metres by other arm; only arms that are named are measured.
        """
        horizons = {name: max(HORIZON, least + _BEYOND) for name, least in enough.items()}
        first = before = self._sample(rows, 0, horizons)
        smallest, spread = dict(first.gaps), 0.0
        i, stride, last = 0, self._stride, len(rows[self._arm]) - 1
        while i < last and all(smallest[name].metres >= least for name, least in enough.items()):
            j = min(i + stride, last)
            now = self._sample(rows, j, horizons)
            own = self._moved(self._arm, before, now)
            between = self._bounds_between(before, now, own)
            unclear = any(between[name] < least for name, least in enough.items())
            if unclear and j > i + 1:
                stride = max((j - i) // 2, 1)
                continue
            for name, least in enough.items():
                nearer = min(before.gaps[name], now.gaps[name], key=_metres)
                if between[name] < least:
                    metres = min(between[name], nearer.metres)
                    smallest[name] = Gap(metres, nearer.first, nearer.second)
                else:
                    smallest[name] = min(smallest[name], nearer, key=_metres)
            spread = max(spread, self._moved(self._arm, first, now) + 0.5 * own)
            i, before, stride = j, now, min(2 * stride, self._stride)
        return Approach(smallest, spread)

    def _sample(self, rows: Mapping[str, Matrix], i: int, horizons: Mapping[str, float]) -> _Sample:
        q = {name: trajectory[i] for name, trajectory in rows.items()}
        gaps = self._separation.gaps(q, horizons)
        return _Sample(
            gaps,
            {name: min(gap.metres, horizons[name]) for name, gap in gaps.items()},
            q,
            {name: self._hulls[name].centers(self._separation.data) for name in rows},
        )

    def _bounds_between(self, before: _Sample, now: _Sample, own: float) -> dict[str, float]:
        """The least distances in m that the arm can have had between two samples."""
        return {
            name: 0.5
            * (before.metres[name] + now.metres[name] - own - self._moved(name, before, now))
            for name in before.metres
        }

    def _moved(self, name: str, first: _Sample, second: _Sample) -> float:
        turn = second.q[name] - first.q[name]
        return self._hulls[name].moved(first.centers[name], second.centers[name], turn)


def _metres(gap: Gap) -> float:
    return gap.metres
