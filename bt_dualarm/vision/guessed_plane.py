"""Localisation on a plane whose depth is a guess: a camera that swings notices one too large."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

import numpy as np

from bt_dualarm.pose import Matrix, Vector
from bt_dualarm.vision.detect import Detection
from bt_dualarm.vision.localise import Localiser, OnPlane, Sighting
from bt_dualarm.world.cameras.frame import Frame

_MEMORY_S = 2.0  # three legs of the slowest swing of an arm
_LEGS = 3  # to and fro and to again: a tool that once comes too far makes two
_LEG_M = 0.006  # shorter ones tell nothing
_SURELY_NO_LEG_M = (1.0 - 1e-9) * _LEG_M
_SLOPE = 0.1  # by which it has to be below 0
_EXPLAINED = 0.6  # share of what the target seems to move that the slope has to explain
_NEAREST = 1.0 / 3.0  # of the guess


@dataclass(frozen=True, eq=False)
class _Seen:
    """One sighting.

    Attributes:
        stamp: When it was exposed, in s.
        eye: Place of the camera in the world, of shape (3,), in m.
        line: Way to the target for each metre into the plane, of shape (3,).
    """

    stamp: float
    eye: Vector
    line: Vector


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
        self._seen: deque[_Seen] = deque()
        self._plane = OnPlane(ahead, normal)

    @property
    def ahead(self) -> Vector:
        """The point that was in the middle of the image, at the depth that is believed now."""
        return self._plane.point

    def locate(self, detection: Detection, frame: Frame) -> Sighting:
        """Where the line of sight meets the plane as it is believed; see ``Localiser``."""
        return self._plane.locate(detection, frame)

    def relocate(self, sighting: Sighting) -> Sighting:
        """Where its line of sight meets the plane as it is believed now."""
        return self._plane.relocate(sighting)

    def learn(self, detection: Detection, frame: Frame) -> bool:
        """Bring the plane nearer if the target seems to move against a camera that swings."""
        eye = frame.pose.position
        line = self.locate(detection, frame).point - eye
        self._seen.append(_Seen(detection.stamp, eye, line / abs(float(self._normal @ line))))
        while self._seen[0].stamp < detection.stamp - _MEMORY_S:
            self._seen.popleft()
        slope = self._slope()
        if slope > -_SLOPE:
            return False
        share = max(self._share / (1.0 - slope), _NEAREST)
        if share >= self._share:
            return False
        self._share = share
        self._plane = OnPlane(self._eye + share * self._way, self._normal)
        return True

    def corners(self, point: Vector, frame: Frame) -> Matrix:
        """The point alone."""
        return self._plane.corners(point, frame)

    def _slope(self) -> float:
        """How far the target moves for each metre of a camera that swings; 0 if that is unsure."""
        eyes = np.array([seen.eye for seen in self._seen])
        begin = _swing_begin(eyes)
        if begin is None:
            return 0.0
        eyes = eyes[begin:]
        lines = np.array([seen.line for seen in self._seen])[begin:]
        depth = self._share * abs(float(self._normal @ self._way))
        places = eyes + depth * lines
        eyes, places = eyes - eyes.mean(axis=0), places - places.mean(axis=0)
        slope = float(np.sum(places * eyes) / np.sum(eyes * eyes))
        rest = places - slope * eyes
        explained = 1.0 - float(np.sum(rest * rest) / np.sum(places * places))
        return slope if explained > _EXPLAINED else 0.0


def _swing_begin(eyes: Matrix) -> int | None:
    """Where among the places of a camera, of shape (n, 3), its last legs to and fro began."""
    # Along no direction do they reach farther than the diagonal of their box.
    if len(eyes) < 2 * _LEGS or np.linalg.norm(np.ptp(eyes, axis=0)) < _SURELY_NO_LEG_M:
        return None
    off = eyes - eyes.mean(axis=0)
    along = off @ np.linalg.eigh(off.T @ off)[1][:, -1]
    if np.ptp(along) < _LEG_M:
        return None
    turns = _turns(along)
    return turns[-_LEGS - 1] if len(turns) > _LEGS else None


def _turns(along: Vector) -> list[int]:
    """Indices of the ends of all legs, the first and the last place among them if they are some."""
    turns: list[int] = [0]
    farthest, sign = 0, 0.0
    for index, place in enumerate(along.tolist()):
        if sign == 0.0:
            if abs(place - along[0]) >= _LEG_M:
                sign, farthest = float(np.sign(place - along[0])), index
        elif sign * (place - along[farthest]) >= 0.0:
            farthest = index
        elif sign * (along[farthest] - place) >= _LEG_M:
            turns.append(farthest)
            sign, farthest = -sign, index
    return [*turns, farthest] if sign else turns
