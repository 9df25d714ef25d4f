"""All sightings of a target: when and where it was seen, and the newest ones whole."""

from __future__ import annotations

from array import array
from collections import deque
from typing import Final

import numpy as np

from bt_dualarm.pose import Matrix, Vector
from bt_dualarm.vision.localise import Sighting

NEWEST: Final = 1024
"""Sightings that are kept whole: of several seconds, whatever the camera."""

_NUMBERS: Final = 4  # stamp, x, y, z


class Sightings:
    """What a tracker has seen, oldest first; 32 bytes of each are kept for good."""

    def __init__(self) -> None:
        self._newest: deque[Sighting] = deque(maxlen=NEWEST)
        self._all = array("d")

    def __len__(self) -> int:
        return len(self._all) // _NUMBERS

    def append(self, sighting: Sighting) -> None:
        """Take one up."""
        self._newest.append(sighting)
        self._all.extend((sighting.stamp, *sighting.point.tolist()))

    def newest(self, count: int = NEWEST) -> list[Sighting]:
        """So many of the latest, or all that are kept whole, oldest first."""
        return list(self._newest)[max(len(self._newest) - count, 0) :]

    def places(self) -> tuple[Vector, Matrix]:
        """When and where in the world it was seen, ever: shapes (n,) and (n, 3), s and m."""
        rows = np.array(self._all).reshape(-1, _NUMBERS)
        return rows[:, 0], rows[:, 1:]
