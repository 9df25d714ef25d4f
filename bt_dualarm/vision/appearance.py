"""What a declared object looks like: the colour that a camera is to look for."""

from __future__ import annotations

import colorsys
import math
from typing import Final

from bt_dualarm.errors import DualArmError
from bt_dualarm.spec.color import Color
from bt_dualarm.spec.document import ObjectSpec

_HUE_ROOM: Final = 14.0
"""Degrees of hue to either side: what light and a camera's noise make of it."""

_LEAST: Final = (0.55, 0.35)
"""Saturation and brightness below which a colour is too grey or too dark to be told by its hue."""


class ColorlessError(DualArmError):
    """An object cannot be told from its surroundings by its colour."""


def color_of(thing: ObjectSpec) -> Color:
    """The colour to look for, by what the file says of an object.

    Raises:
        ColorlessError: It is grey, white, black or nearly so.
    """
    if isinstance(thing.color, str):
        try:
            return Color.named(thing.color)
        except ValueError:
            raise ColorlessError(f"{thing.color} is no colour that a camera finds") from None
    hue, saturation, value = colorsys.rgb_to_hsv(*thing.rgba[:3])
    if saturation < _LEAST[0] or value < _LEAST[1]:
        red, green, blue = thing.rgba[:3]
        written = f"[{red:g}, {green:g}, {blue:g}]"
        raise ColorlessError(f"{written} is too grey or too dark for a camera to find")
    middle = 360.0 * hue
    bounds = [math.fmod(middle + side * _HUE_ROOM + 360.0, 360.0) for side in (-1.0, 1.0)]
    return Color.model_validate([{"hue": bounds}])
