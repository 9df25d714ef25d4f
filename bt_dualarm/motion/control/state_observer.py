"""Where an arm is, how fast, and what disturbs it: from its encoders and what was asked of it."""

from __future__ import annotations

from bt_dualarm.motion.chains.kernel_rows import (
    ASKED,
    ASKED_BEFORE,
    DISTURBANCE,
    READING,
    Law,
    Q,
    V,
)
from bt_dualarm.pose import Matrix, Vector


class StateObserver:
    """Extended state observer of joints that follow accelerations which were asked for.

    Each joint is a double integrator; whatever it does besides (friction, masses that are not those
    of the model, a hand that pushes) is an acceleration that is estimated with its state (Han, From
    PID to active disturbance rejection control, IEEE Trans. Ind. Electron. 2009; one bandwidth for
    all poles: Gao, ACC 2003). Velocity is not differenced, so it does not lag and has little noise.

    Args:
        law: Numbers of the observer.
        state: State of the arm, see `kernel_rows`: what is known is kept there.
        q: Positions at the start, at rest, of shape (dof,), rad.
    """

    def __init__(self, law: Law, state: Matrix, q: Vector) -> None:
        from bt_dualarm.motion.chains.law_kernels import numbers_of
        from bt_dualarm.motion.chains.observer_kernels import observe

        self._observe, self._law, self._state = observe, numbers_of(law), state
        state[Q] = q
        self._reading = state[READING]
        self._is_new = True

    @property
    def q(self) -> Vector:
        """Positions as of the last reading, of shape (dof,), rad."""
        q: Vector = self._state[Q].copy()
        return q

    @property
    def v(self) -> Vector:
        """Velocities, of shape (dof,), rad/s."""
        v: Vector = self._state[V].copy()
        return v

    @property
    def disturbance(self) -> Vector:
        """Accelerations that nobody has asked for, of shape (dof,), rad/s²."""
        disturbance: Vector = self._state[DISTURBANCE].copy()
        return disturbance

    def read(self, q: Vector) -> None:
        """Take up positions of the encoders, of shape (dof,), rad, a period after the last ones."""
        if self.take(q):
            self.observe()

    def take(self, q: Vector) -> bool:
        """Note what the encoders read, as `read` does; whether it remains to be taken up."""
        self._reading[:] = q
        if self._is_new:
            self._is_new = False
            self._state[Q] = q
            return False
        return True

    def observe(self) -> None:
        """Take up what was noted."""
        self._observe(self._law, self._state)

    def expect(self, acceleration: Vector) -> None:
        """Note what the torques of the next period give the joints by the model, (dof,), rad/s²."""
        self._state[ASKED_BEFORE] = self._state[ASKED]
        self._state[ASKED] = acceleration

    def believe_instead(self, acceleration: Vector) -> None:
        """Take up another model, which says that the last torques give these, (dof,), rad/s².

        What the arm was seen to do stays: the disturbance takes up the difference.
        """
        change = acceleration - self._state[ASKED]
        self._state[ASKED] = acceleration
        self._state[ASKED_BEFORE] += change
        self._state[DISTURBANCE] -= change
