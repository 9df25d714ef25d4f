"""Friction in the plant: MuJoCo's dry friction and damping, set anew at each step."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

import mujoco
import numpy as np

from bt_dualarm.pose import Matrix
from bt_dualarm.world.hardware.encoders import kernels
from bt_dualarm.world.hardware.kernel_columns import (
    COULOMB,
    CREEP,
    DROP,
    FRICTION,
    NARROW,
    OFFSET,
    RISE,
    VISCOUS,
)
from bt_dualarm.world.hardware.plant_arm import PlantArm, joints_of
from bt_dualarm.world.robots.friction import JointFriction

STIFF: Final = (0.004, 1.0), (0.9999, 0.9999)
"""Reference and impedance of the constraint by which MuJoCo has dry friction: with its defaults a
joint that sticks creeps at 0.05 rad/s under half of the load that it bears, with these at 1e-5."""


class Rubbing:
    """Friction of the joints of all arms in the plant, set in one call.

    Dry friction is a constraint of MuJoCo, whose level follows the speed (Stribeck). Friction that
    builds up over a speed is damping, of so many N m s/rad as give its torque at the speed of now:
    MuJoCo integrates damping implicitly, so light links stay stable.

    Args:
        friction: Friction of the joints, by arm.
        parts: Rows of each arm's joints among those of all.
    """

    def __init__(self, friction: Mapping[str, JointFriction], parts: Mapping[str, slice]) -> None:
        self._friction, self._parts = friction, parts
        self._rows = np.concatenate([np.zeros((0, FRICTION)), *map(rows_of, friction.values())])
        self._still: set[str] = set()  # arms that have not moved: nobody waits for machine code

    def begin(self, name: str) -> None:
        """Have an arm that comes into the world stand."""
        self._still.add(name)

    def connect(
        self, model: mujoco.MjModel, data: mujoco.MjData, arms: Mapping[str, PlantArm]
    ) -> None:
        """Belong to the arms of the plant that are there; anew after each recompilation."""
        # Views: looking a field up costs more than what is done with it.
        self._v, self._dry, self._damping = data.qvel, model.dof_frictionloss, model.dof_damping
        self._arms = {name: arm for name, arm in arms.items() if _is_some(self._friction[name])}
        for arm in self._arms.values():
            model.dof_solref[arm.dof_ids] = STIFF[0]
            model.dof_solimp[arm.dof_ids, :2] = STIFF[1]
        self._take_up()

    def act(self) -> None:
        """Set friction for the velocities of now; before MuJoCo works out passive forces."""
        if self._standing:
            self._look_at_standing()
        if len(self._where):
            kernels().rub(self._where, self._rows, self._v, self._dry, self._damping)

    def _take_up(self) -> None:
        """Tell arms that stand from those that have moved."""
        self._standing = [name for name in self._arms if name in self._still]
        moving = {name: arm for name, arm in self._arms.items() if name not in self._still}
        self._where = joints_of(moving, self._parts, lambda arm: arm.dof_ids)

    def _look_at_standing(self) -> None:
        """Set friction of arms that stand, and take up those that move now."""
        for name in self._standing:
            dofs, friction = self._arms[name].dof_ids, self._friction[name]
            if self._v[dofs].any():
                self._still.remove(name)
            else:
                gentle = friction.rise > 0.0
                slope = friction.static * friction.build_up(np.full_like(gentle, CREEP, float))
                self._dry[dofs] = np.where(gentle, 0.0, friction.static)
                self._damping[dofs] = friction.viscous + np.where(gentle, slope / CREEP, 0.0)
        self._take_up()


def rows_of(friction: JointFriction) -> Matrix:
    """Friction of one arm's joints as the kernel reads it, of shape (dof, FRICTION)."""
    rows = np.empty((len(friction.coulomb), FRICTION))
    rows[:, COULOMB], rows[:, DROP] = friction.coulomb, friction.static - friction.coulomb
    rows[:, NARROW] = -1.0 / np.square(friction.stribeck_velocity)
    rows[:, VISCOUS], rows[:, RISE] = friction.viscous, friction.rise
    rows[:, OFFSET] = friction.offset
    return rows


def _is_some(friction: JointFriction) -> bool:
    """Whether there is any."""
    return bool(friction.coulomb.any() or friction.static.any() or friction.viscous.any())
