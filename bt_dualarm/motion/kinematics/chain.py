"""One arm's kinematic chain: joint angles to tool pose and Jacobian, in the world."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from functools import cached_property

import numpy as np

from bt_dualarm.motion.kinematics.placo_model import Mechanism, origin
from bt_dualarm.pose import Matrix, Pose, Vector
from bt_dualarm.world.robots.robot import Robot

TOOL = "tool/frame"
"""Name of the frame that is added to the chain at the tool; no link's name has a slash."""


class Chain(Mechanism):
    """One arm.

    Args:
        robot: Robot that the arm is.
        base: Pose of its base link in the world.
        room: Radians that its joints stay away from their limits.
    """

    def __init__(self, robot: Robot, base: Pose, room: float = 0.0) -> None:
        self.robot = robot
        self.base = base
        limits = robot.limits
        super().__init__(with_tool(robot), robot.joints, limits.lower + room, limits.upper - room)
        self.placo.set_T_world_frame(robot.base_link, base.matrix)

    def matrix(self, q: Vector) -> Matrix:
        """The tool in the world as a homogeneous transform, of shape (4, 4)."""
        self.set_state(q)
        return self.frame(TOOL)

    def forward(self, q: Vector) -> Pose:
        """The tool in the world at ``q``, of shape (dof,)."""
        return Pose.from_matrix(self.matrix(q))

    def jacobian(self, q: Vector) -> Matrix:
        """Joint rates to the tool's linear, then angular velocity, world axes: (6, dof)."""
        self.set_state(q)
        jacobian: Matrix = self.placo.frame_jacobian(TOOL, "local_world_aligned")[:, self.v_ids]
        return jacobian

    def tool(self, q: Vector) -> tuple[Matrix, Matrix]:
        """As ``matrix`` and ``jacobian``, at the cost of one of them."""
        jacobian = self.jacobian(q)
        return self.frame(TOOL), jacobian

    def condition(self, q: Vector) -> float:
        """Ratio of the Jacobian's largest to smallest singular value; infinite when singular.

        Metres and radians are taken as they are.
        """
        values = np.linalg.svd(self.jacobian(q), compute_uv=False)
        return float(values[0] / values[-1]) if values[-1] > 0.0 else float("inf")

    def room(self, q: Vector) -> float:
        """Distance in rad from ``q``, of shape (dof,) or (n, dof), to the nearest joint limit."""
        limits = self.robot.limits
        return float(np.minimum(q - limits.lower, limits.upper - q).min())

    @cached_property
    def bounding_ball(self) -> tuple[Vector, float]:
        """The ball that the tool cannot leave: centre in the world, of shape (3,), and radius in m.

        Around the first joint, as far as the distances from joint to joint to tool add up to: less
        is within reach, nothing is beyond.
        """
        children = {
            str(joint.get("name")): str(child.get("link"))
            for joint in ET.fromstring(self.robot.urdf_text).iter("joint")  # noqa: S314 # our own
            for child in joint.iter("child")
        }
        self.set_state(self.robot.postures["home"])
        places = [self.frame(children[name])[:3, 3] for name in self.joints]
        steps = np.diff([*places, self.frame(TOOL)[:3, 3]], axis=0)
        return places[0].copy(), float(np.linalg.norm(steps, axis=1).sum())


def with_tool(robot: Robot) -> str:
    """The URDF with the tool frame as a link of its own."""
    tool = (
        f'<link name="{TOOL}"/><joint name="{TOOL}_joint" type="fixed">'
        f'{origin(robot.tool)}<parent link="{robot.tool_link}"/>'
        f'<child link="{TOOL}"/></joint></robot>'
    )
    return robot.urdf_text.replace("</robot>", tool)
