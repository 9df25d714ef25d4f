"""Outlines of what has a colour, finer than a pixel, in a picture of a camera at rest."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np

from bt_dualarm.pose import Matrix, Pose, Vector
from bt_dualarm.vision.colors import ColorFilter
from bt_dualarm.vision.detect import Blob, Detection, coverage, detect_blobs
from bt_dualarm.world.cameras.frame import Frame, Plain
from bt_dualarm.world.cameras.undrawn import UndrawnFrame
from bt_dualarm.world.rendering.renderer import Image

_FINER: Final = 4
"""Samples a pixel along each direction between which an edge is looked for."""

INSIDE_PX: Final = 0.5 / _FINER
"""Pixels by which the points of an outline are inside of it: they are those of its last samples."""

_MOST_POINTS: Final = 160
"""Points of an outline that are kept: more tell nothing new."""


@dataclass(frozen=True, eq=False)
class OutlineView:
    """The outline of one thing, as a camera at rest has seen it.

    Attributes:
        camera: Pose of the camera in the world (x right, y down, z forward), as it was believed.
        focal_px: Focal length in pixels.
        edge: Points of the outline from the image's middle, of shape (n, 2), px.
        detection: Detection with its place and area.
    """

    camera: Pose
    focal_px: float
    edge: Matrix
    detection: Detection

    @property
    def middle(self) -> Vector:
        """Middle of its box from the image's middle, of shape (2,), px."""
        middle: Vector = (self.edge.min(axis=0) + self.edge.max(axis=0)) / 2.0
        return middle


def merged(frames: list[Frame]) -> Frame:
    """One picture with less noise, of several by a camera that did not move.

    Args:
        frames: Frames, one at least, of one region and stride.
    """

    def mean() -> Image:
        exact = np.mean([frame.image for frame in frames], axis=0)
        return np.asarray(np.rint(exact), dtype=np.uint8)

    return UndrawnFrame.of(frames[-1], mean, merges=len(frames))


def outlines(frame: Frame, color: ColorFilter, min_area: float) -> list[OutlineView]:
    """All that has a colour and is in the picture as a whole, the largest first.

    Args:
        frame: Frame that was exposed as a whole, in full resolution.
        color: Filter of the colour.
        min_area: Least area in square pixels.
    """

    def look() -> Plain:
        return [
            [_edge(frame, blob).ravel().tolist(), detection.plain]
            for detection, blob in detect_blobs(frame, color, min_area)
            if not detection.touches_border
        ]

    found = [
        OutlineView(
            frame.pose,
            frame.focal_px,
            np.array(edge, float).reshape(-1, 2),
            Detection.of_plain(frame, seen),
        )
        for edge, seen in frame.answer(f"outline {color.name} from {min_area!r} px", look)
    ]
    return sorted(found, key=lambda view: -view.detection.area_px)


def _edge(frame: Frame, blob: Blob) -> Matrix:
    """Where half of a pixel is covered, from the image's middle, of shape (n, 2), px."""
    share = coverage(blob)
    height, width = share.shape
    fine = cv2.resize(share, (_FINER * width, _FINER * height), interpolation=cv2.INTER_LINEAR)
    inside = (fine > 0.5).astype(np.uint8)
    contours, _ = cv2.findContours(inside, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    contour = max(contours, key=cv2.contourArea).reshape(-1, 2)
    kept = contour[:: max(len(contour) // _MOST_POINTS, 1)]
    corner = np.array(blob.origin) + np.array(frame.region[:2])
    middle = np.array((frame.width, frame.height)) / 2.0
    points: Matrix = (kept + 0.5) / _FINER + corner - middle
    return points
