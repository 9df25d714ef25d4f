"""Where an arm lies in the arrays of a compiled model."""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np
import numpy.typing as npt

from bt_dualarm.pose import Pose, Vector
from bt_dualarm.world.composition import CAMERA
from bt_dualarm.world.robots.mjspec import TOOL_SITE
from bt_dualarm.world.robots.robot import Robot


@dataclass(frozen=True, eq=False)
class ArmBody:
    """An arm that is present. Bound to one model and data: look it up again after a recompilation.

    Attributes:
        base: Pose of the robot's base link in the world.
        qpos_ids: Addresses of the joints' positions, base to tip, of shape (dof,); likewise
            ``dof_ids`` for velocities and ``actuator_ids`` for torques.
        geom_ids: Ids of all shapes that can touch something.
        tool_geom_ids: Those of them that belong to the links beyond the last joint.
        camera_id: Id of the arm's camera, -1 if it has none.
    """

    name: str
    robot: Robot
    base: Pose
    model: mujoco.MjModel
    data: mujoco.MjData
    qpos_ids: npt.NDArray[np.int64]
    dof_ids: npt.NDArray[np.int64]
    actuator_ids: npt.NDArray[np.int64]
    tool_site: int
    tool_body: int
    geom_ids: frozenset[int]
    tool_geom_ids: frozenset[int]
    camera_id: int

    @classmethod
    def find(
        cls, name: str, robot: Robot, base: Pose, model: mujoco.MjModel, data: mujoco.MjData
    ) -> ArmBody:
        """Look the arm ``name`` up in a compiled model."""
        joints = [model.joint(f"{name}/{joint}") for joint in robot.joints]
        last = int(joints[-1].bodyid[0])
        geoms = {
            g: int(model.geom_bodyid[g])
            for g in range(model.ngeom)
            if model.body(model.geom_bodyid[g]).name.startswith(f"{name}/")
            and not model.geom(g).name.endswith("/pedestal")
            and model.geom_contype[g]
        }
        return cls(
            name=name,
            robot=robot,
            base=base,
            model=model,
            data=data,
            qpos_ids=np.array([int(j.qposadr[0]) for j in joints]),
            dof_ids=np.array([int(j.dofadr[0]) for j in joints]),
            actuator_ids=np.array([model.actuator(f"{name}/{j}").id for j in robot.joints]),
            tool_site=model.site(f"{name}/{TOOL_SITE}").id,
            tool_body=model.body(f"{name}/{robot.tool_link}").id,
            geom_ids=frozenset(geoms),
            tool_geom_ids=frozenset(g for g, body in geoms.items() if _hangs_on(model, body, last)),
            camera_id=mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_CAMERA, f"{name}/{CAMERA}"),
        )

    @property
    def q(self) -> Vector:
        """Measured joint positions in rad, of shape (dof,)."""
        positions: Vector = self.data.qpos[self.qpos_ids]
        return positions

    @property
    def v(self) -> Vector:
        """Measured joint velocities in rad/s, of shape (dof,)."""
        velocities: Vector = self.data.qvel[self.dof_ids]
        return velocities

    @property
    def tool_pose(self) -> Pose:
        """The tool frame in the world, as of the last forward kinematics."""
        quaternion = np.empty(4)
        mujoco.mju_mat2Quat(quaternion, self.data.site_xmat[self.tool_site])
        return Pose(self.data.site_xpos[self.tool_site].copy(), quaternion)

    @property
    def tool_link_pose(self) -> Pose:
        """The link that carries the tool, in the world."""
        return Pose(self.data.xpos[self.tool_body].copy(), self.data.xquat[self.tool_body].copy())


def _hangs_on(model: mujoco.MjModel, body: int, link: int) -> bool:
    """Whether a body is a link, or hangs on it, as the fingers on the hand do."""
    while body not in (0, link):
        body = int(model.body_parentid[body])
    return body == link
