"""Scanning: objects of one kind, by color or by marker, in several images; hand-eye calibration.

`SightedObjects` detects the objects and associates what it sees of each. Square markers are located
by their corners; `hand_eye` calibrates the camera's mount from several views of one.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Final, TypeAlias

import numpy as np
import numpy.typing as npt
import scipy

from bt_dualarm.core.later import Later
from bt_dualarm.core.pose import Matrix, Pose, Vector
from bt_dualarm.perception.detection import ColorFilter, Detection
from bt_dualarm.perception.expected_fit import ExpectedFit
from bt_dualarm.perception.known_shape import KnownShape
from bt_dualarm.perception.shape_fit import (
    OutlineScene,
    OutlineView,
    ShapeFit,
    ShapeFitter,
    SizeFit,
    canonical,
    hulled,
    outlines,
    project,
)
from bt_dualarm.sim.composition import marker_dictionary
from bt_dualarm.sim.frame import Frame, JsonList
from bt_dualarm.spec.cell import Region
from bt_dualarm.spec.values import Color, MarkerSpec

if TYPE_CHECKING:
    import cv2
else:
    cv2 = Later("cv2")

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

    def guesses(self, *, flat: bool) -> list[Matrix]:  # noqa: ARG002 - as the base class
        """None: the corners in one image determine both possible rotations."""
        return []

    def canonical(self, pose: Pose) -> Pose:
        """The pose itself: a marker has no symmetry."""
        return pose

    def angle(self, one: Pose, other: Pose) -> float:
        """Angle between two poses in rad."""
        return one.angle(other)

    @property
    def _own_turns(self) -> tuple[Matrix, ...]:
        return (np.eye(3),)


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
            MarkerView(
                frame.pose,
                frame.focal_px,
                around - middle,
                detection,
                corners - middle,
                shake_rad=frame.shake_rad,
            )
        )
    return views


def _look(frame: Frame, marker: MarkerSpec) -> JsonList:
    """Edge, corners, bounding box and area of each such marker, px from the image's corner."""
    gray = np.asarray(cv2.cvtColor(frame.image, cv2.COLOR_RGB2GRAY), dtype=np.uint8)
    large = cv2.resize(gray, None, fx=_ENLARGEMENT, fy=_ENLARGEMENT, interpolation=cv2.INTER_LINEAR)
    settings = cv2.aruco.DetectorParameters()
    settings.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
    known = marker_dictionary(marker.dictionary)
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

    Minimum squares of the distances in the images with a prior for the mount: bundle adjustment of
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


UNLIKE_PX: Final = 0.8
"""Root-mean-square residual above which an outline is of another shape, or partly occluded."""

LEAST_AREA_PX: Final = 60.0
"""Minimum area of an outline whose shape can be determined, square pixels."""

_BACKGROUND: Final = 0.15
"""Fraction of an image above which regions at its edge may be the background of objects."""

_BESIDE_PX: Final = 4.0
"""Distance from an outline at which an arm is looked for that may cut it off: more than an error
of the camera's mount shifts the hand in the image."""

_CUT_SHARE: Final = 0.05
"""Share of an outline beside an arm above which it counts as cut off."""

_ASTRAY_PX: Final = 12.0
"""Gate of the association, in addition to half the object's width, px."""


def _sight(frame: Frame, view: OutlineView) -> tuple[Vector, Vector]:
    """Line of sight to the part of a region that an image shows: a point and a direction."""
    middle = np.array((frame.width, frame.height)) / 2.0
    pixel = np.array(view.detection.centroid_px) - middle
    return view.camera.position, view.camera.turn(np.array((*pixel, view.focal_px)))


@dataclass(eq=False)
class SightedObject:
    """One detected object.

    Attributes:
        fits: Hypotheses of its pose, the most likely first.
        views: Outlines that were associated with it.
        astray: Outlines at its position that do not fit a still object of this shape.
        middle: Its center in the frame of the fitted shape, of shape (3,), m.
        sizes: Cached size estimates, by number of outlines and dimension.
    """

    fits: list[ShapeFit]
    views: list[OutlineView] = field(default_factory=list)
    astray: list[OutlineView] = field(default_factory=list)
    middle: Vector = field(default_factory=lambda: np.zeros(3))
    sizes: dict[tuple[int, int | None], SizeFit] = field(default_factory=dict)

    @property
    def best(self) -> ShapeFit:
        """The most likely hypothesis, at the object's center."""
        return self.fits[0].about(self.middle) if self.middle.any() else self.fits[0]

    @property
    def position(self) -> Vector:
        """Position of its center in the world, of shape (3,), m."""
        return self.best.scene.position


class SightedObjects:
    """Detector of objects of one kind, which accumulates images.

    Args:
        find: Function that finds candidates in an image.
        fitter: Fitter of their shape.
        middle: Middle of an object in the frame of what is fitted, of shape (3,), m; by default its
            origin.
        none_found: Message for an image without candidates.
        color: Color of the objects, if they are detected by color.

    Attributes:
        unlike: Number of candidates of another shape in the last image.
        others_whole: Number of these that are certainly other objects: balls instead of boxes.
        behind_arm: Number of these that an arm may hide in part.
        beyond: Fraction of the last image covered by regions that go beyond its edge.
        cut_off: Lines of sight to these, unless they are the background, and to those that an arm
            may hide in part: position of the camera and direction in the world, each of shape (3,).
    """

    def __init__(
        self,
        find: Callable[[Frame], list[OutlineView]],
        fitter: ShapeFitter,
        middle: Vector | None = None,
        none_found: str = "nothing in it has that color",
        color: ColorFilter | None = None,
    ) -> None:
        self._color = color
        self._none_found = none_found
        self._all: list[SightedObject] = []
        self._region: tuple[Pose, Region] | None = None
        self.unlike = 0
        self.others_whole = 0
        self.behind_arm = 0
        self.beyond = 0.0
        self._in_part: list[tuple[list[ShapeFit], OutlineView]] = []
        self._arms_before: Callable[[Frame, Matrix], Vector] | None = None
        self.cut_off: list[tuple[Vector, Vector]] = []
        self._find = find
        self._fitter = fitter
        self._middle: Vector = np.zeros(3) if middle is None else middle

    @classmethod
    def of_color(cls, color: Color, shape: KnownShape, *, flat: bool = True) -> SightedObjects:
        """Detector of objects of a color and a shape, which may lie flat on a level surface."""
        seen = ColorFilter(color)
        fitter = ShapeFitter(shape, flat)

        def find(frame: Frame) -> list[OutlineView]:
            found = outlines(frame, seen, LEAST_AREA_PX)
            return [hulled(one) for one in found] if shape.concave else found

        return cls(find, fitter, color=seen)

    @classmethod
    def of_marker(
        cls, marker: MarkerSpec, middle: Vector | None = None, *, flat: bool = True
    ) -> SightedObjects:
        """Detector of objects with a marker; ``middle`` is their center in its frame, (3,), m."""
        fitter = MarkerFitter(SquareCorners("box", (marker.size,)), flat)
        return cls(
            lambda frame: markers_in(frame, marker), fitter, middle, "no such marker is in it"
        )

    def within(self, frame: Pose, region: Region) -> SightedObjects:
        """Ignore everything outside of a region from now on; returns the detector.

        A candidate in an image counts if its line of sight crosses the region, an object if its
        estimated center is in it, or nearer than two standard deviations.

        Args:
            frame: Pose of the region in the world.
            region: The region.
        """
        self._region = frame, region
        return self

    def beside(self, arms_before: Callable[[Frame, Matrix], Vector]) -> SightedObjects:
        """Take for cut off what an arm may hide in part; returns the detector.

        Args:
            arms_before: Function that returns the depths of arms at points of an image, relative to
                its center, of shape (n, 2), px, in m; infinite where there is none.
        """
        self._arms_before = arms_before
        return self

    def accept_hidden(self) -> None:
        """Use what an arm may hide in part, where that fits: there is no better view of it."""
        for fits, region in self._in_part:
            if self._known_at(fits[0].scene.position, []) is None:
                self._all.append(SightedObject(fits, [region], middle=self._middle))
        self._in_part = []

    @property
    def objects(self) -> list[SightedObject]:
        """Detected objects, in no particular order."""
        if self._region is None:
            return self._all
        frame, region = self._region
        inverse = frame.inverse
        return [
            one
            for one in self._all
            if region.outside_by(inverse.apply(one.position)) <= 2.0 * one.best.sigma_m
        ]

    def _may_be_within(self, image: Frame, view: OutlineView) -> bool:
        """Whether the line of sight through the visible part of a candidate crosses the region."""
        if self._region is None:
            return True
        frame, region = self._region
        camera, sight = _sight(image, view)  # a candidate cut off by the border has no outline
        inverse = frame.inverse
        return region.may_cross(inverse.apply(camera), inverse.turn(sight))

    @property
    def shape(self) -> KnownShape:
        """Shape that is fitted."""
        return self._fitter.shape

    def has_color(self, rgba: Sequence[float]) -> bool:
        """Whether a color (red, green, blue, 0 to 1, more ignored) matches the searched one."""
        pixel = np.rint(255.0 * np.array(rgba[:3])).astype(np.uint8).reshape(1, 1, 3)
        return self._color is not None and bool(self._color.mask(pixel).any())

    def take(self, frame: Frame) -> None:
        """Process one image: refine known objects and add new ones."""
        found = [one for one in self._find(frame) if self._may_be_within(frame, one)]
        regions = [region for region in found if region.is_whole]
        hidden = [region for region in regions if self._is_behind_arm(frame, region)]
        cut = [region for region in found if not region.is_whole]
        area = sum(region.detection.area_px for region in cut)
        self.beyond = area / (frame.width * frame.height)
        seen = list[SightedObject]()
        for obj in self._all:
            region = self._of(obj, regions)
            if region is not None:
                regions.remove(region)
                # An outline beside an arm that fits what is known of the object is whole.
                beside = region in hidden
                if self._refine(obj, region, is_whole=not beside) and beside:
                    hidden.remove(region)
                seen.append(obj)
        regions = [region for region in regions if region not in hidden]
        self.cut_off = [] if self.is_ground else [_sight(frame, region) for region in cut]
        self.cut_off += [_sight(frame, region) for region in hidden]
        first = [(self._fitter.first(region), region) for region in hidden]
        self._in_part += [one for one in first if one[0] and one[0][0].residual_px <= UNLIKE_PX]
        self.unlike = self.behind_arm = len(hidden)
        self.others_whole = 0
        for region in regions:
            fits = self._fitter.first(region)
            if not fits or fits[0].residual_px > UNLIKE_PX:
                self.unlike += 1
                self.others_whole += self._is_other(region)
                continue
            known = self._known_at(fits[0].scene.position, seen)
            if known is None:
                known = SightedObject(fits, [region], middle=self._middle)
                self._all.append(known)
            else:
                known.astray.append(region)
            seen.append(known)

    @property
    def is_ground(self) -> bool:
        """Whether the background may have the color in the last image."""
        return self.beyond > _BACKGROUND

    @property
    def others(self) -> str:
        """Message about what else has the color in the last image."""
        reasons = []
        if self.behind_arm:
            are = "region is" if self.behind_arm == 1 else "regions are"
            reasons.append(f"{self.behind_arm} {are} partly hidden by an arm")
        unlike = self.unlike - self.behind_arm
        if unlike:
            are = "region is" if unlike == 1 else "regions are"
            reasons.append(f"{unlike} {are} of another shape, partly occluded, or moving")
        if self.is_ground:
            advice = "the background may have that color, too: choose another `color`"
            share = f"{100 * self.beyond:.0f} %"
            reasons.append(f"{share} of the image has it, up to its border; {advice}")
        elif self.beyond:
            reasons.append("an object extends beyond the image")
        return "; ".join(reasons) or self._none_found

    def _is_behind_arm(self, frame: Frame, region: OutlineView) -> bool:
        """Whether an arm may hide a part of a region: it is beside its outline, and before it."""
        if self._arms_before is None:
            return False
        outward = region.edge - region.middle
        outward /= np.linalg.norm(outward, axis=1, keepdims=True).clip(1e-6)
        depths = self._arms_before(frame, region.edge + _BESIDE_PX * outward)
        if np.isfinite(depths).mean() <= _CUT_SHARE:
            return False
        # What is hidden in part looks smaller, and therefore farther, than it is.
        fits = self._fitter.first(region)
        if fits and fits[0].residual_px <= UNLIKE_PX:
            depth = float(frame.pose.inverse.apply(fits[0].scene.position)[2])
            return bool((depths < depth).mean() > _CUT_SHARE)
        return True

    def fit(self, obj: SightedObject) -> ShapeFit:
        """Fit of the frame of an object; of equivalent poses the one with the smallest rotation."""
        found = canonical(obj.best, self.shape)
        center = np.array(self.shape.center)
        return found.about(-center) if center.any() else found

    def pose(self, obj: SightedObject) -> Pose:
        """Pose of the frame of an object in the world, see `fit`."""
        return self.fit(obj).pose

    def expected(self, obj: SightedObject) -> ExpectedFit:
        """Accuracy that further images of an object will give."""
        return ExpectedFit(self._fitter, obj.fits[0].scene, obj.views, obj.middle)

    def size_of(self, obj: SightedObject) -> SizeFit:
        """Size of an object by all its outlines, if it has the declared proportions."""
        return self._size_of(obj, None)

    def _size_of(self, obj: SightedObject, edge: int | None) -> SizeFit:
        """Size as a whole or in one dimension, cached for all images so far."""
        views = [*obj.views, *obj.astray]
        key = len(views), edge
        if key not in obj.sizes:
            obj.sizes[key] = self._fitter.size_of(obj.fits[0], views, edge)
        return obj.sizes[key]

    def other_size(self, obj: SightedObject) -> SizeFit | None:
        """The true size of an object that differs from the declared one, as a whole or in one edge.

        None if its outlines agree with the declared size, or with no size of this shape.
        """
        edges = len(self.shape.size) if len(self.shape.size) > 1 else 0
        for edge in (None, *range(edges)):
            size = self._size_of(obj, edge)
            if not size.is_declared and size.residual_px <= UNLIKE_PX:
                return size
        return None

    def sigma_rad(self, obj: SightedObject) -> float:
        """Largest standard deviation of the orientation, up to the symmetry of the object, rad."""
        return obj.best.sigma_rad(self._fitter.shape)

    def _is_other(self, region: OutlineView) -> bool:
        """Whether a candidate is certainly another object: a ball, when boxes are detected."""
        if self.shape.kind != "box":
            return False
        balls = ShapeFitter(KnownShape("sphere", (self.shape.extent,))).first(region)
        return bool(balls) and balls[0].residual_px <= UNLIKE_PX

    def _of(self, obj: SightedObject, regions: list[OutlineView]) -> OutlineView | None:
        """Candidate at the predicted position of an object, if there is one."""
        if not regions:
            return None
        seen = project(obj.fits[0].scene, self._fitter.shape, regions[0])
        if seen is None:
            return None
        away = [float(np.linalg.norm(region.middle - seen.middle)) for region in regions]
        nearest = int(np.argmin(away))
        return regions[nearest] if away[nearest] < _ASTRAY_PX + 0.25 * seen.area**0.5 else None

    def _refine(self, obj: SightedObject, region: OutlineView, *, is_whole: bool = True) -> bool:
        """Use an outline of a known object; returns whether it fits.

        Args:
            obj: The object.
            region: The outline.
            is_whole: Whether all of it is surely shown, so that one that does not fit contradicts.
        """
        fits = self._fitter.again(obj.fits, [*obj.views, region])
        if fits[0].residual_px > UNLIKE_PX:
            if is_whole:
                obj.astray.append(region)
            return False
        obj.fits = fits
        obj.views.append(region)
        return True

    def _known_at(self, position: Vector, seen: list[SightedObject]) -> SightedObject | None:
        """Known object nearest to a position, if one is within its extent.

        Objects that the same image shows elsewhere (``seen``) are excluded.
        """
        away = {
            number: float(np.linalg.norm(one.position - position))
            for number, one in enumerate(self._all)
            if one not in seen
        }
        nearest = min(away, key=lambda number: away[number], default=None)
        if nearest is None or away[nearest] >= self._fitter.shape.extent:
            return None
        return self._all[nearest]
