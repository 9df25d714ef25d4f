"""What an arm is and where: the part of it that skills only look at."""

from __future__ import annotations

from bt_dualarm.errors import Failure
from bt_dualarm.motion.control.controller import JointController
from bt_dualarm.motion.control.force_limit import wrench_of
from bt_dualarm.motion.kinematics.arm_kinematics import Kinematics
from bt_dualarm.motion.setpoints.set_point import SetPoint
from bt_dualarm.pose import Pose, Vector
from bt_dualarm.world.nominal.nominal_load import NominalLoad
from bt_dualarm.world.robots.robot import JointLimits, Robot
from bt_dualarm.world.world import World


class ArmState:
    """All poses are of the tool frame, in the world.

    Args:
        world: World that the arm is in, for placing and measuring things; what a camera is meant to
            see is not taken from it.
        name: Name of the arm in the tree file.
        controller: Controller that follows what the skills ask for.
        kinematics: Kinematics of the arm on its base.
    """

    def __init__(
        self, world: World, name: str, controller: JointController, kinematics: Kinematics
    ) -> None:
        self.world = world
        self.name = name
        self.controller = controller
        self.kinematics = kinematics

    @property
    def robot(self) -> Robot:
        """Page of the robot in the catalogue."""
        return self.world.robots[self.name]

    @property
    def is_present(self) -> bool:
        """Whether the arm is in the world; its own leaf may have taken it away."""
        return self.name in self.world.arms

    @property
    def period(self) -> float:
        """Seconds between two set-points."""
        return self.controller.period

    @property
    def time(self) -> float:
        """Simulated time in seconds."""
        return self.world.time

    @property
    def setpoint(self) -> SetPoint:
        """Last set-point that was sent: where motions begin."""
        return self.controller.setpoint

    @property
    def q(self) -> Vector:
        """Measured joint angles, of shape (dof,), rad."""
        return self.world.hardware[self.name].q

    @property
    def tool_pose(self) -> Pose:
        """Measured pose of the tool, by the encoders."""
        return self.world.nominal[self.name].tool_pose_at(self.q)

    @property
    def commanded_tool_pose(self) -> Pose:
        """Pose of the tool at the last set-point: free of the servo error, so plans start here."""
        return self.kinematics.forward(self.setpoint.q)

    @property
    def external_torque(self) -> Vector:
        """What pushes the joints, of shape (dof,), N m; friction that nobody knows of, too."""
        return self.controller.touch.torque

    @property
    def external_wrench(self) -> Vector:
        """Force in N, then moment in N m about the tool, in the world, of shape (6,).

        It is what explains `external_torque` best if all of it acts on the tool.
        """
        return wrench_of(self.world.nominal[self.name], self.q, self.external_torque)

    @property
    def held(self) -> tuple[str, ...]:
        """Objects attached to the tool."""
        return self.world.attachments.attached_to(self.name)

    @property
    def payload(self) -> tuple[NominalLoad, ...]:
        """What it holds, with mass and centre as the file says, or as it has weighed them."""
        return self.world.nominal[self.name].loads

    def limits(self, speed: float) -> JointLimits:
        """Limits of the arm with velocity, acceleration and jerk times ``speed``."""
        return self.robot.limits.scaled(speed)

    def posture(self, name: str) -> Vector:
        """Joint angles, of shape (dof,), of a named posture of the robot.

        Raises:
            Failure: ``INVALID_TARGET``; the sentence names the postures that there are.
        """
        postures = self.robot.postures
        if name not in postures:
            known = ", ".join(postures)
            raise Failure("INVALID_TARGET", f"{self.robot.name} has no posture {name!r}: {known}")
        return postures[name]
