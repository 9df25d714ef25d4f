"""Directions of a file: their length says nothing, but there must be one."""

from __future__ import annotations

import numpy as np
import pytest

from bt_dualarm import Failure, unit_vector


@pytest.mark.parametrize("length", [1e-3, 1.0, 1e6])
def test_the_length_of_a_direction_says_nothing(length: float) -> None:
    """Of every length the same vector comes out."""
    found = unit_vector((0.0, 0.6 * length, -0.8 * length))
    np.testing.assert_allclose(found, (0.0, 0.6, -0.8), atol=1e-12)


def test_a_direction_without_length_is_refused() -> None:
    """Nothing is divided by nothing."""
    with pytest.raises(Failure, match="zero vector") as refusal:
        unit_vector((0.0, 0.0, 0.0))
    assert refusal.value.code == "INVALID_TARGET"
