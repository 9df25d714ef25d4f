"""Pose of an object of known shape from its outlines in several images, with covariance.

`outlines` extracts outlines with subpixel accuracy from images of a camera at rest. `ShapeFitter`
minimizes the distances of the outlines' points from a projected `KnownShape` (bundle adjustment:
Triggs et al., 2000) over the pose of the object and the errors of the camera: its mount, its focal
length, and a constant widening of outlines by the color filter. What the images do not determine of
these keeps its prior uncertainty, which is part of the covariance of the pose.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from operator import attrgetter
from typing import TYPE_CHECKING, Final

import numpy as np
import numpy.typing as npt

from bt_dualarm.core.later import Later
from bt_dualarm.core.pose import Matrix, Pose, Vector
from bt_dualarm.perception.detection import Blob, ColorFilter, Detection, detect_blobs
from bt_dualarm.perception.known_shape import KnownShape
from bt_dualarm.sim.frame import Frame, Image, JsonList, LazyFrame

if TYPE_CHECKING:
    import cv2
else:
    cv2 = Later("cv2")

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
        return Pose.from_axes(self.scene.position, self.scene.rotation.tolist())

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
        guesses = self.shape.guesses(flat=self.flat)
        turned = [Pose.from_axes(_ORIGIN, axes.tolist()) for axes in guesses]
        others = [
            axes
            for axes, one in zip(guesses, turned, strict=True)
            if all(self.shape.angle(one, fit.pose) > _OTHER_RAD for fit in found)
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
