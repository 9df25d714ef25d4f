"""From a detection to a point in the world, on planes that are known or estimated."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass, replace
from functools import cache, cached_property
from types import ModuleType

import cv2
import numpy as np
import numpy.typing as npt

from bt_dualarm.core.errors import DualArmError
from bt_dualarm.core.pose import Matrix, Pose, Vector
from bt_dualarm.perception.detection import Detection
from bt_dualarm.sim.frame import Frame

# Perspective bias of a cube: beside its front face a camera sees a part of its flanks.
#
# While a cube's offset from the camera's axis is below half its edge, the front face hides the
# rest. Beyond that a flank becomes visible and moves the centroid of the outline toward the axis:
# for a 50 mm cube at 0.35 m by 0.4, 1.6 and 4.8 mm at 30, 50 and 100 mm. The rough position of the
# cube determines which part of the outline is flank, and so the center and area of the front face.
# A dark flank does not have the color and causes no bias; the area shows how much of it has.


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
        point: Rough center of the front face in the world, of shape (3,), m; an error of a
            centimeter changes the result by a tenth of that.
        normal: Normal of the front face, either way round, of shape (3,); the cube's edges are
            taken as parallel to the image as far as that allows.
        edge: Length of an edge in m.
        flanks: Share of the flanks that has the color; by default what the area says, which
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
    # Centers weigh by area, so the shift by a share of the flanks is not that share of the shift.
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
    """Corners of a cube whose front face has its center at a point, (8, 3), those first."""
    away = _away(frame, point, normal)
    face = square_corners(frame, point, away, edge)
    return np.vstack([face, face + edge * away])


def square_corners(frame: Frame, point: Vector, normal: Vector, edge: float) -> Matrix:
    """Corners of a square centerd at a point, along the image, of shape (4, 3)."""
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
    """Center and area of the convex hull of points of shape (n, 2).

    The points are moved to the origin first: OpenCV's moments of an outline are cubic in single
    precision coordinates.
    """
    origin = pixels.mean(axis=0)
    hull = cv2.convexHull((pixels - origin).astype(np.float32))
    moments = cv2.moments(hull)
    area = max(moments["m00"], 1e-9)
    return origin[0] + moments["m10"] / area, origin[1] + moments["m01"] / area, area


class RunningMean:
    """A mean over the last good views, each weighed by the inverse square of its doubt.

    What is wrong with a view from one place stays wrong in the next from there: doubts are
    averaged like values, and a hundred poor views are no better than one.

    Args:
        size: Count of numbers that a view tells.

    Attributes:
        value: Mean of the views, of shape (size,).
        doubt: Error that the mean may have, in the unit of the doubts that were taken in.
    """

    def __init__(self, size: int) -> None:
        self.value: Vector = np.zeros(size)
        self.doubt = 0.0
        self._weight = 0.0

    def forget(self) -> None:
        """Let the next view stand alone."""
        self._weight = 0.0

    def take(self, value: Vector, doubt: float, frames: int) -> None:
        """Take in what one more view tells.

        Args:
            value: Numbers of the view, of shape (size,).
            doubt: Error that the view may have, above 0.
            frames: Number of views as good as this one after which the first is forgotten.
        """
        weight = doubt**-2
        self._weight = max(self._weight, min(self._weight + weight, frames * weight))
        share = weight / self._weight
        self.value = self.value + share * (value - self.value)
        self.doubt += share * (doubt - self.doubt)


# Localization of a detection in the world, by the camera's pose at the exposure.
#
# The located point is the center of the visible outline: for a ball its center, for a cube that
# faces the camera the center of its front face. `PlaneOfSizeLocalizer` locates a target of unknown
# depth.


PIXEL_SIGMA = 0.07
"""Standard deviation of a centroid in pixels; 0.03 to 0.07 were measured with both renderers."""

_HELD_SIGMA_M = 1e-5
_MIN_SLOPE = 0.05
_CUT_OFF = 0.3  # of the depth: its doubt where the image cuts off a part of what has a known size


class LocalizationError(DualArmError):
    """The line of sight does not lead to a point of the world."""


@dataclass(frozen=True, eq=False)
class Sighting:
    """A target in the world.

    Args:
        stamp: Simulated time of the exposure in s.
        point: Position in the world, of shape (3,), m.
        sigma: Standard deviation along x, y, z, of shape (3,), m.
        side: Root of the visible area, m.
        camera: Pose of the camera at the exposure.
    """

    stamp: float
    point: Vector
    sigma: Vector
    side: float
    camera: Pose


class Localizer(ABC):
    """Adds to a detection what one image cannot tell: how far away the target is.

    By default one that learns nothing and knows no shape.
    """

    @abstractmethod
    def locate(self, detection: Detection, frame: Frame) -> Sighting:
        """The target in the world.

        Raises:
            LocalizeError: The line of sight leads nowhere.
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
        """Whether the shape is known by which one object looks different from elsewhere."""
        return False

    @abstractmethod
    def corners(self, point: Vector, frame: Frame) -> Matrix:
        """Outermost points in the world of a target at ``point``, of shape (n, 3), m."""

    def doubt(self, point: Vector, frame: Frame) -> float:  # noqa: ARG002 - none is known of
        """Share by which the side, and so the depth, of one at ``point`` may be misjudged."""
        return 0.0


@dataclass(frozen=True, eq=False)
class PlaneLocalizer(Localizer):
    """The target stays on a known plane.

    Args:
        point: Any point of the plane, of shape (3,), m.
        normal: Unit vector, of shape (3,).
    """

    point: Vector
    normal: Vector

    def locate(self, detection: Detection, frame: Frame) -> Sighting:
        """Where the line of sight meets the plane; see ``Localizer``."""
        ray = frame.ray(detection.centroid_px)
        slope = float(self.normal @ ray)
        if abs(slope) < _MIN_SLOPE * math.sqrt(ray.dot(ray)):
            raise LocalizationError("the camera looks along the plane of the target")
        depth = float(self.normal @ (self.point - frame.pose.position)) / slope
        if depth <= 0.0:
            raise LocalizationError("the plane of the target lies behind the camera")
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

    def corners(self, point: Vector, frame: Frame) -> Matrix:  # noqa: ARG002 - see ``Localizer``
        """The point alone."""
        return point[None]


@dataclass(frozen=True)
class SizeLocalizer(Localizer):
    """The target has a known size; what is beside its front face is not known.

    Args:
        side: Root of its outline's area in m: a cube's edge, a ball's radius times root of pi.
    """

    side: float

    def locate(self, detection: Detection, frame: Frame) -> Sighting:
        """Along the line of sight, as far as the size says; see ``Localizer``."""
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


# Plane of known direction whose depth follows from the target's size


_PLANE_MEMORY_FRAMES = 30
_FLANK_ROUNDS = 2
_KNOWN_AFTER_FRAMES = 10
_KNOWN_TO = 0.01  # share of the depth
_HELD_TO = 0.002  # of the depth, too: a mean that has gone no farther leaves the plane where it is


class PlaneOfSizeLocalizer(Localizer):
    """The target stays on a plane of known direction, whose place its known size tells.

    The place is a running mean over the last ``_PLANE_MEMORY_FRAMES`` that were learned: much
    steadier than one image's. A cube seen from ahead counts for far more than one whose flanks may
    be in view: whether they are in the dark, or stand on something, its size does not tell. All is
    located on one plane until the mean has gone elsewhere: then all of it has been there before,
    too, as a depth that is better known is no motion of the target.

    Args:
        normal: Unit vector of the plane, of shape (3,).
        side: Root of its outline's area in m, as for ``SizeLocalizer``.
        cube: Whether the target is a cube with a face parallel to the plane: what is seen of its
            flanks is allowed for, and the center of the front face located.
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
        """Where the line of sight meets the plane; see ``Localizer``."""
        return self.meet(self._face(detection, frame), frame)

    def meet(self, face: Detection, frame: Frame) -> Sighting:
        """On the plane, as soon as it is known; see ``Localizer``."""
        if self._count == 0 or self._plane is None:
            return self._by_size.locate(face, frame)
        return self._plane.locate(face, frame)

    def learn(self, detection: Detection, frame: Frame) -> bool:
        """Take its size into the mean; one that is cut off says nothing."""
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
        """On the plane as it is known now; see ``Localizer``."""
        return sighting if self._plane is None else self._plane.relocate(sighting)

    def forget(self) -> None:
        """Drop where the plane is."""
        self._place.forget()
        self._count = 0
        self._faced = None

    @property
    def knows_shape(self) -> bool:
        """Whether it is a cube."""
        return self._cube

    def corners(self, point: Vector, frame: Frame) -> Matrix:
        """Those of the cube, or of a square in the plane."""
        of_shape = cube_corners if self._cube else square_corners
        return of_shape(frame, point, self._normal, self._by_size.side)

    def doubt(self, point: Vector, frame: Frame) -> float:
        """What a cube's flanks may add: which of them have its color is not known."""
        if not self._cube:
            return 0.0
        return flank_share(frame, point, self._normal, self._by_size.side)

    def _hold(self, frame: Frame) -> bool:
        """Put the plane where the mean is by now, if it is elsewhere; whether it was."""
        place = self._place.value[0] * self._normal
        known = self._plane
        if known is not None:
            moved, depth = (self._normal @ (place - p) for p in (known.point, frame.pose.position))
            if abs(moved) <= _HELD_TO * abs(depth):
                return False
        self._plane = PlaneLocalizer(place, self._normal)
        return known is not None

    def _face(self, detection: Detection, frame: Frame) -> Detection:
        if not self._cube:
            return detection
        # What was located is learned from next, most times: once is enough until something is.
        if self._faced is None or self._faced[0] is not detection:
            self._faced = detection, self._without_flanks(detection, frame)
        return self._faced[1]

    def _without_flanks(self, detection: Detection, frame: Frame) -> Detection:
        """Better each time, as the place gets better; a third would change micrometres."""
        # Until the position of the plane is known, the area cannot tell near from flanks in view.
        known = self._count >= _KNOWN_AFTER_FRAMES and self._place.doubt <= _KNOWN_TO
        flanks = None if known else 1.0
        corrected = detection
        for _ in range(_FLANK_ROUNDS):
            point = self.meet(corrected, frame).point
            corrected = front_face(
                detection, frame, point, self._normal, self._by_size.side, flanks=flanks
            )
        return corrected


# Plane of guessed depth: an oscillating camera reveals a wrong guess


_MEMORY_S = 2.0  # three legs of the slowest swing of an arm
_LEGS = 3  # to and fro and to again: a tool that once comes too far makes two
_LEG_M = 0.006  # shorter ones tell nothing
_SLOPE = 0.1  # by which it has to be below 0
_EXPLAINED = 0.6  # share of what the target seems to move that the slope has to explain
_NEAREST = 1.0 / 3.0  # of the guess
_ROOM = 256  # sightings for which there is room at first


class _Past:
    """What was seen of late, one after the other in memory: what looks at all of it copies nothing.

    Attributes:
        eyes: Positions of the camera in the world, of shape (n, 3), m; the oldest first.
        lines: Ways to the target for each meter into the plane, of shape (n, 3).
    """

    def __init__(self) -> None:
        self._begin = 0
        self._end = 0
        self._stamps = np.empty(_ROOM)
        self._eyes, self._lines = np.empty((2, _ROOM, 3))
        self.eyes = self._eyes[:0]
        self.lines = self._lines[:0]

    def append(self, stamp: float, eye: Vector, line: Vector) -> None:
        """Enter what was exposed at a time in s, and forget what is too old by then."""
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
        """Move what is kept to the front, of longer arrays where it fills half of these."""
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
    """The target stays on a plane, of which only the normal is known.

    Believed at the depth z₀ and being at z, a target at p is located at c + (z₀/z) (p - c) by a
    camera at c. If it is nearer than believed, it seems to move against the camera, z₀/z - 1 times
    as far; a servo that predicts where it will be then swings, ever more. No target moves against a
    camera that swings to and fro, so there the slope tells the depth. One that is farther away than
    believed makes a servo slow, but not unstable, and cannot be told from one that moves along.

    Args:
        eye: Position of the camera, of shape (3,), m.
        ahead: Point of the plane in the middle of its image, as guessed, of shape (3,), m.
        normal: Unit vector, of shape (3,).
    """

    def __init__(self, eye: Vector, ahead: Vector, normal: Vector) -> None:
        self._eye = eye
        self._way = ahead - eye
        self._normal = normal
        self._share = 1.0
        self._past = _Past()
        self._plane = PlaneLocalizer(ahead, normal)
        # What was located is learned from next, most times: once is enough.
        self._located: tuple[Detection, Frame, Sighting] | None = None

    @property
    def ahead(self) -> Vector:
        """The point that was in the middle of the image, at the depth that is believed now."""
        return self._plane.point

    def locate(self, detection: Detection, frame: Frame) -> Sighting:
        """Where the line of sight meets the plane as estimated; see ``Localizer``."""
        known = self._located
        if known is not None and known[0] is detection and known[1] is frame:
            return known[2]
        sighting = self._plane.locate(detection, frame)
        self._located = detection, frame, sighting
        return sighting

    def relocate(self, sighting: Sighting) -> Sighting:
        """Where its line of sight meets the plane as estimated now."""
        return self._plane.relocate(sighting)

    def learn(self, detection: Detection, frame: Frame) -> bool:
        """Bring the plane nearer if the target seems to move against a camera that swings."""
        eye = frame.pose.position
        line = self.locate(detection, frame).point - eye
        self._past.append(detection.stamp, eye, line / abs(float(self._normal @ line)))
        slope = self._slope()
        if slope > -_SLOPE:
            return False
        share = max(self._share / (1.0 - slope), _NEAREST)
        if share >= self._share:
            return False
        self._share = share
        self._located = None
        self._plane = PlaneLocalizer(self._eye + share * self._way, self._normal)
        return True

    def corners(self, point: Vector, frame: Frame) -> Matrix:
        """The point alone."""
        return self._plane.corners(point, frame)

    def _slope(self) -> float:
        """How far the target moves for each meter of a camera that swings; 0 if that is unsure."""
        past = self._past
        if len(past.eyes) < 2 * _LEGS:
            return 0.0
        begin = _kernels().last_swing(past.eyes, _LEG_M, _LEGS)
        if begin < 0:
            return 0.0
        depth = self._share * abs(float(self._normal @ self._way))
        slope, explained = _kernels().slope_against(past.eyes[begin:], past.lines[begin:], depth)
        return slope if explained > _EXPLAINED else 0.0


@cache
def _kernels() -> ModuleType:
    """The kernels of swinging cameras: an import statement costs as much as they do."""
    from bt_dualarm.perception import tracking_kernels

    return tracking_kernels


def warm_up_localization() -> None:
    """Have all kernels of swinging cameras compiled."""
    places = np.zeros((2 * _LEGS, 3))
    places[:, 0] = np.arange(len(places))
    _kernels().last_swing(places, _LEG_M, _LEGS)
    _kernels().slope_against(places, places, 1.0)
