"""Oscillator kernels: compiled, they equal the same functions in plain Python."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from bt_dualarm.perception.perception_kernels import differentiate, swing
from tests.plain_kernels import plain

KERNELS: dict[Callable[..., None], tuple[int, ...]] = {swing: (3, 4), differentiate: (3, 4, 4)}


@pytest.mark.parametrize("kernel", KERNELS)
@pytest.mark.parametrize("dt", [-0.1, 0.0, 0.004, 0.5])
def test_compiled_kernels_equal_plain_python(kernel: Callable[..., None], dt: float) -> None:
    """Except for rounding, and even for a target without a frequency."""
    state = np.random.default_rng(2).normal(size=(3, 4))
    state[1, 3] = 0.0
    compiled, by_python = np.empty((2, *KERNELS[kernel]))
    kernel(state, dt, compiled)
    plain(kernel)(state, dt, by_python)
    assert compiled == pytest.approx(by_python, rel=1e-12, abs=1e-12)
