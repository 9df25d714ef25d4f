"""Search window: it holds all positions where a target may be seen, and little else."""

from __future__ import annotations

import numpy as np
import pytest

from bt_dualarm.perception.tracker import window_about
from bt_dualarm.sim.frame import Window

FOCAL_PX = 250.0
SIZE = (320, 240)
ALL = Window(None, 3)


@pytest.mark.parametrize("seed", range(20))
def test_the_window_holds_every_position_within_the_expected_deviation(seed: int) -> None:
    rng = np.random.default_rng(seed)
    place = rng.normal(0.0, 0.03, 3)
    astray = rng.uniform(0, 0.1)
    about = 20.0
    place[2] += 0.4
    window = window_about(place.tolist(), about, astray, FOCAL_PX, SIZE, ALL)
    assert window.region is not None
    left, top, right, bottom = window.region
    direction = rng.normal(size=2)
    x, y = place[:2] + astray * direction / np.linalg.norm(direction)
    column = SIZE[0] / 2 + FOCAL_PX * x / place[2]
    row = SIZE[1] / 2 + FOCAL_PX * y / place[2]
    assert left <= column - about
    assert column + about <= right
    assert top <= row - about
    assert row + about <= bottom
    assert right - left <= 2 * (about + FOCAL_PX * astray / place[2]) + 2


@pytest.mark.parametrize("place", [(0.0, 0.0, -0.4), (0.0, 0.0, 0.01), (2.0, 0.0, 0.4)])
def test_a_target_out_of_view_is_searched_for_in_the_other_window(
    place: tuple[float, float, float],
) -> None:
    assert window_about(place, 20.0, 0.01, FOCAL_PX, SIZE, ALL) is ALL
