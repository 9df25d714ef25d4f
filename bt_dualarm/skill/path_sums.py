"""What remains of a long motion beside the truth: sums of errors and lags, and a thinned path."""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
import scipy

from bt_dualarm.pose import Matrix, Vector

LAG_S: Final = 0.5
"""Largest lag in s that is looked for."""

OVERLAP: Final = 256
"""Samples that are known, of which a stretch has to have so many before those that are new."""

_MOST_KEPT: Final = 8192
"""Samples of the thinned path, at most."""


class Stretch(NamedTuple):
    """Samples of a motion that follow each other.

    Attributes:
        times: Simulated seconds, of shape (n,).
        tool: Places of the tool in the world, of shape (n, 3), in m.
        truth: Places of the target in the world, of shape (n, 3), in m.
    """

    times: Vector
    tool: Matrix
    truth: Matrix

    def part(self, begin: int, end: int | None = None, step: int = 1) -> Stretch:
        """Some of the samples."""
        some = slice(begin, end, step)
        return Stretch(self.times[some], self.tool[some], self.truth[some])

    def then(self, other: Stretch) -> Stretch:
        """These, and others after them."""
        pairs = zip(self, other, strict=True)
        return Stretch(*(np.concatenate(pair) for pair in pairs))


class Moments:
    """Number, mean and variance of points, along each axis, as they come in.

    Args:
        shape: Shape of the mean.
    """

    def __init__(self, *shape: int) -> None:
        self.count = np.zeros(shape[:-1])
        self.mean = np.zeros(shape)
        self._squares = np.zeros(shape)

    @property
    def variance(self) -> Vector:
        """Variance along each axis, of the shape of the mean."""
        variance: Vector = self._squares / np.maximum(self.count, 1.0)[..., None]
        return variance

    def take(self, points: Matrix, at: int | tuple[()] = ()) -> None:
        """Take in points of shape (n, k); sums of parts are put together as Chan et al. (1979)."""
        if not len(points):
            return
        count, mean = self.count[at], points.mean(axis=0)
        total, apart = count + len(points), mean - self.mean[at]
        self._squares[at] += len(points) * points.var(axis=0)
        self._squares[at] += apart**2 * (count * len(points) / total)
        self.mean[at] += apart * (len(points) / total)
        self.count[at] = total


class PathSums:
    """Takes in a motion piece by piece, in as much memory whatever its length.

    Args:
        axes: Unit vectors of the plane in which it is judged, of shape (2, 3).
        period: Seconds between samples.
    """

    def __init__(self, axes: Matrix, period: float) -> None:
        self._axes, self._period = axes, period
        self._most = min(round(LAG_S / period), OVERLAP)
        self.path: Stretch | None = None
        self._stride, self._taken = 1, 0
        self._errors, self._sightings = Moments(2), Moments(2)
        self._lags = Moments(2 * self._most + 1, 2)
        self._offsets = Moments(3)
        self._outermost = np.zeros((0, 2))
        self._low, self._high = np.full(2, np.inf), np.full(2, -np.inf)

    @property
    def offset(self) -> Vector:
        """Mean way from the target to the tool, of shape (3,), in m."""
        return self._offsets.mean

    def take(self, stretch: Stretch, begin: int, end: int) -> None:
        """Take in some samples of a stretch, from `begin` to before `end`; others are known.

        Of those before `begin` `OVERLAP` have to be there, or all that there ever were.
        """
        new = stretch.part(begin, end)
        leader, follower = stretch.truth @ self._axes.T, stretch.tool @ self._axes.T
        error = follower[begin:end] - leader[begin:end]
        self._errors.take(error)
        self._offsets.take(new.tool - new.truth)
        self._outermost = _outermost(np.vstack((self._outermost, error)))
        self._low = np.minimum(self._low, leader[begin:end].min(axis=0, initial=np.inf))
        self._high = np.maximum(self._high, leader[begin:end].max(axis=0, initial=-np.inf))
        for shift in range(-self._most, self._most + 1):
            late, early = max(shift, 0), max(-shift, 0)
            first = max(begin, late + early)
            away = follower[first - early : end - early] - leader[first - late : end - late]
            self._lags.take(away, shift + self._most)
        self._thin(new)

    def see(self, stretch: Stretch, stamps: Vector, points: Matrix) -> None:
        """Take in sightings, of shapes (n,) and (n, 3), at times that a stretch has."""
        if len(stamps):
            # A straight line between samples 20 ms apart would be wrong by more than these are.
            truth = scipy.interpolate.CubicSpline(stretch.times, stretch.truth @ self._axes.T)
            self._sightings.take(points @ self._axes.T - truth(stamps))

    def errors(self) -> tuple[float, float]:
        """Root mean square and largest of the errors, less their mean, in m."""
        rms = float(np.sqrt(self._errors.variance.sum()))
        return rms, float(np.linalg.norm(self._outermost - self._errors.mean, axis=1).max())

    def lag(self, still: float) -> float:
        """Seconds by which the tool is late; 0 where the target moves no farther than `still`."""
        if float((self._high - self._low).max()) < still:
            return 0.0
        return least_at(self._lags.variance.sum(axis=1), self._period)

    def sighting_sd(self) -> float:
        """Standard deviation of a sighting along an axis, in m."""
        return float(np.sqrt(np.mean(self._sightings.variance)))

    def _thin(self, new: Stretch) -> None:
        kept = new.part(-self._taken % self._stride, None, self._stride)
        self._taken += len(new.times)
        self.path = kept if self.path is None else self.path.then(kept)
        while len(self.path.times) > _MOST_KEPT:
            self.path = self.path.part(0, None, 2)
            self._stride *= 2


def least_at(differences: Vector, period: float) -> float:
    """Lag in s at which differences, of all shifts from the most negative on, are least."""
    best, middle = int(np.argmin(differences)), len(differences) // 2
    if not 0 < best < len(differences) - 1:
        return float((best - middle) * period)
    left, least, right = differences[best - 1 : best + 2]
    vertex = 0.5 * (left - right) / (left - 2 * least + right)
    return float((best - middle + vertex) * period)


def _outermost(points: Matrix) -> Matrix:
    """Those points of the plane, of shape (n, 2), of which one is the farthest from anywhere."""
    try:
        outer: Matrix = points[scipy.spatial.ConvexHull(points).vertices]
    except scipy.spatial.QhullError:  # in one line, or fewer than three
        ends = [points[:, 0].argmin(), points[:, 0].argmax()]
        ends += [points[:, 1].argmin(), points[:, 1].argmax()]
        outer = points[np.unique(ends)]
    return outer
