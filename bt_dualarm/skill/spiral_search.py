"""Looking for a lost target: where the camera goes, within a declared radius."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bt_dualarm.pose import Vector

SEARCH_SPEED = 0.1
"""Highest speed of the search in m/s."""

_LEAST_M = 1e-4  # less than this is no way around


@dataclass(frozen=True, eq=False)
class Spiral:
    """Straight to where the target should be, outwards in a spiral of one turn, then around.

    Args:
        start: Place of the tool in the plane, of shape (2,), m.
        center: Place where the target should be, of shape (2,), m.
        radius: Farthest distance from there that is searched, in m.
    """

    start: Vector
    center: Vector
    radius: float

    def place(self, elapsed: float) -> Vector:
        """Place to be at ``elapsed`` seconds after the search began, of shape (2,), m."""
        way = self.center - self.start
        left = elapsed * SEARCH_SPEED - float(np.hypot(*way))
        if left < 0.0:
            there: Vector = self.center + way * (left / float(np.hypot(*way)))
            return there
        if self.radius < _LEAST_M:
            return self.center
        angle = left / self.radius
        reached = self.radius * min(1.0, angle / (2.0 * np.pi))
        around: Vector = self.center + reached * np.array([np.cos(angle), np.sin(angle)])
        return around
