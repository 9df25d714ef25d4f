"""Arrays come back bit for bit, and little that changes is few bytes."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from bt_dualarm.runtime.history_file import pack, unpack

SHAPES = hnp.array_shapes(min_dims=1, max_dims=3, min_side=0, max_side=7)
ARRAYS = st.sampled_from(["<f8", "<f4", "<u4", "|u1"]).flatmap(
    lambda kind: hnp.arrays(np.dtype(kind), SHAPES)
)


@given(ARRAYS)
def test_an_array_comes_back_bit_for_bit(array: np.ndarray) -> None:
    how, content = pack(array)
    again = unpack(how, content)
    assert (again.dtype, again.shape) == (array.dtype, array.shape)
    assert again.tobytes() == array.tobytes()


def test_what_stands_still_costs_next_to_nothing() -> None:
    """50 states of 40 numbers that do not change: one state, and zeros."""
    row = np.random.default_rng(1).normal(size=40)
    _, content = pack(np.tile(row, (50, 1)))
    assert len(content) < 2 * row.nbytes


def test_other_types_are_refused() -> None:
    with pytest.raises(ValueError, match="int64"):
        pack(np.arange(3))


@pytest.mark.parametrize(
    "shape",
    [[3], [5], [1 << 40], [-1, -4], [4.0], "4", None, [], [4, 1, 1, 1, 1], [1 << 24, 2], [True]],
)
def test_a_wrong_shape_is_refused(shape: Any) -> None:
    how, content = pack(np.arange(4.0))
    with pytest.raises(ValueError, match="expected"):
        unpack({**how, "shape": shape}, content)
