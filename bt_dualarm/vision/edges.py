"""Outlines of what has a colour, finer than a pixel, in a picture of a camera at rest."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np
import numpy.typing as npt

from bt_dualarm.pose import Matrix, Pose, Vector
from bt_dualarm.vision.colors import ColorFilter
from bt_dualarm.vision.detect import Blob, Detection, detect_blobs
from bt_dualarm.world.cameras.frame import Frame, Plain
from bt_dualarm.world.cameras.undrawn import UndrawnFrame
from bt_dualarm.world.rendering.renderer import Image

_FINER: Final = 4
"""Samples a pixel along each direction between which an edge is looked for."""

INSIDE_PX: Final = 0.5 / _FINER
"""Pixels by which the points of an outline are inside of it: they are those of its last samples."""

_NEXT: Final = cv2.getStructuringElement(cv2.MORPH_RECT, (3, 3))
_NEIGHBOURS: Final = cv2.getStructuringElement(cv2.MORPH_RECT, (5, 5))
_AROUND: Final = (9, 9)
"""Pixels, across and along, whose mean is the ground that an edge is seen on."""

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
    def is_whole(self) -> bool:
        """Whether all of it is in the picture; of what is not, there is no edge."""
        return not self.detection.touches_border

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
        exact = np.mean([frame.blocks for frame in frames], axis=0)
        return np.asarray(np.rint(exact), dtype=np.uint8)

    return UndrawnFrame.of(frames[-1], mean, merges=len(frames))


def outlines(frame: Frame, color: ColorFilter, min_area: float) -> list[OutlineView]:
    """All that has a colour, the largest first, what goes beyond the picture as well.

    Args:
        frame: Frame that was exposed as a whole, in full resolution.
        color: Filter of the colour.
        min_area: Least area in square pixels.
    """

    def look() -> Plain:
        return [
            [
                [] if detection.touches_border else _edge(frame, blob).ravel().tolist(),
                detection.plain,
            ]
            for detection, blob in detect_blobs(frame, color, min_area)
        ]

    found = [
        OutlineView(
            frame.pose,
            frame.focal_px,
            np.array(edge, float).reshape(-1, 2),
            Detection.of_plain(frame, seen),
        )
        for edge, seen in frame.answer(f"all outlines {color.name} from {min_area!r} px", look)
    ]
    return sorted(found, key=lambda view: -view.detection.area_px)


def _edge(frame: Frame, blob: Blob) -> Matrix:
    """Where half of a pixel is covered, from the image's middle, of shape (n, 2), px."""
    share = _difference(blob)
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


def _difference(blob: Blob) -> npt.NDArray[np.float32]:
    """How far each pixel differs from what is around the blob, as a share of how far the blob does.

    Inside the outline 1, farther than a pixel from it 0. A pixel at the edge is a mixture of the
    thing and of its surroundings. A side in the shade has not the colour that is looked for; it
    belongs to the thing all the same, and differs from a bright and from a dark ground alike.
    """
    inside, near = cv2.erode(blob.filled, _NEXT), cv2.dilate(blob.filled, _NEXT)
    colors = blob.rgb.astype(np.float32)
    around = (near == 0).astype(np.float32)
    count = cv2.boxFilter(around, -1, _AROUND, normalize=False)
    total = cv2.boxFilter(colors * around[:, :, None], -1, _AROUND, normalize=False)
    ground = total / np.maximum(count, 1.0)[:, :, None]
    away = np.linalg.norm(colors - ground, axis=2).astype(np.float32)
    away[near == 0] = 0.0
    share = np.minimum(away / np.maximum(cv2.dilate(away, _NEIGHBOURS), 1.0), 1.0)
    share[(inside > 0) | (count == 0.0)] = 1.0
    share[near == 0] = 0.0
    return np.asarray(share, dtype=np.float32)
