"""Ticks that take long on the wall: told when they are over, the slowest kept for the summary."""

from __future__ import annotations

import logging
from collections.abc import Iterable
from typing import Final

from bt_dualarm.runtime.result import SlowTick
from bt_dualarm.tree.report import LeafReport

_log = logging.getLogger(__name__)

SLOW_S: Final = 2.0
"""Seconds on the wall from which on a tick is slow; usual ones take milliseconds."""

MOST: Final = 20
"""Ticks that are kept."""


class SlowTicks:
    """The slow ticks of one arm's tree.

    Args:
        arm: Name of the arm.
    """

    def __init__(self, arm: str) -> None:
        self._arm = arm
        self._slowest: list[SlowTick] = []

    @property
    def slowest(self) -> tuple[SlowTick, ...]:
        """Those that are kept, in the order of time."""
        return tuple(sorted(self._slowest, key=lambda tick: tick.time_s))

    def note(self, time: float, wall_s: float, leaves: Iterable[LeafReport]) -> None:
        """Look at a tick that is over.

        Args:
            time: Simulated time in seconds.
            wall_s: Seconds on the wall that it took.
            leaves: Reports of the tree, from which those that ran in it are taken.
        """
        if wall_s < SLOW_S:
            return
        ran = tuple(leaf.path for leaf in leaves if leaf.ended_s in (None, time))
        named = ", ".join(ran) or "no leaf"
        _log.warning("%s: the tick at %.3f s took %.1f s (%s)", self._arm, time, wall_s, named)
        self._slowest.append(SlowTick(time, wall_s, ran))
        if len(self._slowest) > MOST:
            self._slowest.remove(min(self._slowest, key=lambda tick: tick.wall_s))
