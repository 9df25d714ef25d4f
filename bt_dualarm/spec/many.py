"""Many objects from one entry of a tree file: grids, stacks, piles and scattered ones.

An entry with ``many`` stands for several objects, whose names are its own with a number from 1:
``cube1``, ``cube2``. `bt_dualarm.spec.document.expanded` replaces the entries of a file. Random
sizes, colors and positions are drawn when the seed of the run is known, from the `Group` of an
entry.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, ClassVar, Final, TypeAlias

from pydantic import Field, model_validator

from bt_dualarm.spec.colors import ObjectColor
from bt_dualarm.spec.node_types import PortModel, port
from bt_dualarm.spec.shapes import Length

MOST_OF_A_KIND: Final = 100
"""Largest number of objects of one entry."""

_Count: TypeAlias = Annotated[int, Field(ge=1, le=MOST_OF_A_KIND)]
_Size: TypeAlias = Annotated[tuple[Length, ...], Field(min_length=1, max_length=3)]
_Edge: TypeAlias = Annotated[float, Field(ge=0.001, le=20.0)]


class ManySpec(PortModel):
    """How many objects an entry stands for, and where they are."""

    exactly_one_of = ("grid", "stack", "pile", "scatter")
    goes_with: ClassVar[Mapping[str, str]] = {"spacing": "grid"}

    grid: Annotated[tuple[_Count, ...], Field(min_length=1, max_length=3)] | None = port(
        None, "Numbers of objects along x, y and z of the pose, which is in the middle"
    )
    spacing: Annotated[tuple[_Edge, ...], Field(min_length=1, max_length=3)] | None = port(
        None,
        "Distances of the centers of a grid; by default by size and `gap`",
        unit="m",
    )
    stack: _Count | None = port(None, "Number of objects on top of each other, from the pose up")
    pile: _Count | None = port(
        None, "Number of objects that fall onto the pose, over `area`, when the run starts"
    )
    scatter: _Count | None = port(
        None, "Number of objects at random places within `area`, at the height of the pose"
    )
    area: tuple[_Edge, _Edge] = port(
        (0.3, 0.3),
        "Edges of the area of `pile` and `scatter` around the pose",
        unit="m",
    )
    gap: float = port(
        0.01, "Minimum distance between the objects, except in a stack", unit="m", ge=0.0, le=1.0
    )
    yaw: float = port(
        180.0,
        "Half-width of the random turn about the vertical of `pile` and `scatter`",
        unit="deg",
        ge=0.0,
        le=180.0,
    )
    sizes: tuple[_Size, _Size] | None = port(
        None, "Minimum and maximum size: each number is random between them", unit="m"
    )
    colors: Annotated[tuple[ObjectColor, ...], Field(min_length=1, max_length=20)] | None = port(
        None, "Colors of which each object has a random one"
    )

    @model_validator(mode="after")
    def _sizes_ascend(self) -> ManySpec:
        if self.sizes is not None:
            low, high = self.sizes
            if len(low) != len(high) or any(a > b for a, b in zip(low, high, strict=False)):
                raise ValueError(f"sizes: {list(low)} is not the smaller one of {list(high)}")
        if self.count > MOST_OF_A_KIND:
            raise ValueError(f"grid: {self.count} objects; at most {MOST_OF_A_KIND} are allowed")
        if self.spacing is not None and self.grid and len(self.spacing) not in (1, len(self.grid)):
            raise ValueError("spacing: give one number, or one for each number of the grid")
        return self

    @property
    def count(self) -> int:
        """Number of objects."""
        number = 1
        for along in self.grid or ():
            number *= along
        return self.stack or self.pile or self.scatter or number


@dataclass(frozen=True)
class Group:
    """Objects of one entry.

    Attributes:
        entry: Name of the entry.
        names: Names of the objects.
        many: What the entry declares about them.
    """

    entry: str
    names: tuple[str, ...]
    many: ManySpec


def members(entry: str, count: int) -> tuple[str, ...]:
    """Returns the names of the objects of an entry."""
    return tuple(f"{entry}{number}" for number in range(1, count + 1))


MOST_OBJECTS: Final = 200
"""Largest number of objects of a file."""
