"""How a target is assumed to move between two images, each axis by itself.

A state has four numbers an axis, of which the first three are position, velocity, acceleration
in SI units. Noise enters continuously, so that results do not depend on the frame rate.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache, lru_cache
from types import ModuleType
from typing import Protocol

import numpy as np
import numpy.typing as npt

from bt_dualarm.pose import Matrix, Vector

Stack = npt.NDArray[np.float64]
"""One 4 by 4 matrix an axis, of shape (n, 4, 4)."""

_STATES = 4


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

    def carry(self, state: Matrix, covariance: Stack, dt: float) -> tuple[Matrix, Stack]:
        """State and covariance, of shapes (n, 4) and (n, 4, 4), ``dt`` seconds on."""

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
        moved = np.empty_like(state)
        _kernels().swing(state, dt, moved)
        return moved

    def jacobian(self, state: Matrix, dt: float) -> Stack:
        """Exact, by differentiating the sine."""
        jacobian = np.empty((len(state), _STATES, _STATES))
        _kernels().differentiate(state, dt, jacobian)
        return jacobian

    def noise(self, dt: float) -> Matrix:
        """White noise through three integrators, and apart from it the frequency's."""
        noise = np.zeros((_STATES, _STATES))
        noise[:3, :3] = self.jerk_density * chain_noise(dt)[1:, 1:]
        noise[3, 3] = self.frequency_density * abs(dt)
        return noise

    def carry(self, state: Matrix, covariance: Stack, dt: float) -> tuple[Matrix, Stack]:
        """As `carried`, in machine code."""
        moved, spread = np.empty_like(state), np.empty_like(covariance)
        densities = self.jerk_density, self.frequency_density
        _kernels().carry(state, covariance, dt, densities, moved, spread)
        return moved, spread

    def confine(self, state: Matrix) -> Matrix:
        """Frequencies that an arm can reach: beyond, the linearised filter would run away."""
        confined = state.copy()
        frequency = confined[:, 3]
        np.minimum(np.maximum(frequency, 0.0), self.highest_frequency, out=frequency)
        return confined


@cache
def _kernels() -> ModuleType:
    """The kernels of an oscillator: an import statement costs as much as they do."""
    from bt_dualarm.vision import oscillator_kernels

    return oscillator_kernels


def carried(
    model: MotionModel, state: Matrix, covariance: Stack, dt: float
) -> tuple[Matrix, Stack]:
    """State and covariance ``dt`` seconds on, by a model's derivative there and its noise."""
    jacobian = model.jacobian(state, dt)
    spread: Stack = jacobian @ covariance @ jacobian.swapaxes(1, 2) + model.noise(dt)
    return model.move(state, dt), spread


def at_rest(position: Vector) -> Matrix:
    """State of shape (n, 4) of a target that stands at a position of shape (n,), in m."""
    state = np.zeros((len(position), _STATES))
    state[:, 0] = position
    return state


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


def predict_something() -> None:
    """Have all kernels of motion models compiled."""
    from bt_dualarm.vision.filter_kernels import correct
    from bt_dualarm.vision.oscillator_kernels import blend, blend_in_plane

    model, state, spread = Oscillator(), np.ones((1, _STATES)), np.ones((1, _STATES, _STATES))
    model.move(state, 1.0)
    model.jacobian(state, 1.0)
    model.carry(state, spread, 1.0)
    blend(state, 1.0, state, 1.0, 0.5, np.empty((3, 1)))
    axes, motion = np.ones((2, 1)), np.empty((3, 2))
    blend_in_plane(state, 1.0, state, 1.0, 0.5, axes, np.ones(1), motion)
    correct(state, spread, np.ones(1), np.ones(1))
