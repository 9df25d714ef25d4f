"""Ports of skills that look for things: what these look like."""

from __future__ import annotations

from typing import Annotated, Literal, TypeAlias

import numpy as np
from pydantic import Field

from bt_dualarm.arm.arm import Arm
from bt_dualarm.errors import Failure
from bt_dualarm.spec.color import Color
from bt_dualarm.spec.document import ObjectSpec
from bt_dualarm.spec.marker import MarkerSpec
from bt_dualarm.spec.ports import PortModel, port
from bt_dualarm.spec.shapes import SIZE_IN_WORDS, SIZES, ShapeName
from bt_dualarm.spec.values import ObjectName
from bt_dualarm.vision.appearance import ColorlessError, color_of
from bt_dualarm.vision.known_shape import KnownShape
from bt_dualarm.vision.sighted import SightedThings
from bt_dualarm.world.marker_bodies import marker_height

_Length: TypeAlias = Annotated[float, Field(ge=1e-4, le=10.0)]


class SightPorts(PortModel):
    """What is looked for: the kind of a declared object, a shape with size and colour, a marker."""

    exactly_one_of = ("object", "shape", "marker")

    object: ObjectName | None = port(
        None, "declared object whose colour, shape and size are looked for; not its pose"
    )
    by: Literal["color", "marker"] = port(
        "color", "what the object is found by: its colour and shape, or the marker on it"
    )
    marker: MarkerSpec | None = port(
        None, "marker to look for, where no object is named; its pose has z out of it"
    )
    shape: ShapeName | None = port(None, "shape to look for, where no object is named")
    size: tuple[_Length, ...] | None = port(
        None,
        SIZE_IN_WORDS.lower(),
        unit="m",
        min_length=1,
        max_length=3,
    )
    color: Color | None = port(
        None, "a name or HSV ranges; that of the object where it is left out"
    )
    flat: bool = port(
        True, "whether they lie flat on something level: one of their axes is upright"
    )

    @property
    def is_by_marker(self) -> bool:
        """Whether what is looked for is a marker."""
        return self.marker is not None or (self.object is not None and self.by == "marker")

    def sighted(self, arm: Arm) -> SightedThings:
        """What takes pictures in and finds such things in them.

        Whether a declared object is in the world only the pictures say.

        Raises:
            Failure: ``INVALID_TARGET`` for what has no colour, size or marker.
        """
        if self.object is not None:
            return self._like(arm.world.declared_objects[self.object])
        if self.marker is not None:
            return SightedThings.of_marker(self.marker, flat=self.flat)
        if self.shape is None or self.size is None or self.color is None:
            raise Failure("INVALID_TARGET", "a shape has to come with its size and its color")
        wanted = len(SIZES[self.shape])
        if len(self.size) != wanted:
            reason = f"the size of a {self.shape} has {wanted} numbers, not {len(self.size)}"
            raise Failure("INVALID_TARGET", reason)
        shape = KnownShape(self.shape, self.size)
        return SightedThings.of_color(self.color, shape, flat=self.flat)

    def _like(self, thing: ObjectSpec) -> SightedThings:
        """Things that look like a declared object."""
        if self.by == "marker":
            if thing.marker is None:
                raise Failure("INVALID_TARGET", f"object {self.object!r} bears no marker")
            below = np.array((0.0, 0.0, -marker_height(thing)))
            return SightedThings.of_marker(thing.marker, below, flat=self.flat)
        try:
            color = self.color or color_of(thing)
        except ColorlessError as error:
            raise Failure("INVALID_TARGET", f"{error}: give `color`") from error
        return SightedThings.of_color(color, KnownShape(thing.shape, thing.size), flat=self.flat)

    @property
    def ignored(self) -> frozenset[str]:
        """The object that is looked for: it is nowhere yet, so no plan can keep clear of it."""
        return frozenset({self.object} if self.object else ())
