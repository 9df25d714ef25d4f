"""The unit of a number in YAML, and the units that a text may give instead."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

from pydantic import GetJsonSchemaHandler
from pydantic_core import CoreSchema

from bt_dualarm.spec.source import Json

_DIGITS: Final = r"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?"

QUANTITY: Final = re.compile(r"\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*([a-z°%]+)\s*")
"""Text with a unit: the number, the unit."""

SECONDS: Final[Mapping[str, float]] = {"ms": 1e-3, "s": 1.0, "min": 60.0, "h": 3600.0}
DEGREES: Final[Mapping[str, float]] = {"deg": 1.0, "°": 1.0, "rad": math.degrees(1.0)}
_METRES: Final[Mapping[str, float]] = {"mm": 1e-3, "cm": 1e-2, "m": 1.0}
_KILOGRAMS: Final[Mapping[str, float]] = {"g": 1e-3, "kg": 1.0}
_HERTZ: Final[Mapping[str, float]] = {"hz": 1.0, "khz": 1e3, "fps": 1.0}
_NEWTONS: Final[Mapping[str, float]] = {"n": 1.0, "kn": 1e3}
_KNOWN: Final = {
    "m": ("metres", _METRES),
    "s": ("seconds", SECONDS),
    "deg": ("degrees", DEGREES),
    "kg": ("kilograms", _KILOGRAMS),
    "Hz": ("Hz", _HERTZ),
    "N": ("newtons", _NEWTONS),
    "px": ("pixels", {"px": 1.0}),
    "": ("as a share", {"%": 0.01}),
}


def bare(text: str, unit: str) -> str:
    """Text with a unit, ``6 cm``, as the bare number of another one; empty if it cannot be.

    Args:
        text: Text as someone has written it.
        unit: That of the bare number, such as ``"m"``; empty for a share or a count.
    """
    name, others = _KNOWN.get(unit, ("", {}))
    match = QUANTITY.fullmatch(text.lower())
    if match is None or match[2] not in others:
        return ""
    words = f"in {name}" if unit else name
    return f"{words}: {float(match[1]) * others[match[2]]:.6g}"


@dataclass(frozen=True, eq=False)
class Unit:
    """Metadata of a number: how it is written in YAML.

    Attributes:
        yaml: Unit of a bare number.
        others: Units that text may give, in units of that one.
    """

    yaml: str
    others: Mapping[str, float]

    def __get_pydantic_json_schema__(
        self, core_schema: CoreSchema, handler: GetJsonSchemaHandler
    ) -> Json:
        """A number, or text with one of the units."""
        pattern = rf"^\s*{_DIGITS}\s*({'|'.join(self.others)})\s*$"
        return {"anyOf": [handler(core_schema), {"type": "string", "pattern": pattern}]}
