"""What an arm is and where: the part of it that skills only look at."""

from __future__ import annotations

import copy
from typing import Self

from bt_dualarm.errors import Failure
from bt_dualarm.motion.controller import JointController
from bt_dualarm.motion.ik import Kinematics
from bt_dualarm.motion.limiter import SetPoint
from bt_dualarm.pose import Pose, Vector
from bt_dualarm.world.camera import Camera
from bt_dualarm.world.catalogue import JointLimits, Robot
from bt_dualarm.world.guarded_camera import GuardedCamera
from bt_dualarm.world.world import World


class ArmState:
    """All poses are of the tool frame, in the world.

    Args:
        world: The world that the arm is in.
        name: Of the arm in the tree file.
        controller: Follows what the skills ask for.
        camera: Of this arm, if it has one.
        seed: Of everything random in this arm's planning.

    Attributes:
        world: For placing and measuring things. What a camera is meant to see is not taken from it.
    """

    def __init__(
        self, world: World, name: str, controller: JointController, camera: Camera | None, seed: int
    ) -> None:
        self.world = world
        self.name = name
        self._camera = camera
        self.camera = None if camera is None else GuardedCamera(camera)
        self.controller = controller
        self.kinematics = Kinematics(world.robots[name], world.arms[name].base, seed)
        self._seed = seed
        self._leaf: object = None

    def for_leaf(self, leaf: object) -> Self:
        """The same arm in the hands of one leaf."""
        arm = copy.copy(self)
        arm._leaf = leaf
        arm.camera = None if self._camera is None else GuardedCamera(self._camera)
        return arm

    @property
    def robot(self) -> Robot:
        """What the catalogue says of it."""
        return self.world.robots[self.name]

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
        """The last set-point sent: where motions begin."""
        return self.controller.setpoint

    @property
    def q(self) -> Vector:
        """Where the joints really are, of shape (dof,), rad."""
        return self.world.arms[self.name].q

    @property
    def tool_pose(self) -> Pose:
        """Where the tool really is."""
        return self.world.arms[self.name].tool_pose

    @property
    def commanded_tool_pose(self) -> Pose:
        """Where the last set-point puts the tool: free of the servo error, so plans start here."""
        return self.kinematics.forward(self.setpoint.q)

    @property
    def held(self) -> tuple[str, ...]:
        """Objects attached to the tool."""
        return self.world.attachments.attached_to(self.name)

    def limits(self, speed: float) -> JointLimits:
        """The arm's limits with velocity, acceleration and jerk times ``speed``."""
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
