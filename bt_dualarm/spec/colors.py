"""Colors of objects: names, and red, green, blue and opacity."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Final, Literal, TypeAlias

from pydantic import BeforeValidator, Discriminator, Field, Tag

from bt_dualarm.spec.problems import written_as

_Shade: TypeAlias = Annotated[float, Field(ge=0.0, le=1.0)]

NAMED_COLORS: Final[Mapping[str, tuple[float, float, float]]] = {
    "red": (0.80, 0.05, 0.05),
    "orange": (0.95, 0.45, 0.05),
    "yellow": (0.95, 0.85, 0.05),
    "green": (0.05, 0.65, 0.10),
    "blue": (0.05, 0.15, 0.80),
    "white": (0.95, 0.95, 0.95),
    "gray": (0.50, 0.50, 0.50),
    "black": (0.05, 0.05, 0.05),
}
"""Red, green, blue from 0 to 1 of each color that an object can have by name."""


def _american(name: object) -> object:
    """The spelling in `NAMED_COLORS`; British spelling is accepted, too."""
    return "gray" if name == "grey" else name


ColorName: TypeAlias = Literal["red", "orange", "yellow", "green", "blue", "white", "gray", "black"]
ObjectColor: TypeAlias = Annotated[
    Annotated[ColorName, BeforeValidator(_american), Tag("name")]
    | Annotated[tuple[_Shade, ...], Field(min_length=3, max_length=4), Tag("value")],
    Discriminator(written_as),
]
"""Color by name, or as red, green, blue and optionally opacity from 0 to 1."""


def rgba_of(color: str | tuple[float, ...]) -> tuple[float, float, float, float]:
    """Returns red, green, blue and opacity of an object's color, each from 0 to 1."""
    red, green, blue, *opacity = NAMED_COLORS[color] if isinstance(color, str) else color
    return red, green, blue, opacity[0] if opacity else 1.0
