"""Shapes that things can have, and what their sizes mean."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final, Literal, TypeAlias

ShapeName: TypeAlias = Literal["box", "cylinder", "capsule", "sphere"]

SIZES: Final[Mapping[ShapeName, tuple[str, ...]]] = {
    "box": ("x", "y", "z"),
    "cylinder": ("radius", "length"),
    "capsule": ("radius", "length"),
    "sphere": ("radius",),
}
"""Names of the numbers that the size of each shape has."""

SIZE_IN_WORDS: Final = (
    "Edges of a box; radius and length of a cylinder, or of a capsule between its two half balls; "
    "radius of a sphere"
)
"""What these numbers mean, m."""
