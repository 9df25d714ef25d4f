"""How a sine of unknown frequency goes on, and what is known of it by then; see `Oscillator`."""

from __future__ import annotations

import math
from typing import TypeAlias

import numpy as np
import numpy.typing as npt

from bt_dualarm.kernels.kernel import kernel
from bt_dualarm.pose import Matrix, Vector

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


@kernel
def carry(
    state: Matrix, covariance: Stack, dt: float, densities: tuple[float, float],
    moved: Matrix, spread: Stack,
) -> None:  # fmt: skip
    """Enter states and their covariances ``dt`` seconds on.

    Args:
        state: States of shape (n, 4).
        covariance: Their covariances, of shape (n, 4, 4).
        dt: Seconds.
        densities: Densities of the jerk's noise in m²/s⁵ and of the frequency's in rad²/s³.
        moved: States then, of shape (n, 4), to be filled.
        spread: Covariances then, of shape (n, 4, 4), to be filled.
    """
    jacobian, half = np.empty((len(state), 4, 4)), np.empty((4, 4))
    swing(state, dt, moved)
    differentiate(state, dt, jacobian)
    noise = _noise(abs(dt), densities)
    for axis in range(len(state)):
        for row in range(4):
            for column in range(4):
                half[row, column] = 0.0
                for between in range(4):
                    half[row, column] += (
                        jacobian[axis, row, between] * covariance[axis, between, column]
                    )
        for row in range(4):
            for column in range(4):
                total = 0.0
                for between in range(4):
                    total += half[row, between] * jacobian[axis, column, between]
                spread[axis, row, column] = total + noise[row, column]


@kernel
def _noise(t: float, densities: tuple[float, float]) -> Matrix:
    """Covariance of white noise through three integrators, and apart from it the frequency's."""
    noise = np.zeros((4, 4))
    for row in range(3):
        for column in range(3):
            order = 5 - row - column
            share = densities[0] / order / (2.0 if row == 0 else 1.0)
            noise[row, column] = share / (2.0 if column == 0 else 1.0) * t**order
    noise[3, 3] = densities[1] * t
    return noise


@kernel
def blend(
    lively: Matrix, dt: float, calm: Matrix, calm_dt: float, share: float, motion: Matrix
) -> None:
    """Enter position, velocity and acceleration between those of two states.

    Args:
        lively: One state, of shape (n, 4).
        dt: Seconds on at which it is asked for.
        calm: The other, of shape (n, 4).
        calm_dt: Seconds on at which that is asked for.
        share: Weight of the other, from 0 to 1.
        motion: Rows to be filled with them, of shape (3, n).
    """
    one, other = np.empty_like(lively), np.empty_like(calm)
    swing(lively, dt, one)
    swing(calm, calm_dt, other)
    for axis in range(len(one)):
        for order in range(3):
            apart = other[axis, order] - one[axis, order]
            motion[order, axis] = one[axis, order] + share * apart


@kernel
def blend_in_plane(
    lively: Matrix,
    dt: float,
    calm: Matrix,
    calm_dt: float,
    share: float,
    axes: Matrix,
    origin: Vector,
    motion: Matrix,
) -> None:
    """Enter the same along two axes.

    Args:
        lively: One state, of shape (n, 4).
        dt: Seconds on at which it is asked for.
        calm: The other, of shape (n, 4).
        calm_dt: Seconds on at which that is asked for.
        share: Weight of the other, from 0 to 1.
        axes: Unit vectors, of shape (2, n).
        origin: Where positions count from, of shape (n,).
        motion: Rows to be filled with position, velocity and acceleration, of shape (3, 2).
    """
    whole = np.empty((3, len(lively)))
    blend(lively, dt, calm, calm_dt, share, whole)
    whole[0] -= origin
    for order in range(3):
        for axis in range(2):
            total = 0.0
            for k in range(len(lively)):
                total += axes[axis, k] * whole[order, k]
            motion[order, axis] = total
