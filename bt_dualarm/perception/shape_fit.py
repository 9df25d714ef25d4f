"""The pose of an object of known shape from its outlines in several images, with covariance."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import cv2
import numpy as np
import numpy.typing as npt

from bt_dualarm.core.pose import Matrix, Pose, Vector
from bt_dualarm.perception.detection import Blob, ColorFilter, Detection, detect_blobs
from bt_dualarm.perception.known_shape import KnownShape
from bt_dualarm.sim.frame import Frame, JsonList, LazyFrame
from bt_dualarm.sim.renderer import Image

# Outlines with subpixel accuracy in an image of a camera at rest


_FINER: Final = 4
"""Samples a pixel along each direction between which an edge is looked for."""

INSIDE_PX: Final = 0.5 / _FINER
"""Pixels by which the points of an outline are inside of it: they are those of its last samples."""

_NEXT: Final = cv2.getStructuringElement(cv2.MORPH_RECT, (3, 3))
_NEIGHBORS: Final = cv2.getStructuringElement(cv2.MORPH_RECT, (5, 5))
_AROUND: Final = (9, 9)
"""Pixels, across and along, whose mean is the ground that an edge is seen on."""

_MOST_POINTS: Final = 160
"""Points of an outline that are kept: more tell nothing new."""


@dataclass(frozen=True, eq=False)
class OutlineView:
    """The outline of one object, as a camera at rest has seen it.

    Attributes:
        camera: Pose of the camera in the world (x right, y down, z forward), as estimated.
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
        """Whether all of it is in the image; of what is not, there is no edge."""
        return not self.detection.touches_border

    @property
    def middle(self) -> Vector:
        """Middle of its box from the image's middle, of shape (2,), px."""
        middle: Vector = (self.edge.min(axis=0) + self.edge.max(axis=0)) / 2.0
        return middle


def merged(frames: list[Frame]) -> Frame:
    """One image with less noise, of several by a camera that did not move.

    Args:
        frames: Frames, one at least, of one region and stride.
    """

    def mean() -> Image:
        exact = np.mean([frame.blocks for frame in frames], axis=0)
        return np.asarray(np.rint(exact), dtype=np.uint8)

    return LazyFrame.of(frames[-1], mean, merges=len(frames))


def outlines(frame: Frame, color: ColorFilter, min_area: float) -> list[OutlineView]:
    """All that has a color, the largest first, what goes beyond the image as well.

    Args:
        frame: Frame that was exposed as a whole, in full resolution.
        color: Filter of the color.
        min_area: Least area in square pixels.
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
    object and of its surroundings. A side in the shade has not the color that is looked for; it
    belongs to the object all the same, and differs from a bright and from a dark ground alike.
    """
    inside = cv2.erode(blob.filled, _NEXT)
    near = cv2.dilate(blob.filled, _NEXT)
    colors = blob.rgb.astype(np.float32)
    around = (near == 0).astype(np.float32)
    count = cv2.boxFilter(around, -1, _AROUND, normalize=False)
    total = cv2.boxFilter(colors * around[:, :, None], -1, _AROUND, normalize=False)
    ground = total / np.maximum(count, 1.0)[:, :, None]
    away = np.linalg.norm(colors - ground, axis=2).astype(np.float32)
    away[near == 0] = 0.0
    share = np.minimum(away / np.maximum(cv2.dilate(away, _NEIGHBORS), 1.0), 1.0)
    share[(inside > 0) | (count == 0.0)] = 1.0
    share[near == 0] = 0.0
    return np.asarray(share, dtype=np.float32)


# Residuals of outlines and their derivatives


UNKNOWNS: Final = 14
"""Place and turn of the object (3 + 3), turn and shift of the mount (3 + 3), focal length, rim."""

PLACE: Final = slice(0, 3)
TURN: Final = slice(3, 6)
MOUNT_TURN: Final = slice(6, 9)
MOUNT_SHIFT: Final = slice(9, 12)
FOCAL: Final = 12
RIM: Final = 13

_NEAREST_M: Final = 0.01
"""Depth before the camera below which nothing is seen."""


@dataclass(frozen=True, eq=False)
class OutlineScene:
    """All that is unknown about some images of one object.

    Attributes:
        position: Center of the object in the world, of shape (3,), m.
        rotation: Its axes in the world, of shape (3, 3).
        mount_turn: Axes of the camera in the frame where it is estimated to be, of shape (3, 3).
        mount_shift: Position of the camera there, of shape (3,), m.
        longer: Share by which the focal length is longer than believed.
        rim: Pixels by which outlines are wider than what they are of.
    """

    position: Vector
    rotation: Matrix
    mount_turn: Matrix
    mount_shift: Vector
    longer: float = 0.0
    rim: float = 0.0

    @classmethod
    def believed(cls, position: Vector, rotation: Matrix) -> OutlineScene:
        """An object there, and a camera as estimated to be."""
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
    """The rotation, of shape (3, 3), about a vector of shape (3,) by its length in rad."""
    return np.asarray(cv2.Rodrigues(np.asarray(vector, dtype=float))[0], dtype=float)


def vector_of(turn: Matrix) -> Vector:
    """The vector, of shape (3,), rad, that `turn_by` makes a rotation of shape (3, 3) of."""
    return np.asarray(cv2.Rodrigues(np.asarray(turn, dtype=float))[0][:, 0], dtype=float)


def cross_matrix(v: Vector) -> Matrix:
    """The matrix, of shape (3, 3), that takes a vector to its product with ``v`` before it."""
    x, y, z = v.tolist()
    return np.array(((0.0, -z, y), (z, 0.0, -x), (-y, x, 0.0)))


@dataclass(frozen=True, eq=False)
class Projection:
    """Points of a shape in one image, and by what they change.

    Attributes:
        pixels: Position of each point from the image's middle, of shape (n, 2), px.
        change: Change of each with the unknowns, of shape (n, 2, `UNKNOWNS`).
        hull: Which points make the outline, in its order, of shape (m,).
    """

    pixels: Matrix
    change: Matrix
    hull: npt.NDArray[np.intp]

    @property
    def area(self) -> float:
        """Area within the outline, square px."""
        return float(cv2.contourArea(self.pixels[self.hull].astype(np.float32)))

    @property
    def middle(self) -> Vector:
        """Middle of the outline's box from the image's middle, of shape (2,), px."""
        on = self.pixels[self.hull]
        middle: Vector = (on.min(axis=0) + on.max(axis=0)) / 2.0
        return middle


def project(scene: OutlineScene, shape: KnownShape, view: OutlineView) -> Projection | None:
    """The shape as an image would have it; None where a part of it is behind the camera."""
    from bt_dualarm.perception.image_kernels import see

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
    if shape.is_round:  # its outline does not turn with it, but the balls that have it do
        a, b, c = shape.ball_centers(scene.rotation).T[:, :, None]
        x, y, z = change[:, :, PLACE].transpose(2, 0, 1)
        turn = (b * z - c * y, c * x - a * z, a * y - b * x)  # the cross product
        change[:, :, TURN] = np.stack(turn, axis=2)
    around = cv2.convexHull(pixels.astype(np.float32), returnPoints=False)
    hull = np.asarray(around, dtype=np.intp)[:, 0]
    return Projection(pixels, change, hull)


def outline_error(projection: Projection, edge: Matrix, rim: float) -> tuple[Vector, Matrix]:
    """Distance of points from an outline, outside positive, and its change with the unknowns.

    Args:
        projection: Projection of the shape.
        edge: Points of shape (n, 2), px.
        rim: Pixels by which they are expected outside.

    Returns:
        Distances of shape (n,), px, and their change, of shape (n, `UNKNOWNS`).
    """
    from bt_dualarm.perception.image_kernels import measure_outline

    error = np.empty(len(edge))
    jacobian = np.empty((len(edge), UNKNOWNS))
    corners = projection.pixels[projection.hull]
    ends = projection.change[projection.hull]
    measure_outline(corners, ends, np.ascontiguousarray(edge), INSIDE_PX - rim, error, jacobian)
    return error, jacobian


def warm_up_outlines() -> None:
    """Have all kernels of outlines compiled."""
    from bt_dualarm.perception.image_kernels import measure_outline, see

    points = np.eye(4, 3)
    pixels = np.empty((4, 2))
    change = np.empty((4, 2, UNKNOWNS))
    see(points, np.array((0.0, 0.0, 1.0)), np.eye(3), np.eye(3), (1.0, 1.0), pixels, change)
    measure_outline(pixels, change, pixels, 0.0, np.empty(4), np.empty((4, UNKNOWNS)))


# Pose of an object of known shape from its outlines in several images, with covariance.
#
# Least squares of the outlines' distances (bundle adjustment: Triggs and others, 2000) over the
# pose of the object and the unknowns of the camera: its mount, its focal length, and by how much a
# color filter widens outlines. What the images do not determine of these keeps its prior
# uncertainty, which is part of the covariance of the pose.


MOUNT_TURN_DOUBT: Final = 0.01
"""Deviation of the mount's rotation about each axis, rad: a neglected one's, uniform within 1°."""

MOUNT_SHIFT_DOUBT: Final = 0.002
"""Deviation of its place along each axis, m: likewise, uniform within 3 mm."""

FOCAL_DOUBT: Final = 0.006
"""Deviation of the focal length as a share: likewise, uniform within 1 %."""

RIM_DOUBT: Final = 0.3
"""Deviation of what an outline is too wide or too narrow by, px."""

LEVEL_DOUBT: Final = 0.005
"""Deviation of what lies flat from the level, rad."""

EDGE_DOUBT: Final = 0.3
"""Deviation of a point of an outline, px; distortion of the lens included."""

_INDEPENDENT: Final = 12.0
"""Points of one outline that are off for reasons of their own; the others go with them."""

_FREE_TURN: Final = 1.0
"""Deviation of a turn that nothing shows, rad."""

_FREE_PLACE: Final = 100.0
"""Deviation of a place that nothing shows, m."""

_DOUBT: Final = np.array(
    [_FREE_PLACE] * 3  # toward nowhere: what nothing shows stays as it is
    + [_FREE_TURN] * 3  # likewise
    + [MOUNT_TURN_DOUBT] * 3
    + [MOUNT_SHIFT_DOUBT] * 3
    + [FOCAL_DOUBT, RIM_DOUBT]
)
"""Deviation of each unknown before there is an image."""

_SIZE_STEPS: Final = (0.02, 0.08, 0.16, 0.16, 0.08, 0.02, 0.02)
"""Logarithms of factors of the size to either side at which the cost is compared; the first one
is enough where the size is as declared."""

SIZE_KNOWN: Final = 0.02
"""Standard deviation of a size, as a share of it, at which it counts as known."""

SIZE_SIGMAS: Final = 4.0
"""Standard deviations by which a measured size is another than the declared one."""

SIZE_ROOM: Final = 0.03
"""Share by which it may be off in any case: makers have tolerances, and lenses distort."""

_HUBER_PX: Final = 1.0
_ROUNDS: Final = 25
_DONE: Final = 1e-7
_BEST: Final = 3
_FAR: Final = 1e6


@dataclass(frozen=True, eq=False)
class ShapeFit:
    """Where an object is by some images of it.

    Attributes:
        scene: Place and turn of it, and what was found of the camera.
        covariance: Covariance of place (m) and turn about the world's axes (rad), of shape (6, 6).
        residual_px: Root mean square of what is left between the outlines and those of the shape.
        cost: Half the weighted sum of squares, what was known before included.
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
        """The same for another point of the object, in its frame, of shape (3,), m."""
        arm = self.scene.rotation @ point
        lever = np.eye(6)
        lever[PLACE, TURN] = -cross_matrix(arm)
        moved = replace(self.scene, position=self.scene.position + arm)
        return replace(self, scene=moved, covariance=lever @ self.covariance @ lever.T)

    @property
    def sigma_m(self) -> float:
        """Standard deviation of the place along the axis where it is largest, m."""
        return math.sqrt(float(np.linalg.eigvalsh(self.covariance[PLACE, PLACE])[-1]))

    def sigma_rad(self, shape: KnownShape) -> float:
        """Standard deviation of the turn, likewise, as far as a turn of the shape can be seen."""
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
    """How large an object is by images of it, whatever it was declared to be.

    Attributes:
        size: Its measures in m, as `KnownShape.size` has them.
        ratio: The measure that was free as a share of the declared one.
        sigma: Standard deviation of that.
        residual_px: What an object of that size leaves between the outlines, root mean square.
    """

    size: tuple[float, ...]
    ratio: float
    sigma: float
    residual_px: float

    @property
    def is_known(self) -> bool:
        """Whether the images tell it well enough to see that it is as declared."""
        return self.sigma <= SIZE_KNOWN

    @property
    def is_declared(self) -> bool:
        """Whether it may be the declared size: it is not off by what such images hardly show."""
        off = abs(self.ratio - 1.0)
        return off <= max(SIZE_SIGMAS * self.sigma, SIZE_ROOM)


@dataclass(frozen=True, eq=False)
class ShapeFitter:
    """Fits one known shape.

    Attributes:
        shape: The shape.
        flat: Whether it lies flat on something level.
    """

    shape: KnownShape
    flat: bool = True

    def first(self, view: OutlineView) -> list[ShapeFit]:
        """What a single image may show, the likeliest first; none if it cannot be this shape."""
        guesses = [self._placed(view, axes) for axes in self.shape.guesses(flat=self.flat)]
        ranked = sorted(
            (scene for scene in guesses if scene is not None),
            key=lambda scene: self._misfit(scene, view),
        )
        fits = [self._solved(scene, [view]) for scene in ranked[:_BEST]]
        return sorted(fits, key=lambda fit: fit.cost)

    def again(self, fits: Sequence[ShapeFit], views: Sequence[OutlineView]) -> list[ShapeFit]:
        """What all images show, begun from what some of them have shown; the likeliest first."""
        return sorted((self._solved(fit.scene, views) for fit in fits), key=lambda fit: fit.cost)

    def size_of(
        self, fit: ShapeFit, views: Sequence[OutlineView], edge: int | None = None
    ) -> SizeFit:
        """The size that explains all images best, the pose and the camera being free as well.

        The cost at its least over all else is a parabola of the size (the profile likelihood): its
        lowest point is the size, its curvature one over the variance. Images from one place tell
        nothing of the size: what is larger is farther away.

        Args:
            fit: What the images show if it has the declared size.
            views: Outlines of it, those included that do not go with that.
            edge: Which of the shape's measures is free; by default all of them together.
        """
        middle = 0.0
        curve = 0.0
        scene = fit.scene
        for step in _SIZE_STEPS:
            low, here, high = (
                self._scaled(middle + side * step, edge)._solved(scene, views)
                for side in (-1, 0, 1)
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
        fitter = self._scaled(middle, edge)
        sigma = math.sqrt(1.0 / curve) if curve > 0.0 else math.inf
        residual = fitter._solved(scene, views).residual_px
        return SizeFit(fitter.shape.size, math.exp(middle), sigma, residual)

    def _scaled(self, share: float, edge: int | None) -> ShapeFitter:
        """A fitter of a shape that is larger by a factor, of which ``share`` is the logarithm."""
        size = tuple(
            math.exp(share) * length if edge in (None, number) else length
            for number, length in enumerate(self.shape.size)
        )
        return replace(self, shape=replace(self.shape, size=size))

    def _placed(self, view: OutlineView, axes: Matrix) -> OutlineScene | None:
        """An object turned like this where the image has one, as far away as its area says."""
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
        """Levenberg's and Marquardt's method from a scene."""
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
        """Normal matrix, slope, half the sum of squares, and what is left in px."""
        normal, slope, cost = self._known_before(scene, level)
        square = 0.0
        count = 0
        for view in views:
            seen = project(scene, self.shape, view)
            if seen is None:
                return normal, slope, math.inf, math.inf
            error, change = outline_error(seen, view.edge, scene.rim)
            weight = _INDEPENDENT / len(error) / EDGE_DOUBT**2
            size = np.maximum(np.abs(error), 1e-12)
            robust = weight * np.minimum(_HUBER_PX / size, 1.0)
            normal = normal + (change * robust[:, None]).T @ change
            slope = slope + change.T @ (robust * error)
            inner = np.minimum(size, _HUBER_PX)
            cost += weight * float(np.sum(inner * (size - 0.5 * inner)))
            square = square + float(error @ error)
            count = count + len(error)
        return normal, slope, cost, math.sqrt(square / max(count, 1))

    def _known_before(
        self, scene: OutlineScene, level: Vector | None
    ) -> tuple[Matrix, Vector, float]:
        """What is known without an image: normal matrix, slope and half the sum of squares."""
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
    """The same, turned as the pose that looks alike and is turned least."""
    rotation = shape.canonical(fit.pose).rotation_matrix
    return replace(fit, scene=replace(fit.scene, rotation=rotation))
