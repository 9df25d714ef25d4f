"""Sightings of a target: when and where it was seen of late, and the newest ones whole."""

from __future__ import annotations

from array import array
from collections import deque
from itertools import islice
from typing import Final

import numpy as np

from bt_dualarm.pose import Matrix, Vector
from bt_dualarm.vision.localise import Sighting

NEWEST: Final = 1024
"""Sightings that are kept whole: of several seconds, whatever the camera."""

PLACES: Final = 2**16
"""Sightings of which time and place are kept, at most: of half an hour at 30 Hz."""

_NUMBERS: Final = 4  # stamp, x, y, z


class Sightings:
    """What a tracker has seen, oldest first; 32 bytes of each are kept until they are forgotten."""

    def __init__(self) -> None:
        self._newest: deque[Sighting] = deque(maxlen=NEWEST)
        self._places = array("d")
        self._count = 0

    def __len__(self) -> int:
        """Number of those that were taken up, ever."""
        return self._count

    def append(self, sighting: Sighting) -> None:
        """Take one up; where nobody lets go of any, the older half of the places goes."""
        if len(self._places) == _NUMBERS * PLACES:
            del self._places[: _NUMBERS * PLACES // 2]
        self._count += 1
        self._newest.append(sighting)
        self._places.extend((sighting.stamp, *sighting.point.tolist()))

    def newest(self, count: int = NEWEST) -> list[Sighting]:
        """So many of the latest, or all that are kept whole, oldest first."""
        latest = list(islice(reversed(self._newest), count))
        latest.reverse()
        return latest

    def places(self) -> tuple[Vector, Matrix]:
        """When and where in the world it was seen, of those that are kept: s and m.

        Returns:
            Arrays of shapes (n,) and (n, 3).
        """
        rows = np.array(self._places).reshape(-1, _NUMBERS)
        return rows[:, 0], rows[:, 1:]

    def forget(self, until: float) -> None:
        """Let go of the places up to a time in s."""
        stamps, _ = self.places()
        del self._places[: _NUMBERS * int(np.searchsorted(stamps, until, side="right"))]
