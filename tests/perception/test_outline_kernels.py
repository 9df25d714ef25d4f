"""Outline kernels: compiled, they equal the same functions in plain Python."""

from __future__ import annotations

import numpy as np
import pytest

from bt_dualarm.perception.perception_kernels import measure_outline, see
from bt_dualarm.perception.shape_fit import UNKNOWNS, turn_by
from tests.plain_kernels import plain


@pytest.mark.parametrize("seed", range(5))
def test_compiled_kernels_equal_plain_python(seed: int) -> None:
    rng = np.random.default_rng(seed)
    points = rng.normal(0.0, 0.05, (8, 3))
    edge = rng.normal(0.0, 20.0, (30, 2))
    arguments = points, np.array((0.02, -0.01, 0.4)), turn_by(rng.normal(0.0, 0.2, 3)), np.eye(3)
    pixels = np.empty((2, 8, 2))
    change = np.empty((2, 8, 2, UNKNOWNS))
    depths = [
        one(*arguments, (250.0, 251.0), *out)
        for one, out in zip((see, plain(see)), zip(pixels, change, strict=True), strict=True)
    ]
    assert depths[0] == pytest.approx(depths[1], rel=1e-12)
    assert pixels[0] == pytest.approx(pixels[1], rel=1e-12)
    assert change[0] == pytest.approx(change[1], rel=1e-9, abs=1e-9)
    error = np.empty((2, 30))
    jacobian = np.empty((2, 30, UNKNOWNS))
    angles = np.sort(rng.uniform(0.0, 6.28, 8))
    outline = 25.0 * np.column_stack((np.cos(angles), np.sin(angles)))
    measure_outline(outline, change[0], edge, 0.1, error[0], jacobian[0])
    plain(measure_outline)(outline, change[0], edge, 0.1, error[1], jacobian[1])
    assert error[0] == pytest.approx(error[1], rel=1e-12)
    assert jacobian[0] == pytest.approx(jacobian[1], rel=1e-9, abs=1e-9)


def test_outline_error_is_the_largest_distance_beyond_a_side() -> None:
    """For a square with sides of 2 px around the origin; its sides move with its corners."""
    square = np.array(((1.0, -1.0), (1.0, 1.0), (-1.0, 1.0), (-1.0, -1.0)))
    corner_changes = np.zeros((4, 2, UNKNOWNS))
    edge = np.array(((3.0, 0.0), (0.0, -1.5), (0.5, 0.0)))
    corner_changes[:, 0, 0] = 1.0  # the first unknown moves the square along x
    error = np.empty(3)
    jacobian = np.empty((3, UNKNOWNS))
    measure_outline(square, corner_changes, edge, 0.0, error, jacobian)
    assert error == pytest.approx((2.0, 0.5, -0.5))
    assert jacobian[:, 0] == pytest.approx((-1.0, 0.0, -1.0))
