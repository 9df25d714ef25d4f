"""How far along a path, over time: a profile of parabolas, and its moving average."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from bt_dualarm.pose import Vector


@dataclass(frozen=True, eq=False)
class Profile:
    """Path parameter s over time, of constant acceleration between its knots, at rest at the ends.

    Attributes:
        time: Knots, of shape (n,), s, rising from zero.
        place: S at the knots, of shape (n,).
        rate: Ds/dt at the knots, of shape (n,).
    """

    time: Vector
    place: Vector
    rate: Vector

    @classmethod
    def from_rates(cls, place: Vector, rate: Vector) -> Profile:
        """A profile from ds/dt over s; zero at the ends only."""
        steps = 2.0 * np.diff(place) / (rate[1:] + rate[:-1])
        return cls(np.concatenate(((0.0,), np.cumsum(steps))), place, rate)

    @property
    def duration(self) -> float:
        """Time from start to end in seconds."""
        return float(self.time[-1])

    def smoothed(self, times: Vector, width: float) -> tuple[Vector, Vector, Vector]:
        """s, ds/dt and d²s/dt² of the moving average over ``width`` seconds, at ``times``.

        It is at rest before zero and after ``duration + width``, and its third derivative is
        bounded by the change of acceleration within ``width``, over ``width``. As only s is
        averaged, every point is still on the path (Biagiotti and Melchiorri 2012, the filter view
        of multi-segment trajectories).
        """
        now, before = self._integrals(times), self._integrals(times - width)
        area, place, rate = (
            (late - early) / width for late, early in zip(now, before, strict=True)
        )
        return area, place, rate

    def _integrals(self, times: Vector) -> tuple[Vector, Vector, Vector]:
        """The integral of s, s and ds/dt at times that may lie before and after the profile."""
        inside = np.clip(times, 0.0, self.duration)
        i = np.clip(np.searchsorted(self.time, inside, side="right") - 1, 0, len(self.time) - 2)
        bends, areas = self.pieces
        t, rate_at, place_at, bend = inside - self.time[i], self.rate[i], self.place[i], bends[i]
        rate = rate_at + bend * t
        place = place_at + (rate_at + bend * t / 2.0) * t
        area = areas[i] + (place_at + (rate_at / 2.0 + bend * t / 6.0) * t) * t
        area += (times > self.duration) * (times - inside) * self.place[-1]
        return area, place, rate

    @cached_property
    def pieces(self) -> tuple[Vector, Vector]:
        """Second derivative after each knot, (n - 1,), and the integral of s until it, (n,)."""
        step = np.diff(self.time)
        bend = np.diff(self.rate) / step
        areas = (self.place[:-1] + (self.rate[:-1] / 2.0 + bend * step / 6.0) * step) * step
        return bend, np.concatenate(((0.0,), np.cumsum(areas)))
