"""Shapes of objects: what the numbers of a size mean, hollow shapes, and parts of a compound."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Annotated, Final, Literal, Protocol, TypeAlias

from pydantic import Field, model_validator

from bt_dualarm.core.errors import rounded_down, rounded_up
from bt_dualarm.spec.colors import ObjectColor
from bt_dualarm.spec.node_types import port
from bt_dualarm.spec.texture import TextureSpec
from bt_dualarm.spec.values import SIZES as SOLID_SIZES
from bt_dualarm.spec.values import PoseSpec, Value

PartShape: TypeAlias = Literal[
    "box",
    "cylinder",
    "capsule",
    "sphere",
    "ellipsoid",
    "prism",
    "bin",
    "tray",
    "tube",
    "cup",
    "bowl",
    "table",
    "shelf",
]
"""Shapes that are given by a size."""

ObjectShape: TypeAlias = Literal[PartShape, "compound", "mesh"]
"""Shapes that an object can have."""

SIZES: Final[Mapping[PartShape, tuple[str, ...]]] = {
    "box": SOLID_SIZES["box"],
    "cylinder": SOLID_SIZES["cylinder"],
    "capsule": SOLID_SIZES["capsule"],
    "sphere": SOLID_SIZES["sphere"],
    "ellipsoid": ("x", "y", "z"),
    "prism": ("radius", "length"),
    "bin": ("x", "y", "z"),
    "tray": ("x", "y", "z"),
    "tube": ("radius", "length"),
    "cup": ("radius", "height"),
    "bowl": ("radius", "height"),
    "table": ("x", "y", "z"),
    "shelf": ("x", "y", "z"),
}
"""Names of the numbers in the size of each shape."""

HOLLOW: Final = ("bin", "tray", "tube", "cup", "bowl", "table", "shelf")
"""Shapes that have a wall."""

SIZE_IN_WORDS: Final = (
    "Edge lengths of a box; outer lengths of an ellipsoid, bin, tray, table or shelf; radius and "
    "length of a cylinder, prism (of its corners) or tube, or of a capsule without its end caps; "
    "radius and height of a cup or bowl; radius of a sphere. A compound has parts instead, a mesh "
    "a file"
)
"""Description of these numbers, which are in meters."""

THINNEST_WALL: Final = 0.007
"""Minimum wall of a round hollow shape as a fraction of its radius: its wall consists of at most 32
flat segments, which would be thinner at their edges than in their middle."""

_ROUNDING: Final = 1e-9
"""Share by which a wall may miss a bound that is computed from the size."""

WALL_IN_WORDS: Final = (
    "Thickness of the walls of a hollow shape, by default 3 mm; of a table's top, 30 mm; or of the "
    "boards of a shelf, 18 mm"
)
"""Description of ``wall``."""

_WALLS_M: Final = {"table": 0.03, "shelf": 0.018}
_WALL_M: Final = 0.003
"""Thickness of a wall that is not given, m; that of the boards of some shapes, and of others."""

DEFAULT_BOARDS: Final = 3
"""Number of boards of a shelf that does not give it."""

Length: TypeAlias = Annotated[float, Field(ge=1e-4, le=10.0)]


class Shaped(Protocol):
    """What determines the shape of an object or of a part."""

    @property
    def size(self) -> tuple[float, ...]:
        """Its size, m."""

    @property
    def wall(self) -> float | None:
        """Thickness of its wall, m; None for the default."""

    @property
    def sides(self) -> int | None:
        """Number of sides of a prism; None for the default."""

    @property
    def boards(self) -> int | None:
        """Number of boards of a shelf; None for the default."""


def refuse_size(shape: PartShape, shaped: Shaped) -> None:
    """Check that size, wall and sides fit a shape.

    Raises:
        ValueError: One of them does not; the message names it.
    """
    meaning = SIZES[shape]
    wanted = ", ".join(meaning)
    size = shaped.size
    if not size:
        raise ValueError(f"{_a(shape)} needs size: [{wanted}]")
    if len(size) != len(meaning):
        raise ValueError(f"the size of {_a(shape)} is [{wanted}], not {list(size)}")
    if shaped.sides is not None and shape != "prism":
        raise ValueError(f"only a prism has sides, not {_a(shape)}")
    if shaped.boards is not None and shape != "shelf":
        raise ValueError(f"only a shelf has boards, not {_a(shape)}")
    if shaped.wall is not None and shape not in HOLLOW:
        raise ValueError(f"only {', '.join(HOLLOW)} have a wall, not {_a(shape)}")
    if shape not in HOLLOW:
        return
    wall = wall_of(shape, shaped.wall)
    if shape == "shelf":
        most = min(0.4 * size[0], 0.4 * size[1], 0.9 * size[2] / (shaped.boards or DEFAULT_BOARDS))
    elif shape in ("bin", "tray", "table"):
        most = min(0.4 * size[0], 0.4 * size[1], 0.8 * size[2])
    else:
        most = 0.8 * size[0] if shape == "tube" else min(0.8 * size[0], 0.8 * size[1])
        if wall < THINNEST_WALL * size[0] * (1.0 - _ROUNDING):
            raise ValueError(
                f"the wall of {_a(shape)} with a radius of {1e3 * size[0]:g} mm is at least "
                f"{rounded_up(1e3 * THINNEST_WALL * size[0], 2):g} mm, not {1e3 * wall:g} mm"
            )
    if wall > most * (1.0 + _ROUNDING):
        raise ValueError(
            f"the wall of this {shape} is at most {rounded_down(1e3 * most, 4):g} mm, not "
            f"{1e3 * wall:g} mm"
        )


def wall_of(shape: PartShape, wall: float | None) -> float:
    """Returns the thickness of the walls or boards of a shape, m.

    Args:
        shape: Shape.
        wall: Given thickness, m; None for the default.
    """
    return _WALLS_M.get(shape, _WALL_M) if wall is None else wall


def has_round_top(shape: ObjectShape) -> bool:
    """Whether a shape has no level face on top that could bear a marker."""
    return shape not in ("box", "cylinder", "prism")


def room_on_top(shape: ObjectShape, shaped: Shaped) -> float:
    """Returns the edge of the largest square on the top face of a shape that has one, m."""
    if shape == "box":
        return min(shaped.size[:2])
    if shape == "cylinder":
        return 2**0.5 * shaped.size[0]
    # The circle within a regular polygon, and the square within that circle.
    return 2**0.5 * shaped.size[0] * math.cos(math.pi / (shaped.sides or DEFAULT_SIDES))


DEFAULT_SIDES: Final = 6
"""Number of sides of a prism that does not give it."""


class PartSpec(Value):
    """A part of a compound object."""

    shape: PartShape = port(..., "Shape, which determines the meaning of `size`")
    size: tuple[Length, ...] = port(
        ..., "Size, as that of an object of this shape", unit="m", min_length=1, max_length=3
    )
    wall: float | None = port(None, WALL_IN_WORDS, unit="m", ge=5e-4, le=0.2)
    sides: int | None = port(None, "Number of sides of a prism; by default 6", ge=3, le=32)
    boards: int | None = port(None, "Number of boards of a shelf; by default 3", ge=2, le=12)
    pose: PoseSpec = port(
        PoseSpec(xyz=(0.0, 0.0, 0.0)), "Pose of its center in the frame of the object"
    )
    color: ObjectColor | None = port(None, "Its color; by default that of the object")
    texture: TextureSpec | None = port(
        None, "Pattern or image on its surface; by default that of the object"
    )
    density: float = port(
        1.0, "Density relative to the other parts, which share the mass", ge=1e-3, le=1e3
    )

    @model_validator(mode="after")
    def _size_fits_shape(self) -> PartSpec:
        refuse_size(self.shape, self)
        return self


def _a(shape: str) -> str:
    return f"{'an' if shape[0] in 'aeiou' else 'a'} {shape}"
