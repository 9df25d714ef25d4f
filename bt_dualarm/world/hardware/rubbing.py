"""Friction in the plant: MuJoCo's dry friction and damping, set anew at each step."""

from __future__ import annotations

from typing import Final

import mujoco
import numpy as np
import numpy.typing as npt

from bt_dualarm.pose import Vector
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
        self._is_dry = friction.rise <= 0
        self.is_none = not (
            friction.coulomb.any() or friction.static.any() or friction.viscous.any()
        )

    def act(self, model: mujoco.MjModel, data: mujoco.MjData, dofs: npt.NDArray[np.int64]) -> None:
        """Set friction for the velocities of now; before MuJoCo works out passive forces."""
        if self.is_none:
            return
        v: Vector = data.qvel[dofs]
        level = self._friction.level(v)
        model.dof_frictionloss[dofs] = np.where(self._is_dry, level, 0.0)
        fast = np.where(np.abs(v) > _CREEP, v, _CREEP)
        secant = level * self._friction.build_up(fast) / fast
        model.dof_damping[dofs] = self._friction.viscous + np.where(self._is_dry, 0.0, secant)
        model.dof_solref[dofs], model.dof_solimp[dofs, :2] = STIFF
