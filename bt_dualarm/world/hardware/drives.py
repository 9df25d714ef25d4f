"""The drives of an arm's joints: what becomes of a torque on its way to the joint."""

from __future__ import annotations

import math
from collections import deque

import numpy as np

from bt_dualarm.pose import Vector
from bt_dualarm.spec.reality import DriveErrors


class Drives:
    """Acts once a physics step.

    A delay that is no multiple of the step is the mean of two steps: over a step it gives the
    impulse that the delayed torque has.

    Args:
        errors: Delay, lag, steps of the torque.
        gain: Factor of each joint's torque, of shape (dof,).
        effort: Effort limits, of shape (dof,), N m.
        timestep: Seconds of one physics step.
    """

    def __init__(self, errors: DriveErrors, gain: Vector, effort: Vector, timestep: float) -> None:
        whole, self._rest = divmod(round(errors.delay / timestep, 9), 1.0)
        self._quantum = errors.quantum * effort
        self._gain, self._effort = gain, effort
        corner = 2 * math.pi * errors.bandwidth * timestep
        self._share = -math.expm1(-corner) if corner else 1.0
        self._sent: deque[Vector] = deque(maxlen=int(whole) + 2)
        self._torque: Vector | None = None
        self.is_ideal = not (errors.delay or corner or errors.quantum) and bool((gain == 1).all())

    def torque(self, commanded: Vector) -> Vector:
        """Torque at the joints during the next step, of shape (dof,), N m."""
        wanted = commanded
        if self._quantum.any():
            wanted = np.round(wanted / self._quantum) * self._quantum
        if self._torque is None:  # an arm comes as if its drives had held it for long
            self._sent.extend([wanted] * (self._sent.maxlen or 0))
            self._torque = self._gain * wanted
        self._sent.append(wanted)
        old, young = self._sent[0], self._sent[1]
        wanted = self._gain * (young + self._rest * (old - young))
        self._torque = self._torque + self._share * (wanted - self._torque)
        return np.clip(self._torque, -self._effort, self._effort)
