"""Kernels of filters and rest detection: equal to plain Python and to matrix formulas."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from bt_dualarm.perception.perception_kernels import (
    COLUMNS,
    blend,
    correct,
    has_moved,
    propagate,
    scatter,
)
from bt_dualarm.perception.target_filter import Oscillator, propagated
from tests.plain_kernels import plain


def target(seed: int) -> tuple[Any, Any]:
    """A state of three axes, of shape (3, 4), and its covariance, of shape (3, 4, 4)."""
    rng = np.random.default_rng(seed)
    root = rng.normal(size=(3, 4, 4))
    return rng.normal(size=(3, 4)), root @ root.swapaxes(1, 2)


@pytest.mark.parametrize("dt", [-0.1, 0.0, 0.004, 0.5])
def test_propagation_equals_the_matrix_formula(dt: float) -> None:
    model = Oscillator()
    (state, covariance) = target(3)
    moved, spread = model.propagate(state, covariance, dt)
    by_matrices = propagated(model, state, covariance, dt)
    assert moved == pytest.approx(by_matrices[0], rel=1e-12, abs=1e-12)
    assert spread == pytest.approx(by_matrices[1], rel=1e-12, abs=1e-12)
    plain_state = np.empty((3, 4))
    plain_covariance = np.empty((3, 4, 4))
    plain(propagate)(state, covariance, dt, (10.0, 0.5), plain_state, plain_covariance)
    assert spread == pytest.approx(plain_covariance, rel=1e-12, abs=1e-12)


@pytest.mark.parametrize("kernel", [correct, plain(correct)], ids=["compiled", "plain"])
def test_correction_is_a_kalman_update(kernel: Callable[..., None]) -> None:
    """Gain P h' / (h P h' + r), for each axis separately; covariances stay symmetric."""
    (state, covariance) = target(5)
    position = np.arange(3.0)
    variance = np.full(3, 0.1)
    after = state.copy()
    spread = covariance.copy()
    kernel(after, spread, position, variance)
    for axis in range(3):
        gain = covariance[axis, :, 0] / (covariance[axis, 0, 0] + 0.1)
        expected = state[axis] + gain * (position[axis] - state[axis, 0])
        assert after[axis] == pytest.approx(expected)
        remaining = covariance[axis] - np.outer(gain, covariance[axis, 0])
        assert spread[axis] == pytest.approx(remaining)
        assert (spread[axis] == spread[axis].T).all()


@pytest.mark.parametrize("share", [0.0, 0.3, 1.0])
def test_a_blend_lies_between_two_predictions(share: float) -> None:
    model = Oscillator()
    (one, _) = target(1)
    (other, _) = target(2)
    motion, by_python = np.empty((2, 3, 3))
    blend(one, 0.05, other, 0.02, share, motion)
    plain(blend)(one, 0.05, other, 0.02, share, by_python)
    first = model.move(one, 0.05)[:, :3].T
    second = model.move(other, 0.02)[:, :3].T
    assert motion == pytest.approx(first + share * (second - first))
    assert motion == pytest.approx(by_python)


@pytest.mark.parametrize("seed", range(20))
def test_compiled_rest_detection_equals_plain_python(seed: int) -> None:
    """With and without initial means, for sightings that have moved and that have not."""
    rng = np.random.default_rng(seed)
    rows = rng.normal(0.0, 1e-3, (int(rng.integers(4, 70)), COLUMNS))
    rows[:, 4] = 1e-8
    rows[len(rows) // 2 :, 2:4] += rng.choice([0.0, 0.02])
    leaving = int(rng.integers(0, max(len(rows) - 48, 0) + 1))
    firsts = rng.normal(0.0, 1e-3, (int(rng.integers(0, 4)), COLUMNS))
    arguments = rows, leaving, firsts, 0.35, float(rng.choice([1.0, 3.0])), 0.0025
    assert has_moved(*arguments) == plain(has_moved)(*arguments)
    assert scatter(rows, 0.35) == pytest.approx(plain(scatter)(rows, 0.35), rel=1e-12)
