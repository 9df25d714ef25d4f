"""Where a camera sits on its arm, by a mark that stands still in many pictures of it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import scipy

from bt_dualarm.pose import Matrix, Pose, Vector

_TURN_DOUBT: Final = 0.03
"""Deviation of the mount's rotation about each axis before anything was seen, rad."""

_SHIFT_DOUBT: Final = 0.002
"""Deviation of its place along each axis, likewise, m."""

_FOCAL_DOUBT: Final = 0.01
"""Deviation of the focal length as a share: else it would be taken for a place along the view."""

_PIXEL_DOUBT: Final = 0.3
"""Deviation of a centroid in pixels: of its noise, and of what the lens does off its axis."""


@dataclass(frozen=True, eq=False)
class MarkView:
    """One look at the mark from a camera at rest.

    Attributes:
        camera: Pose of the camera in the world (x right, y down, z forward), as it was believed.
        pixel: Centroid of the mark from the image's middle, of shape (2,), px.
        focal_px: Focal length in pixels.
    """

    camera: Pose
    pixel: Vector
    focal_px: float


@dataclass(frozen=True, eq=False)
class HandEye:
    """What the views tell of the camera's mount.

    Attributes:
        correction: Pose of the camera in the frame where it was believed to be.
        mark: Place of the mark in the world, of shape (3,), m.
        before_px: Root mean square of what is left of the pixels if the mount is as believed.
        residual_px: The same with the correction, and the focal length that goes with it.
    """

    correction: Pose
    mark: Vector
    before_px: float
    residual_px: float


def hand_eye(views: Sequence[MarkView], mark: Vector) -> HandEye:
    """Correct a camera's mount so that a mark which stands still is seen to stand still.

    Least squares of the distance in the image, with a prior for the mount (bundle adjustment of
    one point; Tsai, Lenz, IEEE Trans. Robot. Autom. 1989, for what the views have to vary).

    Args:
        views: Looks at it, from distances and directions that differ.
        mark: Place where it is believed to be, of shape (3,), m.
    """

    def correction(x: Vector) -> Pose:
        turn = x[:3] * _TURN_DOUBT
        angle = float(np.linalg.norm(turn))
        if angle < 1e-12:
            return Pose(x[3:6] * _SHIFT_DOUBT, np.array((1.0, 0.0, 0.0, 0.0)))
        half = np.sin(angle / 2) / angle * turn
        return Pose(x[3:6] * _SHIFT_DOUBT, np.array((np.cos(angle / 2), *half)))

    def missed(mount: Pose, place: Vector, longer: float = 0.0) -> Matrix:
        """Where the mark should be in the images less where it is, of shape (n, 2), px."""
        points = np.array([(view.camera @ mount).inverse.apply(place) for view in views])
        focal = np.array([view.focal_px for view in views])
        seen = (1.0 + _FOCAL_DOUBT * longer) * focal[:, None] * points[:, :2] / points[:, 2:]
        off: Matrix = seen - np.array([view.pixel for view in views])
        return off

    def residuals(x: Vector) -> Vector:
        off = missed(correction(x), mark + x[7:], float(x[6])).ravel()
        return np.concatenate((off / _PIXEL_DOUBT, x[:7]))

    believed = Pose.identity()
    alone = scipy.optimize.least_squares(lambda x: missed(believed, mark + x).ravel(), np.zeros(3))
    found = scipy.optimize.least_squares(residuals, np.concatenate((np.zeros(7), alone.x)))
    mount, place = correction(found.x), mark + found.x[7:]
    before, after = missed(believed, mark + alone.x), missed(mount, place, float(found.x[6]))
    return HandEye(mount, place, _rms(before), _rms(after))


def _rms(off: Matrix) -> float:
    return float(np.sqrt(np.square(off).sum(axis=1).mean()))
