"""Whether a target moves or rests, told by its sightings and by how far they scatter."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bt_dualarm.pose import Vector

_STILL_M = 0.0025  # what stays within this distance is still
_BEGUN_M = 0.01  # what has not been farther yet has not moved
_SIGMAS = 6.0  # of a mean: exceeded at rest once in 10⁷ frames, and by _STILL_M more hardly ever
_FEWEST, _MOST = 3, 12  # sightings whose mean is compared


@dataclass(frozen=True, eq=False)
class _Seen:
    stamp: float
    place: Vector
    variance: float


class Stillness:
    """Of one target: since when it has been where it is.

    It moved where the mean of its newest sightings, of however many, is farther from the mean of
    the first ones since it moved last than their scatter explains: the test for a change of a mean
    by its likelihood ratio (Basseville and Nikiforov, Detection of Abrupt Changes, 1993, 2.4).

    Sightings, and not the filter's estimate, which is predicted over the latency: a shake comes out
    of that several times as large, by the velocity that is taken from it.

    The first movement has to be larger than those that end a rest: while a camera comes near, what
    it learns of a target's depth moves all that it sees aside by millimetres.
    """

    def __init__(self) -> None:
        self._seen: list[_Seen] = []  # since it moved last: the first ones and the newest
        self._moved_at: float | None = None

    @property
    def still_for(self) -> float:
        """Seconds for which a target that has moved was seen to rest; 0 before, and if unsure."""
        if self._moved_at is None or len(self._seen) <= _FEWEST:
            return 0.0
        return self._seen[-1].stamp - self._moved_at

    def interrupt(self) -> None:
        """The target was out of view: whether it rested meanwhile nobody knows."""
        if self._moved_at is not None:
            self._seen.clear()

    def take(self, stamp: float, place: Vector, sigma: float) -> None:
        """Take in a sighting.

        Args:
            stamp: When it was exposed, in s; later than all before.
            place: Position in m, of shape (n,).
            sigma: Standard deviation along an axis that is expected of it, in m.
        """
        resumed = self._moved_at is not None and not self._seen
        self._seen.append(_Seen(stamp, place, sigma * sigma))
        if resumed or self._has_moved():
            self._moved_at = stamp
            del self._seen[:-1]
        del self._seen[_MOST:-_MOST]

    def _has_moved(self) -> bool:
        places = np.array([seen.place for seen in self._seen])
        newest = np.arange(_FEWEST, min(_MOST, len(places) - 1) + 1)
        first = np.minimum(len(places) - newest, _MOST)
        sums = np.concatenate((np.zeros_like(places[:1]), places.cumsum(axis=0)))
        then = sums[first] / first[:, None]
        now = (sums[-1] - sums[len(places) - newest]) / newest[:, None]
        scatter = self._spread() * np.sqrt(1.0 / newest + 1.0 / first)
        away = np.linalg.norm(now - then, axis=1)
        # One or two sightings far off move the mean, too: all of the last have to be elsewhere.
        least = np.linalg.norm(places[-_FEWEST:, None] - then, axis=2).min(axis=0)
        far = _BEGUN_M if self._moved_at is None else _STILL_M
        return bool(((away > far + _SIGMAS * scatter) & (least > far)).any())

    def _spread(self) -> float:
        """Standard deviation of a sighting along an axis: as expected, or as seen if that is more.

        Seen in third differences, which smooth movement does not enter (with first ones: Rice,
        Annals of Statistics 12, 1984).
        """
        newest = self._seen[-_MOST:]
        expected = float(np.mean([seen.variance for seen in newest]))
        bends = np.diff([seen.place for seen in newest], 3, axis=0)
        measured = float(np.mean(np.square(bends))) / 20.0 if bends.size else 0.0
        return float(np.sqrt(max(expected, measured)))
