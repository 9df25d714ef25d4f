"""The colour that somebody asks for: read, checked, and changed piece by piece."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from pydantic import ValidationError

from bt_dualarm.errors import DualArmError
from bt_dualarm.spec.color import Color
from bt_dualarm.spec.explain import explain
from bt_dualarm.spec.source import Data, with_tuples
from bt_dualarm.tuning.picking import Pixel, range_of
from bt_dualarm.world.rendering.renderer import Image


class ColorError(DualArmError):
    """What was asked for is no colour; the message says why."""


def color_of(data: Data) -> Color:
    """A colour from its notation: a name, or a list of ranges.

    Raises:
        ColorError: It is none.
    """
    try:
        return Color.model_validate(with_tuples(data))
    except ValidationError as error:
        found = explain(error, Color, data, "field")
        words = (f"{one.message} {one.hint}".strip() for one in found)
        raise ColorError("; ".join(words)) from None
    except UnicodeEncodeError:
        raise ColorError("a colour is written in whole characters") from None


def adjusted(
    color: Color,
    image: Image,
    *,
    pick: Sequence[Pixel] = (),
    widen: Sequence[Pixel] = (),
    bounds: Mapping[str, Sequence[float]] | None = None,
) -> Color:
    """A colour with changes, in this order; without any, the colour itself.

    Args:
        color: Colour to begin with.
        image: Image in which the pixels are.
        pick: Pixels around which one new range is made.
        widen: Pixels that the first range is widened to hold, too.
        bounds: Bounds of hue, saturation or value, for every range; a hue leaves the first
            range only.

    Raises:
        ColorError: A lower bound is above its upper one.
        PixelError: A pixel is outside of the image.
    """
    if not (pick or widen or bounds):
        return color
    ranges = [range_of(image, pick)] if pick else list(color.ranges)
    if widen:
        ranges[0] = range_of(image, widen, ranges[0])
    given = {name: list(pair) for name, pair in (bounds or {}).items()}
    kept = ranges[:1] if "hue" in given else ranges
    return color_of([{**item.data, **given} for item in kept])
