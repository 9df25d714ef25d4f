"""Deadlines on the simulated clock."""

from __future__ import annotations

from typing import Final

_ROUNDING_S: Final = 1e-9


def reached(time: float, deadline: float) -> bool:
    """Whether a deadline has come, with some room for the rounding of summed time steps."""
    return time >= deadline - _ROUNDING_S
