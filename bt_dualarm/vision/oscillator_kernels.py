"""How a sine of unknown frequency goes on, and how that hangs on its state; see `Oscillator`."""

from __future__ import annotations

import math
from typing import TypeAlias

import numpy as np
import numpy.typing as npt

from bt_dualarm.kernels.kernel import kernel
from bt_dualarm.pose import Matrix

Stack: TypeAlias = npt.NDArray[np.float64]

MIN_FREQUENCY = 1e-3
"""Frequency in rad/s that a slower one is taken for."""


@kernel
def swing(state: Matrix, dt: float, moved: Matrix) -> None:
    """Enter states of shape (n, 4) ``dt`` seconds on: a sine through the first three numbers."""
    for axis in range(len(state)):
        p, v, a = state[axis, 0], state[axis, 1], state[axis, 2]
        w = max(abs(state[axis, 3]), MIN_FREQUENCY)
        sine, cosine, half = math.sin(w * dt), math.cos(w * dt), math.sin(0.5 * w * dt)
        moved[axis, 0] = p + v * sine / w + a * 2.0 * (half / w) ** 2
        moved[axis, 1] = v * cosine + a * sine / w
        moved[axis, 2] = a * cosine - v * w * sine
        moved[axis, 3] = state[axis, 3]


@kernel
def differentiate(state: Matrix, dt: float, jacobian: Stack) -> None:
    """Enter the derivative of `swing` by the state, of shape (n, 4, 4)."""
    for axis in range(len(state)):
        v, a, w = state[axis, 1], state[axis, 2], max(abs(state[axis, 3]), MIN_FREQUENCY)
        sine, cosine = math.sin(w * dt), math.cos(w * dt)
        integral, double = sine / w, 2.0 * (math.sin(0.5 * w * dt) / w) ** 2
        by_frequency = (dt * cosine - integral) / w
        own = jacobian[axis]
        own[:] = 0.0
        own[0, 0] = own[3, 3] = 1.0
        own[0, 1] = own[1, 2] = integral
        own[0, 2] = double
        own[1, 1] = own[2, 2] = cosine
        own[2, 1] = -w * sine
        own[0, 3] = v * by_frequency + a * (dt * integral - 2.0 * double) / w
        own[1, 3] = a * by_frequency - v * dt * sine
        own[2, 3] = -a * dt * sine - v * (sine + w * dt * cosine)
