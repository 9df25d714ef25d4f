"""Color ranges from picked pixels."""

from __future__ import annotations

import colorsys

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bt_dualarm.perception.detection import ColorFilter
from bt_dualarm.sim.frame import Image
from bt_dualarm.spec.values import Color, HsvRange
from bt_dualarm.tuning import ColorError, Pixel, PixelError, adjusted, range_of

fractions = st.floats(0.0, 1.0)


def stripes(*colors: tuple[float, float, float]) -> Image:
    """A stripe 8 pixels wide of each color, given as hue in degrees, saturation, value."""
    rgb = [colorsys.hsv_to_rgb(hue / 360, *rest) for hue, *rest in colors]
    row = np.repeat(np.array(rgb), 8, axis=0)
    return np.asarray(np.tile(np.rint(255 * row), (8, 1, 1)), np.uint8)


def middle(stripe: int) -> Pixel:
    return 8 * stripe + 4, 4


def test_range_contains_the_picked_color_only() -> None:
    image = stripes((54, 0.9, 0.9), (120, 0.9, 0.9))
    mask = ColorFilter(Color(ranges=(range_of(image, [middle(0)]),))).mask(image)
    assert (mask[:, :8] == 255).all()
    assert (mask[:, 8:] == 0).all()


def test_range_around_red_wraps_around() -> None:
    found = range_of(stripes((356, 0.9, 0.9), (4, 0.9, 0.9)), [middle(0), middle(1)])
    assert found.hue[0] > found.hue[1]
    assert found.hue[0] >= 345
    assert found.hue[1] <= 15


def test_range_of_gray_has_any_hue() -> None:
    found = range_of(stripes((0, 0.0, 0.5)), [middle(0)])
    assert found.hue == (0, 360)
    assert found.saturation[1] < 0.2


def test_widening_keeps_the_previous_range() -> None:
    begin = HsvRange(hue=(50, 60), saturation=(0.6, 1.0), value=(0.6, 1.0))
    found = range_of(stripes((30, 0.4, 0.9)), [middle(0)], begin)
    assert found.hue[0] <= 24
    assert found.hue[1] == 60
    assert found.saturation == (0.25, 1.0)
    assert found.value == (0.6, 1.0)


@given(st.lists(st.tuples(st.integers(0, 359), fractions, fractions), min_size=1, max_size=5))
def test_range_contains_every_picked_pixel(colors: list[tuple[float, float, float]]) -> None:
    image = stripes(*colors)
    pixels = [middle(stripe) for stripe in range(len(colors))]
    mask = ColorFilter(Color(ranges=(range_of(image, pixels),))).mask(image)
    columns = [x for x, _ in pixels]
    saturated = np.array([s * v > 0.1 for _, s, v in colors])
    assert (mask[4, columns][saturated] == 255).all()


@given(
    st.tuples(st.integers(0, 359), st.integers(0, 359)),
    st.tuples(st.integers(0, 359), st.floats(0.5, 1.0), st.floats(0.5, 1.0)),
)
def test_widened_range_contains_the_old_one(
    hue: tuple[int, int], color: tuple[float, float, float]
) -> None:
    """Checked for all hues on the circle."""
    begin = HsvRange(hue=hue, saturation=(0.0, 1.0), value=(0.0, 1.0))
    every = stripes(*((degree, 1.0, 1.0) for degree in range(0, 360, 6)))
    before = ColorFilter(Color(ranges=(begin,))).mask(every)
    wider = range_of(stripes(color), [middle(0)], begin)
    after = ColorFilter(Color(ranges=(wider,))).mask(every)
    assert not ((before > 0) & (after == 0)).any()


def test_pixel_outside_of_the_image_is_an_error() -> None:
    with pytest.raises(PixelError, match="8,0 is outside the image, which is 8x8"):
        range_of(stripes((54, 0.9, 0.9)), [(8, 0)])


def test_changed_hue_merges_ranges_and_keeps_other_bounds() -> None:
    two = Color(ranges=(HsvRange(hue=(1, 2), value=(0.5, 1)), HsvRange(hue=(3, 4))))
    image = stripes((54, 0.9, 0.9))
    only = HsvRange(hue=(50, 60), value=(0.5, 1))
    assert adjusted(two, image, bounds={"hue": (50.0, 60.0)}) == Color(ranges=(only,))
    brighter = adjusted(two, image, bounds={"value": (0.9, 1.0)})
    assert [one.value for one in brighter.ranges] == [(0.9, 1.0)] * 2
    assert adjusted(two, image) is two
    with pytest.raises(ColorError, match="swap the two"):
        adjusted(two, image, bounds={"value": (0.9, 0.1)})
