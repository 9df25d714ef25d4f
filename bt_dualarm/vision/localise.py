"""From a detection to a point of the world, by the camera's pose at the exposure.

What is located is the centre of the visible outline: of a ball the centre, of a cube that faces
the camera the centre of its front face. ``front_face.py`` says what a cube does to that off axis,
``plane_of_size.py`` locates one whose depth is not known.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from bt_dualarm.errors import DualArmError
from bt_dualarm.pose import Matrix, Pose, Vector
from bt_dualarm.vision.detect import Detection
from bt_dualarm.vision.front_face import square_corners
from bt_dualarm.world.cameras.frame import Frame

PIXEL_SIGMA = 0.07
"""Standard deviation of a centroid in pixels; 0.03 to 0.07 were measured with both renderers."""

_HELD_SIGMA_M = 1e-5
_MIN_SLOPE = 0.05
_CUT_OFF = 0.3  # of the depth: its doubt where the image cuts off a part of what has a known size


class LocaliseError(DualArmError):
    """The line of sight does not lead to a point of the world."""


@dataclass(frozen=True, eq=False)
class Sighting:
    """A target in the world.

    Args:
        stamp: Simulated time of the exposure in s.
        point: Place in the world, of shape (3,), in m.
        sigma: Standard deviation along x, y, z, of shape (3,), in m.
        side: Root of the visible area, in m.
        camera: Pose of the camera at the exposure.
    """

    stamp: float
    point: Vector
    sigma: Vector
    side: float
    camera: Pose


class Localiser(ABC):
    """Adds to a detection what one image cannot tell: how far away the target is.

    By default one that learns nothing and knows no shape.
    """

    @abstractmethod
    def locate(self, detection: Detection, frame: Frame) -> Sighting:
        """The target in the world.

        Raises:
            LocaliseError: The line of sight leads nowhere.
        """

    def meet(self, face: Detection, frame: Frame) -> Sighting:
        """As ``locate``, where the detection is that of the front face alone already."""
        return self.locate(face, frame)

    def learn(self, detection: Detection, frame: Frame) -> bool:  # noqa: ARG002 - an option
        """Take up what the target, and surely the target seen whole, tells of its place.

        Returns:
            Whether all that was seen before lies elsewhere by it: ``relocate`` says where.
        """
        return False

    def relocate(self, sighting: Sighting) -> Sighting:
        """A sighting of before, by what is known now."""
        return sighting

    def forget(self) -> None:  # noqa: B027 - an option
        """Drop all of that: it was not seen whole."""

    @property
    def knows_shape(self) -> bool:
        """Whether the shape is known by which one thing looks different from elsewhere."""
        return False

    @abstractmethod
    def corners(self, point: Vector, frame: Frame) -> Matrix:
        """Outermost points in the world of a target at ``point``, of shape (n, 3), in m."""

    def doubt(self, point: Vector, frame: Frame) -> float:  # noqa: ARG002 - none is known of
        """Share by which the side, and so the depth, of one at ``point`` may be misjudged."""
        return 0.0


@dataclass(frozen=True, eq=False)
class OnPlane(Localiser):
    """The target stays on a known plane.

    Args:
        point: Any point of the plane, of shape (3,), in m.
        normal: Unit vector, of shape (3,).
    """

    point: Vector
    normal: Vector

    def locate(self, detection: Detection, frame: Frame) -> Sighting:
        """Where the line of sight meets the plane; see ``Localiser``."""
        ray = frame.ray(detection.centroid_px)
        slope = float(self.normal @ ray)
        if abs(slope) < _MIN_SLOPE * math.sqrt(ray.dot(ray)):
            raise LocaliseError("the camera looks along the plane of the target")
        depth = float(self.normal @ (self.point - frame.pose.position)) / slope
        if depth <= 0.0:
            raise LocaliseError("the plane of the target lies behind the camera")
        across = depth / frame.focal_px
        sigma = across * _sigma_px(frame) * self._along
        return Sighting(
            detection.stamp,
            frame.pose.position + depth * ray,
            np.maximum(sigma, _HELD_SIGMA_M),
            math.sqrt(detection.area_px) * across,
            frame.pose,
        )

    @cached_property
    def _along(self) -> Vector:
        """Share of each axis of the world that lies in the plane, of shape (3,)."""
        along: Vector = np.sqrt(np.maximum(1.0 - np.square(self.normal), 0.0))
        return along

    def relocate(self, sighting: Sighting) -> Sighting:
        """Along its line of sight to this plane."""
        eye = sighting.camera.position
        line = sighting.point - eye
        farther = float(self.normal @ (self.point - eye)) / float(self.normal @ line)
        return replace(
            sighting,
            point=eye + farther * line,
            sigma=farther * sighting.sigma,
            side=farther * sighting.side,
        )

    def corners(self, point: Vector, frame: Frame) -> Matrix:  # noqa: ARG002 - see ``Localiser``
        """The point alone."""
        return point[None]


@dataclass(frozen=True)
class OfSize(Localiser):
    """The target has a known size; what is beside its front face is not known.

    Args:
        side: Root of its outline's area in m: a cube's edge, a ball's radius times root of pi.
    """

    side: float

    def locate(self, detection: Detection, frame: Frame) -> Sighting:
        """Along the line of sight, as far as the size says; see ``Localiser``."""
        side_px = _side_px(detection)
        depth = frame.focal_px * self.side / side_px
        across = _sigma_px(frame) * depth / frame.focal_px
        # The area of a square with n pixels a side is as uncertain as its 4 n edge pixels.
        along = PIXEL_SIGMA * frame.stride * depth / side_px
        if detection.touches_border:
            along = _CUT_OFF * depth
        view = frame.pose.turn(np.array((0.0, 0.0, 1.0)))
        sigma = np.sqrt(across**2 + (along**2 - across**2) * np.square(view))
        point = frame.pose.position + depth * frame.ray(detection.centroid_px)
        return Sighting(detection.stamp, point, sigma, self.side, frame.pose)

    def corners(self, point: Vector, frame: Frame) -> Matrix:
        """Those of a square that faces the camera."""
        return square_corners(frame, point, frame.pose.turn(np.array((0.0, 0.0, 1.0))), self.side)


def _side_px(detection: Detection) -> float:
    """Root of the area; of what the image cuts off its longer edge, which most times is whole."""
    root = math.sqrt(detection.area_px)
    if not detection.touches_border:
        return root
    left, top, right, bottom = detection.bounds_px
    return max(root, right - left, bottom - top)


def _sigma_px(frame: Frame) -> float:
    """Standard deviation of a centroid along x and y: of its pixels and of the camera's shake."""
    return math.hypot(PIXEL_SIGMA * frame.stride, frame.noise_px)
