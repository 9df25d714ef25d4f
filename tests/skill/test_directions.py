"""Direction vectors of any nonzero length are accepted."""

from __future__ import annotations

import numpy as np
import pytest

from bt_dualarm import Failure, unit_vector


@pytest.mark.parametrize("length", [1e-3, 1.0, 1e6])
def test_length_of_a_direction_does_not_matter(length: float) -> None:
    """The unit vector is the same for every length."""
    found = unit_vector((0.0, 0.6 * length, -0.8 * length))
    np.testing.assert_allclose(found, (0.0, 0.6, -0.8), atol=1e-12)


def test_zero_vector_is_refused_as_a_direction() -> None:
    """It cannot be normalized."""
    with pytest.raises(Failure, match="zero vector") as refusal:
        unit_vector((0.0, 0.0, 0.0))
    assert refusal.value.code == "INVALID_TARGET"
