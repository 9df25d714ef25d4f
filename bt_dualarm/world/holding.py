"""Who holds what in a world: by a weld, or by a gripper's fingers."""

from __future__ import annotations

import math
from dataclasses import replace

from bt_dualarm.errors import WorldError
from bt_dualarm.pose import Pose
from bt_dualarm.world.attachments import Attachment, Attachments
from bt_dualarm.world.hardware.arm_hardware import ArmHardware
from bt_dualarm.world.names import must_be_among
from bt_dualarm.world.nominal.nominal_arm import NominalArm
from bt_dualarm.world.robots.robot import Robot
from bt_dualarm.world.view import WorldView


class HoldingView(WorldView):
    """The side of a world by which arms take hold of things.

    Attributes:
        robots: Robot of each declared arm, its gripper mounted.
        hardware: Sensors and drives of the arms that are present, by name.
        nominal: What is believed of them, likewise.
        attachments: What they hold.
    """

    robots: dict[str, Robot]
    hardware: dict[str, ArmHardware]
    nominal: dict[str, NominalArm]
    attachments: Attachments

    def attach(self, arm: str, thing: str, seen: Pose | None = None) -> Attachment:
        """Weld an object to an arm's tool link as it is now; believed to be where it was ``seen``.

        Raises:
            WorldError: Arm or object is not present, or the object is fixed.
        """
        relative = self._believed(arm, thing, seen)
        pose, link = self.object_pose(thing), f"{arm}/{self.robots[arm].tool_link}"
        held = Attachment(arm, thing, relative, self.time, bool(seen))
        return self.attachments.attach(held, link, self.arms[arm].tool_link_pose.inverse @ pose)

    def hold(
        self,
        arm: str,
        thing: str,
        pose: Pose,
        most_force: float = math.inf,
        *,
        told: bool = True,
    ) -> None:
        """Believe that an arm's gripper holds an object that is at ``pose`` in the world now.

        Args:
            arm: Name of the arm.
            thing: Name of the object.
            pose: Pose of the object in the world, as it is believed.
            most_force: Force in N that it may be held with at most.
            told: Whether its mass counts that the file tells.

        Raises:
            WorldError: Arm or object is not present, or the object is fixed.
        """
        relative = self._believed(arm, thing, pose)
        held = Attachment(arm, thing, relative, self.time, was_seen=True, by_gripper=True)
        self.attachments.hold(replace(held, most_force=most_force, is_told=told, lay=pose))

    def _believed(self, arm: str, thing: str, pose: Pose | None) -> Pose:
        """An object at ``pose``, by default its true one, in the tool link by the encoders."""
        must_be_among(arm, self.arms, "arm", "in the world")
        must_be_among(thing, self.objects, "object", "in the world")
        if self.objects[thing].fixed:
            raise WorldError(f"object {thing!r} is fixed: no arm can carry it")
        link = self.nominal[arm].tool_link_pose_at(self.hardware[arm].q)
        return link.inverse @ (pose or self.object_pose(thing))
