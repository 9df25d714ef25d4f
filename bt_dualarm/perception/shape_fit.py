"""Pose of an object of known shape from its outlines in several images, with covariance.

`KnownShape` is the declared shape: its outline, resting orientations and symmetries. `outlines`
extracts outlines with subpixel accuracy from images of a camera at rest. `ShapeFitter` minimizes
the distances of the outlines' points from the projected shape (bundle adjustment: Triggs et al.,
2000) over the pose of the object and the errors of the camera: its mount, its focal length, and a
constant widening of outlines by the color filter. What the images do not determine of these keeps
its prior uncertainty, which is part of the covariance of the pose.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cache, cached_property
from operator import attrgetter
from typing import TYPE_CHECKING, Final, Literal

import numpy as np
import numpy.typing as npt

from bt_dualarm.core.later import Later
from bt_dualarm.core.pose import Matrix, Pose, Vector
from bt_dualarm.perception.detection import Blob, ColorFilter, Detection, detect_blobs
from bt_dualarm.sim.frame import Frame, Image, JsonList, LazyFrame
from bt_dualarm.sim.object_body import Folds, body_of, half_extents
from bt_dualarm.spec.document import ObjectSpec
from bt_dualarm.spec.shapes import DEFAULT_SIDES
from bt_dualarm.spec.values import ShapeName

if TYPE_CHECKING:
    import cv2
else:
    cv2 = Later("cv2")

_ROUND: Final = 48
"""Points of a circle; their polygon deviates from it by 0.2 % of the radius."""

_AROUND: Final = np.arange(_ROUND) * (2.0 * math.pi / _ROUND)
_COSINES: Final = np.cos(_AROUND)
_SINES: Final = np.sin(_AROUND)

_YAW_STEP: Final = math.radians(15.0)
_AXISYMMETRIC: Final = ("cylinder", "capsule")

_SAME: Final = 1e-6
"""Difference of two edges in m below which they are equal."""

_TILTS: Final = (0.0, 25.0, 50.0)
"""Initial guesses of the tilt of an object that does not lie flat, degrees."""


@dataclass(frozen=True)
class KnownShape:
    """The convex hull of a shape, as an object of a tree file declares it.

    Attributes:
        kind: Kind of shape, which determines the meaning of ``size``; ``hull`` for any other than
            those of `ShapeName`.
        size: Edges of a box; radius and length of a cylinder, or of a capsule without its caps;
            radius of a sphere; distance of the farthest corner of a hull; m.
        hull: Corners of a hull for a farthest distance of 1.
        fold: Number of rotations about the z axis, in a whole turn, of a hull into itself; 0 for
            any rotation.
        flips: Whether half a turn about the x axis brings a hull into itself.
        one_way: Whether such a turn changes the object nevertheless: the opening of a cup does not
            show in its outline. Among poses that look alike, the one with the smallest rotation is
            assumed.
        concave: Whether the outline may be concave, of which only the convex hull is known.
        hull_folds: Symmetry of the hull of a concave shape.
        folds: Symmetry of the object itself, whose outline may have more.
    """

    kind: ShapeName | Literal["hull"]
    size: tuple[float, ...]
    hull: tuple[tuple[float, float, float], ...] = ()
    fold: int = 1
    flips: bool = False
    one_way: bool = False
    concave: bool = False
    hull_folds: Folds = (1, 1, 1)
    folds: Folds = (1, 1, 1)

    @classmethod
    def of(cls, obj: ObjectSpec) -> KnownShape:
        """Shape of a declared object."""
        if obj.shape in ("box", "cylinder", "capsule", "sphere"):
            return cls(obj.shape, obj.size)
        corners = body_of(obj).corners
        far = float(np.linalg.norm(corners, axis=1).max())
        unit = tuple((x, y, z) for x, y, z in (corners / far).tolist())
        if obj.shape in ("compound", "mesh"):
            body = body_of(obj)
            hull = body.hull_folds
            own = body.folds
            if body.is_coaxial:
                flips = hull[0] % 2 == 0
                return cls("hull", (far,), unit, 0, flips, flips and own[0] % 2 > 0, True)
            return cls("hull", (far,), unit, concave=True, hull_folds=hull, folds=own)
        return cls("hull", (far,), unit, *_symmetry(obj))

    @cached_property
    def points(self) -> Matrix:
        """Points whose convex hull is the shape, (n, 3), in its frame; empty for round shapes."""
        if self.kind == "hull":
            scaled: Matrix = self.size[0] * np.array(self.hull)
            return scaled
        if self.kind == "box":
            signs = np.array(list(itertools.product((-0.5, 0.5), repeat=3)))
            corners: Matrix = signs * np.array(self.size)
            return corners
        if self.is_round:
            return np.zeros((0, 3))
        radius, length = self.size
        around = radius * np.column_stack((_COSINES, _SINES, np.zeros(_ROUND)))
        ends = np.array(((0.0, 0.0, -0.5 * length), (0.0, 0.0, 0.5 * length)))
        circles: Matrix = np.vstack((around, around)) + np.repeat(ends, _ROUND, axis=0)
        return circles

    def seen_from(self, eye: Vector, rotation: Matrix) -> Matrix:
        """Points relative to its center whose projection has the shape's outline, (n, 3), m.

        Args:
            eye: Position of the camera relative to the center, world axes, of shape (3,), m.
            rotation: Rotation of the shape in the world, of shape (3, 3).

        Returns:
            Points in the axes of the world.
        """
        if self.is_round:
            centers = self.ball_centers(rotation)
            rings = [self._ring(eye - center) for center in centers[::_ROUND]]
            return centers + np.vstack(rings)
        turned: Matrix = self.points @ rotation.T
        return turned

    @property
    def is_round(self) -> bool:
        """Whether it is a ball or the hull of two, whose outlines determine its outline."""
        return self.kind in ("sphere", "capsule")

    def ball_centers(self, rotation: Matrix) -> Matrix:
        """Center of the ball for each point of `seen_from`, of shape (n, 3), world axes, m."""
        if self.kind == "sphere":
            return np.zeros((_ROUND, 3))
        end = 0.5 * self.size[1] * rotation[:, 2]
        return np.repeat((end, -end), _ROUND, axis=0)

    def _ring(self, eye: Vector) -> Matrix:
        """Outline circle of a ball relative to its center, seen from ``eye``, (n, 3), m."""
        away = float(np.linalg.norm(eye))
        radius = self.size[0]
        toward = eye / max(away, radius * (1.0 + 1e-9))
        side = _crossed(toward, np.eye(3)[int(np.argmin(np.abs(toward)))])
        side /= np.linalg.norm(side)
        sine = min(radius / away, 1.0 - 1e-9)
        ring = np.outer(_COSINES, side) + np.outer(_SINES, _crossed(toward, side))
        circle: Matrix = radius * (sine * toward + math.sqrt(1.0 - sine * sine) * ring)
        return circle

    @property
    def extent(self) -> float:
        """Distance from its center to its farthest point, m."""
        if self.is_round:
            return self.size[0] + 0.5 * sum(self.size[1:])
        return float(np.linalg.norm(self.points, axis=1).max())

    def guesses(self, *, flat: bool) -> list[Matrix]:
        """Rotations in the world, of shape (3, 3), one of which is close to any possible pose.

        Args:
            flat: Whether it lies flat on a level surface.
        """
        if self.kind == "sphere":
            return [np.eye(3)]
        lying = [_about_z(yaw) @ up for up in self._resting_rotations() for yaw in self._yaws(up)]
        if flat:
            return lying
        toward = [_about_z(math.radians(angle)) for angle in range(0, 360, 45)]
        tilts = [
            turn @ _about_x(math.radians(tilt)) @ turn.T
            for tilt in _TILTS
            for turn in (toward if tilt else toward[:1])
        ]
        return [tilt @ rotation for tilt in tilts for rotation in lying]

    def upward(self, rotation: Matrix) -> Vector:
        """The axis of the shape's frame that is closest to the vertical, of shape (3,)."""
        axis = int(np.argmax(np.abs(rotation[2])))
        up: Vector = np.eye(3)[axis] * np.sign(rotation[2, axis])
        return up

    @property
    def spins(self) -> Vector | None:
        """Axis of rotational symmetry in its frame, of shape (3,), if there is one."""
        return np.array((0.0, 0.0, 1.0)) if self._is_axisymmetric else None

    @property
    def _is_axisymmetric(self) -> bool:
        return self.kind in _AXISYMMETRIC or self.fold == 0

    def half_height(self, rotation: Matrix) -> float:
        """Height of its center above its lowest point, m.

        Args:
            rotation: Rotation of the shape in the world, of shape (3, 3).
        """
        if self.kind == "hull":
            return -float((self.points @ rotation[2]).min())
        return float(half_extents(self.kind, self.size, rotation)[2])

    def canonical(self, pose: Pose) -> Pose:
        """The equivalent pose with the smallest rotation from the axes of the world."""
        axes = pose.rotation_matrix
        if self.kind == "sphere":
            return Pose(pose.position, np.array((1.0, 0.0, 0.0, 0.0)))
        if self._is_axisymmetric:
            looks_alike = self.kind != "hull" or self.flips
            up = axes[:, 2] * (np.sign(axes[2, 2]) or 1.0) if looks_alike else axes[:, 2]
            return _pose(pose.position, _least_turn_to(up))
        alike = [axes @ turn for turn in self._symmetries]
        return _pose(pose.position, max(alike, key=lambda one: float(np.trace(one))))

    def angle(self, one: Pose, other: Pose) -> float:
        """Angle between two poses in rad, up to the shape's symmetry."""
        if self.kind == "sphere":
            return 0.0
        first = one.rotation_matrix
        second = other.rotation_matrix
        if self._is_axisymmetric:
            cosine = float(first[:, 2] @ second[:, 2])
            reversible = self.kind != "hull" or (self.flips and not self.one_way)
            cosine = abs(cosine) if reversible else cosine
            return math.acos(min(max(cosine, -1.0), 1.0))
        turns = _group(self.folds) if self.concave else self._symmetries
        if self.one_way:  # of the symmetries of its outline, half turns are none of the object
            turns = turns[: self.fold]
        traces = [float(np.trace(first.T @ second @ turn)) for turn in turns]
        return math.acos(min(max((max(traces) - 1.0) / 2.0, -1.0), 1.0))

    @cached_property
    def _symmetries(self) -> tuple[Matrix, ...]:
        """Rotations of a box, or of a hull that is not a body of revolution, into itself."""
        if self.concave:
            return _group(self.hull_folds)
        if self.kind == "hull":
            about = [_about_z(2.0 * math.pi * k / self.fold) for k in range(self.fold)]
            over = [turn @ _about_x(math.pi) for turn in about] if self.flips else []
            return (*about, *over)  # in this order, see `angle`
        found = []
        for order in itertools.permutations(range(3)):
            if all(abs(self.size[i] - self.size[k]) < _SAME for i, k in enumerate(order)):
                for signs in itertools.product((-1.0, 1.0), repeat=3):
                    turn = np.zeros((3, 3))
                    turn[range(3), order] = signs
                    if np.linalg.det(turn) > 0.0:
                        found.append(turn)
        return tuple(found)

    def _resting_rotations(self) -> list[Matrix]:
        """Rotations in the world, one for each axis of the shape that may be vertical."""
        upright = np.eye(3)
        on_side = _about_x(math.pi / 2)
        on_end = _about_y(math.pi / 2)
        if self.kind == "hull":
            over = _about_x(math.pi)
            ups = [upright, on_end] if self._is_axisymmetric else [upright, on_side, on_end]
            return ups if self.flips else [*ups, *(over @ up for up in ups)]
        if self.kind in _AXISYMMETRIC:
            return [upright, on_end]
        a, b, c = self.size
        rotations = [upright]
        if abs(b - c) > _SAME:
            rotations.append(on_side)
        if abs(a - c) > _SAME and abs(a - b) > _SAME:
            rotations.append(on_end)
        return rotations

    def _yaws(self, up: Matrix) -> list[float]:
        """Distinguishable rotations about the vertical, in steps, rad."""
        if self.kind == "hull":
            upright = abs(up[2, 2]) > 0.5
            whole = 2.0 * math.pi / (self.fold or math.inf) if upright else 2.0 * math.pi
        elif self.kind in _AXISYMMETRIC:
            whole = 0.0 if abs(up[2, 2]) > 0.5 else math.pi
        else:
            level = np.delete(np.array(self.size), int(np.argmax(np.abs(up[2]))))
            whole = math.pi / 2 if abs(level[0] - level[1]) < _SAME else math.pi
        return [step * _YAW_STEP for step in range(max(round(whole / _YAW_STEP), 1))]


@cache
def _group(folds: Folds) -> tuple[Matrix, ...]:
    """All rotations that follow from those about the three axes, the identity first."""
    about = (_about_x, _about_y, _about_z)
    steps = [
        turn(2.0 * math.pi / fold) for turn, fold in zip(about, folds, strict=True) if fold > 1
    ]
    found = [np.eye(3)]
    for one in found:  # which grows meanwhile
        for step in steps:
            turn = one @ step
            whole = np.round(turn)
            turn = np.where(np.abs(turn - whole) < _ROUNDING, whole, turn)
            if np.abs(np.array(found) - turn).max(axis=(1, 2)).min() > _SAME_TURN:
                found.append(turn)
    return tuple(found)


_ROUNDING: Final = 1e-12
_SAME_TURN: Final = 1e-6


def _symmetry(obj: ObjectSpec) -> tuple[int, bool, bool]:
    """`KnownShape.fold`, `flips` and `one_way` of a declared object."""
    if body_of(obj).is_axisymmetric:
        return 0, obj.shape in ("tube", "cup"), obj.shape == "cup"
    if obj.shape == "prism":
        return obj.sides or DEFAULT_SIDES, True, False
    is_square = abs(obj.size[0] - obj.size[1]) < _SAME
    if obj.shape == "ellipsoid":
        return (0 if is_square else 2), True, False
    if obj.shape == "shelf":
        return 1, False, False
    return (4 if is_square else 2), True, True  # a bin, tray or table


def _pose(position: Vector, axes: Matrix) -> Pose:
    matrix = np.eye(4)
    matrix[:3, :3] = axes
    matrix[:3, 3] = position
    return Pose.from_matrix(matrix)


def _least_turn_to(z: Vector) -> Matrix:
    """The smallest rotation that maps the world's z axis to ``z``."""
    x, y, up = z.tolist()
    if up < -1.0 + 1e-9:  # every axis across it is as near
        return _about_x(math.pi)
    share = 1.0 / (1.0 + up)
    return np.array(
        (
            (1.0 - share * x * x, -share * x * y, x),
            (-share * x * y, 1.0 - share * y * y, y),
            (-x, -y, up),
        )
    )


def _about_x(angle: float) -> Matrix:
    c = math.cos(angle)
    s = math.sin(angle)
    return np.array(((1.0, 0.0, 0.0), (0.0, c, -s), (0.0, s, c)))


def _about_y(angle: float) -> Matrix:
    c = math.cos(angle)
    s = math.sin(angle)
    return np.array(((c, 0.0, s), (0.0, 1.0, 0.0), (-s, 0.0, c)))


def _about_z(angle: float) -> Matrix:
    c = math.cos(angle)
    s = math.sin(angle)
    return np.array(((c, -s, 0.0), (s, c, 0.0), (0.0, 0.0, 1.0)))


def _crossed(one: Vector, other: Vector) -> Vector:
    """Cross product of two vectors; `numpy.cross` takes twenty times as long."""
    (a, b, c) = one.tolist()
    (x, y, z) = other.tolist()
    return np.array((b * z - c * y, c * x - a * z, a * y - b * x))


# Outlines

_OVERSAMPLING: Final = 4
"""Samples per pixel along each axis between which an edge is located."""

INSIDE_PX: Final = 0.5 / _OVERSAMPLING
"""Distance in pixels by which the points of an outline, the centers of its outermost samples, are
inside of it."""

_NEXT: Final = np.ones((3, 3), np.uint8)
_NEIGHBORS: Final = np.ones((5, 5), np.uint8)
_NEIGHBORHOOD: Final = (9, 9)
"""Window in pixels over which the background at an edge is averaged."""

_BESIDE: Final = (3, 3)
"""Window in pixels over which the object at an edge is averaged."""

_MAX_POINTS: Final = 160
"""Largest number of points of an outline: more add no information."""


@dataclass(frozen=True, eq=False)
class OutlineView:
    """The outline of one object in an image of a camera at rest.

    Attributes:
        camera: Pose of the camera in the world (x right, y down, z forward), as estimated.
        focal_px: Focal length in pixels.
        edge: Points of the outline relative to the image center, of shape (n, 2), px.
        detection: Detection with its position and area.
        shake_rad: Standard deviation of the rotation of a shaking camera about its x and y axes,
            rad: it shifts the image as a whole.
    """

    camera: Pose
    focal_px: float
    edge: Matrix
    detection: Detection
    shake_rad: float = field(default=0.0, kw_only=True)

    @property
    def is_whole(self) -> bool:
        """Whether the whole object is in the image; if not, ``edge`` is empty."""
        return not self.detection.touches_border

    @property
    def middle(self) -> Vector:
        """Center of the bounding box relative to the image center, of shape (2,), px."""
        middle: Vector = (self.edge.min(axis=0) + self.edge.max(axis=0)) / 2.0
        return middle


def merged(frames: list[Frame]) -> Frame:
    """Average several images of a camera at rest, which reduces noise.

    Args:
        frames: Frames, at least one, of the same region and stride.
    """

    def mean() -> Image:
        exact = np.mean([frame.blocks for frame in frames], axis=0)
        return np.asarray(np.rint(exact), dtype=np.uint8)

    return LazyFrame.of(frames[-1], mean, merges=len(frames))


def outlines(frame: Frame, color: ColorFilter, min_area: float) -> list[OutlineView]:
    """Extract the outlines of all regions of a color, the largest first.

    Args:
        frame: Fully exposed frame, in full resolution.
        color: Filter of the color.
        min_area: Minimum area in square pixels.
    """

    def look() -> JsonList:
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
            shake_rad=frame.shake_rad,
        )
        for edge, seen in frame.answer(f"all outlines {color.name} from {min_area!r} px", look)
    ]
    return sorted(found, key=lambda view: -view.detection.area_px)


_ON_HULL_PX: Final = 0.35
"""Distance from the convex hull of an outline within which its points are on the hull, px: noise
moves points by a fifth of a pixel, and the hull goes through the outermost ones."""


def hulled(view: OutlineView) -> OutlineView:
    """The convex hull of an outline: its points on the hull, and the area within."""
    if not len(view.edge):
        return view
    around = cv2.convexHull(view.edge.astype(np.float32))
    kept = [
        cv2.pointPolygonTest(around, (float(x), float(y)), measureDist=True) <= _ON_HULL_PX
        for x, y in view.edge
    ]
    area = max(float(cv2.contourArea(around)), view.detection.area_px)
    return replace(view, edge=view.edge[kept], detection=replace(view.detection, area_px=area))


def _edge(frame: Frame, blob: Blob) -> Matrix:
    """Contour at half coverage, relative to the image center, of shape (n, 2), px."""
    share = _difference(blob)
    height, width = share.shape
    fine = cv2.resize(
        share, (_OVERSAMPLING * width, _OVERSAMPLING * height), interpolation=cv2.INTER_LINEAR
    )
    inside = (fine > 0.5).astype(np.uint8)
    contours, _ = cv2.findContours(inside, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    contour = max(contours, key=cv2.contourArea).reshape(-1, 2)
    kept = contour[:: max(len(contour) // _MAX_POINTS, 1)]
    corner = np.array(blob.origin) + np.array(frame.region[:2])
    middle = np.array((frame.width, frame.height)) / 2.0
    points: Matrix = (kept + 0.5) / _OVERSAMPLING + corner - middle
    return points


def _difference(blob: Blob) -> npt.NDArray[np.float32]:
    """Color difference of each pixel from the background, relative to that of the object.

    It is 1 inside the contour and 0 farther than a pixel outside; a pixel at the edge is a mixture.
    Unlike the color filter, this includes faces in the shade, which lack the color but differ from
    bright and dark backgrounds alike.
    """
    inside = cv2.erode(blob.filled, _NEXT)
    near = cv2.dilate(blob.filled, _NEXT)
    colors = blob.rgb.astype(np.float32)
    around = (near == 0).astype(np.float32)
    count = cv2.boxFilter(around, -1, _NEIGHBORHOOD, normalize=False)
    total = cv2.boxFilter(colors * around[:, :, None], -1, _NEIGHBORHOOD, normalize=False)
    ground = total / np.maximum(count, 1.0)[:, :, None]
    away = np.linalg.norm(colors - ground, axis=2).astype(np.float32)
    away[near == 0] = 0.0
    # A face in the shade differs less from the ground than a bright face beside it: an edge is at
    # half the difference of the face next to it.
    certain = (inside > 0).astype(np.float32)
    beside = cv2.boxFilter(certain, -1, _BESIDE, normalize=False)
    face = cv2.boxFilter(away * certain, -1, _BESIDE, normalize=False) / np.maximum(beside, 1.0)
    whole = np.where(beside > 0.0, face, cv2.dilate(away, _NEIGHBORS))
    share = np.minimum(away / np.maximum(whole, 1.0), 1.0)
    share[(inside > 0) | (count == 0.0)] = 1.0
    share[near == 0] = 0.0
    return np.asarray(share, dtype=np.float32)


# Residuals

UNKNOWNS: Final = 14
"""Position and rotation of the object (3 + 3), rotation and shift of the mount (3 + 3), focal
length, rim."""

PLACE: Final = slice(0, 3)
TURN: Final = slice(3, 6)
MOUNT_TURN: Final = slice(6, 9)
SHAKE: Final = slice(6, 8)  # a shake acts in one image like a rotation of the mount about x and y
MOUNT_SHIFT: Final = slice(9, 12)
FOCAL: Final = 12
RIM: Final = 13

_NEAREST_M: Final = 0.01
"""Depth in front of the camera below which nothing is visible."""


@dataclass(frozen=True, eq=False)
class OutlineScene:
    """Values of all unknowns of some images of one object.

    Attributes:
        position: Center of the object in the world, of shape (3,), m.
        rotation: Rotation of the object in the world, of shape (3, 3).
        mount_turn: Rotation of the camera in its nominal frame, of shape (3, 3).
        mount_shift: Position of the camera in its nominal frame, of shape (3,), m.
        longer: Relative error of the nominal focal length.
        rim: Pixels by which outlines are wider than the object.
    """

    position: Vector
    rotation: Matrix
    mount_turn: Matrix
    mount_shift: Vector
    longer: float = 0.0
    rim: float = 0.0

    @classmethod
    def believed(cls, position: Vector, rotation: Matrix) -> OutlineScene:
        """An object at a pose, and the nominal camera."""
        return cls(position, rotation, np.eye(3), np.zeros(3))

    def moved(self, step: Vector) -> OutlineScene:
        """The scene after a step in all unknowns, of shape (`UNKNOWNS`,): m, rad, share, px."""
        return replace(
            self,
            position=self.position + step[PLACE],
            rotation=turn_by(step[TURN]) @ self.rotation,
            mount_turn=self.mount_turn @ turn_by(step[MOUNT_TURN]),
            mount_shift=self.mount_shift + step[MOUNT_SHIFT],
            longer=self.longer + float(step[FOCAL]),
            rim=self.rim + float(step[RIM]),
        )


def turn_by(vector: Vector) -> Matrix:
    """Rotation matrix, of shape (3, 3), of a rotation vector of shape (3,), rad."""
    return np.asarray(cv2.Rodrigues(np.asarray(vector, dtype=float))[0], dtype=float)


def vector_of(turn: Matrix) -> Vector:
    """Rotation vector, of shape (3,), rad, of a rotation matrix of shape (3, 3)."""
    return np.asarray(cv2.Rodrigues(np.asarray(turn, dtype=float))[0][:, 0], dtype=float)


def cross_matrix(v: Vector) -> Matrix:
    """Cross product matrix of ``v``, of shape (3, 3): the product with ``v`` from the left."""
    x, y, z = v.tolist()
    return np.array(((0.0, -z, y), (z, 0.0, -x), (-y, x, 0.0)))


@dataclass(frozen=True, eq=False)
class Projection:
    """Points of a shape in one image, with derivatives.

    Attributes:
        pixels: Position of each point relative to the image center, of shape (n, 2), px.
        change: Derivatives with respect to the unknowns, of shape (n, 2, `UNKNOWNS`).
        hull: Indices of the points on the outline, in order, of shape (m,).
    """

    pixels: Matrix
    change: Matrix
    hull: npt.NDArray[np.intp]

    @property
    def area(self) -> float:
        """Area within the outline, in square pixels."""
        return float(cv2.contourArea(self.pixels[self.hull].astype(np.float32)))

    @property
    def middle(self) -> Vector:
        """Center of the bounding box relative to the image center, of shape (2,), px."""
        on = self.pixels[self.hull]
        middle: Vector = (on.min(axis=0) + on.max(axis=0)) / 2.0
        return middle


def project(scene: OutlineScene, shape: KnownShape, view: OutlineView) -> Projection | None:
    """Project a shape into an image; None if a part of it is behind the camera."""
    from bt_dualarm.perception.perception_kernels import see

    camera = view.camera
    inward = np.ascontiguousarray(camera.rotation_matrix @ scene.mount_turn)
    eye = camera.apply(scene.mount_shift)
    about = np.ascontiguousarray(shape.seen_from(eye - scene.position, scene.rotation))
    focal = view.focal_px * (1.0 + scene.longer)
    pixels = np.empty((len(about), 2))
    change = np.empty((len(about), 2, UNKNOWNS))
    offset = scene.position - eye
    mount = np.ascontiguousarray(scene.mount_turn)
    focals = focal, view.focal_px
    if see(about, offset, inward, mount, focals, pixels, change) < _NEAREST_M:
        return None
    if shape.is_round:  # the outline does not rotate with the shape, but the ball centers do
        a, b, c = shape.ball_centers(scene.rotation).T[:, :, None]
        x, y, z = change[:, :, PLACE].transpose(2, 0, 1)
        turn = (b * z - c * y, c * x - a * z, a * y - b * x)  # the cross product
        change[:, :, TURN] = np.stack(turn, axis=2)
    around = cv2.convexHull(pixels.astype(np.float32), returnPoints=False)
    hull = np.asarray(around, dtype=np.intp)[:, 0]
    return Projection(pixels, change, hull)


def outline_error(projection: Projection, edge: Matrix, rim: float) -> tuple[Vector, Matrix]:
    """Signed distance of points from an outline, positive outside, with derivatives.

    Args:
        projection: Projection of the shape.
        edge: Points, of shape (n, 2), px.
        rim: Expected distance of the points outside the outline, px.

    Returns:
        Distances, of shape (n,), px, and their derivatives, of shape (n, `UNKNOWNS`).
    """
    from bt_dualarm.perception.perception_kernels import measure_outline

    error = np.empty(len(edge))
    jacobian = np.empty((len(edge), UNKNOWNS))
    corners = projection.pixels[projection.hull]
    ends = projection.change[projection.hull]
    measure_outline(corners, ends, np.ascontiguousarray(edge), INSIDE_PX - rim, error, jacobian)
    return error, jacobian


def warm_up_outlines() -> None:
    """Compile the kernels of outlines."""
    from bt_dualarm.perception.perception_kernels import measure_outline, see

    points = np.eye(4, 3)
    pixels = np.empty((4, 2))
    change = np.empty((4, 2, UNKNOWNS))
    see(points, np.array((0.0, 0.0, 1.0)), np.eye(3), np.eye(3), (1.0, 1.0), pixels, change)
    measure_outline(pixels, change, pixels, 0.0, np.empty(4), np.empty((4, UNKNOWNS)))


# Fit

MOUNT_TURN_DOUBT: Final = 0.01
"""Prior standard deviation of the mount's rotation about each axis, rad: uniform within 1°."""

MOUNT_SHIFT_DOUBT: Final = 0.002
"""Prior standard deviation of its position along each axis, m: uniform within 3 mm."""

FOCAL_DOUBT: Final = 0.006
"""Prior standard deviation of the focal length as a share: uniform within 1 %."""

RIM_DOUBT: Final = 0.3
"""Prior standard deviation of the widening of outlines, px."""

LEVEL_DOUBT: Final = 0.005
"""Standard deviation of the tilt of an object that lies flat, rad."""

EDGE_DOUBT: Final = 0.3
"""Standard deviation of a point of an outline, with lens distortion, px."""

_INDEPENDENT: Final = 12.0
"""Effective number of independent points of one outline: errors of neighbors are correlated."""

_FREE_TURN: Final = 1.0
"""Prior standard deviation of an unobservable rotation, rad."""

_FREE_PLACE: Final = 100.0
"""Prior standard deviation of an unobservable position, m."""

_DOUBT: Final = np.array(
    [_FREE_PLACE] * 3  # weak, but keeps the normal matrix regular
    + [_FREE_TURN] * 3  # likewise
    + [MOUNT_TURN_DOUBT] * 3
    + [MOUNT_SHIFT_DOUBT] * 3
    + [FOCAL_DOUBT, RIM_DOUBT]
)
"""Prior standard deviation of each unknown."""

_SIZE_STEPS: Final = (0.02, 0.08, 0.16, 0.16, 0.08, 0.02, 0.02)
"""Steps of the logarithm of the size at which the cost is compared; the first one suffices if the
size is as declared."""

SIZE_KNOWN: Final = 0.02
"""Relative standard deviation below which a size counts as known."""

SIZE_SIGMAS: Final = 4.0
"""Standard deviations beyond which a measured size differs from the declared one."""

SIZE_ROOM: Final = 0.03
"""Relative deviation that is always tolerated, for manufacturing tolerances and lens errors."""

_HUBER_PX: Final = 1.0
_ROUNDS: Final = 25
_SHAKE_ROUNDS: Final = 3
_DONE: Final = 1e-7
_BEST: Final = 3
_LIKELIER: Final = 0.5
"""Difference of the costs of two fits above which one is likelier: one standard deviation."""

_EXPLAINED_PX: Final = 0.5
"""Root-mean-square residual up to which outlines are explained: fits to camera images of the right
shape leave 0.3 to 0.4 px, and trying all orientations of a free box takes 0.3 s of CPU."""

_OTHER_RAD: Final = math.radians(20.0)
"""Angle above which an orientation is another one: more than a step between guesses."""

_ORIGIN: Final = np.zeros(3)
_FAR: Final = 1e6


def information_weight(count: int) -> float:
    """Weight of the squared distance of each of so many points of an outline, 1/px²."""
    return _INDEPENDENT / count / EDGE_DOUBT**2


def shake_information(by_shake: Matrix, weights: Vector | float, shake_rad: float) -> Matrix:
    """Information of an outline and the prior about the shake of its image, of shape (2, 2).

    Args:
        by_shake: Derivatives of the distances of its points by the shake, of shape (n, 2), px/rad.
        weights: Weights of their squares, of shape (n,) or one for all, 1/px².
        shake_rad: Standard deviation of the shake, rad, above 0.
    """
    weighted = by_shake * np.reshape(weights, (-1, 1))
    information: Matrix = weighted.T @ by_shake + np.eye(2) / shake_rad**2
    return information


def lost_to_shake(change: Matrix, weights: Vector | float, shake_rad: float) -> Matrix:
    """Information of an outline that is lost because its image shakes, a square matrix.

    Unknowns of one image only are eliminated from the normal equations by their Schur complement
    (Triggs et al., Bundle Adjustment, 2000, section 6.1).

    Args:
        change: Derivatives of the distances of its points by all unknowns, with n rows.
        weights: As of `shake_information`.
        shake_rad: As of `shake_information`.
    """
    by_shake = change[:, SHAKE]
    both = (by_shake * np.reshape(weights, (-1, 1))).T @ change
    lost: Matrix = both.T @ np.linalg.solve(shake_information(by_shake, weights, shake_rad), both)
    return lost


@dataclass(frozen=True, eq=False)
class ShapeFit:
    """Pose of an object by some images of it.

    Attributes:
        scene: Values of all unknowns.
        covariance: Covariance of position (m) and rotation about the world's axes (rad), (6, 6).
        residual_px: Root-mean-square distance between measured and fitted outlines.
        cost: Half the weighted sum of squares, with the priors.
    """

    scene: OutlineScene
    covariance: Matrix
    residual_px: float
    cost: float

    @property
    def pose(self) -> Pose:
        """Pose of the object in the world."""
        matrix = np.eye(4)
        matrix[:3, :3] = self.scene.rotation
        matrix[:3, 3] = self.scene.position
        return Pose.from_matrix(matrix)

    def about(self, point: Vector) -> ShapeFit:
        """The fit of another point of the object, given in its frame, of shape (3,), m."""
        arm = self.scene.rotation @ point
        lever = np.eye(6)
        lever[PLACE, TURN] = -cross_matrix(arm)
        moved = replace(self.scene, position=self.scene.position + arm)
        return replace(self, scene=moved, covariance=lever @ self.covariance @ lever.T)

    @property
    def sigma_m(self) -> float:
        """Standard deviation of the position along its most uncertain axis, m."""
        return math.sqrt(float(np.linalg.eigvalsh(self.covariance[PLACE, PLACE])[-1]))

    def sigma_rad(self, shape: KnownShape) -> float:
        """Standard deviation of the rotation, likewise, up to the shape's symmetry, rad."""
        if shape.kind == "sphere":
            return 0.0
        seen = np.eye(3)
        if shape.spins is not None:
            axis = self.scene.rotation @ shape.spins
            seen -= np.outer(axis, axis)
        turn = seen @ self.covariance[TURN, TURN] @ seen
        return math.sqrt(max(float(np.linalg.eigvalsh(turn)[-1]), 0.0))


@dataclass(frozen=True)
class SizeFit:
    """Size of an object by images of it, independent of the declared one.

    Attributes:
        size: Dimensions in m, as in `KnownShape.size`.
        ratio: Estimated over declared value of the dimension that was estimated.
        sigma: Standard deviation of the ratio.
        residual_px: Root-mean-square distance of the outlines with that size.
    """

    size: tuple[float, ...]
    ratio: float
    sigma: float
    residual_px: float

    @property
    def is_known(self) -> bool:
        """Whether the size is precise enough to confirm the declared one."""
        return self.sigma <= SIZE_KNOWN

    @property
    def is_declared(self) -> bool:
        """Whether the size agrees with the declared one, within its uncertainty."""
        off = abs(self.ratio - 1.0)
        return off <= max(SIZE_SIGMAS * self.sigma, SIZE_ROOM)


@dataclass(frozen=True, eq=False)
class ShapeFitter:
    """Fits one known shape.

    Attributes:
        shape: The shape.
        flat: Whether it lies flat on a level surface.
    """

    shape: KnownShape
    flat: bool = True

    def first(self, view: OutlineView) -> list[ShapeFit]:
        """Possible fits to a single image, the likeliest first; none if it is another shape."""
        scenes = self._likeliest(self.shape.guesses(flat=self.flat), view)
        return sorted((self._solved(scene, [view]) for scene in scenes), key=lambda fit: fit.cost)

    def again(self, fits: Sequence[ShapeFit], views: Sequence[OutlineView]) -> list[ShapeFit]:
        """Fits to all images, starting from fits to some of them; the likeliest first.

        The last image may be the first one that tells two orientations apart: from above, a bottle
        looks the same upside down. If none of the fits explains all images, an orientation that
        none of them has replaces them if it is likelier.
        """
        cost = attrgetter("cost")
        found = sorted((self._solved(fit.scene, views) for fit in fits), key=cost)
        if not found or found[0].residual_px < _EXPLAINED_PX:
            return found
        others = [
            axes
            for axes in self.shape.guesses(flat=self.flat)
            if all(self.shape.angle(_pose(_ORIGIN, axes), fit.pose) > _OTHER_RAD for fit in found)
        ]
        tried = [self._solved(scene, views) for scene in self._likeliest(others, views[-1])]
        likelier = [fit for fit in tried if fit.cost < found[0].cost - _LIKELIER]
        return sorted([*likelier, *found], key=cost)[:_BEST]

    def _likeliest(self, guesses: Sequence[Matrix], view: OutlineView) -> list[OutlineScene]:
        """The scenes with one of some rotations that agree best with a single image."""
        scenes = [self._placed(view, axes) for axes in guesses]
        ranked = sorted(
            (scene for scene in scenes if scene is not None),
            key=lambda scene: self._misfit(scene, view),
        )
        return ranked[:_BEST]

    def size_of(
        self, fit: ShapeFit, views: Sequence[OutlineView], edge: int | None = None
    ) -> SizeFit:
        """Estimate the size together with the pose and the camera.

        The cost, minimized over everything else, is nearly a parabola of the logarithm of the size
        (the profile likelihood): its minimum is the size, its curvature one over the variance.
        Images from a single viewpoint do not determine the size, as larger objects may be farther
        away.

        Args:
            fit: Fit with the declared size.
            views: All outlines of the object, even those that do not agree with the fit.
            edge: Index of the dimension to estimate; by default all in proportion.
        """
        middle = 0.0
        curve = 0.0
        scene = fit.scene
        for step in _SIZE_STEPS:
            low, here, high = (
                self.scaled(middle + side * step, edge)._solved(scene, views) for side in (-1, 0, 1)
            )
            scene = min((low, here, high), key=lambda one: one.cost).scene
            curve = (low.cost + high.cost - 2.0 * here.cost) / step**2
            if curve <= 0.0:
                middle += step if high.cost < low.cost else -step
                continue
            off = 0.5 * (low.cost - high.cost) / (step * curve)
            middle += min(max(off, -2.0 * step), 2.0 * step)
            if abs(off) < 0.5 * step:
                break
        fitter = self.scaled(middle, edge)
        sigma = math.sqrt(1.0 / curve) if curve > 0.0 else math.inf
        residual = fitter._solved(scene, views).residual_px
        return SizeFit(fitter.shape.size, math.exp(middle), sigma, residual)

    def scaled(self, share: float, edge: int | None = None) -> ShapeFitter:
        """A fitter of a shape scaled by ``exp(share)``, as a whole or in one dimension."""
        size = tuple(
            math.exp(share) * length if edge in (None, number) else length
            for number, length in enumerate(self.shape.size)
        )
        return replace(self, shape=replace(self.shape, size=size))

    def _placed(self, view: OutlineView, axes: Matrix) -> OutlineScene | None:
        """A scene with a given rotation whose projection has the view's position and area."""
        width = self.shape.extent
        depth = view.focal_px * width * 1.5 / math.sqrt(view.detection.area_px)
        pixel = view.middle
        scene = None
        for _ in range(3):
            ray = np.array((*(pixel / view.focal_px), 1.0))
            scene = OutlineScene.believed(view.camera.apply(depth * ray), axes)
            seen = project(scene, self.shape, view)
            if seen is None or seen.area <= 0.0:
                return None
            pixel = pixel + view.middle - seen.middle
            depth *= math.sqrt(seen.area / view.detection.area_px)
        return scene

    def _misfit(self, scene: OutlineScene, view: OutlineView) -> float:
        seen = project(scene, self.shape, view)
        if seen is None:
            return _FAR
        return float(np.mean(np.abs(outline_error(seen, view.edge, 0.0)[0])))

    def _solved(self, scene: OutlineScene, views: Sequence[OutlineView]) -> ShapeFit:
        """Minimize the cost from an initial scene (Levenberg-Marquardt)."""
        level = self.shape.upward(scene.rotation) if self.flat else None
        normal, slope, cost, residual = self._equations(scene, views, level)
        damping = 1e-3
        for _ in range(_ROUNDS):
            damped = normal + damping * np.diag(np.diag(normal))
            step: Vector = -np.asarray(np.linalg.solve(damped, slope), dtype=float)
            trial = scene.moved(step)
            tried = self._equations(trial, views, level)
            if tried[2] < cost:
                gained = cost - tried[2]
                scene = trial
                damping = damping / 5.0
                normal, slope, cost, residual = tried
                if gained < _DONE * (1.0 + cost):
                    break
            else:
                damping *= 8.0
                if damping > _FAR:
                    break
        covariance = np.asarray(np.linalg.inv(normal), dtype=float)[:6, :6]
        return ShapeFit(scene, covariance, residual, cost)

    def _equations(
        self, scene: OutlineScene, views: Sequence[OutlineView], level: Vector | None
    ) -> tuple[Matrix, Vector, float, float]:
        """Normal matrix, gradient, cost, and root-mean-square residual in px, with a Huber loss."""
        normal, slope, cost = self._prior(scene, level)
        square = 0.0
        count = 0
        for view in views:
            seen = project(scene, self.shape, view)
            if seen is None:
                return normal, slope, math.inf, math.inf
            weight = information_weight(len(view.edge))
            shake = np.zeros(2)  # in the end the most probable one for this scene
            for left in range(_SHAKE_ROUNDS if view.shake_rad else 0, -1, -1):
                shift = view.focal_px * np.array((shake[1], -shake[0]))
                error, change = outline_error(seen, view.edge + shift, scene.rim)
                size = np.maximum(np.abs(error), 1e-12)
                robust = weight * np.minimum(_HUBER_PX / size, 1.0)
                if left:
                    by_shake = change[:, SHAKE]
                    slant = by_shake.T @ (robust * error) + shake / view.shake_rad**2
                    stiffness = shake_information(by_shake, robust, view.shake_rad)
                    shake -= np.linalg.solve(stiffness, slant)
            normal = normal + (change * robust[:, None]).T @ change
            slope = slope + change.T @ (robust * error)
            if view.shake_rad:
                cost += 0.5 * float(shake @ shake) / view.shake_rad**2
                normal = normal - lost_to_shake(change, robust, view.shake_rad)
            inner = np.minimum(size, _HUBER_PX)
            cost += weight * float(np.sum(inner * (size - 0.5 * inner)))
            square = square + float(error @ error)
            count = count + len(error)
        return normal, slope, cost, math.sqrt(square / max(count, 1))

    def prior_information(self, scene: OutlineScene) -> Matrix:
        """Information of the priors about the unknowns, of shape (`UNKNOWNS`, `UNKNOWNS`)."""
        level = self.shape.upward(scene.rotation) if self.flat else None
        return self._prior(scene, level)[0]

    def _prior(self, scene: OutlineScene, level: Vector | None) -> tuple[Matrix, Vector, float]:
        """Normal matrix, gradient and cost of the priors."""
        off = np.zeros(UNKNOWNS)
        off[MOUNT_TURN] = vector_of(scene.mount_turn)
        off[MOUNT_SHIFT] = scene.mount_shift
        off[FOCAL] = scene.longer
        off[RIM] = scene.rim
        normal = np.diag(_DOUBT**-2.0)
        slope = off / _DOUBT**2
        cost = 0.5 * float(np.sum((off / _DOUBT) ** 2))
        if level is not None and self.shape.kind != "sphere":
            up = scene.rotation @ level
            tilt = up[:2] / LEVEL_DOUBT
            by_turn = -cross_matrix(up)[:2] / LEVEL_DOUBT
            normal[TURN, TURN] += by_turn.T @ by_turn
            slope[TURN] += by_turn.T @ tilt
            cost += 0.5 * float(tilt @ tilt)
        return normal, slope, cost


def canonical(fit: ShapeFit, shape: KnownShape) -> ShapeFit:
    """The equivalent fit with the smallest rotation from the axes of the world."""
    rotation = shape.canonical(fit.pose).rotation_matrix
    return replace(fit, scene=replace(fit.scene, rotation=rotation))
