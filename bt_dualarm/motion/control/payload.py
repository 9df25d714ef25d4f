"""What a body that an arm holds asks of the arm's joints."""

from __future__ import annotations

import mujoco
import numpy as np

from bt_dualarm.pose import Vector
from bt_dualarm.world.arm_body import ArmBody


class Payload:
    """A body held by an arm's tool; valid until the world is recompiled.

    Args:
        model: Compiled world.
        data: State of the world.
        body: Id of the body that is held.
        arm: Arm that holds it.
    """

    def __init__(self, model: mujoco.MjModel, data: mujoco.MjData, body: int, arm: ArmBody) -> None:
        self._model = model
        self._data = data
        self._holder = arm.tool_body
        self._dofs = arm.dof_ids
        self._mass = float(model.body_mass[body])
        self._inertia = model.body_inertia[body]
        self._gravity = model.opt.gravity.copy()
        # Views: looking a field up costs as much as a product of matrices.
        self._center = data.xipos[body]
        self._axes = data.ximat[body].reshape(3, 3)
        self._jacobian, self._drift = np.zeros((2, 6, model.nv))
        self._linear, self._angular = self._jacobian[:3], self._jacobian[3:]
        self._linear_drift, self._angular_drift = self._drift[:3], self._drift[3:]

    def torque(self, acceleration: Vector) -> Vector:
        """Joint torques, of shape (dof,), that carry it along (Newton and Euler at its centre).

        Its gyroscopic moment is left out: below 0.01 N m for what a tool holds.

        Args:
            acceleration: Acceleration of the joints, of shape (dof,), rad/s².
        """
        model, data, holder = self._model, self._data, self._holder
        mujoco.mj_jac(model, data, self._linear, self._angular, self._center, holder)
        mujoco.mj_jacDot(model, data, self._linear_drift, self._angular_drift, self._center, holder)
        jacobian = self._jacobian.take(self._dofs, axis=1)
        wrench = jacobian @ acceleration + self._drift @ data.qvel
        wrench[:3] = self._mass * (wrench[:3] - self._gravity)
        wrench[3:] = self._axes @ (self._inertia * (wrench[3:] @ self._axes))
        torque: Vector = wrench @ jacobian
        return torque
