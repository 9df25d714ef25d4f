"""Localization: from a detection in an image to a point in the world.

One image does not determine the depth of a target. A `Localizer` adds what is known: the plane on
which the target moves, its size, or the direction of the plane together with the size or with the
motion of the camera. The located point is the center of the visible outline: for a ball its center,
for a cube that faces the camera the center of its front face.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass, replace
from functools import cache, cached_property
from types import ModuleType
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from bt_dualarm.core.errors import DualArmError
from bt_dualarm.core.later import Later
from bt_dualarm.core.pose import Matrix, Pose, Vector
from bt_dualarm.perception.detection import Detection
from bt_dualarm.sim.frame import Frame

if TYPE_CHECKING:
    import cv2
else:
    cv2 = Later("cv2")

# Perspective bias of cubes
#
# While a cube's offset from the camera's axis is below half its edge, the front face hides the
# rest. Beyond that a flank becomes visible and moves the centroid of the outline toward the axis:
# for a 50 mm cube at a depth of 0.35 m by 0.4, 1.6 and 4.8 mm at offsets of 30, 50 and 100 mm. The
# approximate position of the cube determines which part of the outline is flank, and so the center
# and area of the front face. A dark flank does not have the color and causes no bias; the area
# shows which fraction of the flanks does.


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
    """Correct a detection to that of the cube's front face alone.

    Args:
        detection: Detection of the whole outline.
        frame: Frame in which it was detected.
        point: Approximate center of the front face in the world, of shape (3,), m; an error of a
            centimeter changes the result by a tenth of that.
        normal: Normal of the front face, of either sign, of shape (3,); the cube's edges are
            assumed to be as parallel to the image axes as possible.
        edge: Length of an edge, m.
        flanks: Fraction of the flanks that has the color; by default estimated from the area, which
            requires the depth to 1 %.
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
    # Centroids are weighted by area: half of the flanks' area does not cause half of the shift.
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
    """Largest relative increase of a cube's side (root of the area) by its visible flanks.

    Arguments as for `front_face`.
    """
    pixels = _corner_pixels(frame, point, normal, edge)
    if pixels is None:
        return 1.0
    return max(math.sqrt(_outline(pixels)[2] / _outline(pixels[:4])[2]) - 1.0, 0.0)


def cube_corners(frame: Frame, point: Vector, normal: Vector, edge: float) -> Matrix:
    """Corners of a cube with the center of its front face at a point, front ones first, (8, 3)."""
    away = _away(frame, point, normal)
    face = square_corners(frame, point, away, edge)
    return np.vstack([face, face + edge * away])


def square_corners(frame: Frame, point: Vector, normal: Vector, edge: float) -> Matrix:
    """Corners of a square centered at a point, aligned with the image axes, of shape (4, 3)."""
    away = _away(frame, point, normal)
    across = frame.right - (frame.right @ away) * away
    across /= math.sqrt(across @ across)
    (a, b, c) = away.tolist()
    (x, y, z) = across.tolist()
    along = (b * z - c * y, c * x - a * z, a * y - b * x)
    square: Matrix = point + edge * _CORNERS @ np.array([(x, y, z), along])
    return square


def _corner_pixels(
    frame: Frame, point: Vector, normal: Vector, edge: float
) -> npt.NDArray[np.float64] | None:
    """A cube's corners in the image, of shape (8, 2); None if one is not in front of the camera."""
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
    """Centroid and area of the convex hull of points, of shape (n, 2).

    The points are moved to the origin first, because OpenCV's moments are cubic in the coordinates,
    in single precision.
    """
    origin = pixels.mean(axis=0)
    hull = cv2.convexHull((pixels - origin).astype(np.float32))
    moments = cv2.moments(hull)
    area = max(moments["m00"], 1e-9)
    return origin[0] + moments["m10"] / area, origin[1] + moments["m01"] / area, area


class RunningMean:
    """A running mean of views, each weighted by the inverse square of its doubt.

    Errors of views from one viewpoint are systematic: doubts are averaged like values, and a
    hundred poor views are no better than one.

    Args:
        size: Number of values of a view.

    Attributes:
        value: Mean of the views, of shape (size,).
        doubt: Possible error of the mean, in the unit of the views' doubts.
    """

    def __init__(self, size: int) -> None:
        self.value: Vector = np.zeros(size)
        self.doubt = 0.0
        self._weight = 0.0

    def forget(self) -> None:
        """Reset: the next view replaces the mean."""
        self._weight = 0.0

    def take(self, value: Vector, doubt: float, frames: int) -> None:
        """Add a view.

        Args:
            value: Values of the view, of shape (size,).
            doubt: Possible error of the view, above 0.
            frames: Length of the mean's memory, in views as good as this one.
        """
        weight = doubt**-2
        self._weight = max(self._weight, min(self._weight + weight, frames * weight))
        share = weight / self._weight
        self.value = self.value + share * (value - self.value)
        self.doubt += share * (doubt - self.doubt)


# Localizers


PIXEL_SIGMA = 0.07
"""Standard deviation of a centroid in pixels; with both renderers 0.03 to 0.07 were measured."""

_MIN_SIGMA_M = 1e-5
_MIN_SLOPE = 0.05  # minimum cosine between a line of sight and the plane's normal
_CUT_OFF = 0.3  # relative uncertainty of the depth by size, if the image border cuts off a part


class LocalizationError(DualArmError):
    """The line of sight does not lead to a point in the world."""


@dataclass(frozen=True, eq=False)
class Sighting:
    """Position of a target in the world by one image.

    Args:
        stamp: Simulated time of the exposure in s.
        point: Position in the world, of shape (3,), m.
        sigma: Standard deviation along x, y, z, of shape (3,), m.
        side: Square root of the visible area, m.
        camera: Pose of the camera at the exposure.
    """

    stamp: float
    point: Vector
    sigma: Vector
    side: float
    camera: Pose


class Localizer(ABC):
    """Determines the depth of a detected target, which a single image does not show.

    The default methods are those of a localizer that learns nothing and knows no shape.
    """

    @abstractmethod
    def locate(self, detection: Detection, frame: Frame) -> Sighting:
        """Locate a detected target in the world.

        Raises:
            LocalizationError: The line of sight does not lead to a point.
        """

    def meet(self, face: Detection, frame: Frame) -> Sighting:
        """Like `locate`, for a detection that is already corrected to the front face."""
        return self.locate(face, frame)

    def learn(self, detection: Detection, frame: Frame) -> bool:  # noqa: ARG002 - an option
        """Learn from a detection that certainly shows the whole target.

        Returns:
            Whether previous sightings have moved: `relocate` returns them corrected.
        """
        return False

    def relocate(self, sighting: Sighting) -> Sighting:
        """Correct a previous sighting by what is known now."""
        return sighting

    def forget(self) -> None:  # noqa: B027 - an option
        """Discard everything learned: it was not the whole target."""

    @property
    def knows_shape(self) -> bool:
        """Whether the shape is known, and with it the appearance from other directions."""
        return False

    @abstractmethod
    def corners(self, point: Vector, frame: Frame) -> Matrix:
        """Extreme points of a target at ``point`` in the world, of shape (n, 3), m."""

    def doubt(self, point: Vector, frame: Frame) -> float:  # noqa: ARG002 - an option
        """Possible relative error of the side, and so of the depth, of a target at ``point``."""
        return 0.0


@dataclass(frozen=True, eq=False)
class PlaneLocalizer(Localizer):
    """Localizes targets on a known plane.

    Args:
        point: Any point of the plane, of shape (3,), m.
        normal: Unit vector, of shape (3,).
    """

    point: Vector
    normal: Vector

    def locate(self, detection: Detection, frame: Frame) -> Sighting:
        """Intersect the line of sight with the plane; see `Localizer.locate`."""
        ray = frame.ray(detection.centroid_px)
        slope = float(self.normal @ ray)
        if abs(slope) < _MIN_SLOPE * math.sqrt(ray.dot(ray)):
            raise LocalizationError("the camera looks along the plane of the target")
        depth = float(self.normal @ (self.point - frame.pose.position)) / slope
        if depth <= 0.0:
            raise LocalizationError("the plane of the target is behind the camera")
        across = depth / frame.focal_px
        sigma = across * _sigma_px(frame) * self._along
        return Sighting(
            detection.stamp,
            frame.pose.position + depth * ray,
            np.maximum(sigma, _MIN_SIGMA_M),
            math.sqrt(detection.area_px) * across,
            frame.pose,
        )

    @cached_property
    def _along(self) -> Vector:
        """Length of the projection of each world axis to the plane, of shape (3,)."""
        along: Vector = np.sqrt(np.maximum(1.0 - np.square(self.normal), 0.0))
        return along

    def relocate(self, sighting: Sighting) -> Sighting:
        """Move a sighting along its line of sight to this plane."""
        eye = sighting.camera.position
        line = sighting.point - eye
        farther = float(self.normal @ (self.point - eye)) / float(self.normal @ line)
        return replace(
            sighting,
            point=eye + farther * line,
            sigma=farther * sighting.sigma,
            side=farther * sighting.side,
        )

    def corners(self, point: Vector, frame: Frame) -> Matrix:  # noqa: ARG002 - see `Localizer`
        """The point alone."""
        return point[None]


@dataclass(frozen=True)
class SizeLocalizer(Localizer):
    """Localizes targets of a known size.

    Args:
        side: Square root of the outline's area in m: a cube's edge, a ball's radius times √π.
    """

    side: float

    def locate(self, detection: Detection, frame: Frame) -> Sighting:
        """Locate a target along its line of sight by its size; see `Localizer.locate`."""
        side_px = _side_px(detection)
        depth = frame.focal_px * self.side / side_px
        across = _sigma_px(frame) * depth / frame.focal_px
        # The uncertainty of the area of a square of n by n pixels is that of its 4 n edge pixels.
        along = PIXEL_SIGMA * frame.stride * depth / side_px
        if detection.touches_border:
            along = _CUT_OFF * depth
        view = frame.pose.turn(np.array((0.0, 0.0, 1.0)))
        sigma = np.sqrt(across**2 + (along**2 - across**2) * np.square(view))
        point = frame.pose.position + depth * frame.ray(detection.centroid_px)
        return Sighting(detection.stamp, point, sigma, self.side, frame.pose)

    def corners(self, point: Vector, frame: Frame) -> Matrix:
        """Corners of a square that faces the camera."""
        return square_corners(frame, point, frame.pose.turn(np.array((0.0, 0.0, 1.0))), self.side)


class FacingCubeLocalizer(Localizer):
    """Localizes a cube of known size at any depth, with a face that stays parallel to a plane.

    Each view is located by its size, corrected for the flanks, which are assumed to have the color.
    A view of other proportions, of a part of the cube or of a cube that has turned, does not count
    as one of the whole (`knows_shape`): the tracker then keeps the predicted depth.

    Args:
        normal: Unit vector, normal to the face, of shape (3,); None for a target that shows any
            camera that faces it the same outline, as a ball does.
        edge: Length of an edge, m.
    """

    def __init__(self, normal: Vector | None, edge: float) -> None:
        self._normal = normal
        self._by_size = SizeLocalizer(edge)

    def _normal_in(self, frame: Frame) -> Vector:
        """Normal of the face, or the optical axis."""
        if self._normal is not None:
            return self._normal
        return frame.pose.turn(np.array((0.0, 0.0, 1.0)))

    def locate(self, detection: Detection, frame: Frame) -> Sighting:
        """Locate the center of the front face; see `Localizer.locate`."""
        if detection.touches_border:
            return self.meet(detection, frame)
        edge = self._by_size.side
        face = detection
        for _ in range(_FLANK_ITERATIONS):
            point = self.meet(face, frame).point
            face = front_face(detection, frame, point, self._normal_in(frame), edge, flanks=1.0)
        return self.meet(face, frame)

    def meet(self, face: Detection, frame: Frame) -> Sighting:
        """Locate a detection of the front face by its size."""
        return self._by_size.locate(face, frame)

    @property
    def knows_shape(self) -> bool:
        """Always: a cube."""
        return True

    def corners(self, point: Vector, frame: Frame) -> Matrix:
        """Corners of the cube."""
        return cube_corners(frame, point, self._normal_in(frame), self._by_size.side)

    def doubt(self, point: Vector, frame: Frame) -> float:
        """Possible effect of the flanks: it is unknown whether they have the color."""
        return flank_share(frame, point, self._normal_in(frame), self._by_size.side)


def _side_px(detection: Detection) -> float:
    """Square root of the area; if the image cuts the target off, its longer edge."""
    root = math.sqrt(detection.area_px)
    if not detection.touches_border:
        return root
    left, top, right, bottom = detection.bounds_px
    return max(root, right - left, bottom - top)


def _sigma_px(frame: Frame) -> float:
    """Standard deviation of a centroid along x and y, by pixels and by the camera's shake."""
    return math.hypot(PIXEL_SIGMA * frame.stride, frame.noise_px)


# Plane of known direction, at a depth by the target's size

_PLANE_MEMORY_FRAMES = 30
_FLANK_ITERATIONS = 2
_KNOWN_AFTER_FRAMES = 10
_KNOWN_TO = 0.01  # relative uncertainty of the depth
_MIN_MOVE = 0.002  # relative change of the mean depth that moves the plane


class PlaneOfSizeLocalizer(Localizer):
    """Localizes targets of known size on a plane whose direction is known, but not its position.

    The position is a running mean over the last ``_PLANE_MEMORY_FRAMES`` detections, which is much
    steadier than that of one image. Frontal views of a cube count far more than views that may show
    flanks: its size does not show whether these are dark or occluded. All sightings are
    on one plane until the mean has moved noticeably; then previous sightings move, too, as a better
    known depth is not a motion of the target.

    Args:
        normal: Unit vector of the plane, of shape (3,).
        side: Square root of the outline's area in m, as for `SizeLocalizer`.
        cube: Whether the target is a cube with a face parallel to the plane. Then the visible
            flanks are corrected for, and the center of the front face is located.
    """

    def __init__(self, normal: Vector, side: float, *, cube: bool = False) -> None:
        self._normal = np.array(normal, dtype=float)
        self._by_size = SizeLocalizer(side)
        self._cube = cube
        self._place = RunningMean(1)
        self._plane: PlaneLocalizer | None = None
        self._count = 0
        self._faced: tuple[Detection, Detection] | None = None

    def locate(self, detection: Detection, frame: Frame) -> Sighting:
        """Intersect the line of sight with the plane; see `Localizer.locate`."""
        return self.meet(self._face(detection, frame), frame)

    def meet(self, face: Detection, frame: Frame) -> Sighting:
        """Intersect with the plane once it is known, until then locate by size."""
        if self._count == 0 or self._plane is None:
            return self._by_size.locate(face, frame)
        return self._plane.locate(face, frame)

    def learn(self, detection: Detection, frame: Frame) -> bool:
        """Add the depth by its size to the mean, unless the image border cuts it off."""
        if detection.touches_border:
            return False
        found = self._by_size.locate(self._face(detection, frame), frame)
        grain = PIXEL_SIGMA * frame.stride / math.sqrt(detection.area_px)
        doubt = grain + self.doubt(found.point, frame)
        self._place.take(self._normal[None] @ found.point, doubt, _PLANE_MEMORY_FRAMES)
        self._count += 1
        self._faced = None
        return self._hold(frame)

    def relocate(self, sighting: Sighting) -> Sighting:
        """Move a sighting to the plane as it is known now; see `Localizer.relocate`."""
        return sighting if self._plane is None else self._plane.relocate(sighting)

    def forget(self) -> None:
        """Discard the position of the plane."""
        self._place.forget()
        self._count = 0
        self._faced = None

    @property
    def knows_shape(self) -> bool:
        """Whether it is a cube."""
        return self._cube

    def corners(self, point: Vector, frame: Frame) -> Matrix:
        """Corners of the cube, or of a square in the plane."""
        of_shape = cube_corners if self._cube else square_corners
        return of_shape(frame, point, self._normal, self._by_size.side)

    def doubt(self, point: Vector, frame: Frame) -> float:
        """Possible effect of a cube's flanks: it is unknown whether they have the color."""
        if not self._cube:
            return 0.0
        return flank_share(frame, point, self._normal, self._by_size.side)

    def _hold(self, frame: Frame) -> bool:
        """Move the plane to the mean if that has changed noticeably; returns whether it did."""
        place = self._place.value[0] * self._normal
        known = self._plane
        if known is not None:
            moved, depth = (self._normal @ (place - p) for p in (known.point, frame.pose.position))
            if abs(moved) <= _MIN_MOVE * abs(depth):
                return False
        self._plane = PlaneLocalizer(place, self._normal)
        return known is not None

    def _face(self, detection: Detection, frame: Frame) -> Detection:
        if not self._cube:
            return detection
        # Cached, since a detection is usually located and then learned from.
        if self._faced is None or self._faced[0] is not detection:
            self._faced = detection, self._without_flanks(detection, frame)
        return self._faced[1]

    def _without_flanks(self, detection: Detection, frame: Frame) -> Detection:
        """Correct for flanks iteratively; a third iteration would change micrometers."""
        # Until the plane is known, a larger area may mean a smaller depth or visible flanks.
        known = self._count >= _KNOWN_AFTER_FRAMES and self._place.doubt <= _KNOWN_TO
        flanks = None if known else 1.0
        corrected = detection
        for _ in range(_FLANK_ITERATIONS):
            point = self.meet(corrected, frame).point
            corrected = front_face(
                detection, frame, point, self._normal, self._by_size.side, flanks=flanks
            )
        return corrected


# Plane of guessed depth

_MEMORY_S = 2.0  # three legs of the slowest oscillation of an arm
_LEGS = 3  # to, fro and to: a single overshoot makes only two
_LEG_M = 0.006  # shorter legs are not significant
_SLOPE = 0.1  # minimum magnitude of a significant negative slope
_EXPLAINED = 0.6  # minimum share of the apparent motion that the slope must explain
_NEAREST = 1.0 / 3.0  # lower limit of the depth, as a fraction of the guess
_CAPACITY = 256  # initial capacity in sightings


class _RecentViews:
    """Recent camera positions and lines of sight, contiguous in memory, so that views suffice.

    Attributes:
        eyes: Positions of the camera in the world, oldest first, of shape (n, 3), m.
        lines: Lines of sight per meter along the plane's normal, of shape (n, 3).
    """

    def __init__(self) -> None:
        self._begin = 0
        self._end = 0
        self._stamps = np.empty(_CAPACITY)
        self._eyes, self._lines = np.empty((2, _CAPACITY, 3))
        self.eyes = self._eyes[:0]
        self.lines = self._lines[:0]

    def append(self, stamp: float, eye: Vector, line: Vector) -> None:
        """Add a view at a time in s, and drop those that are too old by then."""
        if self._end == len(self._stamps):
            self._make_room()
        end = self._end
        self._stamps[end] = stamp
        self._eyes[end] = eye
        self._lines[end] = line
        self._end = end + 1
        while self._stamps[self._begin] < stamp - _MEMORY_S:
            self._begin += 1
        kept = slice(self._begin, self._end)
        self.eyes = self._eyes[kept]
        self.lines = self._lines[kept]

    def _make_room(self) -> None:
        """Move the views to the front of new arrays, which are larger if needed."""
        kept = slice(self._begin, self._end)
        count = self._end - self._begin
        room = max(len(self._stamps), 4 * count)
        stamps = self._stamps[kept]
        eyes = self._eyes[kept]
        lines = self._lines[kept]
        self._stamps = np.empty(room)
        self._eyes, self._lines = np.empty((2, room, 3))
        self._stamps[:count] = stamps
        self._eyes[:count] = eyes
        self._lines[:count] = lines
        self._begin = 0
        self._end = count


class EstimatedPlaneLocalizer(Localizer):
    """Localizes targets on a plane of which only the normal is known, starting from a guess.

    With an assumed depth z₀ instead of the true one z, a camera at c locates a target at p at
    c + (z₀/z) (p - c). A target that is nearer than assumed seems to move against the camera,
    z₀/z - 1 times as far; visual servoing with prediction then oscillates with growing amplitude.
    No real target moves against an oscillating camera, so the slope of this apparent motion
    determines the depth. A target that is farther away than assumed makes servoing slow but not
    unstable, and is indistinguishable from one that moves along with the camera.

    Args:
        eye: Position of the camera, of shape (3,), m.
        ahead: Guessed point of the plane in the middle of its image, of shape (3,), m.
        normal: Unit vector, of shape (3,).

    Attributes:
        share: Depth estimated now as a fraction of the guess.
    """

    def __init__(self, eye: Vector, ahead: Vector, normal: Vector) -> None:
        self._eye = eye
        self._guess = ahead - eye
        self._normal = normal
        self.share = 1.0
        self._past = _RecentViews()
        self._plane = PlaneLocalizer(ahead, normal)
        # Cached, since a detection is usually located and then learned from.
        self._located: tuple[Detection, Frame, Sighting] | None = None

    @property
    def ahead(self) -> Vector:
        """The point in the middle of the initial image, at the depth estimated now."""
        return self._plane.point

    def locate(self, detection: Detection, frame: Frame) -> Sighting:
        """Intersect the line of sight with the estimated plane; see `Localizer.locate`."""
        known = self._located
        if known is not None and known[0] is detection and known[1] is frame:
            return known[2]
        sighting = self._plane.locate(detection, frame)
        self._located = detection, frame, sighting
        return sighting

    def relocate(self, sighting: Sighting) -> Sighting:
        """Move a sighting to the plane as estimated now."""
        return self._plane.relocate(sighting)

    def learn(self, detection: Detection, frame: Frame) -> bool:
        """Move the plane nearer if the target seems to move against an oscillating camera."""
        eye = frame.pose.position
        line = self.locate(detection, frame).point - eye
        self._past.append(detection.stamp, eye, line / abs(float(self._normal @ line)))
        slope = self._slope()
        if slope > -_SLOPE:
            return False
        share = max(self.share / (1.0 - slope), _NEAREST)
        if share >= self.share:
            return False
        self.share = share
        self._located = None
        self._plane = PlaneLocalizer(self._eye + share * self._guess, self._normal)
        return True

    def corners(self, point: Vector, frame: Frame) -> Matrix:
        """The point alone."""
        return self._plane.corners(point, frame)

    def _slope(self) -> float:
        """Apparent motion of the target per meter of camera oscillation; 0 if insignificant."""
        past = self._past
        if len(past.eyes) < 2 * _LEGS:
            return 0.0
        turns = _kernels().last_swing(past.eyes, _LEG_M, _LEGS)
        if not len(turns):
            return 0.0
        depth = self.share * abs(float(self._normal @ self._guess))
        eyes = past.eyes[turns]
        legs = np.diff(eyes, axis=0)
        moved = legs + depth * np.diff(past.lines[turns], axis=0)
        # A target that moves once while the camera swings is not against it on every leg.
        if ((moved * legs).sum(axis=1) > -_SLOPE * (legs * legs).sum(axis=1)).any():
            return 0.0
        begin = turns[0]
        slope, explained = _kernels().slope_against(past.eyes[begin:], past.lines[begin:], depth)
        return slope if explained > _EXPLAINED else 0.0


@cache
def _kernels() -> ModuleType:
    """The compiled kernels, imported once: an import statement costs as much as a kernel."""
    from bt_dualarm.perception import perception_kernels

    return perception_kernels


def warm_up_localization() -> None:
    """Compile the kernels of oscillation."""
    places = np.zeros((2 * _LEGS, 3))
    places[:, 0] = np.arange(len(places))
    _kernels().last_swing(places, _LEG_M, _LEGS)
    _kernels().slope_against(places, places, 1.0)
