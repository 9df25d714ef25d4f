"""What pushes an arm, as torques of its joints: told by its momentum, without a force sensor."""

from __future__ import annotations

from bt_dualarm.motion.chains.kernel_rows import DISTURBING, EXTERNAL, UNTOUCHED
from bt_dualarm.pose import Matrix, Vector


class MomentumObserver:
    """Residual of the generalised momentum p = M(q) v.

    The change of momentum that torques, gravity and velocities explain is integrated; what the
    momentum does besides is an external torque, through a first-order lag (De Luca, Albu-Schäffer,
    Haddadin, Hirzinger, IROS 2006; Haddadin, De Luca, Albu-Schäffer, T-RO 2017). So is whatever the
    nominal arm does not have: friction that is not fed forward, masses that are off. It is worked
    out with the torques (`observer_kernels`).

    Args:
        state: State of the arm, see `kernel_rows`.
        inertia: Inertia matrix of now, of shape (dof, dof), kg m²: a view of it.

    Attributes:
        is_new: Whether the arm weighs something else than in the period before.
        inertia: Inertia matrix of now, as it was given.
    """

    def __init__(self, state: Matrix, inertia: Matrix) -> None:
        self.is_new = True
        self.inertia = inertia
        self._torque, self._disturbing = state[EXTERNAL], state[DISTURBING]
        self._untouched = state[UNTOUCHED]

    @property
    def torque(self) -> Vector:
        """External torques, of shape (dof,), N m: positive where they push a joint forward."""
        torque: Vector = self._torque.copy()
        return torque

    @property
    def disturbing(self) -> Vector:
        """Torques that would disturb the nominal arm as much as it is, of shape (dof,), N m.

        They come sooner than `torque`, and with more noise.
        """
        torque: Vector = self._disturbing.copy()
        return torque

    @property
    def since(self) -> Vector:
        """By how much external torques differ from those while nothing was touched, (dof,), N m."""
        since: Vector = self._torque - self._untouched
        return since

    def untouched(self) -> None:
        """Say that nothing is touched: what there is now is friction, or a mass that is off."""
        self._untouched[:] = self._torque

    def forget(self) -> None:
        """Begin anew: the arm weighs something else now."""
        self.is_new = True
        self._torque[:] = 0.0
