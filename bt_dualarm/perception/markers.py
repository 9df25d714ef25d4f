"""Square markers in images, and hand-eye calibration by a marker at rest."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, TypeAlias

import cv2
import numpy as np
import numpy.typing as npt
import scipy

from bt_dualarm.core.pose import Matrix, Pose, Vector
from bt_dualarm.perception.detection import Detection
from bt_dualarm.perception.known_shape import KnownShape
from bt_dualarm.perception.shape_fit import OutlineScene, OutlineView, ShapeFit, ShapeFitter
from bt_dualarm.sim.composition import DICTIONARIES
from bt_dualarm.sim.frame import Frame, JsonList
from bt_dualarm.spec.values import MarkerSpec

Grey: TypeAlias = npt.NDArray[np.uint8]
"""Brightness of each pixel, of shape (height, width)."""

_TURNED = cv2.SOLVEPNP_IPPE_SQUARE
_LARGER: Final = 2
"""Factor by which an image is enlarged first: small cells are read better."""

_FINER: Final = 4
"""Samples a pixel along each direction between which an edge is looked for."""

_AROUND: Final = 0.6
"""Share of a cell, of the white around the black square, in which its edge is looked for."""


@dataclass(frozen=True, eq=False)
class MarkerView(OutlineView):
    """The outline of a marker's black square, and its corners, which tell how it is turned.

    Attributes:
        corners: Corners in OpenCV's order from the image's middle, of shape (4, 2), px.
    """

    corners: Matrix


@dataclass(frozen=True)
class SquareCorners(KnownShape):
    """The corners of a marker as a shape: no outline, four points that are told apart.

    Its frame has z out of the marker and y up as it is printed; the first corner is at -x, +y.
    """

    @property
    def points(self) -> Matrix:
        """Corners as OpenCV orders them, of shape (4, 3), in its own frame."""
        half = 0.5 * self.size[0]
        return half * np.array(
            ((-1.0, 1.0, 0.0), (1.0, 1.0, 0.0), (1.0, -1.0, 0.0), (-1.0, -1.0, 0.0))
        )

    def canonical(self, pose: Pose) -> Pose:
        """The pose itself: no two turns of a marker look alike."""
        return pose

    def angle(self, one: Pose, other: Pose) -> float:
        """Angle between two poses in rad."""
        return one.angle(other)


def markers_in(frame: Frame, marker: MarkerSpec) -> list[OutlineView]:
    """All markers of one number in an image."""
    middle = np.array((frame.width, frame.height)) / 2.0
    asked = f"marker {marker.dictionary} {marker.id}"
    views: list[OutlineView] = []
    for edge, four, bounds, area in frame.answer(asked, lambda: _look(frame, marker)):
        corners = np.array(four, float).reshape(4, 2)
        x, y = corners.mean(axis=0).tolist()
        box = (bounds[0], bounds[1], bounds[2], bounds[3])
        detection = Detection.at(frame, (x, y), area, box)
        around = np.array(edge, float).reshape(-1, 2)
        views.append(
            MarkerView(frame.pose, frame.focal_px, around - middle, detection, corners - middle)
        )
    return views


def _look(frame: Frame, marker: MarkerSpec) -> JsonList:
    """Edge, corners, box and area of each such marker, in px from the image's corner."""
    grey = np.asarray(cv2.cvtColor(frame.image, cv2.COLOR_RGB2GRAY), dtype=np.uint8)
    large = cv2.resize(grey, None, fx=_LARGER, fy=_LARGER, interpolation=cv2.INTER_LINEAR)
    settings = cv2.aruco.DetectorParameters()
    settings.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
    known = cv2.aruco.getPredefinedDictionary(DICTIONARIES[marker.dictionary])
    all_corners, ids, _ = cv2.aruco.ArucoDetector(known, settings).detectMarkers(large)
    found: JsonList = []
    for four, number in zip(all_corners, () if ids is None else ids.ravel(), strict=False):
        corners = (np.asarray(four, dtype=float).reshape(4, 2) + 0.5) / _LARGER
        edge = _edge(grey, corners, marker.cells) if number == marker.id else np.zeros((0, 2))
        if len(edge):
            area = float(cv2.contourArea(corners.astype(np.float32)))
            low = corners.min(axis=0)
            high = corners.max(axis=0)
            bounds = (int(low[0]), int(low[1]), int(high[0]) + 1, int(high[1]) + 1)
            found.append([edge.ravel().tolist(), corners.ravel().tolist(), bounds, area])
    return found


def _edge(grey: Grey, corners: Matrix, cells: int) -> Matrix:
    """Outline of the black square, finer than a pixel, from the image's corner, (n, 2), px."""
    center = corners.mean(axis=0)
    around = center + (1.0 + 2.0 * _AROUND / cells) * (corners - center)
    height, width = grey.shape
    left, top = np.maximum(np.floor(around.min(axis=0)).astype(int) - 1, 0).tolist()
    right, bottom = np.minimum(
        np.ceil(around.max(axis=0)).astype(int) + 2, (width, height)
    ).tolist()
    part = grey[top:bottom, left:right].astype(np.float32)
    size = (_FINER * part.shape[1], _FINER * part.shape[0])
    fine = cv2.resize(part, size, interpolation=cv2.INTER_LINEAR)
    mask = np.zeros(fine.shape, np.uint8)
    ring = np.rint(_FINER * (around - np.array((left, top))) - 0.5).astype(np.int32)
    cv2.fillConvexPoly(mask, ring, 1)
    black, white = np.percentile(fine[mask > 0], (10, 95))
    inside = ((fine < 0.5 * (black + white)) & (mask > 0)).astype(np.uint8)
    contours, _ = cv2.findContours(inside, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    if not contours:
        return np.zeros((0, 2))
    contour = max(contours, key=cv2.contourArea).reshape(-1, 2)
    edge: Matrix = (contour[::_FINER] + 0.5) / _FINER + np.array((left, top))
    return edge


@dataclass(frozen=True, eq=False)
class MarkerFitter(ShapeFitter):
    """Fits the square of one marker; begins with IPPE (Collins, Bartoli, 2014)."""

    def first(self, view: OutlineView) -> list[ShapeFit]:
        """Both poses that one image may show, the likelier first."""
        if not isinstance(view, MarkerView):
            raise TypeError("a marker is fitted to views of markers")
        intrinsics = np.diag((view.focal_px, view.focal_px, 1.0))
        _, turns, places, _ = cv2.solvePnPGeneric(
            self.shape.points, view.corners, intrinsics, None, flags=_TURNED
        )
        scenes = [
            OutlineScene.believed(
                view.camera.apply(np.asarray(place, dtype=float).ravel()),
                view.camera.rotation_matrix @ cv2.Rodrigues(turn)[0],
            )
            for turn, place in zip(turns, places, strict=True)
        ]
        return sorted((self._solved(scene, [view]) for scene in scenes), key=lambda fit: fit.cost)


# Hand-eye calibration


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
        camera: Pose of the camera in the world (x right, y down, z forward), as estimated.
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
        correction: Pose of the camera in the frame where it was assumed to be.
        mark: Position of the mark in the world, of shape (3,), m.
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
        mark: Place where it is estimated to be, of shape (3,), m.
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
    mount = correction(found.x)
    place = mark + found.x[7:]
    before = missed(believed, mark + alone.x)
    after = missed(mount, place, float(found.x[6]))
    return HandEye(mount, place, _rms(before), _rms(after))


def _rms(off: Matrix) -> float:
    return float(np.sqrt(np.square(off).sum(axis=1).mean()))
