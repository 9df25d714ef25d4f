"""The drives of an arm's joints: what becomes of a torque on its way to the joint."""

from __future__ import annotations

import math

import numpy as np

from bt_dualarm.pose import Vector
from bt_dualarm.spec.reality import DriveErrors
from bt_dualarm.world.hardware.encoders import kernels
from bt_dualarm.world.hardware.kernel_rows import DRIVES, EFFORT, GAIN, PER_STEP, WANTED

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

    Attributes:
        is_ideal: Whether they give what is commanded at once.
        rows: What their kernel reads and writes, see `kernel_rows`.
    """

    def __init__(self, errors: DriveErrors, gain: Vector, effort: Vector, timestep: float) -> None:
        whole, self._rest = divmod(round(errors.delay / timestep, 9), 1.0)
        quantum = errors.quantum if errors.quantum > _FINEST else 0.0
        self.rows = np.zeros((DRIVES, len(effort)))
        # What a torque is rounded in, and what it then is at the joint.
        self.rows[PER_STEP] = 1.0 / (quantum * effort) if quantum else 0.0
        self.rows[GAIN] = gain * quantum * effort if quantum else gain
        self.rows[EFFORT] = effort
        corner = 2 * math.pi * errors.bandwidth * timestep
        self._share = -math.expm1(-corner) if corner else 1.0
        self._sent = np.zeros((int(whole) + 2, len(effort)))
        self._newest = 0
        self._wanted, self._torque = self.rows[WANTED], np.zeros(len(effort))
        self._is_new = True
        self.is_ideal = not (errors.delay or corner or quantum) and bool((gain == 1).all())

    def command(self, torque: Vector) -> None:
        """Take up torques of shape (dof,), N m, that hold until the next."""
        kernels().take_torques(np.array(torque, dtype=float), self.rows)

    def torque(self) -> Vector:
        """Torque at the joints during the next step, of shape (dof,), N m."""
        motors = np.empty_like(self._torque)
        self.drive(motors)
        return motors

    def drive(self, motors: Vector) -> None:
        """Have motors give the torque of the next step, of shape (dof,), N m."""
        if self._is_new:  # an arm comes as if its drives had held it for long
            self._is_new = False
            self._sent[:] = self._torque[:] = self._wanted
        self._newest = (self._newest + 1) % len(self._sent)
        kernels().pass_on(
            self._sent, self._newest, self._wanted, self._rest, self._share, self._torque, motors
        )
