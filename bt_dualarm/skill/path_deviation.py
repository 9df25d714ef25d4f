"""How far the tool is from where a motion plans it to be, measured while it goes on."""

from __future__ import annotations

import math
from typing import TypeAlias

import numpy as np

from bt_dualarm.arm.arm import Arm
from bt_dualarm.motion.setpoints.trajectory_source import TrajectorySource
from bt_dualarm.skill.skill import Record

_TOGETHER = 256
"""Positions that are recorded at a time, and worked out where they are planned."""

_Place: TypeAlias = list[float]  # x, y, z in m: of so few at a tick arrays take longer


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
        self._planned: list[_Place] = []
        self._executed: list[_Place] = []
        self._first, self._block = 0, list[_Place]()

    @property
    def rms_m(self) -> float:
        """Root mean square of the distance so far, in m."""
        return float(np.sqrt(self._squares / max(self._count, 1)))

    def look(self) -> float:
        """Compare what was measured since the last look; the largest distance of that in m."""
        farthest = 0.0
        for position, parameter in self._source.take_measured():
            executed, planned = position.tolist(), self._planned_at(parameter)
            away = math.dist(executed, planned)
            farthest = max(farthest, away)
            self._squares += away * away
            self._count += 1
            self._planned.append(planned)
            self._executed.append(executed)
        self.worst_m = max(self.worst_m, farthest)
        if self._count - self._recorded >= _TOGETHER:
            self.flush()
        return farthest

    def flush(self) -> None:
        """Record what was compared and is not recorded yet."""
        if self._count == self._recorded:
            return
        times = self._began_s + self._arm.period * np.arange(self._recorded, self._count)
        self._record("planned", times, np.array(self._planned))
        self._record("executed", times, np.array(self._executed))
        self._recorded = self._count
        self._planned.clear()
        self._executed.clear()

    def _planned_at(self, parameter: float) -> _Place:
        """Tool position planned for a path parameter in s: between two set-points, straight."""
        motion = self._source.trajectory
        index, last = parameter / motion.dt, len(motion) - 1
        low = max(min(int(index), last - 1), 0)
        begin, end = self._of_set_point(low), self._of_set_point(min(low + 1, last))
        share = min(max(index - low, 0.0), 1.0)
        return [a + share * (b - a) for a, b in zip(begin, end, strict=True)]

    def _of_set_point(self, number: int) -> _Place:
        """Tool position at a set-point; those of the next ones are worked out with it.

        By the chain that says where the tool was measured to be.
        """
        if not self._first <= number < self._first + len(self._block):
            motion, nominal = self._source.trajectory, self._arm.world.nominal[self._arm.name]
            piece = motion.piece(number, min(number + _TOGETHER, len(motion)))
            self._first = number
            self._block = [nominal.tool_position_at(q).tolist() for q in piece.q]
        return self._block[number - self._first]
