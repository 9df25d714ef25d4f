"""How fast simulated time may pass: as fast as it can, or as fast as a clock on the wall."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

_WORTH_SLEEPING_S = 0.001
"""A sleep shorter than this costs more than it gains."""

_GIVE_UP_S = 0.5
"""So far behind, time is not caught up: after a long plan the arms must not race."""


class Pacer(Protocol):
    """Holds the run back where it is too fast."""

    def pace(self, time: float) -> None:
        """Return no earlier than simulated ``time`` in seconds may be reached."""


class Unpaced:
    """As fast as the machine allows."""

    def pace(self, time: float) -> None:
        """Return at once."""


class RealTime:
    """One simulated second takes at least one second of the given clock.

    Args:
        clock: Seconds, never going backwards.
        sleep: Function that waits so many seconds.
    """

    def __init__(self, clock: Callable[[], float], sleep: Callable[[float], None]) -> None:
        self._clock = clock
        self._sleep = sleep
        self._lead: float | None = None

    def pace(self, time: float) -> None:
        """Sleep while simulated time is ahead of the clock."""
        now = time - self._clock()
        if self._lead is None:
            self._lead = now
        ahead = now - self._lead
        if ahead > _WORTH_SLEEPING_S:
            self._sleep(ahead)
        elif ahead < -_GIVE_UP_S:
            self._lead = now
