"""An arm that gives way to what it meets, for motions that are to touch something."""

from __future__ import annotations

from typing import Final

from bt_dualarm.motion.chains.kernel_rows import Law
from bt_dualarm.pose import Vector

BREAKAWAY_S: Final = 0.35
"""Seconds in which joints break loose and their friction settles: an arm gives way to nothing."""

_LEARNT_S: Final = 0.5  # over which a compliant arm makes up for a disturbance
_BANDWIDTH: Final = 30.0  # rad/s: softer, friction takes it off its way; stiffer, it bounces

# Where they stand in `numbers_of`: gravity counts three.
_BANDWIDTH_AT: Final = 2 + Law._fields.index("bandwidth")
_HEEDED_AT: Final = 2 + Law._fields.index("heeded")


class Compliance:
    """Lets an arm lean on what it meets like a spring, with 5 to 10 N/mm at a tool.

    A stiff arm makes up for every disturbance at once, for a contact as well: 0.1 mm into a table
    makes 60 N. A compliant one makes up for what has been off for some time, as its model is, and
    leans with its inertia times the square of a lower bandwidth on all that comes faster.

    Args:
        numbers: Numbers of the law, of shape (18,), see `numbers_of`; they are changed.
        period: Seconds between two readings.
    """

    def __init__(self, numbers: Vector, period: float) -> None:
        self._numbers, self._period, self._stiff = numbers, period, numbers.copy()
        self._active = self._holds = False
        self._since = 0.0

    @property
    def active(self) -> bool:
        """Whether the arm is to give way; one that holds its force goes on with that."""
        return self._active

    @active.setter
    def active(self, active: bool) -> None:
        if active != self._active:
            self._active, self._since = active, 0.0
            self._numbers[:] = self._stiff
            self._holds = False

    def hold_force(self) -> None:
        """Learn no more until it is stiff: what it leans on, it presses no harder with time."""
        if self._active:
            self._holds = True
            self._numbers[_HEEDED_AT] = 0.0

    def advance(self) -> None:
        """Take up a period.

        What is made up for at first is the mean since the joints broke loose: the noise of one
        moment would stay.
        """
        if not self._active or self._holds:
            return
        self._since += self._period
        settled = self._since - BREAKAWAY_S
        if settled > 0.0:
            self._numbers[_BANDWIDTH_AT] = _BANDWIDTH
            self._numbers[_HEEDED_AT] = self._period / min(max(settled, self._period), _LEARNT_S)
