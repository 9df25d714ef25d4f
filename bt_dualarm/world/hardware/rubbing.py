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

_CREEP: Final = 1e-9
"""Speed in rad/s that is added before a secant is taken: that of a joint that stands is a slope."""


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
        dry = friction.rise <= 0
        drop = friction.static - friction.coulomb
        # What joints have at any speed, and how much more of it when they stand.
        self._level, self._drop = np.where(dry, friction.coulomb, 0.0), np.where(dry, drop, 0.0)
        self._narrow = -1.0 / np.square(friction.stribeck_velocity)
        self._fall = np.empty_like(drop)
        self._gentle, self._gentle_drop = friction.coulomb - self._level, drop - self._drop
        self._steepness = 1.0 / np.where(dry, 1.0, friction.rise)
        self._start = np.tanh(friction.offset * self._steepness)
        self._falls = bool(drop.any())
        self._builds_up = not bool(dry.all())
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
        gentle = self._gentle
        if self._falls:
            fall, v = self._fall, self._v  # in place: what is allocated here costs most
            np.multiply(v, v, fall)
            np.multiply(fall, self._narrow, fall)
            np.exp(fall, fall)
            if self._builds_up:
                gentle = gentle + self._gentle_drop * fall
            np.multiply(fall, self._drop, fall)
            np.add(fall, self._level, self._dry)
        if self._builds_up:
            v = self._v + _CREEP
            rise = np.tanh((v + self._friction.offset) * self._steepness) - self._start
            self._damping[:] = self._friction.viscous + gentle * rise / v
