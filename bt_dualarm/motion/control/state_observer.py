"""Where an arm is, how fast, and what disturbs it: from its encoders and what was asked of it."""

from __future__ import annotations

import math

import numpy as np

from bt_dualarm.pose import Vector

OBSERVER_BANDWIDTH = 300.0
"""All poles of the observer's error, in 1/s: four times that of the control loop, so that the loop
hardly feels it; an encoder's noise of 2e-5 rad then is 6e-3 rad/s of velocity."""

DRIVE_DELAY_S = 0.001
"""Until a torque acts: what drives with a torque interface of 1 kHz need at least."""


class StateObserver:
    """Extended state observer of joints that follow accelerations which were asked for.

    Each joint is a double integrator; whatever it does besides (friction, masses that are not those
    of the model, a hand that pushes) is an acceleration that is estimated with its state (Han, From
    PID to active disturbance rejection control, IEEE Trans. Ind. Electron. 2009; one bandwidth for
    all poles: Gao, ACC 2003). Velocity is not differenced, so it does not lag and has little noise.

    Args:
        q: Positions at the start, at rest, of shape (dof,), rad.
        period: Seconds between two readings.
        timestep: Seconds of a step of the plant's physics.

    Attributes:
        q: Positions as of the last reading, rad; all of shape (dof,).
        v: Velocities, rad/s.
        disturbance: Acceleration that nobody has asked for, rad/s².
    """

    def __init__(self, q: Vector, period: float, timestep: float) -> None:
        self._period = period
        # MuJoCo's Euler steps move by the velocity at their end.
        self._fall = 0.5 * period * (period + timestep)
        pole = math.exp(-OBSERVER_BANDWIDTH * period)
        self._gain_q = 1.0 - pole**3
        self._gain_v = 1.5 * (1.0 - pole) ** 2 * (1.0 + pole) / period
        self._gain_d = (1.0 - pole) ** 3 / period**2
        self.q = q.copy()
        self.v, self.disturbance, self._asked, self._before = np.zeros((4, len(q)))
        self._late = DRIVE_DELAY_S / period
        self._is_new = True

    def read(self, q: Vector) -> None:
        """Take up positions of the encoders, of shape (dof,), rad, a period after the last ones."""
        if self._is_new:
            self._is_new = False
            self.q = q.copy()
            return
        asked = self._asked + self._late * (self._before - self._asked)
        a = asked + self.disturbance
        surprise = q - (self.q + self._period * self.v + self._fall * a)
        self.q = q - (1.0 - self._gain_q) * surprise
        self.v = self.v + self._period * a + self._gain_v * surprise
        self.disturbance = self.disturbance + self._gain_d * surprise

    @property
    def acceleration(self) -> Vector:
        """Accelerations until new torques act, of shape (dof,), rad/s²."""
        a: Vector = self._asked + self.disturbance
        return a

    def expect(self, acceleration: Vector) -> None:
        """Note what the torques of the next period give the joints by the model, (dof,), rad/s²."""
        self._before, self._asked = self._asked, acceleration

    def believe_instead(self, acceleration: Vector) -> None:
        """Take up another model, which says that the last torques give these, (dof,), rad/s².

        What the arm was seen to do stays: the disturbance takes up the difference.
        """
        change = acceleration - self._asked
        self._asked, self._before = acceleration, self._before + change
        self.disturbance = self.disturbance - change
