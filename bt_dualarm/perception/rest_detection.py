"""Rest detection: a statistical test for a change of a target's mean position."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bt_dualarm.core.pose import Matrix, Vector
from bt_dualarm.perception.localization import Sighting

_STILL_M = 0.0025  # displacement within which the target is at rest
_MOVED_M = 0.007  # displacement beyond which it has moved for the first time
_NEWEST = 48  # number of newest sightings; means of 3, 6, 12, 24 and 48 are compared
_FEWEST = 3
_FIRST = 24  # first sightings that are averaged
_MAX_SLOPES = 64  # slopes for which first sightings are kept

# Columns of a row
_SLOPE = slice(2, 4)
_COLUMNS = 5


@dataclass(frozen=True, eq=False)
class RestSample:
    """One sighting, projected onto the plane of motion.

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
    """Project a sighting onto a plane.

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
    """Measures how long one target has been at rest.

    The target has moved if the mean of its newest sightings, over any of several windows, differs
    from the mean of the first ones since the last motion by more than their scatter explains: the
    likelihood-ratio test for a change of mean (Basseville and Nikiforov, Detection of Abrupt
    Changes, 1993, 2.4).

    It uses sightings, not the filter's estimate, which is extrapolated over the latency: the
    estimated velocity would amplify the camera's shake several times.

    A difference that another depth explains is no motion either. At the depth z the target would be
    at c + z s, seen along the slope s from the camera position c; of all depths that it may have,
    the one with the least motion counts. A camera that centers a resting target in its image
    changes c by about -z s, and a wrong depth explains much of that. Therefore first sightings are
    kept for each slope: a target that moves is sooner or later seen along an old slope from another
    camera position.

    Args:
        depth_doubt: Factor by which the depth may be larger or smaller than estimated.
    """

    def __init__(self, depth_doubt: float) -> None:
        self._doubt = depth_doubt
        self._depth = 0.0  # the first estimate: later ones would look like motion
        self._firsts = np.zeros((0, _COLUMNS))  # means of first sightings since the last motion
        self._rows = np.empty((_FIRST + _NEWEST, _COLUMNS))  # recent sightings, oldest first
        self._count = 0
        self._leaving = 0  # number of them that are not among the newest, nor in a mean yet
        self._stamp = 0.0
        self._moved_at: float | None = None

    @property
    def still_for(self) -> float:
        """Seconds since the last motion; 0 before the first motion, and while undecided."""
        if self._moved_at is None or self._count - self._leaving <= _FEWEST:
            return 0.0
        return self._stamp - self._moved_at

    def interrupt(self) -> None:
        """Reset after the target was out of view, since it may have moved."""
        if self._moved_at is not None:
            self._forget()

    def take(self, look: RestSample) -> None:
        """Process a sighting, later than all previous ones."""
        self._depth = self._depth or look.depth
        self._stamp = look.stamp
        row = np.array((*look.eye, *look.slope, look.sigma**2))
        resumed = self._moved_at is not None and not self._count
        if self._count - self._leaving == _NEWEST:
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
        """Retire the oldest of the newest sightings; average the retired ones once they suffice."""
        from bt_dualarm.perception.tracking_kernels import scatter

        self._leaving += 1
        if self._leaving < _FIRST:
            return
        mean = np.mean(self._rows[:_FIRST], axis=0)
        # The first mean along a slope is kept: later ones would hide slow motion.
        newest = self._rows[_FIRST - 1 : self._count]
        apart = scatter(newest, self._depth) * np.sqrt(2.0 / _FIRST) / self._depth
        known = np.linalg.norm(self._firsts[:, _SLOPE] - mean[_SLOPE], axis=1) < apart
        if len(self._firsts) < _MAX_SLOPES and not known.any():
            self._firsts = np.vstack((self._firsts, mean))
        self._rows[: self._count - _FIRST] = self._rows[_FIRST : self._count].copy()
        self._count -= _FIRST
        self._leaving = 0

    def _has_moved(self) -> bool:
        from bt_dualarm.perception.tracking_kernels import has_moved

        # After the first motion the estimated depth is good enough.
        doubt, far = (self._doubt, _MOVED_M) if self._moved_at is None else (1.0, _STILL_M)
        rows = self._rows[: self._count]
        return has_moved(rows, self._leaving, self._firsts, self._depth, doubt, far)


def warm_up_rest_detection() -> None:
    """Compile the kernels of rest detection."""
    still = RestDetector(1.0)
    for stamp in range(_FIRST + _NEWEST + 1):
        still.take(RestSample(float(stamp), np.zeros(2), np.zeros(2), 1.0, 1.0))
