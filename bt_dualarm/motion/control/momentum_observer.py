"""What pushes an arm, as torques of its joints: told by its momentum, without a force sensor."""

from __future__ import annotations

import numpy as np

from bt_dualarm.motion.control.dynamics import ArmDynamics
from bt_dualarm.pose import Vector

TOUCH_BANDWIDTH = 50.0
"""Of the residual, in 1/s: it has 63 % of a push after 20 ms."""


class MomentumObserver:
    """Residual of the generalised momentum p = M(q) v.

    The change of momentum that torques, gravity and velocities explain is integrated; what the
    momentum does besides is an external torque, through a first-order lag (De Luca, Albu-Schäffer,
    Haddadin, Hirzinger, IROS 2006; Haddadin, De Luca, Albu-Schäffer, T-RO 2017). So is whatever the
    nominal arm does not have: friction that is not fed forward, masses that are off.

    Args:
        dof: Number of joints.
        period: Seconds between two updates.

    Attributes:
        torque: External torques, of shape (dof,), N m: positive where they push a joint forward.
    """

    def __init__(self, dof: int, period: float) -> None:
        self._period = period
        self.torque = np.zeros(dof)
        self._explained = np.zeros(dof)
        self._inertia = np.zeros((0, 0))
        self._bias = np.zeros(dof)

    def update(self, dynamics: ArmDynamics, v: Vector, driving: Vector) -> None:
        """Take up a period that has passed.

        Args:
            dynamics: Dynamics of the arm, updated to now.
            v: Velocities of now, of shape (dof,), rad/s.
            driving: Torques of the motors during the period without what friction takes of them,
                of shape (dof,), N m.
        """
        inertia = dynamics.inertia
        momentum = inertia @ v
        if not self._inertia.size:
            self._explained = momentum
            self._inertia = inertia
        change = (inertia - self._inertia) @ v / self._period
        self._explained = self._explained + self._period * (
            driving + change - self._bias + self.torque
        )
        self.torque = TOUCH_BANDWIDTH * (momentum - self._explained)
        self._inertia, self._bias = inertia, dynamics.bias.copy()

    def forget(self) -> None:
        """Begin anew: the arm weighs something else now."""
        self.torque = np.zeros_like(self.torque)
        self._inertia = np.zeros((0, 0))
