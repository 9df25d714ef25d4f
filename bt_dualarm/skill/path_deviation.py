"""How far the tool is from where a motion plans it to be, measured while it goes on."""

from __future__ import annotations

import math

import numpy as np

from bt_dualarm.arm.arm import Arm
from bt_dualarm.motion.setpoints.trajectory_source import TrajectorySource
from bt_dualarm.pose import Matrix, Vector
from bt_dualarm.skill.skill import Record

_TOGETHER = 256
"""Positions that are recorded at a time, and worked out where they are planned."""


class PathDeviation:
    """Compares executed with planned tool positions at equal times.

    What it keeps does not grow with the motion.

    Args:
        arm: Arm that moves.
        source: Motion at its beginning, as it is executed.
        record: Taker of ``planned`` and ``executed`` tool positions.

    Attributes:
        worst_m: Largest distance so far, in m.
    """

    def __init__(self, arm: Arm, source: TrajectorySource, record: Record) -> None:
        self.worst_m = 0.0
        self._arm, self._source, self._record = arm, source, record
        self._began_s = arm.time
        self._count, self._recorded = 0, 0
        self._squares = 0.0
        self._planned: list[Matrix] = []
        self._executed: list[Matrix] = []
        self._block: tuple[int, Matrix] = (0, np.empty((0, 3)))

    @property
    def rms_m(self) -> float:
        """Root mean square of the distance so far, in m."""
        return float(np.sqrt(self._squares / max(self._count, 1)))

    def look(self) -> float:
        """Compare what was measured since the last look; the largest distance of that in m."""
        executed, parameters = self._source.take_measured()
        if not len(parameters):
            return 0.0
        planned = self._planned_at(parameters)
        squares = ((executed - planned) ** 2).sum(axis=1)
        farthest = math.sqrt(squares.max())
        self._count += len(squares)
        self._squares += float(squares.sum())
        self.worst_m = max(self.worst_m, farthest)
        self._planned.append(planned)
        self._executed.append(executed)
        if self._count - self._recorded >= _TOGETHER:
            self.flush()
        return farthest

    def flush(self) -> None:
        """Record what was compared and is not recorded yet."""
        if self._count == self._recorded:
            return
        times = self._began_s + self._arm.period * np.arange(self._recorded, self._count)
        self._record("planned", times, np.vstack(self._planned))
        self._record("executed", times, np.vstack(self._executed))
        self._recorded = self._count
        self._planned.clear()
        self._executed.clear()

    def _planned_at(self, parameters: Vector) -> Matrix:
        """Tool positions, of shape (n, 3), m, planned for path parameters in s."""
        motion = self._source.trajectory
        index = parameters / motion.dt
        # Minimum and maximum: a clip costs three times as much.
        low = np.maximum(np.minimum(index.astype(int), len(motion) - 2), 0)
        high = np.minimum(low + 1, len(motion) - 1)
        first, planned = self._block_of(int(low.min()), int(high.max()) + 1)
        u, begin = np.minimum(np.maximum(index - low, 0.0), 1.0)[:, None], planned[low - first]
        between: Matrix = begin + u * (planned[high - first] - begin)
        return between

    def _block_of(self, first: int, end: int) -> tuple[int, Matrix]:
        """Planned positions of some set-points, or of more, and the number of the first of them."""
        begin, planned = self._block
        if not begin <= first <= end <= begin + len(planned):
            motion = self._source.trajectory
            piece = motion.piece(first, min(max(first + _TOGETHER, end), len(motion)))
            self._block = first, self._arm.planned_tool_positions(piece)
        return self._block
