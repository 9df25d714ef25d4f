"""The drives of an arm's joints: what becomes of a torque on its way to the joint."""

from __future__ import annotations

import math
from collections import deque

import numpy as np

from bt_dualarm.pose import Vector
from bt_dualarm.spec.reality import DriveErrors

_FINEST = 1e-12
"""Step of a torque, as a share of the effort limit, that numbers themselves have."""


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
        quantum = errors.quantum if errors.quantum > _FINEST else 0.0
        # What a torque is rounded in, and what it then is at the joint.
        self._per_step = 1.0 / (quantum * effort) if quantum else None
        self._gain = gain * quantum * effort if quantum else gain
        self._most, self._least = effort, -effort
        corner = 2 * math.pi * errors.bandwidth * timestep
        # An array of no dimension: with one, arrays are multiplied in half the time.
        self._share = np.array(-math.expm1(-corner)) if corner else None
        self._sent: deque[Vector] = deque(maxlen=int(whole) + 2)
        self._wanted = np.zeros_like(effort)
        self._torque: Vector | None = None
        self.is_ideal = not (errors.delay or corner or quantum) and bool((gain == 1).all())

    def command(self, torque: Vector) -> None:
        """Take up torques of shape (dof,), N m, that hold until the next."""
        if self._per_step is not None:
            torque = torque * self._per_step
            np.rint(torque, torque)
        wanted: Vector = self._gain * torque
        np.minimum(wanted, self._most, wanted)
        np.maximum(wanted, self._least, wanted)
        self._wanted = wanted  # another array each time: older ones are still on their way

    def torque(self) -> Vector:
        """Torque at the joints during the next step, of shape (dof,), N m."""
        sent, wanted = self._sent, self._wanted
        if self._torque is None:  # an arm comes as if its drives had held it for long
            sent.extend([wanted] * (sent.maxlen or 0))
            self._torque = wanted
        sent.append(wanted)
        if sent[0] is not sent[1] and self._rest:
            wanted = sent[1] + self._rest * (sent[0] - sent[1])
        else:
            wanted = sent[1]
        if self._share is not None:
            lag = wanted - self._torque
            np.multiply(lag, self._share, lag)
            wanted = np.add(self._torque, lag, lag)
        self._torque = wanted
        return wanted
