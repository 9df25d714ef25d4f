"""Cameras, places and depths by seed: `until_still` waits for a movement, and for its end."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest

from benchmarks.until_still import draw, ends_well
from tests.families import some


@pytest.mark.slow
@pytest.mark.parametrize(("seed", "moves"), some(product(range(3), [False, True]), 3))
def test_it_ends_after_a_movement_and_after_nothing_else(seed: int, moves: bool) -> None:
    case = draw(np.random.default_rng(seed), moves=moves)
    assert ends_well(case) == "", case
