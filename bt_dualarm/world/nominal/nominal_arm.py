"""One arm as its page describes it, in a model of its own."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TypeAlias

import mujoco
import numpy as np
import numpy.typing as npt

from bt_dualarm.pose import Matrix, Pose, Vector
from bt_dualarm.world.nominal.camera_pose import camera_pose
from bt_dualarm.world.nominal.nominal_load import NominalLoad
from bt_dualarm.world.robots.friction import JointFriction
from bt_dualarm.world.robots.mjspec import TOOL_SITE
from bt_dualarm.world.robots.robot import Robot

Turns: TypeAlias = npt.NDArray[np.float64]
"""Rotations, of shape (n, 3, 3)."""


class NominalArm:
    """The arm that its controller believes in: masses of the URDF, rigid joints.

    Args:
        name: Name of the arm in the tree file.
        robot: Robot that it is.
        base: Pose of its base link in the world.
        model: Model of this arm alone, on its base: joints in the robot's order, nothing else.
        friction: Friction of its joints, as far as that is known.
        weighs: Whether nobody says what it holds, so that it has to find out.

    Attributes:
        model: The model.
        loads: What the arm holds; another tuple after every change.
        friction: Friction of its joints as the page has it, and how well that is known.
        tool_site: Id of the tool frame's site in the model.
        tool_body: Id of the link that carries the tool.
    """

    def __init__(
        self,
        name: str,
        robot: Robot,
        base: Pose,
        model: mujoco.MjModel,
        friction: JointFriction,
        *,
        weighs: bool = False,
    ) -> None:
        self.name = name
        self.robot = robot
        self.base = base
        self.model = model
        self.friction = friction
        self.weighs = weighs
        self.loads: tuple[NominalLoad, ...] = ()
        self.tool_site = int(model.site(f"{name}/{TOOL_SITE}").id)
        self.tool_body = int(model.body(f"{name}/{robot.tool_link}").id)
        self._data = mujoco.MjData(model)
        # Views: looking a field up costs more than reading it.
        self._q, self._tool_place = self._data.qpos, self._data.site_xpos[self.tool_site]

    def hold(self, loads: Iterable[NominalLoad]) -> None:
        """Believe that the arm holds these; what it has weighed and still holds, it knows."""
        weighed = {load.object: load for load in self.loads if not load.is_told}
        self.loads = tuple(weighed.get(load.object, load) for load in loads)

    def weigh(self, load: NominalLoad) -> None:
        """Believe this of a load that the arm holds and was told no mass of."""
        self.loads = tuple(load if one.object == load.object else one for one in self.loads)

    def tool_pose_at(self, q: Vector) -> Pose:
        """The tool frame in the world at positions of shape (dof,), rad."""
        return _pose_of_site(self._placed(q), self.tool_site)

    def tool_position_at(self, q: Vector) -> Vector:
        """Its origin alone, of shape (3,), m: asked for at every set-point of a path."""
        self._placed(q)
        position: Vector = self._tool_place.copy()
        return position

    def tool_link_pose_at(self, q: Vector) -> Pose:
        """The link that carries the tool, likewise."""
        data = self._placed(q)
        return Pose(data.xpos[self.tool_body].copy(), data.xquat[self.tool_body].copy())

    def tool_link_frames_at(self, rows: Matrix) -> tuple[Matrix, Turns]:
        """At many positions, of shape (n, dof): places, (n, 3), m, and turns, (n, 3, 3)."""
        places, turns = np.empty((len(rows), 3)), np.empty((len(rows), 9))
        for i, q in enumerate(rows):
            data = self._placed(q)
            places[i], turns[i] = data.xpos[self.tool_body], data.xmat[self.tool_body]
        return places, turns.reshape(-1, 3, 3)

    def camera_pose_at(self, q: Vector) -> Pose:
        """The arm's camera (x right, y down, z forward) by its calibration, likewise."""
        data = self._placed(q)
        mujoco.mj_camlight(self.model, data)
        return camera_pose(data, 0)

    def correct_camera(self, correction: Pose) -> None:
        """Believe the camera to be elsewhere on its link.

        Args:
            correction: Pose in the frame where it was believed to be (x right, y down, z forward).
        """
        model, flip = self.model, Pose.from_rpy((0.0, 0.0, 0.0), (np.pi, 0.0, 0.0))
        believed = Pose(model.cam_pos[0].copy(), model.cam_quat[0].copy()) @ flip
        mount = believed @ correction @ flip.inverse
        model.cam_pos[0], model.cam_quat[0] = mount.position, mount.quaternion

    def tool_jacobian_at(self, q: Vector) -> Matrix:
        """Of the tool in the world: velocity, then angular velocity, by those of the joints.

        Args:
            q: Positions of the joints, of shape (dof,), rad.

        Returns:
            Jacobian of shape (6, dof).
        """
        data, jacobian = self._placed(q), np.zeros((6, self.model.nv))
        mujoco.mj_comPos(self.model, data)
        mujoco.mj_jacSite(self.model, data, jacobian[:3], jacobian[3:], self.tool_site)
        return jacobian

    def _placed(self, q: Vector) -> mujoco.MjData:
        self._q[:] = q
        mujoco.mj_kinematics(self.model, self._data)
        return self._data


def _pose_of_site(data: mujoco.MjData, site: int) -> Pose:
    quaternion = np.empty(4)
    mujoco.mju_mat2Quat(quaternion, data.site_xmat[site])
    return Pose(data.site_xpos[site].copy(), quaternion)
