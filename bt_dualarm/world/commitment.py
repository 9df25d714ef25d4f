"""What an arm has committed itself to: where it will be until it rests, whatever else happens."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bt_dualarm.pose import Matrix


@dataclass(frozen=True, eq=False)
class Commitment:
    """Published by an arm's controller for those of the other arms; never by or for its tree.

    Attributes:
        time: Simulated time in s of the first row.
        period: Seconds from row to row.
        q: Set-points to come, of shape (n, dof), rad; the last one is where it rests.
        reach: How far any point of the arm may be away from there, in metres.
        spread: How far any point of the arm may get from ``spheres``, in metres.
        spheres: Around the arm as it was at ``time``: centres and radii, of shape (m, 4), m.
        generation: Of the world that the spheres belong to.
    """

    time: float
    period: float
    q: Matrix
    reach: float
    spread: float
    spheres: Matrix
    generation: int

    def rows(self, time: float, count: int) -> Matrix:
        """Where the arm will be at ``count`` times from ``time`` on, of shape (count, dof)."""
        index = np.minimum(np.arange(count) + self._first(time), len(self.q) - 1)
        rows: Matrix = self.q[index]
        return rows

    def left(self, time: float) -> int:
        """Rows from ``time`` to the last one, at least one."""
        return max(len(self.q) - self._first(time), 1)

    def _first(self, time: float) -> int:
        return max(round((time - self.time) / self.period), 0)
