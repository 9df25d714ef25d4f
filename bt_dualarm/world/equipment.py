"""What every arm of a world is controlled through: its hardware, and what is believed of it."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import mujoco

from bt_dualarm.spec.document import ArmSpec, ObjectSpec
from bt_dualarm.world.arm_body import ArmBody
from bt_dualarm.world.attachments import Attachment
from bt_dualarm.world.composition import nominal_model
from bt_dualarm.world.hardware.arm_hardware import ArmHardware
from bt_dualarm.world.nominal.nominal_arm import NominalArm
from bt_dualarm.world.nominal.nominal_load import NominalLoad
from bt_dualarm.world.robots.robot import Robot


class Equipment:
    """Hardware and nominal model of each arm that is present.

    Attributes:
        hardware: Sensors and drives by arm.
        nominal: What is believed of each arm.
    """

    def __init__(self) -> None:
        self.hardware: dict[str, ArmHardware] = {}
        self.nominal: dict[str, NominalArm] = {}

    def add(self, name: str, arm: ArmSpec, robot: Robot, option: mujoco.MjOption) -> None:
        """Equip an arm that comes."""
        model = nominal_model(name, arm, robot, option)
        self.nominal[name] = NominalArm(name, robot, arm.base.pose, model)
        self.hardware[name] = ArmHardware(robot.dof)

    def remove(self, name: str) -> None:
        """Forget an arm that goes."""
        del self.hardware[name], self.nominal[name]

    def connect(
        self,
        arms: Mapping[str, ArmBody],
        held: Iterable[Attachment],
        objects: Mapping[str, ObjectSpec],
    ) -> None:
        """Belong to what was recompiled: the plant's arms, and what they hold now."""
        loads: dict[str, list[NominalLoad]] = {name: [] for name in arms}
        for one in held:
            loads[one.arm].append(NominalLoad.of(one.object, objects[one.object], one.relative))
        for name, body in arms.items():
            self.hardware[name].connect(body)
            self.nominal[name].loads = tuple(loads[name])

    def sense(self) -> None:
        """Read the sensors of all arms."""
        for hardware in self.hardware.values():
            hardware.sense()
