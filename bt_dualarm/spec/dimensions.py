"""Dimensions of values in expressions: what is known of a value before it is.

A bare number in a port has the port's unit; a dimension defines which units are compatible.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final, TypeAlias

Dimension: TypeAlias = tuple[tuple[str, float], ...]
"""Base units with their exponents, sorted: a speed is ``(("m", 1), ("s", -1))``."""

LENGTH: Final[Dimension] = (("m", 1),)
_S: Final[Dimension] = (("s", 1),)
ANGLE: Final[Dimension] = (("deg", 1),)
_KG: Final[Dimension] = (("kg", 1),)
_SPEED: Final[Dimension] = (("m", 1), ("s", -1))
_ACCELERATION: Final[Dimension] = (("m", 1), ("s", -2))
_N: Final[Dimension] = (("kg", 1), ("m", 1), ("s", -2))
_HZ: Final[Dimension] = (("s", -1),)

UNITS: Final[Mapping[str, tuple[float, Dimension]]] = {
    "mm": (1e-3, LENGTH),
    "cm": (1e-2, LENGTH),
    "m": (1.0, LENGTH),
    "ms": (1e-3, _S),
    "s": (1.0, _S),
    "min": (60.0, _S),
    "h": (3600.0, _S),
    "deg": (1.0, ANGLE),
    "°": (1.0, ANGLE),
    "rad": (math.degrees(1.0), ANGLE),
    "g": (1e-3, _KG),
    "kg": (1.0, _KG),
    "N": (1.0, _N),
    "Hz": (1.0, _HZ),
    "m/s": (1.0, _SPEED),
    "m/s²": (1.0, _ACCELERATION),
}
"""Units that a number in an expression may have: as a multiple of the unit that a bare number in a
port has, and with its dimension."""

_DIMENSIONS: Final[Mapping[str, Dimension]] = {
    **{unit: dimension for unit, (factor, dimension) in UNITS.items() if factor == 1.0},
    "N m": (("kg", 1), ("m", 2), ("s", -2)),
    "m/N": (("kg", -1), ("s", 2)),
    "px": (("px", 1),),
}
_NOUNS: Final[Mapping[Dimension, str]] = {
    (): "a number without a unit",
    LENGTH: "a length (m)",
    _S: "a time (s)",
    ANGLE: "an angle (deg)",
    _KG: "a mass (kg)",
    _N: "a force (N)",
    _HZ: "a rate (Hz)",
    _SPEED: "a speed (m/s)",
    _ACCELERATION: "an acceleration (m/s²)",
}


@dataclass(frozen=True)
class ValueType:
    """What is known of a value before it is.

    Attributes:
        kind: JSON type: ``number``, ``boolean``, ``string``, ``array``, ``object``; empty if it is
            not known.
        dimension: Dimension of the number, or of all numbers in the list; None if it is not known.
        bare: Whether it is made of numbers that were written without a unit: they have any unit in
            a sum, and none in a product.
    """

    kind: str = ""
    dimension: Dimension | None = None
    bare: bool = False

    @property
    def noun(self) -> str:
        """Description of its unit, to follow "is"."""
        known = self.dimension or ()
        parts = (f"{base}^{exponent:g}" if exponent != 1 else base for base, exponent in known)
        return _NOUNS.get(known, f"a quantity in {' '.join(parts)}")


ANYTHING: Final = ValueType()
BARE: Final = ValueType("number", None, True)
TRUTH: Final = ValueType("boolean")
TEXT: Final = ValueType("string")


def dimension_of(unit: str) -> Dimension | None:
    """Returns the dimension of a port's unit, such as ``"m/s"``; None if it is not a known one."""
    return _DIMENSIONS.get(unit)


def misfit(found: ValueType, wanted: Dimension | None) -> str:
    """Returns what is wrong with a value's unit, empty if nothing is known to be.

    Args:
        found: Type of the value.
        wanted: Dimension that it should have, None if that is not known.
    """
    if found.dimension is None or wanted is None or found.dimension == wanted:
        return ""
    return f"expected {ValueType('number', wanted).noun}, not {found.noun}"
