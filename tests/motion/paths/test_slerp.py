"""Turning evenly, against SciPy's."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation, Slerp

from bt_dualarm.motion.paths.slerp import evenly_turned


@pytest.mark.parametrize("spread", [0.0, 1e-5, 1e-3, 0.1, 10.0])
def test_it_is_scipys(spread: float) -> None:
    """The same orientations and even steps between them, at and between knots."""
    rng = np.random.default_rng(3)
    for count in (2, 3, 7):
        knots = np.cumsum(rng.uniform(0.1, 1.0, count)) - 0.05
        given = rng.normal(size=4) + spread * rng.normal(size=(count, 4))
        places = np.sort(np.concatenate((rng.uniform(knots[0], knots[-1], 50), knots)))
        theirs = Slerp(knots, Rotation.from_quat(given, scalar_first=True))(places)
        found = evenly_turned(knots, given, places)
        assert found == pytest.approx(theirs.as_quat(scalar_first=True), abs=1e-14)
        assert np.linalg.norm(found, axis=1) == pytest.approx(1.0, abs=1e-14)


def test_it_takes_the_shorter_way_round() -> None:
    """Of the two quaternions of an orientation it does not matter which is given."""
    here, there = np.array((1.0, 0.0, 0.0, 0.0)), np.array((0.8, 0.6, 0.0, 0.0))
    places = np.linspace(0.0, 1.0, 5)
    knots = np.array((0.0, 1.0))
    one, other = (evenly_turned(knots, np.array((here, s * there)), places) for s in (1.0, -1.0))
    assert np.abs(np.einsum("ij,ij->i", one, other)) == pytest.approx(1.0)
    assert 2.0 * np.arccos(one[:, 0]) == pytest.approx(places * 2.0 * np.arccos(0.8), abs=1e-7)
