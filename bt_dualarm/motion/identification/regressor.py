"""The torques of an arm as a linear function of the masses of its links."""

from __future__ import annotations

from collections.abc import Iterator

import mujoco
import numpy as np
import numpy.typing as npt

from bt_dualarm.pose import Matrix, Pose, Vector
from bt_dualarm.world.nominal.nominal_arm import NominalArm

INERTIAL = 10
"""Numbers of a rigid body: mass, first moment (3), inertia about its frame's origin (6)."""

_PAIRS = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))


class TorqueRegressor:
    """Inverse dynamics of a chain, as columns that the links' inertial numbers are factors of.

    Newton and Euler's equations are linear in them (Khalil, Dombre, Modeling, identification and
    control of robots, 9.4). Links that are rigidly joined count as one, in the frame of the one
    that moves: there are as many as joints.

    Args:
        nominal: What is believed of the arm.

    Attributes:
        links: Inertial numbers of the links by their page, of shape (dof, 10).
        tool_link: Pose of the tool's link in the frame of the last one that moves.
    """

    def __init__(self, nominal: NominalArm) -> None:
        self._model = model = nominal.model
        self._data = data = mujoco.MjData(model)
        self._bodies = model.jnt_bodyid.tolist()
        mujoco.mj_kinematics(model, data)
        self.links = np.zeros((model.nv, INERTIAL))
        for body, row in self._rigid_parts():
            mass, inertia = float(model.body_mass[body]), model.body_inertia[body]
            own = Pose(model.body_ipos[body], model.body_iquat[body])
            self.links[row] += inertial_numbers(mass, inertia, self._in_link(row, body) @ own)
        self.tool_link = self._in_link(model.nv - 1, nominal.tool_body)

    def __call__(self, q: Vector, v: Vector, a: Vector) -> npt.NDArray[np.float64]:
        """Columns of each link, of shape (dof, links, 10), at a state of shapes (dof,), SI units.

        Summed over links and their numbers, times these, they are the torques of the motion.
        """
        model, data, dof = self._model, self._data, self._model.nv
        data.qpos[:], data.qvel[:] = q, v
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        mujoco.mj_comVel(model, data)
        jacobian, change = np.zeros((2, dof, 6, dof))
        for row, body in enumerate(self._bodies):
            mujoco.mj_jacBody(model, data, jacobian[row, :3], jacobian[row, 3:], body)
            point = data.xpos[body]
            mujoco.mj_jacDot(model, data, change[row, :3], change[row, 3:], point, body)
        axes = data.xmat[self._bodies].reshape(dof, 3, 3)
        acceleration = (jacobian @ a + change @ v).reshape(dof, 2, 3) @ axes
        linear = acceleration[:, 0] - model.opt.gravity @ axes
        turning, spinning = acceleration[:, 1], (jacobian[:, 3:] @ v)[:, None] @ axes
        wrench = _wrenches(linear, turning, spinning[:, 0])
        in_world = axes[:, None] @ wrench.reshape(dof, 2, 3, INERTIAL)
        columns: npt.NDArray[np.float64] = np.einsum(
            "bij,bik->jbk", jacobian, in_world.reshape(dof, 6, INERTIAL)
        )
        return columns

    def _rigid_parts(self) -> Iterator[tuple[int, int]]:
        """Each body that moves, and the row of the link that it is a part of."""
        for body, root in enumerate(self._model.body_weldid.tolist()):
            if root in self._bodies:
                yield body, self._bodies.index(root)

    def _in_link(self, row: int, body: int) -> Pose:
        """Pose of a body in the frame of the link that it is a part of."""
        data, link = self._data, self._bodies[row]
        frame = Pose(data.xpos[link].copy(), data.xquat[link].copy())
        return frame.inverse @ Pose(data.xpos[body].copy(), data.xquat[body].copy())


def inertial_numbers(mass: float, moments: Vector, pose: Pose) -> Vector:
    """Inertial numbers, of shape (10,), of a body in a frame.

    Args:
        mass: Mass in kg.
        moments: Principal moments of inertia about its centre, of shape (3,), kg m².
        pose: Pose of its centre and principal axes in the frame.
    """
    turn, centre = pose.rotation_matrix, pose.position
    inertia = turn @ np.diag(moments) @ turn.T
    inertia += mass * (float(centre @ centre) * np.eye(3) - np.outer(centre, centre))
    return np.array([mass, *(mass * centre), *(inertia[i, j] for i, j in _PAIRS)])


def _wrenches(linear: Matrix, turning: Matrix, spinning: Matrix) -> npt.NDArray[np.float64]:
    """Forces and moments about the frames' origins, in their axes, of each inertial number.

    Args:
        linear: Accelerations of the origins without gravity's, of shape (n, 3), m/s².
        turning: Angular accelerations, likewise, rad/s².
        spinning: Angular velocities, likewise, rad/s.

    Returns:
        Wrenches of shape (n, 6, 10).
    """
    wrench = np.zeros((len(linear), 6, INERTIAL))
    wrench[:, :3, 0] = linear
    spin = _cross(spinning)
    wrench[:, :3, 1:4] = _cross(turning) + spin @ spin
    wrench[:, 3:, 1:4] = -_cross(linear)
    wrench[:, 3:, 4:] = _inertia_times(turning) + spin @ _inertia_times(spinning)
    return wrench


def _cross(vectors: Matrix) -> npt.NDArray[np.float64]:
    """Matrices of shape (n, 3, 3) that give the cross product of vectors of shape (n, 3)."""
    matrices = np.zeros((len(vectors), 3, 3))
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        matrices[:, k, j], matrices[:, j, k] = vectors[:, i], -vectors[:, i]
    return matrices


def _inertia_times(vectors: Matrix) -> npt.NDArray[np.float64]:
    """Matrices of shape (n, 3, 6) whose factors are an inertia, for its product with vectors."""
    matrices = np.zeros((len(vectors), 3, len(_PAIRS)))
    for column, (i, j) in enumerate(_PAIRS):
        matrices[:, i, column] = vectors[:, j]
        if i != j:
            matrices[:, j, column] = vectors[:, i]
    return matrices
