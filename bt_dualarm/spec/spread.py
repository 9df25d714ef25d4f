"""How far a true value may lie from the one that is believed: drawn with the seed."""

from __future__ import annotations

from collections.abc import Callable
from typing import Annotated, Final, TypeAlias

import numpy as np
from pydantic import AfterValidator, ConfigDict, Field, model_validator

from bt_dualarm.pose import Vector
from bt_dualarm.spec.ports import port
from bt_dualarm.spec.source import Data, Json
from bt_dualarm.spec.values import Value

_TAIL: Final = 3.0
"""Standard deviations at which a normal distribution is cut off: no robot has a negative mass."""


def _notations(schema: Json) -> None:
    """A bare number instead of the mapping that pydantic knows of."""
    mapping = dict(schema)
    schema.clear()
    schema["description"] = mapping["description"]
    schema["anyOf"] = [{"type": "number", "minimum": 0.0}, mapping]


class Spread(Value):
    """A bare number is the half-width of a uniform distribution about zero; or say which."""

    model_config = ConfigDict(json_schema_extra=_notations)

    uniform: Annotated[float, Field(ge=0.0, le=1e3)] = port(
        0.0, "Half-width of a uniform distribution about zero"
    )
    normal: Annotated[float, Field(ge=0.0, le=1e3)] = port(
        0.0, "Standard deviation of a normal distribution about zero, cut off at three of them"
    )

    @model_validator(mode="before")
    @classmethod
    def _of_a_number(cls, data: Data) -> Data:
        """``0.05`` is ``{uniform: 0.05}``."""
        is_number = isinstance(data, int | float) and not isinstance(data, bool)
        return {"uniform": float(data)} if is_number else data

    @model_validator(mode="after")
    def _is_one(self) -> Spread:
        if self.uniform and self.normal:
            raise ValueError("give uniform or normal, not both")
        return self

    @property
    def most(self) -> float:
        """Largest value that can be drawn."""
        return max(self.uniform, _TAIL * self.normal)

    def draw(self, rng: np.random.Generator, size: int) -> Vector:
        """So many values, of shape (size,); as many numbers are drawn whatever the spread."""
        share = rng.uniform(-1.0, 1.0, size)
        bell = rng.normal(0.0, 1.0, size)
        drawn: Vector = self.uniform * share + self.normal * np.clip(bell, -_TAIL, _TAIL)
        return drawn

    def draw_one(self, rng: np.random.Generator) -> float:
        """One value, as `draw` has it, for what is drawn for each picture."""
        share, bell = rng.uniform(-1.0, 1.0), rng.normal(0.0, 1.0)
        return self.uniform * share + self.normal * min(max(bell, -_TAIL), _TAIL)


def _below(limit: float, unit: str = "") -> Callable[[Spread], Spread]:
    def check(spread: Spread) -> Spread:
        if spread.most > limit:
            allowed = f"{limit:g} {unit}".rstrip()
            raise ValueError(f"may come to {spread.most:g}; at most {allowed} is allowed")
        return spread

    return check


Share: TypeAlias = Annotated[Spread, AfterValidator(_below(0.9))]
"""Spread of a share of the value: 0.05 is 5 %. With all of it, nothing would be left."""

Bend: TypeAlias = Annotated[Spread, AfterValidator(_below(0.3))]
"""Spread of a coefficient of radial distortion."""

Metres: TypeAlias = Annotated[Spread, AfterValidator(_below(0.1, "m"))]
Degrees: TypeAlias = Annotated[Spread, AfterValidator(_below(20.0, "deg"))]
Seconds: TypeAlias = Annotated[Spread, AfterValidator(_below(0.1, "s"))]
