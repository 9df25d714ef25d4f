"""Ports of skills that look for things: what these look like."""

from __future__ import annotations

from typing import Annotated, Final, Literal, TypeAlias

from pydantic import Field

from bt_dualarm.arm.arm import Arm
from bt_dualarm.errors import Failure
from bt_dualarm.spec.color import Color
from bt_dualarm.spec.ports import PortModel, port
from bt_dualarm.spec.values import ObjectName
from bt_dualarm.vision.appearance import ColorlessError, color_of
from bt_dualarm.vision.known_shape import KnownShape

_Length: TypeAlias = Annotated[float, Field(ge=1e-4, le=10.0)]

_NUMBERS: Final = {"box": 3, "cylinder": 2, "sphere": 1}
"""Numbers that the size of a shape has."""


class SightPorts(PortModel):
    """What is looked for: the kind of a declared object, or a shape with its size and colour."""

    exactly_one_of = ("object", "shape")

    object: ObjectName | None = port(
        None, "declared object whose colour, shape and size are looked for; not its pose"
    )
    shape: Literal["box", "cylinder", "sphere"] | None = port(
        None, "shape to look for, where no object is named"
    )
    size: tuple[_Length, ...] | None = port(
        None,
        "edges of a box; radius and length of a cylinder; radius of a sphere",
        unit="m",
        min_length=1,
        max_length=3,
    )
    color: Color | None = port(
        None, "a name or HSV ranges; that of the object where it is left out"
    )
    flat: bool = port(True, "whether the things lie flat on something level")

    def looked_for(self, arm: Arm) -> tuple[Color, KnownShape]:
        """Colour and shape, from the ports or from what the file says of the object.

        Raises:
            Failure: ``INVALID_TARGET`` for what has no colour or size; ``NOT_SEEN`` for an object
                that is not in the world.
        """
        if self.object is not None:
            thing = arm.world.objects.get(self.object)
            if thing is None:
                raise Failure("NOT_SEEN", f"object {self.object!r} is not in the world")
            try:
                return self.color or color_of(thing), KnownShape(thing.shape, thing.size)
            except ColorlessError as error:
                raise Failure("INVALID_TARGET", f"{error}: give `color`") from error
        if self.shape is None or self.size is None or self.color is None:
            raise Failure("INVALID_TARGET", "without an object, shape, size and color are needed")
        wanted = _NUMBERS[self.shape]
        if len(self.size) != wanted:
            reason = f"the size of a {self.shape} has {wanted} numbers, not {len(self.size)}"
            raise Failure("INVALID_TARGET", reason)
        return self.color, KnownShape(self.shape, self.size)

    @property
    def ignored(self) -> frozenset[str]:
        """The object that is looked for: it is nowhere yet, so no plan can keep clear of it."""
        return frozenset({self.object} if self.object else ())
