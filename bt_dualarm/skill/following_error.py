"""How well a target is followed, as the camera itself sees it: how far off the middle it is."""

from __future__ import annotations

import math
from collections import deque

from bt_dualarm.errors import Failure, Number
from bt_dualarm.pose import Vector

_WINDOW_S = 1.0  # of the mean that is judged: the slowest swing of an arm fits in twice
_ARRIVED_S = 0.5  # so long within the bound is arrived, and not passing by
_FEWEST = 3  # sightings that make a mean
_NEARER = 0.9  # of the least error so far: what has become no less than this has come no nearer


class FollowingError:
    """Judges the error that a follower sees, from sighting to sighting.

    On its way to a target the error may be anything, as long as it falls. Once it has stayed within
    the bound for half a second the tool has arrived, and from then on the error's root mean square
    over each second has to stay there: that is what a lag, a swing and a target that runs away
    have in common.

    Args:
        bound: Largest root mean square over a second, in m.
        patience: Longest time in s in which the error comes no nearer to the bound.

    Attributes:
        arrived: Whether the tool has arrived, and follows within the bound.
        largest: Largest error of a sighting since the first arrival, in m.
    """

    def __init__(self, bound: float, patience: float) -> None:
        self.arrived = False
        self.largest = 0.0
        self._bound = bound
        self._patience = patience
        self._seen: deque[tuple[float, float]] = deque()
        self._least = math.inf
        self._nearer_at = 0.0
        self._squares = 0.0
        self._count = 0

    def interrupt(self) -> None:
        """The target is out of view or out of reach: the tool has to arrive anew."""
        self._seen.clear()
        self.arrived = False
        self._least = math.inf

    def take(self, stamp: float, error: Vector) -> None:
        """Take in a sighting.

        Args:
            stamp: When it was exposed, in s; later than all before.
            error: Way from the middle of the image to the target, in the plane, shape (2,), in m.

        Raises:
            Failure: ``NOT_FOLLOWING``.
        """
        square = float(error @ error)
        self._seen.append((stamp, square))
        if len(self._seen) == 1:
            self._nearer_at = stamp
        self._drop(stamp - _WINDOW_S)
        if len(self._seen) < _FEWEST:
            return
        if self.arrived:
            self._count += 1
            self._squares += square
            self.largest = max(self.largest, math.sqrt(square))
            self._keep()
        else:
            self._approach(stamp)

    def metrics(self) -> dict[str, Number]:
        """``seen_rms_m`` and ``seen_max_m`` while it followed; none where it never arrived."""
        if self._count == 0:
            return {}
        rms = math.sqrt(self._squares / self._count)
        return {"seen_rms_m": rms, "seen_max_m": self.largest}

    def _keep(self) -> None:
        rms = self._rms(-math.inf)
        if rms > self._bound:
            raise Failure(
                "NOT_FOLLOWING",
                f"the camera saw the target {1000 * rms:.1f} mm off its middle over the last "
                f"second (root mean square; max_error allows {1000 * self._bound:.1f} mm)",
                seen_rms_m=rms,
                max_error_m=self._bound,
            )

    def _approach(self, stamp: float) -> None:
        rms = self._rms(stamp - _ARRIVED_S)
        if rms <= self._bound and stamp - self._seen[0][0] >= _ARRIVED_S:
            self.arrived = True
            self._drop(stamp - _ARRIVED_S)
        elif rms < _NEARER * self._least:
            self._least, self._nearer_at = rms, stamp
        elif rms <= self._bound:
            self._nearer_at = stamp
        elif stamp - self._nearer_at > self._patience:
            raise Failure(
                "NOT_FOLLOWING",
                f"for {stamp - self._nearer_at:.1f} s the camera has come no nearer to having the "
                f"target in its middle: {1000 * rms:.1f} mm off (root mean square over "
                f"{_ARRIVED_S} s; max_error allows {1000 * self._bound:.1f} mm)",
                seen_rms_m=rms,
                max_error_m=self._bound,
            )

    def _drop(self, before: float) -> None:
        """Forget what was seen before then, but never so much that no mean is left."""
        while len(self._seen) > _FEWEST and self._seen[0][0] < before:
            self._seen.popleft()

    def _rms(self, since: float) -> float:
        """Root mean square in m of the sightings since then."""
        squares = [square for stamp, square in self._seen if stamp >= since]
        if len(squares) < _FEWEST:
            squares = [square for _, square in list(self._seen)[-_FEWEST:]]
        return math.sqrt(math.fsum(squares) / len(squares))
