"""What several arms do to an object beyond moving and bearing it: nothing else is internal."""

from __future__ import annotations

import numpy as np
import pytest

from bt_dualarm.control.internal_wrench import crossed, internal_wrenches

POINTS = np.array([[-0.5, 0.1, 0.0], [0.5, 0.0, 0.05]])
SHARES = (0.5, 0.5)


def total(points: np.ndarray, wrenches: np.ndarray) -> np.ndarray:
    """Sum of all wrenches about the origin."""
    moments = wrenches[:, 3:] + np.cross(points, wrenches[:, :3])
    return np.concatenate((wrenches[:, :3].sum(axis=0), moments.sum(axis=0)))


def test_arms_that_press_against_each_other_do_so_with_all_their_force() -> None:
    wrenches = np.zeros((2, 6))
    along = (POINTS[1] - POINTS[0]) / np.linalg.norm(POINTS[1] - POINTS[0])
    wrenches[0, :3] = 30.0 * along
    wrenches[1, :3] = -30.0 * along
    np.testing.assert_allclose(internal_wrenches(SHARES, POINTS, wrenches), wrenches, atol=1e-9)


def test_shares_of_a_weight_are_not_internal() -> None:
    shares = (0.3, 0.7)
    wrenches = np.zeros((2, 6))
    wrenches[:, 2] = np.array(shares) * 40.0
    np.testing.assert_allclose(internal_wrenches(shares, POINTS, wrenches), 0.0, atol=1e-9)


def test_what_is_internal_moves_nothing_whatever_the_wrenches_are() -> None:
    rng = np.random.default_rng(0)
    for count in (2, 3):
        for _ in range(20):
            shares = rng.dirichlet(np.ones(count))
            points = rng.normal(size=(count, 3))
            wrenches = rng.normal(size=(count, 6))
            internal = internal_wrenches(list(shares), points, wrenches)
            np.testing.assert_allclose(total(points, internal), 0.0, atol=1e-9)
            # Nothing is left to take away from what is not internal.
            again = internal_wrenches(list(shares), points, wrenches - internal)
            np.testing.assert_allclose(again, 0.0, atol=1e-9)


def test_a_twist_of_both_ends_against_each_other_is_an_internal_moment() -> None:
    wrenches = np.zeros((2, 6))
    wrenches[0, 3] = 4.0
    wrenches[1, 3] = -4.0
    found = internal_wrenches(SHARES, POINTS, wrenches)
    assert np.abs(found[:, 3:]).max() == pytest.approx(4.0)


def test_cross_products_of_rows() -> None:
    first, second = np.random.default_rng(1).normal(size=(2, 5, 3))
    np.testing.assert_allclose(crossed(first, second), np.cross(first, second))
