"""From a detection to a point of the world, by the camera's pose at the exposure.

What is located is the centre of the visible outline: of a ball the centre, of a cube that faces
the camera the centre of its front face. ``front_face.py`` says what a cube does to that off axis.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from bt_dualarm.errors import DualArmError
from bt_dualarm.pose import Matrix, Vector
from bt_dualarm.vision.detect import Detection
from bt_dualarm.vision.front_face import cube_corners, flank_share, front_face, square_corners
from bt_dualarm.vision.memory import Memory
from bt_dualarm.world.camera import Frame

PIXEL_SIGMA = 0.07
"""Standard deviation of a centroid in pixels; 0.03 to 0.07 were measured with both renderers."""

_HELD_SIGMA_M = 1e-5
_MIN_SLOPE = 0.05
_PLANE_MEMORY_FRAMES = 30
_FLANK_ROUNDS = 2
_KNOWN_AFTER_FRAMES = 10
_KNOWN_TO = 0.01  # share of the depth


class LocaliseError(DualArmError):
    """The line of sight does not lead to a point of the world."""


@dataclass(frozen=True, eq=False)
class Sighting:
    """A target in the world.

    Args:
        stamp: Simulated time of the exposure in s.
        point: Of shape (3,), in m.
        sigma: Standard deviation along x, y, z, of shape (3,), in m.
        side: Root of the visible area, in m.
    """

    stamp: float
    point: Vector
    sigma: Vector
    side: float


class Localiser(Protocol):
    """Adds to a detection what one image cannot tell: how far away the target is."""

    def locate(self, detection: Detection, frame: Frame) -> Sighting:
        """The target in the world.

        Raises:
            LocaliseError: The line of sight leads nowhere.
        """

    def meet(self, face: Detection, frame: Frame) -> Sighting:
        """As ``locate``, where the detection is that of the front face alone already."""

    def learn(self, detection: Detection, frame: Frame) -> None:
        """Take up what the target, and surely the target seen whole, tells of its place."""

    def forget(self) -> None:
        """All of that: it was not seen whole."""

    @property
    def knows_shape(self) -> bool:
        """Whether the shape is known by which one thing looks different from elsewhere."""

    def corners(self, point: Vector, frame: Frame) -> Matrix:
        """Outermost points in the world of a target at ``point``, of shape (n, 3)."""

    def doubt(self, point: Vector, frame: Frame) -> float:
        """Share by which the side, and so the depth, of one at ``point`` may be misjudged."""


@dataclass(frozen=True, eq=False)
class OnPlane:
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
        if abs(slope) < _MIN_SLOPE * float(np.linalg.norm(ray)):
            raise LocaliseError("the camera looks along the plane of the target")
        depth = float(self.normal @ (self.point - frame.pose.position)) / slope
        if depth <= 0.0:
            raise LocaliseError("the plane of the target lies behind the camera")
        across = depth / frame.focal_px
        sigma = across * _sigma_px(frame) * np.sqrt(np.maximum(1.0 - np.square(self.normal), 0.0))
        return Sighting(
            detection.stamp,
            frame.pose.position + depth * ray,
            np.maximum(sigma, _HELD_SIGMA_M),
            math.sqrt(detection.area_px) * across,
        )

    def meet(self, face: Detection, frame: Frame) -> Sighting:
        """The same; see ``Localiser``."""
        return self.locate(face, frame)

    def learn(self, detection: Detection, frame: Frame) -> None:
        """Nothing: the plane is known."""

    def forget(self) -> None:
        """Nothing was learnt."""

    @property
    def knows_shape(self) -> bool:
        """No."""
        return False

    def corners(self, point: Vector, frame: Frame) -> Matrix:  # noqa: ARG002 - see ``Localiser``
        """The point alone."""
        return point[None]

    def doubt(self, point: Vector, frame: Frame) -> float:  # noqa: ARG002 - see ``Localiser``
        """None that is known of."""
        return 0.0


@dataclass(frozen=True)
class OfSize:
    """The target has a known size.

    Args:
        side: Root of its outline's area in m: a cube's edge, a ball's radius times root of pi.
    """

    side: float

    def locate(self, detection: Detection, frame: Frame) -> Sighting:
        """Along the line of sight, as far as the size says; see ``Localiser``."""
        side_px = math.sqrt(detection.area_px)
        depth = frame.focal_px * self.side / side_px
        across = _sigma_px(frame) * depth / frame.focal_px
        # The area of a square with n pixels a side is as uncertain as its 4 n edge pixels.
        along = PIXEL_SIGMA * frame.stride * depth / side_px
        view = frame.pose.turn(np.array((0.0, 0.0, 1.0)))
        sigma = np.sqrt(across**2 + (along**2 - across**2) * np.square(view))
        point = frame.pose.position + depth * frame.ray(detection.centroid_px)
        return Sighting(detection.stamp, point, sigma, self.side)

    def meet(self, face: Detection, frame: Frame) -> Sighting:
        """The same; see ``Localiser``."""
        return self.locate(face, frame)

    def learn(self, detection: Detection, frame: Frame) -> None:
        """Nothing: each image tells its own depth."""

    def forget(self) -> None:
        """Nothing was learnt."""

    @property
    def knows_shape(self) -> bool:
        """The size alone: what is beside the front face is not known."""
        return False

    def corners(self, point: Vector, frame: Frame) -> Matrix:
        """Of a square that faces the camera."""
        return square_corners(frame, point, frame.pose.turn(np.array((0.0, 0.0, 1.0))), self.side)

    def doubt(self, point: Vector, frame: Frame) -> float:  # noqa: ARG002 - see ``Localiser``
        """None that is known of."""
        return 0.0


class OnPlaneOfSize:
    """The target stays on a plane of known direction, whose place its known size tells.

    The place is a running mean over the last ``_PLANE_MEMORY_FRAMES`` that were learnt: much
    steadier than one image's. A cube seen from ahead counts for far more than one whose flanks may
    be in view: whether they are in the dark, or stand on something, its size does not tell.

    Args:
        normal: Unit vector of the plane, of shape (3,).
        side: As for ``OfSize``.
        cube: The target is a cube with a face parallel to the plane: what is seen of its flanks
            is allowed for, and the centre of the front face located.
    """

    def __init__(self, normal: Vector, side: float, *, cube: bool = False) -> None:
        self._normal = np.array(normal, dtype=float)
        self._by_size = OfSize(side)
        self._cube = cube
        self._place = Memory(1)
        self._count = 0
        self._faced: tuple[Detection, Detection] | None = None

    def locate(self, detection: Detection, frame: Frame) -> Sighting:
        """Where the line of sight meets the plane; see ``Localiser``."""
        return self.meet(self._face(detection, frame), frame)

    def meet(self, face: Detection, frame: Frame) -> Sighting:
        """On the plane, as soon as it is known; see ``Localiser``."""
        if self._count == 0:
            return self._by_size.locate(face, frame)
        return OnPlane(self._place.value[0] * self._normal, self._normal).locate(face, frame)

    def learn(self, detection: Detection, frame: Frame) -> None:
        """Take its size into the mean; one that is cut off says nothing."""
        if detection.touches_border:
            return
        found = self._by_size.locate(self._face(detection, frame), frame)
        grain = PIXEL_SIGMA * frame.stride / math.sqrt(detection.area_px)
        doubt = grain + self.doubt(found.point, frame)
        self._place.take(self._normal[None] @ found.point, doubt, _PLANE_MEMORY_FRAMES)
        self._count += 1
        self._faced = None

    def forget(self) -> None:
        """Where the plane is."""
        self._place.forget()
        self._count = 0
        self._faced = None

    @property
    def knows_shape(self) -> bool:
        """That of a cube."""
        return self._cube

    def corners(self, point: Vector, frame: Frame) -> Matrix:
        """Of the cube, or of a square in the plane."""
        of_shape = cube_corners if self._cube else square_corners
        return of_shape(frame, point, self._normal, self._by_size.side)

    def doubt(self, point: Vector, frame: Frame) -> float:
        """By a cube's flanks: which of them have its colour is not known."""
        if not self._cube:
            return 0.0
        return flank_share(frame, point, self._normal, self._by_size.side)

    def _face(self, detection: Detection, frame: Frame) -> Detection:
        if not self._cube:
            return detection
        # What was located is learnt from next, most times: once is enough until something is.
        if self._faced is None or self._faced[0] is not detection:
            self._faced = detection, self._without_flanks(detection, frame)
        return self._faced[1]

    def _without_flanks(self, detection: Detection, frame: Frame) -> Detection:
        """Better each time, as the place gets better; a third would change micrometres."""
        # Until the place of the plane is known, the area cannot tell near from flanks in view.
        known = self._count >= _KNOWN_AFTER_FRAMES and self._place.doubt <= _KNOWN_TO
        flanks = None if known else 1.0
        corrected = detection
        for _ in range(_FLANK_ROUNDS):
            point = self.meet(corrected, frame).point
            corrected = front_face(
                detection, frame, point, self._normal, self._by_size.side, flanks=flanks
            )
        return corrected


def _sigma_px(frame: Frame) -> float:
    """Standard deviation of a centroid along x and y: of its pixels and of the camera's shake."""
    return math.hypot(PIXEL_SIGMA * frame.stride, frame.noise_px)
