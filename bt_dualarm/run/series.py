"""What skills measure over time: planned and executed positions, errors. Plots are made of it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from bt_dualarm.pose import Matrix, Vector


@dataclass
class Series:
    """One quantity of one leaf over time.

    Attributes:
        arm: Whose leaf.
        leaf: Its path in the tree.
        name: ``planned``, ``executed``, ``target``, … for positions; a scalar's name ends with
            its unit (``error_m``, ``offset_px``). Of a leaf with a scalar that begins with
            ``error`` plots show no other distance.
    """

    arm: str
    leaf: str
    name: str
    _time: list[npt.NDArray[np.float64]] = field(default_factory=list)
    _values: list[npt.NDArray[np.float64]] = field(default_factory=list)

    def extend(self, time: npt.ArrayLike, values: npt.ArrayLike) -> None:
        """Add one sample, or n of them.

        Raises:
            ValueError: The samples do not go together with each other or with those before.
        """
        stamps = np.atleast_1d(np.asarray(time, dtype=float))
        rows = np.asarray(values, dtype=float).reshape(len(stamps), -1)
        columns = self._values[0].shape[1] if self._values else (1, 3)[rows.shape[1] == 3]
        if rows.shape[1] != columns:
            raise ValueError(f"series {self.name!r}: a sample is {columns} numbers, not {rows[0]}")
        self._time.append(stamps)
        self._values.append(rows)

    @property
    def time(self) -> Vector:
        """Simulated seconds, of shape (n,)."""
        return np.concatenate(self._time)

    @property
    def values(self) -> Matrix:
        """Of shape (n, 3) for positions in the world in metres, (n, 1) for scalars."""
        return np.concatenate(self._values)

    @property
    def is_position(self) -> bool:
        """Whether it is a point of the world rather than a number."""
        return int(self._values[0].shape[1]) == 3


class SeriesLog:
    """All series of a run, in the order in which they began."""

    def __init__(self) -> None:
        self._series: dict[tuple[str, str, str], Series] = {}

    def add(
        self, arm: str, leaf: str, name: str, time: npt.ArrayLike, values: npt.ArrayLike
    ) -> None:
        """Add one sample or n of them to a series, which begins with its first sample.

        Args:
            arm: Whose leaf.
            leaf: Its path in the tree.
            name: As in `Series`.
            time: Simulated seconds, a number or of shape (n,).
            values: A number or a point of shape (3,); or of shape (n,) or (n, 3).
        """
        if np.size(time):
            key = (arm, leaf, name)
            self._series.setdefault(key, Series(*key)).extend(time, values)

    def __iter__(self) -> Iterator[Series]:
        return iter(self._series.values())

    def of(self, arm: str) -> dict[str, list[Series]]:
        """The series of an arm, by leaf."""
        found: dict[str, list[Series]] = {}
        for series in self:
            if series.arm == arm:
                found.setdefault(series.leaf, []).append(series)
        return found
