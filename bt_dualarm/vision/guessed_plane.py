"""Localisation on a plane whose depth is a guess: a camera that swings notices one too large."""

from __future__ import annotations

from functools import cache
from types import ModuleType

import numpy as np

from bt_dualarm.pose import Matrix, Vector
from bt_dualarm.vision.detect import Detection
from bt_dualarm.vision.localise import Localiser, OnPlane, Sighting
from bt_dualarm.world.cameras.frame import Frame

_MEMORY_S = 2.0  # three legs of the slowest swing of an arm
_LEGS = 3  # to and fro and to again: a tool that once comes too far makes two
_LEG_M = 0.006  # shorter ones tell nothing
_SLOPE = 0.1  # by which it has to be below 0
_EXPLAINED = 0.6  # share of what the target seems to move that the slope has to explain
_NEAREST = 1.0 / 3.0  # of the guess
_ROOM = 256  # sightings for which there is room at first


class _Past:
    """What was seen of late, one after the other in memory: what looks at all of it copies nothing.

    Attributes:
        eyes: Places of the camera in the world, of shape (n, 3), in m; the oldest first.
        lines: Ways to the target for each metre into the plane, of shape (n, 3).
    """

    def __init__(self) -> None:
        self._begin, self._end = 0, 0
        self._stamps = np.empty(_ROOM)
        self._eyes, self._lines = np.empty((2, _ROOM, 3))
        self.eyes, self.lines = self._eyes[:0], self._lines[:0]

    def append(self, stamp: float, eye: Vector, line: Vector) -> None:
        """Enter what was exposed at a time in s, and forget what is too old by then."""
        if self._end == len(self._stamps):
            self._make_room()
        end = self._end
        self._stamps[end], self._eyes[end], self._lines[end] = stamp, eye, line
        self._end = end + 1
        while self._stamps[self._begin] < stamp - _MEMORY_S:
            self._begin += 1
        kept = slice(self._begin, self._end)
        self.eyes, self.lines = self._eyes[kept], self._lines[kept]

    def _make_room(self) -> None:
        """Move what is kept to the front, of longer arrays where it fills half of these."""
        kept = slice(self._begin, self._end)
        count = self._end - self._begin
        room = max(len(self._stamps), 4 * count)
        stamps, eyes, lines = self._stamps[kept], self._eyes[kept], self._lines[kept]
        self._stamps = np.empty(room)
        self._eyes, self._lines = np.empty((2, room, 3))
        self._stamps[:count], self._eyes[:count], self._lines[:count] = stamps, eyes, lines
        self._begin, self._end = 0, count


class OnGuessedPlane(Localiser):
    """The target stays on a plane, of which only the normal is known.

    Believed at the depth z₀ and being at z, a target at p is located at c + (z₀/z) (p - c) by a
    camera at c. If it is nearer than believed, it seems to move against the camera, z₀/z - 1 times
    as far; a servo that predicts where it will be then swings, ever more. No target moves against a
    camera that swings to and fro, so there the slope tells the depth. One that is farther away than
    believed makes a servo slow, but not unstable, and cannot be told from one that moves along.

    Args:
        eye: Place of the camera, of shape (3,), in m.
        ahead: Point of the plane in the middle of its image, as guessed, of shape (3,), in m.
        normal: Unit vector, of shape (3,).
    """

    def __init__(self, eye: Vector, ahead: Vector, normal: Vector) -> None:
        self._eye, self._way, self._normal = eye, ahead - eye, normal
        self._share = 1.0
        self._past = _Past()
        self._plane = OnPlane(ahead, normal)
        # What was located is learnt from next, most times: once is enough.
        self._located: tuple[Detection, Frame, Sighting] | None = None

    @property
    def ahead(self) -> Vector:
        """The point that was in the middle of the image, at the depth that is believed now."""
        return self._plane.point

    def locate(self, detection: Detection, frame: Frame) -> Sighting:
        """Where the line of sight meets the plane as it is believed; see ``Localiser``."""
        known = self._located
        if known is not None and known[0] is detection and known[1] is frame:
            return known[2]
        sighting = self._plane.locate(detection, frame)
        self._located = detection, frame, sighting
        return sighting

    def relocate(self, sighting: Sighting) -> Sighting:
        """Where its line of sight meets the plane as it is believed now."""
        return self._plane.relocate(sighting)

    def learn(self, detection: Detection, frame: Frame) -> bool:
        """Bring the plane nearer if the target seems to move against a camera that swings."""
        eye = frame.pose.position
        line = self.locate(detection, frame).point - eye
        self._past.append(detection.stamp, eye, line / abs(float(self._normal @ line)))
        slope = self._slope()
        if slope > -_SLOPE:
            return False
        share = max(self._share / (1.0 - slope), _NEAREST)
        if share >= self._share:
            return False
        self._share, self._located = share, None
        self._plane = OnPlane(self._eye + share * self._way, self._normal)
        return True

    def corners(self, point: Vector, frame: Frame) -> Matrix:
        """The point alone."""
        return self._plane.corners(point, frame)

    def _slope(self) -> float:
        """How far the target moves for each metre of a camera that swings; 0 if that is unsure."""
        past = self._past
        if len(past.eyes) < 2 * _LEGS:
            return 0.0
        begin = _kernels().last_swing(past.eyes, _LEG_M, _LEGS)
        if begin < 0:
            return 0.0
        depth = self._share * abs(float(self._normal @ self._way))
        slope, explained = _kernels().slope_against(past.eyes[begin:], past.lines[begin:], depth)
        return slope if explained > _EXPLAINED else 0.0


@cache
def _kernels() -> ModuleType:
    """The kernels of swinging cameras: an import statement costs as much as they do."""
    from bt_dualarm.vision import swing_kernels

    return swing_kernels


def swing_something() -> None:
    """Have all kernels of swinging cameras compiled."""
    places = np.zeros((2 * _LEGS, 3))
    places[:, 0] = np.arange(len(places))
    _kernels().last_swing(places, _LEG_M, _LEGS)
    _kernels().slope_against(places, places, 1.0)
