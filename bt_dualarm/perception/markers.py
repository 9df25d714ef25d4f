"""Detection and pose estimation of square markers, and hand-eye calibration."""

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

Gray: TypeAlias = npt.NDArray[np.uint8]
"""Brightness of each pixel, of shape (height, width)."""

_ENLARGEMENT: Final = 2
"""Factor by which an image is enlarged before detection: small cells are decoded better."""

_OVERSAMPLING: Final = 4
"""Samples per pixel along each axis between which an edge is located."""

_MARGIN: Final = 0.6
"""Margin around the black square, in cells, in which its edge is searched."""


@dataclass(frozen=True, eq=False)
class MarkerView(OutlineView):
    """The outline of a marker's black square, and its corners, which determine its orientation.

    Attributes:
        corners: Corners in OpenCV's order relative to the image center, of shape (4, 2), px.
    """

    corners: Matrix


@dataclass(frozen=True)
class SquareCorners(KnownShape):
    """A marker as a shape of four distinguishable corners.

    Its frame has z out of the marker and y up as it is printed; the first corner is at -x, +y.
    """

    @property
    def points(self) -> Matrix:
        """Corners in OpenCV's order, of shape (4, 3), in the marker's frame, m."""
        half = 0.5 * self.size[0]
        return half * np.array(
            ((-1.0, 1.0, 0.0), (1.0, 1.0, 0.0), (1.0, -1.0, 0.0), (-1.0, -1.0, 0.0))
        )

    def canonical(self, pose: Pose) -> Pose:
        """The pose itself: a marker has no symmetry."""
        return pose

    def angle(self, one: Pose, other: Pose) -> float:
        """Angle between two poses in rad."""
        return one.angle(other)


def markers_in(frame: Frame, marker: MarkerSpec) -> list[OutlineView]:
    """Detect all markers with a given id in an image."""
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
    """Edge, corners, bounding box and area of each such marker, px from the image's corner."""
    gray = np.asarray(cv2.cvtColor(frame.image, cv2.COLOR_RGB2GRAY), dtype=np.uint8)
    large = cv2.resize(gray, None, fx=_ENLARGEMENT, fy=_ENLARGEMENT, interpolation=cv2.INTER_LINEAR)
    settings = cv2.aruco.DetectorParameters()
    settings.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
    known = cv2.aruco.getPredefinedDictionary(DICTIONARIES[marker.dictionary])
    all_corners, ids, _ = cv2.aruco.ArucoDetector(known, settings).detectMarkers(large)
    found: JsonList = []
    for four, number in zip(all_corners, () if ids is None else ids.ravel(), strict=False):
        corners = (np.asarray(four, dtype=float).reshape(4, 2) + 0.5) / _ENLARGEMENT
        edge = _edge(gray, corners, marker.cells) if number == marker.id else np.zeros((0, 2))
        if len(edge):
            area = float(cv2.contourArea(corners.astype(np.float32)))
            low = corners.min(axis=0)
            high = corners.max(axis=0)
            bounds = (int(low[0]), int(low[1]), int(high[0]) + 1, int(high[1]) + 1)
            found.append([edge.ravel().tolist(), corners.ravel().tolist(), bounds, area])
    return found


def _edge(gray: Gray, corners: Matrix, cells: int) -> Matrix:
    """Subpixel outline of the black square, of shape (n, 2), px from the image's corner."""
    center = corners.mean(axis=0)
    around = center + (1.0 + 2.0 * _MARGIN / cells) * (corners - center)
    height, width = gray.shape
    left, top = np.maximum(np.floor(around.min(axis=0)).astype(int) - 1, 0).tolist()
    right, bottom = np.minimum(
        np.ceil(around.max(axis=0)).astype(int) + 2, (width, height)
    ).tolist()
    part = gray[top:bottom, left:right].astype(np.float32)
    size = (_OVERSAMPLING * part.shape[1], _OVERSAMPLING * part.shape[0])
    fine = cv2.resize(part, size, interpolation=cv2.INTER_LINEAR)
    mask = np.zeros(fine.shape, np.uint8)
    ring = np.rint(_OVERSAMPLING * (around - np.array((left, top))) - 0.5).astype(np.int32)
    cv2.fillConvexPoly(mask, ring, 1)
    black, white = np.percentile(fine[mask > 0], (10, 95))
    inside = ((fine < 0.5 * (black + white)) & (mask > 0)).astype(np.uint8)
    contours, _ = cv2.findContours(inside, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    if not contours:
        return np.zeros((0, 2))
    contour = max(contours, key=cv2.contourArea).reshape(-1, 2)
    edge: Matrix = (contour[::_OVERSAMPLING] + 0.5) / _OVERSAMPLING + np.array((left, top))
    return edge


@dataclass(frozen=True, eq=False)
class MarkerFitter(ShapeFitter):
    """Fits the square of one marker, with initial poses by IPPE (Collins, Bartoli, 2014)."""

    def first(self, view: OutlineView) -> list[ShapeFit]:
        """The two possible poses by one image (perspective ambiguity), the likelier first."""
        if not isinstance(view, MarkerView):
            raise TypeError("a marker is fitted to views of markers")
        intrinsics = np.diag((view.focal_px, view.focal_px, 1.0))
        _, turns, places, _ = cv2.solvePnPGeneric(
            self.shape.points, view.corners, intrinsics, None, flags=cv2.SOLVEPNP_IPPE_SQUARE
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
"""Prior standard deviation of the mount's rotation about each axis, rad."""

_SHIFT_DOUBT: Final = 0.002
"""Prior standard deviation of its position along each axis, m."""

_FOCAL_DOUBT: Final = 0.01
"""Prior standard deviation of the focal length as a share; a fixed one would bias the depth."""

_PIXEL_DOUBT: Final = 0.3
"""Standard deviation of a centroid in pixels, including the distortion of the lens."""


@dataclass(frozen=True, eq=False)
class MarkView:
    """One view of the mark from a camera at rest.

    Attributes:
        camera: Pose of the camera in the world (x right, y down, z forward), as estimated.
        pixel: Centroid of the mark relative to the image center, of shape (2,), px.
        focal_px: Focal length in pixels.
    """

    camera: Pose
    pixel: Vector
    focal_px: float


@dataclass(frozen=True, eq=False)
class HandEye:
    """Result of a hand-eye calibration.

    Attributes:
        correction: Pose of the camera in its nominal frame.
        mark: Position of the mark in the world, of shape (3,), m.
        before_px: Root-mean-square residual with the nominal mount.
        residual_px: Root-mean-square residual with the correction.
    """

    correction: Pose
    mark: Vector
    before_px: float
    residual_px: float


def hand_eye(views: Sequence[MarkView], mark: Vector) -> HandEye:
    """Calibrate a camera's mount by views of a mark at rest.

    Least squares of the distances in the images with a prior for the mount: bundle adjustment of
    one point. See Tsai and Lenz, IEEE Trans. Robot. Autom. 1989, for how the views have to vary.

    Args:
        views: Views of the mark, from different distances and directions.
        mark: Estimated position of the mark, of shape (3,), m.
    """

    def correction(x: Vector) -> Pose:
        turn = x[:3] * _TURN_DOUBT
        angle = float(np.linalg.norm(turn))
        if angle < 1e-12:
            return Pose(x[3:6] * _SHIFT_DOUBT, np.array((1.0, 0.0, 0.0, 0.0)))
        half = np.sin(angle / 2) / angle * turn
        return Pose(x[3:6] * _SHIFT_DOUBT, np.array((np.cos(angle / 2), *half)))

    def errors(mount: Pose, place: Vector, longer: float = 0.0) -> Matrix:
        """Predicted less measured positions in the images, of shape (n, 2), px."""
        points = np.array([(view.camera @ mount).inverse.apply(place) for view in views])
        focal = np.array([view.focal_px for view in views])
        seen = (1.0 + _FOCAL_DOUBT * longer) * focal[:, None] * points[:, :2] / points[:, 2:]
        off: Matrix = seen - np.array([view.pixel for view in views])
        return off

    def residuals(x: Vector) -> Vector:
        off = errors(correction(x), mark + x[7:], float(x[6])).ravel()
        return np.concatenate((off / _PIXEL_DOUBT, x[:7]))

    nominal = Pose.identity()
    alone = scipy.optimize.least_squares(lambda x: errors(nominal, mark + x).ravel(), np.zeros(3))
    found = scipy.optimize.least_squares(residuals, np.concatenate((np.zeros(7), alone.x)))
    mount = correction(found.x)
    place = mark + found.x[7:]
    before = errors(nominal, mark + alone.x)
    after = errors(mount, place, float(found.x[6]))
    return HandEye(mount, place, _rms(before), _rms(after))


def _rms(off: Matrix) -> float:
    return float(np.sqrt(np.square(off).sum(axis=1).mean()))
