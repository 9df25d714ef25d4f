"""Directions as they stand in a file: of any length but none."""

from __future__ import annotations

import numpy as np

from bt_dualarm.errors import Failure
from bt_dualarm.pose import Vector

_LEAST = 1e-6


def unit_vector(direction: tuple[float, float, float]) -> Vector:
    """A direction as a vector of length 1, of shape (3,).

    Args:
        direction: Vector in any frame, which stays the same.

    Raises:
        Failure: INVALID_TARGET, the vector has no length.
    """
    length = float(np.linalg.norm(direction))
    if length < _LEAST:
        raise Failure("INVALID_TARGET", "the direction has no length")
    return np.array(direction) / length
