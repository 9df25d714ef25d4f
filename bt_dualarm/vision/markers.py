"""Square markers in pictures (OpenCV's ArUco and AprilTag), and their poses from several."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, TypeAlias

import cv2
import numpy as np
import numpy.typing as npt

from bt_dualarm.pose import Matrix, Pose
from bt_dualarm.spec.marker import MarkerSpec
from bt_dualarm.vision.detect import Detection
from bt_dualarm.vision.edges import OutlineView
from bt_dualarm.vision.known_shape import KnownShape
from bt_dualarm.vision.outline_error import Scene
from bt_dualarm.vision.shape_fit import ShapeFit, ShapeFitter
from bt_dualarm.world.cameras.frame import Frame, Plain
from bt_dualarm.world.marker_bodies import DICTIONARIES

Grey: TypeAlias = npt.NDArray[np.uint8]
"""Brightness of each pixel, of shape (height, width)."""

_TURNED = cv2.SOLVEPNP_IPPE_SQUARE
_LARGER: Final = 2
"""Factor by which a picture is enlarged first: small cells are read better."""

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
    """All markers of one number in a picture."""
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


def _look(frame: Frame, marker: MarkerSpec) -> Plain:
    """Edge, corners, box and area of each such marker, in px from the image's corner."""
    grey = np.asarray(cv2.cvtColor(frame.image, cv2.COLOR_RGB2GRAY), dtype=np.uint8)
    large = cv2.resize(grey, None, fx=_LARGER, fy=_LARGER, interpolation=cv2.INTER_LINEAR)
    settings = cv2.aruco.DetectorParameters()
    settings.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
    known = cv2.aruco.getPredefinedDictionary(DICTIONARIES[marker.dictionary])
    all_corners, ids, _ = cv2.aruco.ArucoDetector(known, settings).detectMarkers(large)
    found: Plain = []
    for four, number in zip(all_corners, () if ids is None else ids.ravel(), strict=False):
        corners = (np.asarray(four, dtype=float).reshape(4, 2) + 0.5) / _LARGER
        edge = _edge(grey, corners, marker.cells) if number == marker.id else np.zeros((0, 2))
        if len(edge):
            area = float(cv2.contourArea(corners.astype(np.float32)))
            low, high = corners.min(axis=0), corners.max(axis=0)
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
        """Both poses that one picture may show, the likelier first."""
        if not isinstance(view, MarkerView):
            raise TypeError("a marker is fitted to views of markers")
        intrinsics = np.diag((view.focal_px, view.focal_px, 1.0))
        _, turns, places, _ = cv2.solvePnPGeneric(
            self.shape.points, view.corners, intrinsics, None, flags=_TURNED
        )
        scenes = [
            Scene.believed(
                view.camera.apply(np.asarray(place, dtype=float).ravel()),
                view.camera.rotation_matrix @ cv2.Rodrigues(turn)[0],
            )
            for turn, place in zip(turns, places, strict=True)
        ]
        return sorted((self._solved(scene, [view]) for scene in scenes), key=lambda fit: fit.cost)
