"""A running mean of what images tell, in which a good view counts for more than a doubtful one."""

from __future__ import annotations

import numpy as np

from bt_dualarm.pose import Vector


class RunningMean:
    """A mean over the last good views, each weighed by the inverse square of its doubt.

    What is wrong with a view from one place stays wrong in the next from there: doubts are
    averaged like values, and a hundred poor views are no better than one.

    Args:
        size: Count of numbers that a view tells.

    Attributes:
        value: Mean of the views, of shape (size,).
        doubt: Error that the mean may have, in the unit of the doubts that were taken in.
    """

    def __init__(self, size: int) -> None:
        self.value: Vector = np.zeros(size)
        self.doubt = 0.0
        self._weight = 0.0

    def forget(self) -> None:
        """Let the next view stand alone."""
        self._weight = 0.0

    def take(self, value: Vector, doubt: float, frames: int) -> None:
        """Take in what one more view tells.

        Args:
            value: Numbers of the view, of shape (size,).
            doubt: Error that the view may have, above 0.
            frames: Number of views as good as this one after which the first is forgotten.
        """
        weight = doubt**-2
        self._weight = max(self._weight, min(self._weight + weight, frames * weight))
        share = weight / self._weight
        self.value = self.value + share * (value - self.value)
        self.doubt += share * (doubt - self.doubt)
