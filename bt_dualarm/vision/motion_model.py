"""How a target is assumed to move between two images, each axis by itself.

A state has four numbers an axis, of which the first three are position, velocity, acceleration
in SI units. Noise enters continuously, so that results do not depend on the frame rate.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import Protocol

import numpy as np
import numpy.typing as npt

from bt_dualarm.pose import Matrix, Vector

Stack = npt.NDArray[np.float64]
"""One 4 by 4 matrix an axis, of shape (n, 4, 4)."""

_STATES = 4
_MIN_FREQUENCY = 1e-3


class MotionModel(Protocol):
    """What a filter needs to know about motion."""

    @property
    def spread(self) -> tuple[float, float, float]:
        """Standard deviation of velocity, acceleration and the last state of a new target."""

    def start(self, position: Vector) -> Matrix:
        """State of shape (n, 4) of a target first seen at ``position`` of shape (n,)."""

    def move(self, state: Matrix, dt: float) -> Matrix:
        """The state, of shape (n, 4), ``dt`` seconds on."""

    def jacobian(self, state: Matrix, dt: float) -> Stack:
        """Derivative of ``move`` by the state, of shape (n, 4, 4) or (1, 4, 4)."""

    def noise(self, dt: float) -> Matrix:
        """Covariance that ``dt`` seconds add, of shape (4, 4)."""

    def confine(self, state: Matrix) -> Matrix:
        """The nearest state, of shape (n, 4), that a target can have."""


@dataclass(frozen=True)
class Oscillator:
    """A sine of unknown frequency w, the fourth state in rad/s: p''' = -w² p'.

    Three integrators with white noise ``jerk_density`` in m²/s⁵, and a frequency that wanders
    with ``frequency_density`` in rad²/s³, between 0 and ``highest_frequency``.
    """

    jerk_density: float = 10.0
    frequency_density: float = 0.5
    start_frequency: float = 4.0
    highest_frequency: float = 12.0
    spread: tuple[float, float, float] = (0.5, 3.0, 2.0)

    def start(self, position: Vector) -> Matrix:
        """At rest, at the frequency of a slow curve."""
        state = at_rest(position)
        state[:, 3] = self.start_frequency
        return state

    def move(self, state: Matrix, dt: float) -> Matrix:
        """The sine through position, velocity and acceleration."""
        # Plain floats: asked at the control rate, and numpy is slower on three numbers.
        return np.array([_swing(p, v, a, w, dt) for p, v, a, w in state.tolist()])

    def jacobian(self, state: Matrix, dt: float) -> Stack:
        """Exact, by differentiating the sine."""
        _, v, a, frequency = state.T
        w = np.maximum(np.abs(frequency), _MIN_FREQUENCY)
        sine, cosine = np.sin(w * dt), np.cos(w * dt)
        integral = sine / w
        double = 2.0 * np.square(np.sin(0.5 * w * dt) / w)
        jacobian = np.zeros((len(state), _STATES, _STATES))
        jacobian[:, 0, 0] = jacobian[:, 3, 3] = 1.0
        jacobian[:, 0, 1] = jacobian[:, 1, 2] = integral
        jacobian[:, 0, 2] = double
        jacobian[:, 1, 1] = jacobian[:, 2, 2] = cosine
        jacobian[:, 2, 1] = -w * sine
        by_frequency = (dt * cosine - integral) / w
        jacobian[:, 0, 3] = v * by_frequency + a * (dt * integral - 2.0 * double) / w
        jacobian[:, 1, 3] = a * by_frequency - v * dt * sine
        jacobian[:, 2, 3] = -a * dt * sine - v * (sine + w * dt * cosine)
        return jacobian

    def noise(self, dt: float) -> Matrix:
        """White noise through three integrators, and apart from it the frequency's."""
        noise = np.zeros((_STATES, _STATES))
        noise[:3, :3] = self.jerk_density * chain_noise(dt)[1:, 1:]
        noise[3, 3] = self.frequency_density * abs(dt)
        return noise

    def confine(self, state: Matrix) -> Matrix:
        """Frequencies that an arm can reach: beyond, the linearised filter would run away."""
        confined = state.copy()
        confined[:, 3] = np.clip(state[:, 3], 0.0, self.highest_frequency)
        return confined


def at_rest(position: Vector) -> Matrix:
    """State of shape (n, 4) of a target that stands at a position of shape (n,), in m."""
    state = np.zeros((len(position), _STATES))
    state[:, 0] = position
    return state


def _swing(
    p: float, v: float, a: float, frequency: float, dt: float
) -> tuple[float, float, float, float]:
    """One axis of a sine, ``dt`` seconds on."""
    w = max(abs(frequency), _MIN_FREQUENCY)
    sine, cosine, half = math.sin(w * dt), math.cos(w * dt), math.sin(0.5 * w * dt)
    return (
        p + v * sine / w + a * 2.0 * (half / w) ** 2,
        v * cosine + a * sine / w,
        a * cosine - v * w * sine,
        frequency,
    )


@lru_cache(maxsize=256)
def chain_noise(dt: float) -> Matrix:
    """Covariance of four integrators driven by white noise of density one, of shape (4, 4).

    The integral over t of c c' with c = (t³/6, t²/2, t, 1).
    """
    order = np.array([3, 2, 1, 0])
    factorial = np.array([6.0, 2.0, 1.0, 1.0])
    power = order[:, None] + order[None, :] + 1
    noise: Matrix = abs(dt) ** power / (power * factorial[:, None] * factorial[None, :])
    return noise
