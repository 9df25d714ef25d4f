"""One arm's kinematic chain in PlaCo: joint angles to tool pose and Jacobian, in the world."""

from __future__ import annotations

import warnings

import numpy as np

from bt_dualarm.pose import Matrix, Pose, Vector
from bt_dualarm.world.catalogue import Robot

with warnings.catch_warnings():
    # Pinocchio 3.8, which PlaCo brings, imports a module that has been renamed.
    warnings.simplefilter("ignore", DeprecationWarning)
    import pinocchio
    import placo

TOOL = "bt_dualarm_tool"
"""Name of the frame that is added to the chain at the tool."""


class Chain:
    """The arm ``robot`` with its base link at ``base`` in the world.

    Its state is the last configuration that was asked for: no result depends on it.
    """

    def __init__(self, robot: Robot, base: Pose) -> None:
        self.robot = robot
        self.base = base
        self.lower, self.upper = robot.limits.lower, robot.limits.upper
        self.placo = placo.RobotWrapper("", placo.Flags.ignore_collisions, _with_tool(robot))
        for name, lower, upper in zip(robot.joints, self.lower, self.upper, strict=True):
            self.placo.set_joint_limits(name, lower, upper)
        self.placo.set_T_world_frame(robot.base_link, base.matrix)
        self._q_ids = np.array([self.placo.get_joint_offset(name) for name in robot.joints])
        self._v_ids = np.array([self.placo.get_joint_v_offset(name) for name in robot.joints])

    @property
    def dof(self) -> int:
        """Number of joints of the arm."""
        return len(self._q_ids)

    @property
    def state(self) -> Vector:
        """The configuration that PlaCo holds, a copy, of shape (dof,)."""
        q: Vector = self.placo.state.q[self._q_ids]
        return q

    def set_state(self, q: Vector) -> None:
        """Give PlaCo a configuration, of shape (dof,)."""
        self.placo.state.q[self._q_ids] = q
        self.placo.update_kinematics()

    def matrix(self, q: Vector) -> Matrix:
        """The tool in the world as a homogeneous transform, of shape (4, 4)."""
        self.set_state(q)
        matrix: Matrix = self.placo.get_T_world_frame(TOOL)
        return matrix

    def forward(self, q: Vector) -> Pose:
        """The tool in the world at ``q``, of shape (dof,)."""
        return Pose.from_matrix(self.matrix(q))

    def jacobian(self, q: Vector) -> Matrix:
        """Joint rates to the tool's linear, then angular velocity, world axes: (6, dof)."""
        self.set_state(q)
        jacobian: Matrix = self.placo.frame_jacobian(TOOL, "local_world_aligned")[:, self._v_ids]
        return jacobian

    def condition(self, q: Vector) -> float:
        """Ratio of the Jacobian's largest to smallest singular value; infinite when singular.

        Metres and radians are taken as they are.
        """
        values = np.linalg.svd(self.jacobian(q), compute_uv=False)
        return float(values[0] / values[-1]) if values[-1] > 0.0 else float("inf")

    def manipulability(self, q: Vector) -> float:
        """Product of the Jacobian's singular values (Yoshikawa 1985): zero when singular."""
        return float(np.prod(np.linalg.svd(self.jacobian(q), compute_uv=False)))


def _with_tool(robot: Robot) -> str:
    """The URDF with the tool frame as a link of its own."""
    xyz = " ".join(repr(float(x)) for x in robot.tool.position)
    rpy = " ".join(repr(float(x)) for x in pinocchio.rpy.matrixToRpy(robot.tool.rotation_matrix))
    tool = (
        f'<link name="{TOOL}"/><joint name="{TOOL}_joint" type="fixed">'
        f'<origin xyz="{xyz}" rpy="{rpy}"/><parent link="{robot.tool_link}"/>'
        f'<child link="{TOOL}"/></joint></robot>'
    )
    return robot.urdf_text.replace("</robot>", tool)
