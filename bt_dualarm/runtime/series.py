"""What skills measure over time: planned and executed positions, errors. Plots are made of it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from bt_dualarm.pose import Matrix, Vector
from bt_dualarm.skill.samples import Samples

MOST_SAMPLES = 1 << 15
"""Samples of one series that are kept: two minutes at 250 Hz."""


@dataclass(frozen=True, eq=False, repr=False)
class Series:
    """One quantity of one leaf over time; of more than 32,768 samples every second, fourth, ….

    Attributes:
        arm: Name of the arm.
        leaf: Path of the leaf in its tree.
        name: ``planned``, ``executed``, ``target``, … for positions; a scalar's name ends with
            its unit (``error_m``, ``offset_px``). Of a leaf with a scalar that begins with
            ``error`` plots show no other distance.
        time: Simulated seconds, of shape (n,).
        values: Positions in the world in metres, of shape (n, 3); or scalars, of shape (n, 1).
    """

    arm: str
    leaf: str
    name: str
    time: Vector
    values: Matrix

    @property
    def is_position(self) -> bool:
        """Whether it is a point of the world rather than a number."""
        return int(self.values.shape[1]) == 3

    def __repr__(self) -> str:
        return f"<Series {self.arm}:{self.leaf} {self.name}, {len(self.time)} samples>"


class SeriesLog:
    """All series of a run, in the order in which they began."""

    def __init__(self) -> None:
        self._series: dict[tuple[str, str, str], _Samples] = {}

    def add(
        self, arm: str, leaf: str, name: str, time: npt.ArrayLike, values: npt.ArrayLike
    ) -> None:
        """Add one sample or n of them to a series, which begins with its first sample.

        Args:
            arm: Name of the arm.
            leaf: Path of the leaf in its tree.
            name: Name of the series, as in `Series`.
            time: Simulated seconds, a number or of shape (n,).
            values: A number or a point of shape (3,); or of shape (n,) or (n, 3).

        Raises:
            SkillError: The samples do not go together with each other or with those before.
        """
        samples = Samples.of(name, time, values)
        if len(samples.time):
            key = (arm, leaf, name)
            series = self._series.get(key) or _Samples(name)
            series.add(samples)
            self._series[key] = series  # only now: a series has a sample

    def __iter__(self) -> Iterator[Series]:
        for key, samples in self._series.items():
            yield Series(*key, *samples.arrays())

    def of(self, arm: str) -> dict[str, dict[str, Series]]:
        """The series of an arm, by leaf and by name."""
        found: dict[str, dict[str, Series]] = {}
        for series in self:
            if series.arm == arm:
                found.setdefault(series.leaf, {})[series.name] = series
        return found


class _Samples:
    """A series that grows; a long one is thinned.

    Args:
        name: Name of the series.
    """

    def __init__(self, name: str) -> None:
        self._name = name
        self._rows = np.empty((0, 0))
        self._kept, self._seen, self._stride = 0, 0, 1
        self._last = 0.0

    def add(self, samples: Samples) -> None:
        """Take samples up that go with those before.

        Raises:
            SkillError: They do not.
        """
        if self._seen:
            samples.refuse_after(self._name, self._last, self._rows.shape[1] - 1)
        self._last = float(samples.time[-1])
        rows = np.column_stack((samples.time, samples.values))
        first = -self._seen % self._stride
        self._seen += len(rows)
        self._append(rows[first :: self._stride])

    def arrays(self) -> tuple[Vector, Matrix]:
        rows = self._rows[: self._kept]
        return rows[:, 0].copy(), rows[:, 1:].copy()

    def _append(self, rows: Matrix) -> None:
        needed = self._kept + len(rows)
        if needed > len(self._rows):
            grown = np.empty((max(needed, 2 * len(self._rows)), rows.shape[1]))
            if self._kept:
                grown[: self._kept] = self._rows[: self._kept]
            self._rows = grown
        self._rows[self._kept : needed] = rows
        self._kept = needed
        while self._kept > MOST_SAMPLES:
            self._rows = self._rows[: self._kept : 2].copy()
            self._kept = len(self._rows)
            self._stride *= 2
