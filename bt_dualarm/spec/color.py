"""What a camera is to look for: a named colour, or ranges of hue, saturation and brightness."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Final, TypeAlias

import numpy as np
import numpy.typing as npt
from pydantic import ConfigDict, Field, model_validator

from bt_dualarm.spec.edit import flow_text
from bt_dualarm.spec.ports import port
from bt_dualarm.spec.problems import suggestion
from bt_dualarm.spec.source import Data, Json, with_tuples
from bt_dualarm.spec.values import Value

_Hue: TypeAlias = Annotated[float, Field(ge=0.0, le=360.0)]
_Part: TypeAlias = Annotated[float, Field(ge=0.0, le=1.0)]
Bounds: TypeAlias = tuple[npt.NDArray[np.uint8], npt.NDArray[np.uint8]]
"""Lower and upper bound for ``cv2.inRange`` on an HSV image, each of shape (3,), inclusive."""

_NAMED_HUES: Final[Mapping[str, tuple[float, float]]] = {
    "red": (340.0, 12.0),
    "orange": (14.0, 40.0),
    "yellow": (42.0, 70.0),
    "green": (80.0, 165.0),
    "blue": (216.0, 260.0),  # not the joints of a UR
}


def _short(number: float) -> int | float:
    """A number as a person would write it: 1 and not 1.0."""
    return int(number) if float(number).is_integer() else number


class HsvRange(Value):
    """A box in hue, saturation and value (brightness), bounds inclusive."""

    hue: tuple[_Hue, _Hue] = port(
        ...,
        "Angles on the colour circle; a first bound above the second wraps through red",
        unit="deg",
    )
    saturation: tuple[_Part, _Part] = port((0.4, 1.0), "Saturation from 0 (grey) to 1")
    value: tuple[_Part, _Part] = port((0.2, 1.0), "Brightness from 0 (black) to 1")

    @model_validator(mode="after")
    def _ascending(self) -> HsvRange:
        for name in ("saturation", "value"):
            low, high = getattr(self, name)
            if low > high:
                raise ValueError(f"{name} goes from {low} down to {high}: swap the two")
        return self

    @property
    def data(self) -> Data:
        """As YAML says it, with every field."""
        return {
            name: [_short(end) for end in getattr(self, name)] for name in HsvRange.model_fields
        }

    @property
    def bounds(self) -> tuple[Bounds, ...]:
        """For OpenCV (hue 0 to 179, the others 0 to 255): one box, or two where hue wraps."""
        low, high = (min(round(hue / 2), 179) for hue in self.hue)
        hues = [(low, high)] if self.hue[0] <= self.hue[1] else [(low, 179), (0, high)]
        return tuple((self._corner(a, 0), self._corner(b, 1)) for a, b in hues)

    def _corner(self, hue: int, end: int) -> npt.NDArray[np.uint8]:
        shares = (self.saturation[end], self.value[end])
        return np.array([hue, *(round(255 * share) for share in shares)], np.uint8)


def _notations(schema: Json) -> None:
    """A name or a list instead of the mapping that pydantic knows of."""
    mapping = dict(schema)
    schema.clear()
    schema["description"] = mapping["description"]
    schema["anyOf"] = [{"enum": list(_NAMED_HUES)}, mapping["properties"]["ranges"], mapping]


class Color(Value):
    """``yellow``, or a list of ranges any of which a pixel may lie in."""

    model_config = ConfigDict(json_schema_extra=_notations)

    name: str = port("", "Name of a colour; none where ranges are given")
    ranges: tuple[HsvRange, ...] = port(
        ..., "Ranges, any of which a pixel may lie in", min_length=1, max_length=8
    )

    @model_validator(mode="before")
    @classmethod
    def _from_notation(cls, value: Data) -> Data:
        if isinstance(value, str):
            if value not in _NAMED_HUES:
                hint = suggestion(value, _NAMED_HUES, "colour")
                raise ValueError(f"there is no colour '{value}' ({hint})")
            return {"name": value, "ranges": ({"hue": _NAMED_HUES[value]},)}
        if isinstance(value, (list, tuple)):
            return {"ranges": with_tuples(value)}
        return with_tuples(value)

    @classmethod
    def named(cls, name: str) -> Color:
        """One of red, orange, yellow, green, blue.

        Raises:
            pydantic.ValidationError: There is no such name.
        """
        return cls.model_validate(name)

    @property
    def data(self) -> Data:
        """As YAML says it: the name, or the list of ranges."""
        if self.name:
            return self.name
        return [
            {
                field: [_short(end) for end in getattr(item, field)]
                for field in HsvRange.model_fields
            }
            for item in self.ranges
        ]

    @property
    def notation(self) -> str:
        """`data` on one line of YAML."""
        return self.name or flow_text(self.data)

    @property
    def bounds(self) -> tuple[Bounds, ...]:
        """Boxes for ``cv2.inRange``; a pixel in any of them has this colour."""
        return tuple(box for item in self.ranges for box in item.bounds)
