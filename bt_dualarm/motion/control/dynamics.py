"""The equations of motion of an arm and of what it holds, as one chain of rigid bodies."""

from __future__ import annotations

import copy
from collections.abc import Iterable
from typing import TypeAlias

import mujoco
import numpy as np

from bt_dualarm.pose import Matrix, Pose, Vector
from bt_dualarm.world.nominal.nominal_arm import NominalArm
from bt_dualarm.world.nominal.nominal_load import NominalLoad


class ArmDynamics:
    """Torques that an arm's joints need, as far as its page and the tree file say.

    Args:
        nominal: What is believed of the arm.
        loads: Things that it holds, rigidly; those of unknown mass count for nothing.
    """

    def __init__(self, nominal: NominalArm, loads: Iterable[NominalLoad] = ()) -> None:
        self.model = copy.copy(nominal.model)
        self.data = mujoco.MjData(self.model)
        known = [
            (load.mass, np.diag(load.inertia), load.pose)
            for load in loads
            if load.mass is not None and load.inertia is not None
        ]
        if known:
            _load(self.model, nominal.tool_body, known)
            mujoco.mj_setConst(self.model, self.data)

    def update(self, q: Vector, v: Vector) -> None:
        """Take up positions in rad and velocities in rad/s, each of shape (dof,)."""
        model, data = self.model, self.data
        data.qpos[:], data.qvel[:] = q, v
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        mujoco.mj_makeM(model, data)
        mujoco.mj_factorM(model, data)
        mujoco.mj_comVel(model, data)
        mujoco.mj_rne(model, data, 0, data.qfrc_bias)

    @property
    def inertia(self) -> Matrix:
        """Inertia matrix at the last update, of shape (dof, dof), kg m²."""
        inertia = np.empty((self.model.nv, self.model.nv))
        mujoco.mj_fullM(self.model, self.data, inertia)
        return inertia

    @property
    def bias(self) -> Vector:
        """Torques of gravity and of velocity at the last update, of shape (dof,), N m."""
        bias: Vector = self.data.qfrc_bias
        return bias

    def inertia_times(self, acceleration: Vector) -> Vector:
        """Torques, of shape (dof,), N m, that give accelerations of shape (dof,), rad/s²."""
        product = np.empty_like(acceleration)
        mujoco.mj_mulM(self.model, self.data, product, acceleration)
        return product

    def accelerations(self, torque: Vector) -> Vector:
        """Accelerations, of shape (dof,), rad/s², that torques of shape (dof,), N m, give."""
        found = np.empty((1, len(torque)))
        mujoco.mj_solveM(self.model, self.data, found, torque[None])
        accelerations: Vector = found[0]
        return accelerations

    def at_rest(self, q: Vector) -> Vector:
        """Torques, of shape (dof,), N m, that hold a configuration ``q``, of shape (dof,), rad."""
        nothing = np.zeros_like(q)
        return self.moving(q, nothing, nothing)

    def moving(self, q: Vector, v: Vector, a: Vector) -> Vector:
        """Torques, of shape (dof,), N m, of a motion: inverse dynamics (Newton and Euler).

        Args:
            q: Configuration, of shape (dof,), rad.
            v: Velocity, of shape (dof,), rad/s.
            a: Acceleration, of shape (dof,), rad/s².
        """
        model, data = self.model, self.data
        data.qpos[:], data.qvel[:], data.qacc[:] = q, v, a
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        mujoco.mj_comVel(model, data)
        torques = np.empty(model.nv)
        mujoco.mj_rne(model, data, 1, torques)
        whole: Vector = torques + model.dof_armature * a  # which MuJoCo's own leaves out
        return whole


_Body: TypeAlias = tuple[float, Matrix, Pose]
"""Mass in kg, inertia of shape (3, 3) along the axes of the pose of its centre in a link."""


def _load(model: mujoco.MjModel, link: int, loads: Iterable[_Body]) -> None:
    """Make what is held a part of a link: mass, centre and inertia of both together."""
    own = Pose(model.body_ipos[link].copy(), model.body_iquat[link].copy())
    bodies = [(float(model.body_mass[link]), np.diag(model.body_inertia[link]), own), *loads]
    mass = sum(body[0] for body in bodies)
    centre: Vector = sum((body[0] * body[2].position for body in bodies), np.zeros(3)) / mass
    tensor = sum((_about(centre, *body) for body in bodies), np.zeros((3, 3)))
    moments, axes = np.linalg.eigh(tensor)
    axes *= np.sign(np.linalg.det(axes))  # a rotation, no reflection
    model.body_mass[link], model.body_ipos[link] = mass, centre
    model.body_inertia[link] = moments
    mujoco.mju_mat2Quat(model.body_iquat[link], axes.ravel())


def _about(centre: Vector, mass: float, inertia: Matrix, pose: Pose) -> Matrix:
    """Inertia of a body about a point, both in a link, along its axes (parallel-axis theorem)."""
    turn, away = pose.rotation_matrix, pose.position - centre
    own: Matrix = turn @ inertia @ turn.T
    return own + mass * (float(away @ away) * np.eye(3) - np.outer(away, away))
