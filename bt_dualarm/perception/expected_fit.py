"""Accuracy that further images will give an estimate, computed before they are taken."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Final, NamedTuple

import numpy as np
import numpy.typing as npt

from bt_dualarm.core.pose import Matrix, Pose, Vector
from bt_dualarm.perception.known_shape import KnownShape
from bt_dualarm.perception.shape_fit import (
    PLACE,
    TURN,
    UNKNOWNS,
    OutlineScene,
    OutlineView,
    ShapeFitter,
    cross_matrix,
    information_weight,
    lost_to_shake,
    outline_error,
    project,
)

Stack = npt.NDArray[np.float64]
"""Matrices of shape (n, rows, columns)."""

_POINTS: Final = 48
"""Points on an outline: enough for each edge of a box."""

_SIZE_STEP: Final = 0.01
"""Step of the logarithm of the size for its derivative."""

_SIZE_DOUBT: Final = 1.0
"""Prior standard deviation of that logarithm: weak, but keeps the normal matrix regular."""


class Accuracy(NamedTuple):
    """Expected standard deviations, each of shape (n,) for n alternatives.

    Attributes:
        position: Along the most uncertain axis, m.
        angle: That of the rotation, up to the symmetry of the shape, rad.
        size: That of the size, as a fraction.
    """

    position: Vector
    angle: Vector
    size: Vector


class ExpectedFit:
    """Fisher information about one object by the images so far, and by images not taken yet.

    Images add information to that of the priors (`ShapeFitter`), whose inverse is the covariance of
    the estimate. It depends on where the cameras are, not on what the images will show. The size is
    an additional unknown, as in `ShapeFitter.size_of`.

    Args:
        fitter: Fitter of the shape.
        scene: Estimate so far.
        views: Images so far, at least one.
        middle: Center of the object in the frame of the fitted shape, of shape (3,), m.
    """

    def __init__(
        self,
        fitter: ShapeFitter,
        scene: OutlineScene,
        views: Sequence[OutlineView],
        middle: Vector,
    ) -> None:
        self._fitter = fitter
        self._larger = fitter.scaled(_SIZE_STEP)
        self._scene = scene
        self._view = views[-1]
        self._lever = np.eye(6)
        self._lever[PLACE, TURN] = -cross_matrix(scene.rotation @ middle)
        spins = fitter.shape.spins
        axis = np.zeros(3) if spins is None else scene.rotation @ spins
        self._visible_turn = np.eye(3) - np.outer(axis, axis)
        prior = np.zeros((UNKNOWNS + 1, UNKNOWNS + 1))
        prior[:UNKNOWNS, :UNKNOWNS] = fitter.prior_information(scene)
        prior[UNKNOWNS, UNKNOWNS] = _SIZE_DOUBT**-2.0
        self.information: Matrix = prior + sum(self._by(view) for view in views)

    @property
    def center(self) -> Pose:
        """Estimated pose of the center of the fitted shape in the world."""
        return Pose.from_axes(self._scene.position, self._scene.rotation.tolist())

    @property
    def shape(self) -> KnownShape:
        """Shape that is fitted."""
        return self._fitter.shape

    def by(self, camera: Pose) -> Matrix:
        """Information by an image from a pose of the camera, a square matrix."""
        return self._by(replace(self._view, camera=camera))

    def _by(self, view: OutlineView) -> Matrix:
        shape = self._fitter.shape
        seen = project(self._scene, shape, view)
        larger = project(self._scene, self._larger.shape, view)
        if seen is None or larger is None:
            return np.zeros((UNKNOWNS + 1, UNKNOWNS + 1))
        edge = _along(seen.pixels[seen.hull])
        error, change = outline_error(seen, edge, self._scene.rim)
        by_size = (outline_error(larger, edge, self._scene.rim)[0] - error) / _SIZE_STEP
        every = np.column_stack((change, by_size))
        weight = information_weight(len(edge))
        found: Matrix = weight * every.T @ every
        if view.shake_rad:
            found -= lost_to_shake(every, weight, view.shake_rad)
        return found

    def accuracy(self, more: Stack) -> Accuracy:
        """Expected accuracy with each of n alternatives in addition.

        Args:
            more: Information by further images, of shape (n, rows, rows).
        """
        whole = self.information + more
        pose = np.linalg.inv(whole[:, :UNKNOWNS, :UNKNOWNS])[:, :6, :6]
        pose = self._lever @ pose @ self._lever.T
        place = np.linalg.eigvalsh(pose[:, PLACE, PLACE])[:, -1]
        turn = np.zeros(len(more))
        if self._fitter.shape.kind != "sphere":
            about = self._visible_turn @ pose[:, TURN, TURN] @ self._visible_turn
            turn = np.linalg.eigvalsh(about)[:, -1].clip(0.0)
        size = np.linalg.inv(whole)[:, UNKNOWNS, UNKNOWNS]
        return Accuracy(np.sqrt(place), np.sqrt(turn), np.sqrt(size))


def _along(corners: Matrix) -> Matrix:
    """Evenly spaced points on a closed polygon, of shape (`_POINTS`, 2)."""
    sides = np.roll(corners, -1, axis=0) - corners
    lengths = np.hypot(*sides.T)
    ends = np.cumsum(lengths)
    at = (np.arange(_POINTS) + 0.5) / _POINTS * ends[-1]
    side = np.searchsorted(ends, at).clip(max=len(corners) - 1)
    share = 1.0 - (ends[side] - at) / lengths[side].clip(1e-12)
    points: Matrix = corners[side] + share[:, None] * sides[side]
    return points
