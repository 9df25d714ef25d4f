"""Array layouts of the chain kernels, and the conversion of a MuJoCo model to them.

All data of a link is one row of a matrix: passing an array to compiled code costs about as much as
the computation for one joint.
"""

from __future__ import annotations

from typing import Final, TypeAlias

import mujoco
import numpy as np
import numpy.typing as npt

from bt_dualarm.core.pose import Matrix, Vector

Stack: TypeAlias = npt.NDArray[np.float64]
"""Stacked matrices, of shape (k, n, m)."""

Triple: TypeAlias = tuple[float, float, float]
"""Vector in world coordinates, as a tuple: compiled code keeps its elements in registers."""

# Link columns, of shape (dof, LINK), in world axes with all joints at zero.
AXIS: Final = 0
"""Joint axis, 3 elements."""
STEP: Final = 3
"""Vector from the previous joint (or the origin) to this one, 3 elements, m."""
MASS: Final = 6
"""Mass of the link, kg."""
CENTER: Final = 7
"""Vector from the joint to the link's center of mass, 3 elements, m."""
INERTIA: Final = 10
"""Inertia tensor about the center of mass, 9 elements row by row, kg m²."""
ROTOR: Final = 19
"""Rotor inertia reflected to the joint, kg m²."""
LINK: Final = 20

# Joint limits, of shape (LIMITS, dof).
LOWER: Final = 0
UPPER: Final = 1
"""Position limits, rad."""
MAX_VELOCITY: Final = 2
MAX_ACCELERATION: Final = 3
MAX_JERK: Final = 4
"""Velocity, acceleration and jerk limits, rad/s, rad/s², rad/s³."""
LIMITS: Final = 5
ROUNDING: Final = 1e-6
"""Tolerance for floating-point rounding: in rad for positions, relative for the other limits."""


def links_of(model: mujoco.MjModel) -> Matrix:
    """Links of an arm, of shape (dof, LINK).

    Args:
        model: Model of this arm alone: a serial chain of revolute joints from base to tip.
    """
    data = mujoco.MjData(model)
    data.qpos[:] = 0.0
    mujoco.mj_kinematics(model, data)
    links = np.zeros((model.nv, LINK))
    anchors = data.xanchor
    axes = data.xaxis
    links[:, AXIS : AXIS + 3] = axes
    links[:, STEP : STEP + 3] = np.diff(anchors, axis=0, prepend=0.0)
    links[:, ROTOR] = model.dof_armature
    for joint in range(model.nv):
        bodies = [body for body in range(1, model.nbody) if _joint_of(model, body) == joint]
        mass, center, inertia = _combined_body(model, data, bodies)
        links[joint, MASS] = mass
        links[joint, CENTER : CENTER + 3] = center - anchors[joint]
        links[joint, INERTIA : INERTIA + 9] = inertia.ravel()
    return links


def _joint_of(model: mujoco.MjModel, body: int) -> int:
    """Index of the last joint between the base and a body; -1 if there is none."""
    while body and not model.body_dofnum[body]:
        body = int(model.body_parentid[body])
    return int(model.body_dofadr[body]) if body else -1


def _combined_body(
    model: mujoco.MjModel, data: mujoco.MjData, bodies: list[int]
) -> tuple[float, Vector, Matrix]:
    """Mass, center of mass, and inertia about it of rigidly connected bodies, in world axes."""
    masses = model.body_mass[bodies]
    centers = data.xipos[bodies]
    mass = float(masses.sum())
    center: Vector = masses @ centers / mass if mass > 0.0 else centers[0]
    inertia = np.zeros((3, 3))
    for body, body_mass, body_center in zip(bodies, masses, centers, strict=True):
        rotation = data.ximat[body].reshape(3, 3)
        offset = body_center - center
        inertia += rotation @ np.diag(model.body_inertia[body]) @ rotation.T
        # Parallel-axis theorem.
        inertia += body_mass * (float(offset @ offset) * np.eye(3) - np.outer(offset, offset))
    return mass, center, inertia


def links_from_jacobian(tool: Matrix, jacobian: Matrix) -> Matrix:
    """Massless links, of shape (dof, LINK), of a chain of which only the tool is known.

    Args:
        tool: Pose of the tool in the world with all joints at zero, of shape (4, 4).
        jacobian: Jacobian of the tool there, linear first, of shape (6, dof).
    """
    links = np.zeros((jacobian.shape[1], LINK))
    axes = jacobian[3:].T
    # The linear part is v = axis x (tool - anchor), so v x axis = (tool - anchor) perpendicular to
    # the axis: the anchor is the point of the axis that is nearest to the tool.
    anchors = tool[:3, 3] - np.cross(jacobian[:3].T, axes)
    links[:, AXIS : AXIS + 3] = axes
    links[:, STEP : STEP + 3] = np.diff(anchors, axis=0, prepend=np.zeros((1, 3)))
    return links
