"""What pushes an arm, as torques of its joints: told by its momentum, without a force sensor."""

from __future__ import annotations

from bt_dualarm.motion.chains.kernel_rows import DISTURBING, EXTERNAL
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

    def square_since(self, before: Vector) -> float:
        """Square of how much external torques differ from others, of shape (dof,), N m: (N m)²."""
        since = self._torque - before
        return float(since.dot(since))

    def forget(self) -> None:
        """Begin anew: the arm weighs something else now."""
        self.is_new = True
        self._torque[:] = 0.0
