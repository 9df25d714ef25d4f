"""Friction in the plant: MuJoCo's dry friction and damping, set anew at each step."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final, TypeAlias

import mujoco
import numpy as np
import numpy.typing as npt

from bt_dualarm.pose import Matrix, Vector
from bt_dualarm.world.hardware.kernel_rows import (
    COULOMB,
    CREEP,
    DROP,
    FRICTION,
    NARROW,
    OFFSET,
    RISE,
    VISCOUS,
)
from bt_dualarm.world.robots.friction import JointFriction

STIFF: Final = (0.004, 1.0), (0.9999, 0.9999)
"""Reference and impedance of the constraint by which MuJoCo has dry friction: with its defaults a
joint that sticks creeps at 0.05 rad/s under half of the load that it bears, with these at 1e-5."""


Rub: TypeAlias = Callable[[Matrix, Vector, Vector, Vector], None]
"""Sets friction and damping of joints for their velocities."""


class Rubbing:
    """Friction of one arm's joints in the plant.

    Dry friction is a constraint of MuJoCo, whose level follows the speed (Stribeck). Friction that
    builds up over a speed is damping, of so many N m s/rad as give its torque at the speed of now:
    MuJoCo integrates damping implicitly, so light links stay stable.

    Args:
        friction: Friction of the joints.

    Attributes:
        joints: The same as the kernel reads it, of shape (FRICTION, dof).
        is_none: Whether there is none.
    """

    def __init__(self, friction: JointFriction) -> None:
        self._friction, self.joints = friction, _rows(friction)
        self._rub: Rub | None = None  # before anything moves nobody waits for machine code
        self.is_none = not (
            friction.coulomb.any() or friction.static.any() or friction.viscous.any()
        )

    def connect(
        self, model: mujoco.MjModel, data: mujoco.MjData, dofs: npt.NDArray[np.int64]
    ) -> None:
        """Belong to an arm of a model, by the addresses of its velocities, of shape (dof,)."""
        if self.is_none:
            return
        part = slice(int(dofs[0]), int(dofs[-1]) + 1)  # a chain's are one after the other
        # Views: looking a field up costs more than what is done with it.
        self._v = data.qvel[part]
        self._dry, self._damping = model.dof_frictionloss[part], model.dof_damping[part]
        model.dof_solref[part], model.dof_solimp[part, :2] = STIFF

    def act(self) -> None:
        """Set friction for the velocities of now; before MuJoCo works out passive forces."""
        if self.is_none:
            return
        if self._rub is not None:
            self._rub(self.joints, self._v, self._dry, self._damping)
        elif self._v.any():
            from bt_dualarm.world.hardware.hardware_kernels import rub

            self._rub = rub
            self.act()
        else:
            self._rest()

    def _rest(self) -> None:
        """Set friction of joints that stand."""
        friction, gentle = self._friction, self._friction.rise > 0.0
        slope = friction.static * friction.build_up(np.full_like(friction.rise, CREEP)) / CREEP
        self._dry[:] = np.where(gentle, 0.0, friction.static)
        self._damping[:] = friction.viscous + np.where(gentle, slope, 0.0)


def _rows(friction: JointFriction) -> Matrix:
    """Friction as the kernel reads it, of shape (FRICTION, dof)."""
    rows = np.empty((FRICTION, len(friction.coulomb)))
    rows[COULOMB], rows[DROP] = friction.coulomb, friction.static - friction.coulomb
    rows[NARROW] = -1.0 / np.square(friction.stribeck_velocity)
    rows[VISCOUS], rows[RISE], rows[OFFSET] = friction.viscous, friction.rise, friction.offset
    return rows
