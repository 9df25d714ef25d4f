"""The numbers of a chain as its kernels have them: taken from a MuJoCo model."""

from __future__ import annotations

import mujoco
import numpy as np

from bt_dualarm.motion.chains.kernel_rows import (
    AXIS,
    CENTER,
    INERTIA,
    LINK,
    MASS,
    ROTOR,
    STEP,
)
from bt_dualarm.pose import Matrix, Vector


def links_of(model: mujoco.MjModel) -> Matrix:
    """The links of an arm, of shape (dof, LINK): what `kernel_rows` says.

    Args:
        model: Model of this arm alone: turning joints one after the other, base to tip.
    """
    data = mujoco.MjData(model)
    data.qpos[:] = 0.0
    mujoco.mj_kinematics(model, data)
    links = np.zeros((model.nv, LINK))
    anchors, axes = data.xanchor, data.xaxis
    links[:, AXIS : AXIS + 3] = axes
    links[:, STEP : STEP + 3] = np.diff(anchors, axis=0, prepend=0.0)
    links[:, ROTOR] = model.dof_armature
    for joint in range(model.nv):
        bodies = [body for body in range(1, model.nbody) if _joint_of(model, body) == joint]
        mass, center, inertia = _together(model, data, bodies)
        links[joint, MASS] = mass
        links[joint, CENTER : CENTER + 3] = center - anchors[joint]
        links[joint, INERTIA : INERTIA + 9] = inertia.ravel()
    return links


def _joint_of(model: mujoco.MjModel, body: int) -> int:
    """The last joint between the base and a body; -1 where there is none."""
    while body and not model.body_dofnum[body]:
        body = int(model.body_parentid[body])
    return int(model.body_dofadr[body]) if body else -1


def _together(
    model: mujoco.MjModel, data: mujoco.MjData, bodies: list[int]
) -> tuple[float, Vector, Matrix]:
    """Mass, centre, and inertia about it of bodies that are one, in the world's axes."""
    masses, centers = model.body_mass[bodies], data.xipos[bodies]
    mass = float(masses.sum())
    center: Vector = masses @ centers / mass if mass > 0.0 else centers[0]
    inertia = np.zeros((3, 3))
    for body, weight, place in zip(bodies, masses, centers, strict=True):
        turn, away = data.ximat[body].reshape(3, 3), place - center
        inertia += turn @ np.diag(model.body_inertia[body]) @ turn.T
        inertia += weight * (float(away @ away) * np.eye(3) - np.outer(away, away))
    return mass, center, inertia


def links_by_jacobian(tool: Matrix, jacobian: Matrix) -> Matrix:
    """Links without masses, of shape (dof, LINK), of a chain that is known by its tool only.

    Args:
        tool: Pose of the tool in the world while all joints are at zero, of shape (4, 4).
        jacobian: Joint rates to the tool's linear, then angular velocity then, of shape (6, dof).
    """
    links = np.zeros((jacobian.shape[1], LINK))
    axes = jacobian[3:].T
    # The point of each axis that is nearest to the tool.
    anchors = tool[:3, 3] - np.cross(jacobian[:3].T, axes)
    links[:, AXIS : AXIS + 3] = axes
    links[:, STEP : STEP + 3] = np.diff(anchors, axis=0, prepend=np.zeros((1, 3)))
    return links
