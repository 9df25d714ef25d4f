"""Kernel that finds the cells of a row on the inner side of planes through the camera center."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bt_dualarm.sim.ray_intersection_kernels import crossing, stretch

ROWS = 18
COLUMNS = 24
SPACING = 0.03
CENTER = (9.5, 7.25)


def rays(within: Any) -> Any:
    """Rays through positions `within` each cell, of shape (2, rows, columns), 0 to 1."""
    rows, columns = np.indices((ROWS, COLUMNS)) + within
    x = SPACING * (columns - CENTER[0])
    y = SPACING * (CENTER[1] - rows)
    return np.stack([x, y, np.full_like(x, -1.0)])


@given(seed=st.integers(0, 100_000), flat=st.sampled_from([1.0, 1e-8, 1e-10, 0.0]))
@settings(max_examples=60, deadline=None)
def test_stretch_bounds_the_inner_cells(seed: int, flat: float) -> None:
    """No inner cell is outside the stretch, and no outer one in its sure part.

    This holds for any planes, and for rays anywhere in their cells, including borders.
    """
    rng = np.random.default_rng(seed)
    normals = rng.normal(size=(3, 3)) * (1.0, 1.0, 0.3)
    normals[:, 0] *= flat
    first, second, third = (crossing(SPACING, CENTER, *normal) for normal in normals.tolist())
    sides = np.round(rng.random((2, ROWS, COLUMNS))) * (1.0 - 1e-9)
    for within in (rng.random((2, ROWS, COLUMNS)), sides):
        inside: Any = np.all(np.tensordot(normals, rays(within), axes=1) <= 0.0, axis=0)
        for row in range(ROWS):
            begin, sure, unsure, end = stretch(0, COLUMNS, row, first, second, third)
            assert not inside[row, :begin].any()
            assert not inside[row, end:].any()
            assert inside[row, sure:unsure].all()


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_plane_across_the_rows_splits_them(side: float) -> None:
    edge = crossing(SPACING, CENTER, side, 0.0, 0.0)
    begin, sure, unsure, end = stretch(0, COLUMNS, 3, edge, edge, edge)
    kept = (0, 0, 9, 10) if side > 0.0 else (9, 10, COLUMNS, COLUMNS)
    assert (begin, sure, unsure, end) == kept
