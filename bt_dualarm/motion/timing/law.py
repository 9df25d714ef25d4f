"""A motion as a law: its set-points as a function of their number."""

from __future__ import annotations

from typing import Protocol, TypeAlias

import numpy as np
import numpy.typing as npt

from bt_dualarm.pose import Matrix

Rows: TypeAlias = npt.NDArray[np.int_]
"""Numbers of set-points, of shape (n,)."""

SetPoints: TypeAlias = tuple[Matrix, Matrix, Matrix]
"""Positions, velocities, accelerations."""


class Law(Protocol):
    """What trajectories are worked out from."""

    def __len__(self) -> int:
        """How many there are."""

    def rows(self, index: Rows, /) -> SetPoints:
        """Some of them, as `Trajectory.rows`."""
