"""Kernels for an oscillating camera: equal to plain Python, and right for given turns."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from bt_dualarm.core.pose import Matrix
from bt_dualarm.perception.perception_kernels import (
    Indices,
    last_swing,
    longest_axis,
    slope_against,
    spread,
    swing_turns,
)
from tests.plain_kernels import plain

LEG_M = 0.006
LEGS = 3


def both(kernel: Callable[..., Any]) -> tuple[Callable[..., Any], Callable[..., Any]]:
    """The compiled kernel, and its function in plain Python."""
    return kernel, plain(kernel)


def begin_of(turns: Indices) -> int:
    """The first of all turns; -1 if there are none."""
    assert len(turns) in (0, LEGS + 1)
    return int(turns[0]) if len(turns) else -1


def zigzag(turns: list[float], between: int = 5) -> Matrix:
    """Positions on the diagonal of x, y and z from turn to turn, of shape (n, 3), in m."""
    steps = np.arange((len(turns) - 1) * between + 1) / between
    along = np.interp(steps, np.arange(len(turns)), turns)
    return np.outer(along, np.full(3, 3.0**-0.5)) + 0.4


@pytest.mark.parametrize("seed", range(5))
def test_spread_equals_the_matrix_formula(seed: int) -> None:
    places = np.random.default_rng(seed).normal(0.3, 0.02, (40, 3))
    deviations = places - places.mean(axis=0)
    for one in both(spread):
        middle = np.empty(3)
        products = np.empty((3, 3))
        diagonal = one(places, middle, products)
        assert diagonal == pytest.approx(np.linalg.norm(np.ptp(places, axis=0)), rel=1e-12)
        assert middle == pytest.approx(places.mean(axis=0), rel=1e-12)
        assert products == pytest.approx(deviations.T @ deviations, rel=1e-9, abs=1e-15)


@pytest.mark.parametrize(
    ("turns", "begin"),
    [
        ([0.0, 0.02, 0.0], -1),  # two legs
        ([0.0, 0.02, 0.0, 0.02], 0),
        ([0.0, 0.02, 0.0, 0.02, 0.0], 5),  # the last three of four
        ([0.0, -0.01, 0.01, -0.01, 0.03, 0.0], 10),
        ([0.0, 0.02, 0.017, 0.03, 0.0, 0.02], 0),  # a step back too short for a leg
        ([0.0, 0.003, 0.0, 0.003, 0.0], -1),  # all too short
        ([0.0, 0.0], -1),
    ],
)
def test_the_last_legs_begin_where_the_camera_turned(turns: list[float], begin: int) -> None:
    places = zigzag(turns)
    for one in both(swing_turns):
        turns_at = one(places, places.mean(axis=0), np.full(3, 3.0**-0.5), LEG_M, LEGS)
        assert begin_of(turns_at) == begin


@pytest.mark.parametrize("seed", range(20))
def test_the_longest_axis_is_that_of_the_largest_eigenvalue(seed: int) -> None:
    rng = np.random.default_rng(seed)
    root = rng.normal(size=(6, 3)) * rng.choice([1e-6, 1e-2, 1.0], 3)
    products = root.T @ root
    expected = np.linalg.eigh(products)[1][:, -1]
    for one in both(longest_axis):
        axis = one(products.copy())
        assert axis * np.sign(axis @ expected) == pytest.approx(expected, abs=1e-12)


@pytest.mark.parametrize(("turns", "begin"), [([0.0, 0.02, 0.0, 0.02], 0), ([0.0, 0.003, 0.0], -1)])
def test_the_last_swing_is_along_the_longest_axis(turns: list[float], begin: int) -> None:
    for one in both(last_swing):
        assert begin_of(one(zigzag(turns), LEG_M, LEGS)) == begin


@pytest.mark.parametrize("seed", range(20))
def test_compiled_turns_equal_plain_python(seed: int) -> None:
    rng = np.random.default_rng(seed)
    places = np.cumsum(rng.normal(0.0, 0.004, (60, 3)), axis=0)
    axis = rng.normal(size=3)
    axis /= np.linalg.norm(axis)
    compiled, plain = (
        one(places, places.mean(axis=0), axis, LEG_M, LEGS) for one in both(swing_turns)
    )
    assert compiled.tolist() == plain.tolist()


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("against", [-0.8, 0.0, 0.5])
def test_the_slope_is_that_of_least_squares(seed: int, against: float) -> None:
    """The explained share is one minus the share of the residual."""
    rng = np.random.default_rng(seed)
    eyes = rng.normal(0.2, 0.03, (30, 3))
    places = against * eyes + rng.normal(0.0, 0.01, (30, 3)) + 0.1
    deviations = eyes - eyes.mean(axis=0)
    moved = places - places.mean(axis=0)
    slope = float(np.sum(moved * deviations) / np.sum(deviations * deviations))
    unexplained = float(np.sum((moved - slope * deviations) ** 2) / np.sum(moved * moved))
    for one in both(slope_against):
        found = one(eyes, (places - eyes) / 0.35, 0.35)
        assert found == pytest.approx((slope, 1.0 - unexplained), rel=1e-9, abs=1e-12)


def test_a_target_without_apparent_motion_explains_nothing() -> None:
    eyes = zigzag([0.0, 0.02])
    for one in both(slope_against):
        assert one(eyes, np.zeros_like(eyes), 0.0)[0] == pytest.approx(1.0)
        assert one(eyes - eyes[0], eyes[0] - eyes, 1.0) == (0.0, 0.0)
