"""Detection of rest and motion of a target by a test for a change of mean."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bt_dualarm.core.pose import Matrix, Vector
from bt_dualarm.perception.localization import Sighting

_STILL_M = 0.0025  # displacement within which the target rests
_BEGUN_M = 0.007  # displacement beyond which it has moved for the first time
_MOST = 48  # newest sightings, of which means of 3, 6, 12, 24 and 48 are compared
_FEWEST = 3
_FIRST = 24  # first sightings of a mean
_REMEMBERED = 64  # slopes for which first sightings are kept

# Columns of a row of numbers
_SLOPE = slice(2, 4)
_COLUMNS = 5


@dataclass(frozen=True, eq=False)
class RestSample:
    """One sighting along the plane.

    Attributes:
        stamp: Time of exposure, s.
        eye: Position of the camera along the plane, of shape (2,), m.
        slope: Displacement of the line of sight along the plane for each meter of depth, (2,).
        depth: Estimated depth of the target in front of the camera, m.
        sigma: Expected standard deviation of the target's position along an axis, m.
    """

    stamp: float
    eye: Vector
    slope: Vector
    depth: float
    sigma: float


def look(sighting: Sighting, axes: Matrix) -> RestSample:
    """Sample of a sighting along a plane.

    Args:
        sighting: Sighting in the world.
        axes: Unit vectors of the plane in the world, of shape (2, 3).
    """
    line = sighting.point - sighting.camera.position
    (a, b, c), (x, y, z) = axes.tolist()
    normal = np.array((b * z - c * y, c * x - a * z, a * y - b * x))
    depth = abs(float(normal @ line))
    sigma = float(np.sqrt((np.square(axes) @ np.square(sighting.sigma)).max()))
    return RestSample(
        sighting.stamp, axes @ sighting.camera.position, axes @ line / depth, depth, sigma
    )


class RestDetector:
    """Time at rest of one target.

    The target has moved if the mean of its newest sightings, over any of several windows, differs
    from the mean of the first ones since the last motion by more than their scatter explains: the
    likelihood-ratio test for a change of mean (Basseville and Nikiforov, Detection of Abrupt
    Changes, 1993, 2.4).

    Sightings, and not the filter's estimate, which is predicted over the latency: a shake comes out
    of that several times as large, by the velocity that is taken from it.

    Neither has it moved where another depth than the believed one explains the change: at the depth
    z it would be at c + z s, seen along the slope s from c, and of all depths that it may have the
    one counts at which it moved least. A camera that comes to look at a target in the middle of its
    image changes c by as much as -z s, and explains much by a wrong depth. So the first sightings
    are remembered for each slope: what has moved is, sooner or later, seen along an old one from
    elsewhere.

    Args:
        depth_doubt: Factor by which the depth may be larger or smaller than estimated.
    """

    def __init__(self, depth_doubt: float) -> None:
        self._doubt = depth_doubt
        self._depth = 0.0  # the first that is believed: what is learned of it later moves nothing
        self._firsts = np.zeros((0, _COLUMNS))  # since it moved last: means, by slope
        self._rows = np.empty((_FIRST + _MOST, _COLUMNS))  # of late, oldest first
        self._count = 0
        self._leaving = 0  # of them that are no more among the newest, and not yet in a mean
        self._stamp = 0.0
        self._moved_at: float | None = None

    @property
    def still_for(self) -> float:
        """Seconds for which a target that has moved has rested; 0 before, and if undecided."""
        if self._moved_at is None or self._count - self._leaving <= _FEWEST:
            return 0.0
        return self._stamp - self._moved_at

    def interrupt(self) -> None:
        """Reset, as the target was out of view and may have moved."""
        if self._moved_at is not None:
            self._forget()

    def take(self, look: RestSample) -> None:
        """Process a sighting, later than all before."""
        self._depth = self._depth or look.depth
        self._stamp = look.stamp
        row = np.array((*look.eye, *look.slope, look.sigma**2))
        resumed = self._moved_at is not None and not self._count
        if self._count - self._leaving == _MOST:
            self._leave()
        self._append(row)
        if resumed or self._has_moved():
            self._moved_at = look.stamp
            self._forget()
            self._append(row)

    def _append(self, row: Vector) -> None:
        self._rows[self._count] = row
        self._count += 1

    def _forget(self) -> None:
        self._firsts = self._firsts[:0]
        self._count = self._leaving = 0

    def _leave(self) -> None:
        """Take the oldest of the newest sightings out, and enough of them into a mean."""
        from bt_dualarm.perception.tracking_kernels import scatter

        self._leaving += 1
        if self._leaving < _FIRST:
            return
        mean = np.mean(self._rows[:_FIRST], axis=0)
        # The first along a slope stands: by later ones a slow movement would be missed.
        newest = self._rows[_FIRST - 1 : self._count]
        apart = scatter(newest, self._depth) * np.sqrt(2.0 / _FIRST) / self._depth
        known = np.linalg.norm(self._firsts[:, _SLOPE] - mean[_SLOPE], axis=1) < apart
        if len(self._firsts) < _REMEMBERED and not known.any():
            self._firsts = np.vstack((self._firsts, mean))
        self._rows[: self._count - _FIRST] = self._rows[_FIRST : self._count].copy()
        self._count -= _FIRST
        self._leaving = 0

    def _has_moved(self) -> bool:
        from bt_dualarm.perception.tracking_kernels import has_moved

        begun = self._moved_at is not None
        # For what once moved the believed depth will do: to be wrong then ends no rest too early.
        doubt, far = (1.0, _STILL_M) if begun else (self._doubt, _BEGUN_M)
        rows = self._rows[: self._count]
        return has_moved(rows, self._leaving, self._firsts, self._depth, doubt, far)


def warm_up_rest_detection() -> None:
    """Have all kernels of stillness compiled."""
    still = RestDetector(1.0)
    for stamp in range(_FIRST + _MOST + 1):
        still.take(RestSample(float(stamp), np.zeros(2), np.zeros(2), 1.0, 1.0))
