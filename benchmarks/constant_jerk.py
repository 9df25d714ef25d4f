"""Constant-jerk motion model of a target, with which the tracker's own model is compared."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from bt_dualarm.core.pose import Matrix, Vector
from bt_dualarm.perception.target_filter import Stack, at_rest, chain_noise, propagated


@dataclass(frozen=True)
class ConstantJerk:
    """Motion model whose jerk changes only by white noise of density ``snap_density`` in m²/s⁷.

    Source: Mehrotra and Mahapatra, "A jerk model for tracking highly maneuvering targets",
    IEEE Trans. Aerospace and Electronic Systems 33(4), 1997, with an infinite time constant.
    """

    snap_density: float = 1000.0
    spread: tuple[float, float, float] = (0.5, 3.0, 20.0)

    def start(self, position: Vector) -> Matrix:
        """State of a target at rest, of shape (n, 4)."""
        return at_rest(position)

    def move(self, state: Matrix, dt: float) -> Matrix:
        """Propagate a state by a Taylor series, exact for a constant jerk."""
        moved: Matrix = state @ _chain(dt).T
        return moved

    def jacobian(self, state: Matrix, dt: float) -> Stack:  # noqa: ARG002 - linear model
        """Transition of shape (1, 4, 4), the same for every state."""
        return _chain(dt)[None]

    def noise(self, dt: float) -> Matrix:
        """White noise through four integrators, of shape (4, 4)."""
        return self.snap_density * chain_noise(dt)

    def propagate(self, state: Matrix, covariance: Stack, dt: float) -> tuple[Matrix, Stack]:
        """State and covariance, of shapes (n, 4) and (n, 4, 4), ``dt`` seconds on."""
        return propagated(self, state, covariance, dt)

    def confine(self, state: Matrix) -> Matrix:
        """The state itself: every state is possible."""
        return state


@lru_cache(maxsize=256)
def _chain(dt: float) -> Matrix:
    """Transition of four integrators, of shape (4, 4)."""
    return np.array(
        [
            [1.0, dt, dt**2 / 2.0, dt**3 / 6.0],
            [0.0, 1.0, dt, dt**2 / 2.0],
            [0.0, 0.0, 1.0, dt],
            [0.0, 0.0, 0.0, 1.0],
        ]
    )
