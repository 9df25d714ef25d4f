"""What a body that an arm holds asks of the arm's joints."""

from __future__ import annotations

import mujoco
import numpy as np

from bt_dualarm.pose import Vector
from bt_dualarm.world.nominal.nominal_arm import NominalArm
from bt_dualarm.world.nominal.nominal_load import NominalLoad


class Payload:
    """A body held by an arm's tool, as far as it is known; one of unknown mass weighs nothing.

    Args:
        load: What is held.
        arm: Arm that holds it, as it is believed to be.
    """

    def __init__(self, load: NominalLoad, arm: NominalArm) -> None:
        self._model = arm.model
        self._data = arm.data
        self._holder = arm.tool_body
        self._mass = load.mass or 0.0
        self._inertia = np.zeros(3) if load.inertia is None else load.inertia
        self._gravity = arm.model.opt.gravity.copy()
        self._center_in_link = load.pose.position
        self._axes_in_link = load.pose.rotation_matrix
        # Views: looking a field up costs as much as a product of matrices.
        self._link = arm.data.xpos[self._holder]
        self._link_axes = arm.data.xmat[self._holder].reshape(3, 3)
        self._jacobian, self._drift = np.zeros((2, 6, arm.model.nv))
        self._linear, self._angular = self._jacobian[:3], self._jacobian[3:]
        self._linear_drift, self._angular_drift = self._drift[:3], self._drift[3:]

    def torque(self, acceleration: Vector) -> Vector:
        """Joint torques, of shape (dof,), that carry it along (Newton and Euler at its centre).

        Its gyroscopic moment is left out: below 0.01 N m for what a tool holds.

        Args:
            acceleration: Acceleration of the joints, of shape (dof,), rad/s².
        """
        model, data, holder = self._model, self._data, self._holder
        center = self._link + self._link_axes @ self._center_in_link
        mujoco.mj_jac(model, data, self._linear, self._angular, center, holder)
        mujoco.mj_jacDot(model, data, self._linear_drift, self._angular_drift, center, holder)
        wrench = self._jacobian @ acceleration + self._drift @ data.qvel
        axes = self._link_axes @ self._axes_in_link
        wrench[:3] = self._mass * (wrench[:3] - self._gravity)
        wrench[3:] = axes @ (self._inertia * (wrench[3:] @ axes))
        torque: Vector = wrench @ self._jacobian
        return torque
