"""Things of one colour and shape, found in pictures from several places and told apart."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Final

import numpy as np

from bt_dualarm.pose import Pose, Vector
from bt_dualarm.spec.color import Color
from bt_dualarm.spec.marker import MarkerSpec
from bt_dualarm.vision.colors import ColorFilter
from bt_dualarm.vision.edges import OutlineView, outlines
from bt_dualarm.vision.known_shape import KnownShape
from bt_dualarm.vision.markers import MarkerFitter, SquareCorners, markers_in
from bt_dualarm.vision.outline_error import project
from bt_dualarm.vision.shape_fit import ShapeFit, ShapeFitter, SizeFit, canonical
from bt_dualarm.world.cameras.frame import Frame

UNLIKE_PX: Final = 0.8
"""Root mean square of what an outline leaves, from which on it is of another shape, or covered."""

LEAST_AREA_PX: Final = 60.0
"""Area of an outline, in square pixels, that tells a shape."""

_BEHIND: Final = 0.15
"""Share of a picture from which on what goes beyond its edge may be the ground of things."""

_ASTRAY_PX: Final = 12.0
"""Pixels from its prediction at which a thing is still taken for the same, with half its width."""


@dataclass(eq=False)
class SightedThing:
    """One thing, and what was seen of it.

    Attributes:
        fits: What the pictures may show, the likeliest first.
        views: Its outlines.
        astray: Outlines in its place that were not of such a thing that stands still there.
        middle: Its middle in the frame of what is fitted, of shape (3,), m.
        sizes: What was found of its size, by the number of outlines and the measure.
    """

    fits: list[ShapeFit]
    views: list[OutlineView] = field(default_factory=list)
    astray: list[OutlineView] = field(default_factory=list)
    middle: Vector = field(default_factory=lambda: np.zeros(3))
    sizes: dict[tuple[int, int | None], SizeFit] = field(default_factory=dict)

    @property
    def best(self) -> ShapeFit:
        """The likeliest, at the thing's middle."""
        return self.fits[0].about(self.middle) if self.middle.any() else self.fits[0]

    @property
    def position(self) -> Vector:
        """Place of its centre in the world, of shape (3,), m."""
        return self.best.scene.position


class SightedThings:
    """Takes pictures in, and knows the things in them.

    Args:
        find: Function that finds what may be one of the things in a picture.
        fitter: Fitter of their shape.
        middle: Middle of a thing in the frame of what is fitted, of shape (3,), m; by default its
            origin.
        nothing: Words for a picture in which nothing is that could be one of them.
        color: Colour that they have, if they are found by that.

    Attributes:
        things: Things that were found, in no particular order.
        unlike: Number of patches of the colour, in the last picture, that are of another shape.
        others_whole: How many of these are certainly none of the things, whole or not: balls where
            boxes are looked for, which no boxes together look like.
        beyond: Share of the last picture covered by patches that go beyond its edge.
    """

    def __init__(
        self,
        find: Callable[[Frame], list[OutlineView]],
        fitter: ShapeFitter,
        middle: Vector | None = None,
        nothing: str = "nothing has that colour",
        color: ColorFilter | None = None,
    ) -> None:
        self._color = color
        self._nothing = nothing
        self.things: list[SightedThing] = []
        self.unlike, self.others_whole, self.beyond = 0, 0, 0.0
        self._find = find
        self._fitter = fitter
        self._middle: Vector = np.zeros(3) if middle is None else middle

    @classmethod
    def of_color(cls, color: Color, shape: KnownShape, *, flat: bool = True) -> SightedThings:
        """Things of a colour and a shape, which may lie flat on something level."""
        seen = ColorFilter(color)
        fitter = ShapeFitter(shape, flat)
        return cls(lambda frame: outlines(frame, seen, LEAST_AREA_PX), fitter, color=seen)

    @classmethod
    def of_marker(
        cls, marker: MarkerSpec, middle: Vector | None = None, *, flat: bool = True
    ) -> SightedThings:
        """Things that bear a marker, whose middle is there in the marker's frame, (3,), m."""
        fitter = MarkerFitter(SquareCorners("box", (marker.size,)), flat)
        return cls(
            lambda frame: markers_in(frame, marker), fitter, middle, "no such marker is in it"
        )

    @property
    def shape(self) -> KnownShape:
        """Shape that is fitted."""
        return self._fitter.shape

    def has_color(self, rgba: Sequence[float]) -> bool:
        """Whether that colour (red, green, blue, 0..1, more ignored) is the one looked for."""
        pixel = np.rint(255.0 * np.array(rgba[:3])).astype(np.uint8).reshape(1, 1, 3)
        return self._color is not None and bool(self._color.mask(pixel).any())

    def take(self, frame: Frame) -> None:
        """Take one picture in: better poses of known things, and new ones."""
        found = self._find(frame)
        patches = [patch for patch in found if patch.is_whole]
        cut = sum(patch.detection.area_px for patch in found if not patch.is_whole)
        self.beyond = cut / (frame.width * frame.height)
        seen = list[SightedThing]()
        for thing in self.things:
            patch = self._of(thing, patches)
            if patch is not None:
                patches.remove(patch)
                self._look_again(thing, patch)
                seen.append(thing)
        self.unlike, self.others_whole = 0, 0
        for patch in patches:
            fits = self._fitter.first(patch)
            if not fits or fits[0].residual_px > UNLIKE_PX:
                self.unlike += 1
                self.others_whole += self._is_other(patch)
                continue
            known = self._known_at(fits[0].scene.position, seen)
            if known is None:
                known = SightedThing(fits, [patch], middle=self._middle)
                self.things.append(known)
            else:
                known.astray.append(patch)
            seen.append(known)

    @property
    def is_ground(self) -> bool:
        """Whether so much of the last picture has the colour that things may lie before it."""
        return self.beyond > _BEHIND

    @property
    def others(self) -> str:
        """What else has the colour in the last picture, in words."""
        said = []
        if self.unlike:
            are = "patch is" if self.unlike == 1 else "patches are"
            said.append(f"{self.unlike} {are} of another shape, covered in part, or moving")
        if self.is_ground:
            behind = "what is behind may have that colour, too: tell it apart by `color`"
            share = f"{100 * self.beyond:.0f} %"
            said.append(f"{share} of the picture have it, up to its edge; {behind}")
        elif self.beyond:
            said.append("something goes beyond the picture")
        return "; ".join(said) or self._nothing

    def pose(self, thing: SightedThing) -> Pose:
        """Pose of a thing in the world; of those that look alike the one turned least."""
        return canonical(thing.best, self._fitter.shape).pose

    def size_of(self, thing: SightedThing) -> SizeFit:
        """How large a thing is as a whole by all its outlines, if it has the declared form."""
        return self._size_of(thing, None)

    def _size_of(self, thing: SightedThing, edge: int | None) -> SizeFit:
        """Its size, as a whole or in one measure: worked out once for all pictures so far."""
        views = [*thing.views, *thing.astray]
        key = len(views), edge
        if key not in thing.sizes:
            thing.sizes[key] = self._fitter.size_of(thing.fits[0], views, edge)
        return thing.sizes[key]

    def other_size(self, thing: SightedThing) -> SizeFit | None:
        """The size that a thing has instead of the declared one, as a whole or in one measure.

        None where its outlines go with the declared size, or with no size of this form.
        """
        edges = len(self.shape.size) if len(self.shape.size) > 1 else 0
        for edge in (None, *range(edges)):
            size = self._size_of(thing, edge)
            if not size.is_declared and size.residual_px <= UNLIKE_PX:
                return size
        return None

    def sigma_rad(self, thing: SightedThing) -> float:
        """Standard deviation of its turn about the worst axis, as far as one can be seen, rad."""
        return thing.best.sigma_rad(self._fitter.shape)

    def _is_other(self, patch: OutlineView) -> bool:
        """Whether a patch of another outline has the outline of a ball, as boxes never have."""
        if self.shape.kind != "box":
            return False
        balls = ShapeFitter(KnownShape("sphere", (self.shape.extent,))).first(patch)
        return bool(balls) and balls[0].residual_px <= UNLIKE_PX

    def _of(self, thing: SightedThing, patches: list[OutlineView]) -> OutlineView | None:
        """The patch that is where a thing should be seen, if there is one."""
        if not patches:
            return None
        seen = project(thing.fits[0].scene, self._fitter.shape, patches[0])
        if seen is None:
            return None
        away = [float(np.linalg.norm(patch.middle - seen.middle)) for patch in patches]
        nearest = int(np.argmin(away))
        return patches[nearest] if away[nearest] < _ASTRAY_PX + 0.25 * seen.area**0.5 else None

    def _look_again(self, thing: SightedThing, patch: OutlineView) -> None:
        fits = self._fitter.again(thing.fits, [*thing.views, patch])
        if fits[0].residual_px > UNLIKE_PX:
            thing.astray.append(patch)
            return
        thing.fits = fits
        thing.views.append(patch)

    def _known_at(self, position: Vector, seen: list[SightedThing]) -> SightedThing | None:
        """The known thing nearest to a place, if one is not farther than its extent.

        What is elsewhere in the same picture (``seen``) is another one, however near.
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
