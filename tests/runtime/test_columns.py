"""Packed arrays: they are restored bit for bit, and data that change little take few bytes."""

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
def test_an_array_is_restored_bit_for_bit(array: np.ndarray) -> None:
    header, content = pack(array)
    again = unpack(header, content)
    assert (again.dtype, again.shape) == (array.dtype, array.shape)
    assert again.tobytes() == array.tobytes()


def test_constant_data_take_almost_no_space() -> None:
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
    header, content = pack(np.arange(4.0))
    with pytest.raises(ValueError, match="expected"):
        unpack({**header, "shape": shape}, content)
