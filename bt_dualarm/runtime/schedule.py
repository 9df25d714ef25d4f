"""When something is due: whole physics steps, computed from exact fractions, so nothing drifts."""

from __future__ import annotations

from fractions import Fraction

_FINEST = 10**9
"""Largest denominator in which a period in seconds is read: 0.002 is 1/500, not a binary float."""


def exact(seconds: float | Fraction) -> Fraction:
    """The fraction that a person meant who wrote ``seconds`` as a decimal number."""
    return Fraction(seconds).limit_denominator(_FINEST)


class Periodic:
    """Due at the first step at or after each multiple of a period, counted from a first step.

    A period that is no multiple of the step falls on alternating gaps (60 Hz at 2 ms: 8 and 9
    steps) and keeps its mean exactly. A period below one step is due at every step.

    Args:
        period: Seconds between two times it is due.
        timestep: Seconds of one physics step.
        first: Step at which it is due for the first time.

    Attributes:
        next: Step at which, or after which, it is due next.
    """

    def __init__(self, period: Fraction, timestep: Fraction, first: int = 0) -> None:
        if period <= 0 or timestep <= 0:
            raise ValueError(f"period {period} s and step {timestep} s must be positive")
        steps = max(period / timestep, Fraction(1))
        # Whole numbers: this is asked at every step, and fractions are slow.
        self._numerator, self._denominator = steps.numerator, steps.denominator
        self._first = first
        self._count = 0
        self.next = first

    def due(self, step: int) -> bool:
        """Whether it is due at this step; asking with a due step uses it up."""
        if step < self.next:
            return False
        self._count += 1
        self.next = self._first - (-self._count * self._numerator // self._denominator)
        return True
