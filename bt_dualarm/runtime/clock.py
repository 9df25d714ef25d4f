"""The simulated clock: periodic deadlines in whole physics steps, and pacing to real time."""

from __future__ import annotations

from collections.abc import Callable
from fractions import Fraction
from typing import Protocol

_FINEST = 10**9
"""Largest denominator of a period in seconds: 0.002 is read as 1/500, not as a binary float."""


def exact(seconds: float | Fraction) -> Fraction:
    """The fraction closest to a number of seconds written in decimal notation, in s."""
    return Fraction(seconds).limit_denominator(_FINEST)


class Periodic:
    """Schedule that is due at the first step at or after each multiple of a period.

    Deadlines are computed from exact fractions, so they do not drift: a period that is not a
    multiple of the step gives alternating gaps (60 Hz at 2 ms: 8 and 9 steps) with the exact
    mean. A period below one step is due at every step.

    Args:
        period: Seconds between two deadlines.
        timestep: Seconds of one physics step.
        first: Step of the first deadline.

    Attributes:
        next: Earliest step at which it is due next.
    """

    def __init__(self, period: Fraction, timestep: Fraction, first: int = 0) -> None:
        if period <= 0 or timestep <= 0:
            raise ValueError(f"period {period} s and step {timestep} s must be positive")
        steps = max(period / timestep, Fraction(1))
        # Integers, because `due` is called at every step and fractions are slow.
        self._numerator = steps.numerator
        self._denominator = steps.denominator
        self._first = first
        self._count = 0
        self.next = first

    def due(self, step: int) -> bool:
        """Whether it is due at this step; if so, schedules the next deadline."""
        if step < self.next:
            return False
        self._count += 1
        self.next = self._first - (-self._count * self._numerator // self._denominator)
        return True


_WORTH_SLEEPING_S = 0.001
"""Shortest sleep in s; a shorter one is less precise than the time it waits."""

_GIVE_UP_S = 0.5
"""Lag in s beyond which lost time is not made up, so that arms do not race after a long plan."""


class Pacer(Protocol):
    """Limits the rate of simulated time."""

    def pace(self, time: float) -> None:
        """Return no earlier than simulated ``time``, s, may be reached."""


class Unpaced:
    """Pacer of a run that goes as fast as the machine allows."""

    def pace(self, time: float) -> None:
        """Return at once."""


class RealTime:
    """Pacer of a run whose simulated second takes at least one second of the given clock.

    Args:
        clock: Monotonic clock in seconds.
        sleep: Function that waits for a number of seconds.
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
