"""Whether a target moves or rests, told by its sightings and by how far they scatter."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

import numpy as np

from bt_dualarm.pose import Matrix, Vector
from bt_dualarm.vision.localise import Sighting

_STILL_M = 0.0025  # what stays within this distance is still
_BEGUN_M = 0.007  # what has not been farther yet has not moved
_SIGMAS = 6.0  # of a mean: exceeded at rest once in 10⁷ frames, and by _STILL_M more hardly ever
_COUNTS = (3, 6, 12, 24, 48)  # of newest sightings whose mean is compared
_FEWEST, _MOST = _COUNTS[0], _COUNTS[-1]
_FIRST = 24  # of the first ones that make a mean
_REMEMBERED = 64  # slopes along which the target was seen
_EYE, _SLOPE, _VARIANCE, _COLUMNS = slice(0, 2), slice(2, 4), 4, 5  # of a row of numbers


@dataclass(frozen=True, eq=False)
class Look:
    """One sighting, as the camera had it.

    Attributes:
        stamp: When it was exposed, in s.
        eye: Place of the camera along the plane, of shape (2,), in m.
        slope: Way along the plane of the line of sight for each metre into it, of shape (2,).
        depth: Distance in front of the camera at which the target is believed to be, in m.
        sigma: Standard deviation of the target's place along an axis that is expected, in m.
    """

    stamp: float
    eye: Vector
    slope: Vector
    depth: float
    sigma: float


def look(sighting: Sighting, axes: Matrix) -> Look:
    """A sighting as seen along a plane.

    Args:
        sighting: Where it was seen in the world.
        axes: Unit vectors of the plane in the world, of shape (2, 3).
    """
    line = sighting.point - sighting.camera.position
    depth = abs(float(np.cross(*axes) @ line))
    sigma = float(np.sqrt((np.square(axes) @ np.square(sighting.sigma)).max()))
    return Look(sighting.stamp, axes @ sighting.camera.position, axes @ line / depth, depth, sigma)


class Stillness:
    """Of one target: since when it has been where it is.

    It moved where the mean of its newest sightings, of however many, is farther from the mean of
    the first ones since it moved last than their scatter explains: the test for a change of a mean
    by its likelihood ratio (Basseville and Nikiforov, Detection of Abrupt Changes, 1993, 2.4).

    Sightings, and not the filter's estimate, which is predicted over the latency: a shake comes out
    of that several times as large, by the velocity that is taken from it.

    Neither has it moved where another depth than the believed one explains the change: at the depth
    z it would be at c + z s, seen along the slope s from c, and of all depths that it may have the
    one counts at which it moved least. A camera that comes to look at a target in the middle of its
    image changes c by as much as -z s, and explains much by a wrong depth. So the first sightings
    are remembered for each slope: what has moved is, sooner or later, seen along an old one from
    elsewhere.

    Args:
        depth_doubt: Factor by which the depth may be larger or smaller than is believed.
    """

    def __init__(self, depth_doubt: float) -> None:
        self._doubt = depth_doubt
        self._depth = 0.0  # the first that is believed: what is learnt of it later moves nothing
        self._firsts = np.zeros((0, _COLUMNS))  # since it moved last: means, by slope
        self._leaving: list[Vector] = []  # no more among the newest, not yet a mean
        self._newest: deque[Vector] = deque(maxlen=_MOST)
        self._stamp = 0.0
        self._moved_at: float | None = None

    @property
    def still_for(self) -> float:
        """Seconds for which a target that has moved was seen to rest; 0 before, and if unsure."""
        if self._moved_at is None or len(self._newest) <= _FEWEST:
            return 0.0
        return self._stamp - self._moved_at

    def interrupt(self) -> None:
        """The target was out of view: whether it rested meanwhile nobody knows."""
        if self._moved_at is not None:
            self._forget()

    def take(self, look: Look) -> None:
        """Take in a sighting, later than all before."""
        self._depth = self._depth or look.depth
        self._stamp = look.stamp
        row = np.array((*look.eye, *look.slope, look.sigma**2))
        resumed = self._moved_at is not None and not self._newest
        if len(self._newest) == _MOST:
            self._leave(self._newest[0])
        self._newest.append(row)
        if resumed or self._has_moved():
            self._moved_at = look.stamp
            self._forget()
            self._newest.append(row)

    def _forget(self) -> None:
        self._firsts = self._firsts[:0]
        self._leaving.clear()
        self._newest.clear()

    def _leave(self, row: Vector) -> None:
        self._leaving.append(row)
        if len(self._leaving) < _FIRST:
            return
        mean = np.mean(self._leaving, axis=0)
        self._leaving.clear()
        # The first along a slope stands: by later ones a slow movement would be missed.
        apart = self._scatter(np.array(self._newest)) * np.sqrt(2.0 / _FIRST) / self._depth
        known = np.linalg.norm(self._firsts[:, _SLOPE] - mean[_SLOPE], axis=1) < apart
        if len(self._firsts) < _REMEMBERED and not known.any():
            self._firsts = np.vstack((self._firsts, mean))

    def _has_moved(self) -> bool:
        rows = np.array([*self._leaving, *self._newest])
        newest = rows[len(self._leaving) :]
        counts = np.array([count for count in _COUNTS if count <= len(newest)], dtype=int)
        if len(self._firsts):
            then, of = self._firsts[None], np.full((1, 1), _FIRST)
        else:
            counts = counts[counts < len(rows)]
            of = np.minimum(len(rows) - counts, _FIRST)[:, None]
            then = (np.cumsum(rows, axis=0)[of[:, 0] - 1] / of)[:, None]
        if not len(counts):
            return False
        now = (np.cumsum(newest[::-1], axis=0)[counts - 1] / counts[:, None])[:, None]
        far = _BEGUN_M if self._moved_at is None else _STILL_M
        allowed = _SIGMAS * self._scatter(newest) * np.sqrt(1.0 / counts[:, None] + 1.0 / of)
        # One or two sightings far off move the mean, too: all of the last have to be elsewhere.
        last = newest[-_FEWEST:, None, None]
        least = self._excess(last, then[None], np.zeros(1)).min(axis=0)
        return bool(((self._excess(now, then, allowed) > far) & (least > far)).any())

    def _excess(self, now: Vector, then: Vector, allowed: Vector) -> Vector:
        """How far it moved at least, in m, less what the scatter explains, whatever the depth.

        The least of |e + z s| - z a over z, the depth as a share of the believed one: of a convex
        function, in closed form.
        """
        change = now - then
        eye, slope = change[..., _EYE], self._depth * change[..., _SLOPE]
        length = np.maximum(np.linalg.norm(slope, axis=-1), 1e-9)
        along = np.sum(eye * slope, axis=-1) / length
        across = np.sqrt(np.maximum(np.sum(eye * eye, axis=-1) - along * along, 0.0))
        steep = np.sqrt(np.maximum(length * length - allowed * allowed, 1e-18))
        depth = (allowed * across / steep - along) / length
        depth = np.where(allowed < length, depth, np.inf)
        # For what once moved the believed depth will do: to be wrong then ends no rest too early.
        doubt = self._doubt if self._moved_at is None else 1.0
        depth = np.clip(depth, 1.0 / doubt, doubt)
        excess: Vector = np.hypot(along + depth * length, across) - depth * allowed
        return excess

    def _scatter(self, newest: Matrix) -> float:
        """Standard deviation of a sighting along an axis: as expected, or as seen if that is more.

        Seen in third differences, which smooth movement does not enter (with first ones: Rice,
        Annals of Statistics 12, 1984).
        """
        bends = np.diff(newest[:, _EYE] + self._depth * newest[:, _SLOPE], 3, axis=0)
        measured = float(np.mean(np.square(bends))) / 20.0 if bends.size else 0.0
        return float(np.sqrt(max(float(np.mean(newest[:, _VARIANCE])), measured)))
