"""Scanning: detection and data association of objects of one kind in several images."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Final

import numpy as np

from bt_dualarm.core.pose import Pose, Vector
from bt_dualarm.perception.detection import ColorFilter
from bt_dualarm.perception.known_shape import KnownShape
from bt_dualarm.perception.markers import MarkerFitter, SquareCorners, markers_in
from bt_dualarm.perception.shape_fit import (
    OutlineView,
    ShapeFit,
    ShapeFitter,
    SizeFit,
    canonical,
    outlines,
    project,
)
from bt_dualarm.sim.frame import Frame
from bt_dualarm.spec.values import Color, MarkerSpec

UNLIKE_PX: Final = 0.8
"""Root-mean-square residual above which an outline is of another shape, or partly occluded."""

LEAST_AREA_PX: Final = 60.0
"""Least area of an outline whose shape can be determined, square pixels."""

_BACKGROUND: Final = 0.15
"""Share of an image above which regions at its edge may be the background of objects."""

_ASTRAY_PX: Final = 12.0
"""Gate of the association, in addition to half the object's width, px."""


@dataclass(eq=False)
class SightedThing:
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


class SightedThings:
    """Detector of objects of one kind, which accumulates images.

    Args:
        find: Function that finds candidates in an image.
        fitter: Fitter of their shape.
        middle: Middle of an object in the frame of what is fitted, of shape (3,), m; by default its
            origin.
        none_found: Message for an image without candidates.
        color: Color of the objects, if they are detected by color.

    Attributes:
        things: Detected objects, in no particular order.
        unlike: Number of candidates of another shape in the last image.
        others_whole: Number of these that are certainly other objects: balls instead of boxes.
        beyond: Share of the last image covered by regions that go beyond its edge.
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
        self.things: list[SightedThing] = []
        self.unlike = 0
        self.others_whole = 0
        self.beyond = 0.0
        self._find = find
        self._fitter = fitter
        self._middle: Vector = np.zeros(3) if middle is None else middle

    @classmethod
    def of_color(cls, color: Color, shape: KnownShape, *, flat: bool = True) -> SightedThings:
        """Detector of objects of a color and a shape, which may lie flat on a level surface."""
        seen = ColorFilter(color)
        fitter = ShapeFitter(shape, flat)
        return cls(lambda frame: outlines(frame, seen, LEAST_AREA_PX), fitter, color=seen)

    @classmethod
    def of_marker(
        cls, marker: MarkerSpec, middle: Vector | None = None, *, flat: bool = True
    ) -> SightedThings:
        """Detector of objects with a marker; ``middle`` is their center in its frame, (3,), m."""
        fitter = MarkerFitter(SquareCorners("box", (marker.size,)), flat)
        return cls(
            lambda frame: markers_in(frame, marker), fitter, middle, "no such marker is in it"
        )

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
        found = self._find(frame)
        regions = [region for region in found if region.is_whole]
        cut = sum(region.detection.area_px for region in found if not region.is_whole)
        self.beyond = cut / (frame.width * frame.height)
        seen = list[SightedThing]()
        for thing in self.things:
            region = self._of(thing, regions)
            if region is not None:
                regions.remove(region)
                self._refine(thing, region)
                seen.append(thing)
        self.unlike = 0
        self.others_whole = 0
        for region in regions:
            fits = self._fitter.first(region)
            if not fits or fits[0].residual_px > UNLIKE_PX:
                self.unlike += 1
                self.others_whole += self._is_other(region)
                continue
            known = self._known_at(fits[0].scene.position, seen)
            if known is None:
                known = SightedThing(fits, [region], middle=self._middle)
                self.things.append(known)
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
        if self.unlike:
            are = "region is" if self.unlike == 1 else "regions are"
            reasons.append(f"{self.unlike} {are} of another shape, partly occluded, or moving")
        if self.is_ground:
            advice = "the background may have that color, too: choose another `color`"
            share = f"{100 * self.beyond:.0f} %"
            reasons.append(f"{share} of the image has it, up to its border; {advice}")
        elif self.beyond:
            reasons.append("an object extends beyond the image")
        return "; ".join(reasons) or self._none_found

    def pose(self, thing: SightedThing) -> Pose:
        """Pose of an object in the world; of equivalent ones the one with the least rotation."""
        return canonical(thing.best, self._fitter.shape).pose

    def size_of(self, thing: SightedThing) -> SizeFit:
        """Size of an object by all its outlines, if it has the declared proportions."""
        return self._size_of(thing, None)

    def _size_of(self, thing: SightedThing, edge: int | None) -> SizeFit:
        """Size as a whole or in one dimension, cached for all images so far."""
        views = [*thing.views, *thing.astray]
        key = len(views), edge
        if key not in thing.sizes:
            thing.sizes[key] = self._fitter.size_of(thing.fits[0], views, edge)
        return thing.sizes[key]

    def other_size(self, thing: SightedThing) -> SizeFit | None:
        """The true size of an object that differs from the declared one, as a whole or in one edge.

        None if its outlines agree with the declared size, or with no size of this shape.
        """
        edges = len(self.shape.size) if len(self.shape.size) > 1 else 0
        for edge in (None, *range(edges)):
            size = self._size_of(thing, edge)
            if not size.is_declared and size.residual_px <= UNLIKE_PX:
                return size
        return None

    def sigma_rad(self, thing: SightedThing) -> float:
        """Largest standard deviation of the orientation, up to the symmetry of the object, rad."""
        return thing.best.sigma_rad(self._fitter.shape)

    def _is_other(self, region: OutlineView) -> bool:
        """Whether a candidate is certainly another object: a ball, when boxes are detected."""
        if self.shape.kind != "box":
            return False
        balls = ShapeFitter(KnownShape("sphere", (self.shape.extent,))).first(region)
        return bool(balls) and balls[0].residual_px <= UNLIKE_PX

    def _of(self, thing: SightedThing, regions: list[OutlineView]) -> OutlineView | None:
        """Candidate at the predicted position of an object, if there is one."""
        if not regions:
            return None
        seen = project(thing.fits[0].scene, self._fitter.shape, regions[0])
        if seen is None:
            return None
        away = [float(np.linalg.norm(region.middle - seen.middle)) for region in regions]
        nearest = int(np.argmin(away))
        return regions[nearest] if away[nearest] < _ASTRAY_PX + 0.25 * seen.area**0.5 else None

    def _refine(self, thing: SightedThing, region: OutlineView) -> None:
        fits = self._fitter.again(thing.fits, [*thing.views, region])
        if fits[0].residual_px > UNLIKE_PX:
            thing.astray.append(region)
            return
        thing.fits = fits
        thing.views.append(region)

    def _known_at(self, position: Vector, seen: list[SightedThing]) -> SightedThing | None:
        """Known object nearest to a position, if one is within its extent.

        Objects that the same image shows elsewhere (``seen``) are excluded.
        """
        away = {
            number: float(np.linalg.norm(one.position - position))
            for number, one in enumerate(self.things)
            if one not in seen
        }
        nearest = min(away, key=lambda number: away[number], default=None)
        if nearest is None or away[nearest] >= self._fitter.shape.extent:
            return None
        return self.things[nearest]
