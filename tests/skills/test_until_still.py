"""`track` with `until_still` ends after a motion, for random cameras, positions and depths."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest

from benchmarks.until_still import draw, ends_well
from tests.families import some


@pytest.mark.slow
@pytest.mark.parametrize(("seed", "moves"), some(product(range(3), [False, True]), 3))
def test_until_still_ends_only_after_a_motion(seed: int, moves: bool) -> None:
    case = draw(np.random.default_rng(seed), moves=moves)
    assert ends_well(case) == "", case
