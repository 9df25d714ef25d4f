"""What every arm of a world is controlled through: its hardware, and what is believed of it."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace

import mujoco

from bt_dualarm.pose import Vector
from bt_dualarm.spec.document import ObjectSpec, TreeFile
from bt_dualarm.spec.reality import RealityErrors, resolved
from bt_dualarm.spec.reality_sets import REALITY_SETS
from bt_dualarm.world.arm_body import ArmBody
from bt_dualarm.world.attachments import Attachment
from bt_dualarm.world.composition import nominal_model
from bt_dualarm.world.grippers.carrying import Carrying, carry_all
from bt_dualarm.world.grippers.drive import GripperHardware
from bt_dualarm.world.grippers.gripper import FINGERS, Gripper
from bt_dualarm.world.hardware.arm_hardware import ArmHardware
from bt_dualarm.world.hardware.drawn_arm import (
    DrawnArm,
    LinkFactors,
    draw_arm,
    draw_object,
    stream,
)
from bt_dualarm.world.hardware.electronics import Electronics
from bt_dualarm.world.nominal.nominal_arm import NominalArm
from bt_dualarm.world.nominal.nominal_load import NominalLoad
from bt_dualarm.world.robots.friction import JointFriction
from bt_dualarm.world.robots.robot import Robot


class Equipment:
    """Hardware and nominal model of each arm that is present.

    Args:
        file: Declares the arms, and how far they are from what is believed of them.
        robots: Robot of each of them.
        mounted: Grippers by arm, of those that have one.
        seed: Seed that draws how far.

    Attributes:
        hardware: Sensors and drives by arm.
        mounted: Grippers by arm, of those declared that have one.
        grippers: Drives and sensors of the grippers by arm.
        nominal: What is believed of each arm.
        errors: How far each declared arm may be from that.
        drawn: What the seed has made of each declared arm.
    """

    def __init__(
        self,
        file: TreeFile,
        robots: Mapping[str, Robot],
        mounted: Mapping[str, Gripper],
        seed: int,
    ) -> None:
        self._file, self._robots, self._seed = file, robots, seed
        self.hardware: dict[str, ArmHardware] = {}
        self.nominal: dict[str, NominalArm] = {}
        self.mounted = mounted
        self.grippers: dict[str, GripperHardware] = {}
        self._places: list[tuple[ArmHardware, Vector]] = []
        self._carrying: list[Carrying] = []
        self.errors: dict[str, RealityErrors] = {
            name: resolved(file.world.reality, arm.reality, REALITY_SETS)
            for name, arm in file.arms.items()
        }
        self.drawn: dict[str, DrawnArm] = {
            name: draw_arm(errors, robots[name], seed, name, _fingers(mounted.get(name)))
            for name, errors in self.errors.items()
        }
        efforts = {name: robot.limits.effort for name, robot in robots.items()}
        self._electronics = Electronics(self.errors, self.drawn, efforts, file.world.timestep)

    def add(self, name: str, option: mujoco.MjOption) -> None:
        """Equip an arm that comes into a world with these options."""
        arm, robot, errors = self._file.arms[name], self._robots[name], self.errors[name]
        friction = JointFriction.none(robot.dof)
        if errors.friction.present:
            friction = replace(robot.friction, uncertainty=errors.friction.coulomb.most)
        model = nominal_model(name, arm, robot, option, rotors=errors.links.rotor)
        self.nominal[name] = NominalArm(
            name, robot, arm.base.pose, model, friction, weighs=not errors.payload.known
        )
        self.hardware[name] = self._electronics.begin(name, self._seed)
        if name in self.mounted:
            rng = stream(self._seed, f"{name}:gripper")
            self.grippers[name] = GripperHardware(self.mounted[name], errors, rng, option.timestep)

    def open_gripper(self, name: str) -> None:
        """Put the fingers of an arm that has just come to where its drive holds them: open."""
        if name in self.grippers:
            self.grippers[name].stand_open()

    def drawn_object(self, name: str) -> LinkFactors:
        """What the seed has made of an object's mass: the world's reality has the spread."""
        errors = resolved(self._file.world.reality, None, REALITY_SETS)
        return draw_object(errors.payload, self._seed, name)

    def remove(self, name: str) -> None:
        """Forget an arm that goes."""
        del self.hardware[name], self.nominal[name]
        self._electronics.end(name)
        self.grippers.pop(name, None)

    def connect(
        self,
        plant: tuple[mujoco.MjModel, mujoco.MjData],
        arms: Mapping[str, ArmBody],
        held: Iterable[Attachment],
        objects: Mapping[str, ObjectSpec],
    ) -> None:
        """Belong to what was recompiled: the plant's arms, and what they hold now."""
        self._model, self._plant = plant
        self._sensed, self._is_sensed = mujoco.MjData(self._model), False
        self._places = []
        self._carrying = []
        self._everywhere = self._sensed.qpos  # views, as in `ArmHardware`
        loads: dict[str, list[NominalLoad]] = {name: [] for name in arms}
        for one in held:
            known = one.is_told and self.errors[one.arm].payload.known
            load = NominalLoad.of(one.object, objects[one.object], one.relative, known=known)
            loads[one.arm].append(load)
        for name, body in arms.items():
            self.hardware[name].connect(body)
            first, last = body.qpos_ids[0], body.qpos_ids[-1]
            self._places.append((self.hardware[name], self._everywhere[first : last + 1]))
            self.nominal[name].hold(loads[name])
            if name in self.grippers:
                self.grippers[name].connect(self._model, body.data, name)
                self._carrying.append(Carrying(self._model, body.data, name, self.mounted[name]))
        self._electronics.connect(*plant, arms)

    def sense(self, time: float) -> None:
        """Read the sensors of all arms at a simulated time in s, which is now."""
        self._is_sensed = False
        self._electronics.sense(time)
        for gripper in self.grippers.values():
            gripper.sense(time)

    @property
    def sensed(self) -> mujoco.MjData:
        """Where everything is by the last readings, for planning; worked out when asked for.

        Arms are where their encoders say, objects where they are. Who keeps views of it asks for it
        before reading them.
        """
        if not self._is_sensed:
            self._is_sensed = True
            self._everywhere[:] = self._plant.qpos
            for hardware, place in self._places:
                place[:] = hardware.q
            for gripper in self.grippers.values():
                gripper.place(self._everywhere)
            mujoco.mj_kinematics(self._model, self._sensed)
        return self._sensed

    def drive(self) -> None:
        """Let all drives act during the next step."""
        self._electronics.drive()
        for gripper in self.grippers.values():
            gripper.drive()

    def carry(self) -> None:
        """Let what grippers hold go with them, after the integration of a step."""
        carry_all(self._model, self._plant, self._carrying)

    def rub(self) -> None:
        """Set the friction of all arms for the velocities of now."""
        self._electronics.rub()


def _fingers(gripper: Gripper | None) -> tuple[str, ...]:
    """Bodies of an arm that its page does not know of."""
    return FINGERS if gripper is not None and gripper.fingers else ()
