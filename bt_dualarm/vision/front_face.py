"""The perspective bias of a cube: beside its front face a camera sees a part of its flanks.

While a cube's offset from the camera's axis is below half its edge, the front face hides the
rest. Beyond, a flank comes into view and pulls the centroid of the outline towards the axis: a
50 mm cube at 0.35 m by 0.4, 1.6 and 4.8 mm at 30, 50 and 100 mm. Where the cube roughly is tells
which part of the outline is flank, so the front face's own centre and area can be inferred. A
flank in the dark does not have the colour and does not pull; the area tells how much of it does.
"""

from __future__ import annotations

import math
from dataclasses import replace

import cv2
import numpy as np
import numpy.typing as npt

from bt_dualarm.pose import Matrix, Vector
from bt_dualarm.vision.detect import Detection
from bt_dualarm.world.cameras.frame import Frame

_MIN_DEPTH_M = 1e-3
_MIN_FLANKS_PX = 1.0
_CORNERS = np.array([[u, v] for u in (-0.5, 0.5) for v in (-0.5, 0.5)])


def front_face(
    detection: Detection,
    frame: Frame,
    point: Vector,
    normal: Vector,
    edge: float,
    *,
    flanks: float | None = None,
) -> Detection:
    """What would have been detected of the cube's front face alone.

    Args:
        detection: Detection of the whole outline.
        frame: Frame in which it was detected.
        point: Rough centre of the front face in the world, of shape (3,), in m; an error of a
            centimetre changes the result by a tenth of that.
        normal: Normal of the front face, either way round, of shape (3,); the cube's edges are
            taken as parallel to the image as far as that allows.
        edge: Length of an edge in m.
        flanks: Share of the flanks that has the colour; by default what the area says, which
            asks for a depth that is known to a hundredth.
    """
    pixels = _corner_pixels(frame, point, normal, edge)
    if pixels is None:
        return detection
    face_x, face_y, face_area = _outline(pixels[:4])
    all_x, all_y, all_area = _outline(pixels)
    if flanks is None:
        flanks = (detection.area_px - face_area) / max(all_area - face_area, _MIN_FLANKS_PX)
        flanks = min(max(flanks, 0.0), 1.0)
    seen = face_area + flanks * (all_area - face_area)
    # Centres weigh by area, so the shift by a share of the flanks is not that share of the shift.
    pull = flanks * all_area / seen
    x = detection.centroid_px[0] + pull * (face_x - all_x)
    y = detection.centroid_px[1] + pull * (face_y - all_y)
    area = detection.area_px * face_area / seen
    return replace(
        detection,
        centroid_px=(x, y),
        centroid=(2.0 * x / frame.width - 1.0, 2.0 * y / frame.height - 1.0),
        area_px=area,
        size=math.sqrt(area) / frame.height,
    )


def flank_share(frame: Frame, point: Vector, normal: Vector, edge: float) -> float:
    """Share by which a cube's flanks enlarge its outline, as root of the area, at most.

    Arguments as of ``front_face``.
    """
    pixels = _corner_pixels(frame, point, normal, edge)
    if pixels is None:
        return 1.0
    return max(math.sqrt(_outline(pixels)[2] / _outline(pixels[:4])[2]) - 1.0, 0.0)


def cube_corners(frame: Frame, point: Vector, normal: Vector, edge: float) -> Matrix:
    """Corners of a cube whose front face has its centre at a point, (8, 3), those first."""
    away = _away(frame, point, normal)
    face = square_corners(frame, point, away, edge)
    return np.vstack([face, face + edge * away])


def square_corners(frame: Frame, point: Vector, normal: Vector, edge: float) -> Matrix:
    """Corners of a square centred at a point, along the image, of shape (4, 3)."""
    away = _away(frame, point, normal)
    across = frame.right - (frame.right @ away) * away
    across /= math.sqrt(across @ across)
    (a, b, c), (x, y, z) = away.tolist(), across.tolist()
    along = (b * z - c * y, c * x - a * z, a * y - b * x)
    square: Matrix = point + edge * _CORNERS @ np.array([(x, y, z), along])
    return square


def _corner_pixels(
    frame: Frame, point: Vector, normal: Vector, edge: float
) -> npt.NDArray[np.float64] | None:
    """A cube's corners in the image, of shape (8, 2); None where the camera is too near."""
    local = frame.world_in_camera.apply(cube_corners(frame, point, normal, edge))
    if local[:, 2].min() < _MIN_DEPTH_M:
        return None
    pixels: npt.NDArray[np.float64] = frame.focal_px * local[:, :2] / local[:, 2:]
    pixels += (frame.width / 2.0, frame.height / 2.0)
    return pixels


def _away(frame: Frame, point: Vector, normal: Vector) -> Vector:
    """The normal, pointing away from the camera."""
    return normal if normal @ (point - frame.pose.position) > 0.0 else -normal


def _outline(pixels: npt.NDArray[np.float64]) -> tuple[float, float, float]:
    """Centre and area of the convex hull of points of shape (n, 2).

    The points are moved to the origin first: OpenCV's moments of an outline are cubic in single
    precision coordinates.
    """
    origin = pixels.mean(axis=0)
    hull = cv2.convexHull((pixels - origin).astype(np.float32))
    moments = cv2.moments(hull)
    area = max(moments["m00"], 1e-9)
    return origin[0] + moments["m10"] / area, origin[1] + moments["m01"] / area, area
