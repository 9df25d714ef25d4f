"""The pose of a thing of known shape from its outlines in several pictures, with its covariance.

Least squares of the outlines' distances (bundle adjustment: Triggs and others, 2000) over the pose
of the thing and over what is not known of the camera: its mount, its focal length, and by how much
a colour filter sees a thing wider than it is. What the pictures do not tell of these stays in
doubt, and that doubt is in the covariance of the pose.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from bt_dualarm.pose import Matrix, Pose, Vector
from bt_dualarm.vision.edges import OutlineView
from bt_dualarm.vision.known_shape import KnownShape
from bt_dualarm.vision.outline_error import (
    FOCAL,
    MOUNT_SHIFT,
    MOUNT_TURN,
    PLACE,
    RIM,
    TURN,
    UNKNOWNS,
    Scene,
    cross_matrix,
    outline_error,
    project,
    vector_of,
)

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
    [_FREE_PLACE] * 3  # towards nowhere: what nothing shows stays as it is
    + [_FREE_TURN] * 3  # likewise
    + [MOUNT_TURN_DOUBT] * 3
    + [MOUNT_SHIFT_DOUBT] * 3
    + [FOCAL_DOUBT, RIM_DOUBT]
)
"""Deviation of each unknown before there is a picture."""

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
    """Where a thing is by some pictures of it.

    Attributes:
        scene: Place and turn of it, and what was found of the camera.
        covariance: Covariance of place (m) and turn about the world's axes (rad), of shape (6, 6).
        residual_px: Root mean square of what is left between the outlines and those of the shape.
        cost: Half the weighted sum of squares, what was known before included.
    """

    scene: Scene
    covariance: Matrix
    residual_px: float
    cost: float

    @property
    def pose(self) -> Pose:
        """Pose of the thing in the world."""
        matrix = np.eye(4)
        matrix[:3, :3], matrix[:3, 3] = self.scene.rotation, self.scene.position
        return Pose.from_matrix(matrix)

    def about(self, point: Vector) -> ShapeFit:
        """The same for another point of the thing, in its frame, of shape (3,), m."""
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
    """How large a thing is by pictures of it, whatever it was declared to be.

    Attributes:
        size: Its measures in m, as `KnownShape.size` has them.
        ratio: The measure that was free as a share of the declared one.
        sigma: Standard deviation of that.
        residual_px: What a thing of that size leaves between the outlines, root mean square.
    """

    size: tuple[float, ...]
    ratio: float
    sigma: float
    residual_px: float

    @property
    def is_known(self) -> bool:
        """Whether the pictures tell it well enough to see that it is as declared."""
        return self.sigma <= SIZE_KNOWN

    @property
    def is_declared(self) -> bool:
        """Whether it may be the declared size: it is not off by what such pictures hardly show."""
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
        """What a single picture may show, the likeliest first; none if it cannot be this shape."""
        guesses = [self._placed(view, axes) for axes in self.shape.guesses(flat=self.flat)]
        ranked = sorted(
            (scene for scene in guesses if scene is not None),
            key=lambda scene: self._misfit(scene, view),
        )
        fits = [self._solved(scene, [view]) for scene in ranked[:_BEST]]
        return sorted(fits, key=lambda fit: fit.cost)

    def again(self, fits: Sequence[ShapeFit], views: Sequence[OutlineView]) -> list[ShapeFit]:
        """What all pictures show, begun from what some of them have shown; the likeliest first."""
        return sorted((self._solved(fit.scene, views) for fit in fits), key=lambda fit: fit.cost)

    def size_of(
        self, fit: ShapeFit, views: Sequence[OutlineView], edge: int | None = None
    ) -> SizeFit:
        """The size that explains all pictures best, the pose and the camera being free as well.

        The cost at its least over all else is a parabola of the size (the profile likelihood): its
        lowest point is the size, its curvature one over the variance. Pictures from one place tell
        nothing of the size: what is larger is farther away.

        Args:
            fit: What the pictures show if it has the declared size.
            views: Outlines of it, those included that do not go with that.
            edge: Which of the shape's measures is free; by default all of them together.
        """
        middle, curve, scene = 0.0, 0.0, fit.scene
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

    def _placed(self, view: OutlineView, axes: Matrix) -> Scene | None:
        """A thing turned like this where the picture has one, as far away as its area says."""
        width = self.shape.extent
        depth = view.focal_px * width * 1.5 / math.sqrt(view.detection.area_px)
        pixel = view.middle
        scene = None
        for _ in range(3):
            ray = np.array((*(pixel / view.focal_px), 1.0))
            scene = Scene.believed(view.camera.apply(depth * ray), axes)
            seen = project(scene, self.shape, view)
            if seen is None or seen.area <= 0.0:
                return None
            pixel = pixel + view.middle - seen.middle
            depth *= math.sqrt(seen.area / view.detection.area_px)
        return scene

    def _misfit(self, scene: Scene, view: OutlineView) -> float:
        seen = project(scene, self.shape, view)
        if seen is None:
            return _FAR
        return float(np.mean(np.abs(outline_error(seen, view.edge, 0.0)[0])))

    def _solved(self, scene: Scene, views: Sequence[OutlineView]) -> ShapeFit:
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
                scene, damping = trial, damping / 5.0
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
        self, scene: Scene, views: Sequence[OutlineView], level: Vector | None
    ) -> tuple[Matrix, Vector, float, float]:
        """Normal matrix, slope, half the sum of squares, and what is left in px."""
        normal, slope, cost = self._known_before(scene, level)
        square, count = 0.0, 0
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
            square, count = square + float(error @ error), count + len(error)
        return normal, slope, cost, math.sqrt(square / max(count, 1))

    def _known_before(self, scene: Scene, level: Vector | None) -> tuple[Matrix, Vector, float]:
        """What is known without a picture: normal matrix, slope and half the sum of squares."""
        off = np.zeros(UNKNOWNS)
        off[MOUNT_TURN], off[MOUNT_SHIFT] = vector_of(scene.mount_turn), scene.mount_shift
        off[FOCAL], off[RIM] = scene.longer, scene.rim
        normal, slope = np.diag(_DOUBT**-2.0), off / _DOUBT**2
        cost = 0.5 * float(np.sum((off / _DOUBT) ** 2))
        if level is not None and self.shape.kind != "sphere":
            up = scene.rotation @ level
            tilt, by_turn = up[:2] / LEVEL_DOUBT, -cross_matrix(up)[:2] / LEVEL_DOUBT
            normal[TURN, TURN] += by_turn.T @ by_turn
            slope[TURN] += by_turn.T @ tilt
            cost += 0.5 * float(tilt @ tilt)
        return normal, slope, cost


def canonical(fit: ShapeFit, shape: KnownShape) -> ShapeFit:
    """The same, turned as the pose that looks alike and is turned least."""
    rotation = shape.canonical(fit.pose).rotation_matrix
    return replace(fit, scene=replace(fit.scene, rotation=rotation))
