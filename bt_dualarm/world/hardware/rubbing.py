"""Friction in the plant: MuJoCo's dry friction and damping, set anew at each step."""

from __future__ import annotations

from typing import Final

import mujoco
import numpy as np
import numpy.typing as npt

from bt_dualarm.world.robots.friction import JointFriction

STIFF: Final = (0.004, 1.0), (0.9999, 0.9999)
"""Reference and impedance of the constraint by which MuJoCo has dry friction: with its defaults a
joint that sticks creeps at 0.05 rad/s under half of the load that it bears, with these at 1e-5."""

_CREEP: Final = 1e-6
"""Speed in rad/s below which a slope is taken instead of a secant."""


class Rubbing:
    """Friction of one arm's joints in the plant.

    Dry friction is a constraint of MuJoCo, whose level follows the speed (Stribeck). Friction that
    builds up over a speed is damping, of so many N m s/rad as give its torque at the speed of now:
    MuJoCo integrates damping implicitly, so light links stay stable.

    Args:
        friction: Friction of the joints.
    """

    def __init__(self, friction: JointFriction) -> None:
        self._friction = friction
        self._is_gentle = friction.rise > 0
        drop = friction.static - friction.coulomb
        # What dry joints have at any speed, and how much more of it when they stand.
        self._level = np.where(self._is_gentle, 0.0, friction.coulomb)
        self._drop = np.where(self._is_gentle, 0.0, drop)
        self._slowness = 1.0 / friction.stribeck_velocity
        self._is_level = not self._drop.any()
        self._is_even = not self._is_gentle.any()
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
        self._dry[:], self._damping[:] = self._level, self._friction.viscous
        model.dof_solref[part], model.dof_solimp[part, :2] = STIFF

    def act(self) -> None:
        """Set friction for the velocities of now; before MuJoCo works out passive forces."""
        if self.is_none:
            return
        if not self._is_level:
            slow = self._slowness * self._v
            self._dry[:] = self._level + self._drop * np.exp(-slow * slow)
        if not self._is_even:
            v = np.where(np.abs(self._v) > _CREEP, self._v, _CREEP)
            friction = self._friction
            secant = friction.level(v) * friction.build_up(v) / v
            self._damping[:] = friction.viscous + np.where(self._is_gentle, secant, 0.0)
