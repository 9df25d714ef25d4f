"""Rotations of many rows agree with SciPy's to the last bit."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation, Slerp

from bt_dualarm.core import rotations
from bt_dualarm.core.pose import Matrix

SEEDS = range(20)


def vectors(seed: int, count: int = 12) -> Matrix:
    """Rotation vectors of all sizes, two of them small enough for a series, and a zero vector."""
    rng = np.random.default_rng(seed)
    found = rng.normal(size=(count, 3)) * 10.0 ** rng.uniform(-1.0, 0.8, (count, 1))
    found[:2] *= 1e-5
    found[2] = 0.0
    return found


def rows(rotation: Rotation) -> Matrix:
    quaternions: Matrix = rotation.as_quat(scalar_first=True)
    return quaternions


@pytest.mark.parametrize("seed", SEEDS)
def test_conversions_agree_with_scipy(seed: int) -> None:
    turns = Rotation.from_rotvec(vectors(seed))
    ours = rotations.from_rotation_vectors(vectors(seed))
    assert ours.tobytes() == rows(turns).tobytes()
    assert rotations.rotation_vectors(ours).tobytes() == turns.as_rotvec().tobytes()
    assert rotations.matrices(ours).tobytes() == turns.as_matrix().tobytes()
    raw = np.random.default_rng(seed).normal(size=(5, 4))
    theirs = Rotation.from_quat(raw, scalar_first=True)
    assert rotations.normalized(raw).tobytes() == rows(theirs).tobytes()


@pytest.mark.parametrize("seed", SEEDS)
def test_products_and_inverses_agree_with_scipy(seed: int) -> None:
    """Products of rows with rows and of one row with all agree."""
    first = Rotation.from_rotvec(vectors(seed))
    second = Rotation.from_rotvec(vectors(seed + 100))
    p, q = rows(first), rows(second)
    assert rotations.product(p, q).tobytes() == rows(first * second).tobytes()
    assert rotations.product(p[:1], q).tobytes() == rows(first[:1] * second).tobytes()
    assert rotations.product(p, q[:1]).tobytes() == rows(first * second[:1]).tobytes()
    undone = rotations.product(rotations.inverse(p), q)
    assert undone.tobytes() == rows(first.inv() * second).tobytes()


@pytest.mark.parametrize("seed", SEEDS)
def test_interpolation_agrees_with_scipy(seed: int) -> None:
    """Values agree at the knots and between them."""
    rng = np.random.default_rng(seed)
    turns = Rotation.from_rotvec(vectors(seed))
    knots = np.cumsum(rng.uniform(0.1, 1.0, len(turns)))
    at = np.concatenate((knots, rng.uniform(knots[0], knots[-1], 20)))
    ours = rotations.slerp(knots, rows(turns), at)
    assert ours.tobytes() == rows(Slerp(knots, turns)(at)).tobytes()
