"""Localisation on a plane whose depth is a guess: a camera that swings notices one too large."""

from __future__ import annotations

from collections import deque

import numpy as np

from bt_dualarm.pose import Matrix, Vector
from bt_dualarm.vision.detect import Detection
from bt_dualarm.vision.localise import Localiser, OnPlane, Sighting
from bt_dualarm.world.cameras.frame import Frame

_MEMORY_S = 1.0  # a swing of an arm is shorter
_SWINGS = 0.4  # share of its way that a camera which swings is away from where it began, at most
_WAY_M = 0.02  # less tells nothing
_SIGMAS, _SLOPE = 3.0, 0.1  # by which the slope has to be below 0, both
_STEP = 0.03  # largest share of the depth taken off with one image: the target must not jump
_NEAREST = 1.0 / 3.0  # of the guess


class OnGuessedPlane(Localiser):
    """The target stays on a plane, of which only the normal is known.

    Believed at the depth z₀ and being at z, a target at p is located at c + (z₀/z) (p - c) by a
    camera at c. If it is nearer than believed, it seems to move against the camera, 1 - z₀/z times
    as far; a servo that predicts where it will be then swings, ever more. No target moves against a
    camera that swings to and fro, so there the slope tells the depth. One that is farther away than
    believed makes a servo slow, but not unstable, and cannot be told from one that moves along.

    Args:
        point: Any point of the plane as it is guessed, of shape (3,), in m.
        normal: Unit vector, of shape (3,).
    """

    def __init__(self, point: Vector, normal: Vector) -> None:
        self._plane = OnPlane(point, normal)
        self._least = 0.0
        self._seen: deque[tuple[float, Vector, Vector]] = deque()

    def locate(self, detection: Detection, frame: Frame) -> Sighting:
        """Where the line of sight meets the plane as it is believed; see ``Localiser``."""
        return self._plane.locate(detection, frame)

    def learn(self, detection: Detection, frame: Frame) -> None:
        """Bring the plane nearer if the target seems to move against a camera that swings."""
        sighting, eye = self.locate(detection, frame), frame.pose.position
        normal = self._plane.normal
        depth = float(normal @ (self._plane.point - eye))
        self._least = self._least or _NEAREST * abs(depth)
        self._seen.append((sighting.stamp, eye, (sighting.point - eye) / abs(depth)))
        while self._seen[0][0] < sighting.stamp - _MEMORY_S:
            self._seen.popleft()
        slope = self._slope(abs(depth))
        if slope < 0.0:
            nearer = max(abs(depth) * max(1.0 / (1.0 - slope), 1.0 - _STEP), self._least)
            self._plane = OnPlane(eye + np.copysign(nearer, depth) * normal, normal)

    def corners(self, point: Vector, frame: Frame) -> Matrix:
        """The point alone."""
        return self._plane.corners(point, frame)

    def _slope(self, depth: float) -> float:
        """How far the target moves for each metre of a camera that swings; 0 unless against it."""
        eyes = np.array([eye for _, eye, _ in self._seen])
        steps = np.diff(eyes, axis=0)
        way = float(np.sum(np.linalg.norm(steps, axis=1)))
        if way < _WAY_M or np.linalg.norm(eyes[-1] - eyes[0]) > _SWINGS * way:
            return 0.0
        moves = np.diff([eye + depth * line for _, eye, line in self._seen], axis=0)
        square = float(np.sum(steps * steps))
        slope = float(np.sum(moves * steps)) / square
        rest = moves - slope * steps
        sigma = np.sqrt(float(np.mean(rest * rest)) / square)
        return slope if slope < -max(_SIGMAS * sigma, _SLOPE) else 0.0
