"""What the kernels of an oscillator mean: the same functions, read by Python itself."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from bt_dualarm.perception.perception_kernels import differentiate, swing
from tests.plain_kernels import plain

KERNELS: dict[Callable[..., None], tuple[int, ...]] = {swing: (3, 4), differentiate: (3, 4, 4)}


@pytest.mark.parametrize("kernel", KERNELS)
@pytest.mark.parametrize("dt", [-0.1, 0.0, 0.004, 0.5])
def test_compiled_kernels_do_what_plain_python_does(kernel: Callable[..., None], dt: float) -> None:
    """But for rounding; a target without a frequency included."""
    state = np.random.default_rng(2).normal(size=(3, 4))
    state[1, 3] = 0.0
    mine, its = np.empty((2, *KERNELS[kernel]))
    kernel(state, dt, mine)
    plain(kernel)(state, dt, its)
    assert mine == pytest.approx(its, rel=1e-12, abs=1e-12)
