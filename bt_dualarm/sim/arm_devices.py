"""Devices of the arms in a world: sensors, drives and grippers, and the nominal models."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace

import mujoco
import numpy as np
import numpy.typing as npt

from bt_dualarm.core.pose import Vector
from bt_dualarm.robots.gripper import FINGERS, Gripper
from bt_dualarm.robots.robot import JointFriction, Robot
from bt_dualarm.sim.arm_models import (
    LinkFactors,
    NominalArm,
    NominalLoad,
    SampledArm,
    random_stream,
    sample_arm,
    sample_object,
)
from bt_dualarm.sim.composition import ArmBody, Present, nominal_model
from bt_dualarm.sim.devices import ArmHardware, DeviceBank, kernels
from bt_dualarm.sim.grippers import Attachment, FingerBank, GripperHardware, HeldObjectMotion
from bt_dualarm.sim.passengers import Passengers
from bt_dualarm.spec.document import REALITY_SETS, ObjectSpec, RealityErrors, TreeFile, resolved

_MAX_SPEED = 1e4  # rad/s or m/s: no valid state comes near it


class ArmDevices:
    """Hardware and nominal model of each arm that is present: all that its controller may use.

    Args:
        file: Declares the arms, and the error bounds of their hardware and models.
        robots: Robot of each declared arm.
        mounted: Grippers by arm, of those that have one.
        seed: Seed of all sampled errors.

    Attributes:
        hardware: Sensors and drives by arm.
        mounted: Grippers by arm, of those declared that have one.
        grippers: Drives and sensors of the grippers by arm.
        nominal: Nominal model of each arm.
        errors: Error bounds of each declared arm.
        sampled: Sampled deviations of each declared arm.
        touches_foreign: Whether an arm was in contact in the last step with something that it
            neither owns nor holds, by `notice_foreign`.
    """

    def __init__(
        self,
        file: TreeFile,
        robots: Mapping[str, Robot],
        mounted: Mapping[str, Gripper],
        seed: int,
    ) -> None:
        self._file = file
        self._robots = robots
        self._seed = seed
        self.hardware: Present[ArmHardware] = Present.arms()
        self.nominal: Present[NominalArm] = Present.arms()
        self.mounted = mounted
        self.grippers: dict[str, GripperHardware] = {}
        self._sensed_joints: list[tuple[ArmHardware, Vector]] = []
        self.errors: dict[str, RealityErrors] = {
            name: resolved(file.world.reality, arm.reality, REALITY_SETS)
            for name, arm in file.arms.items()
        }
        self.sampled: dict[str, SampledArm] = {
            name: sample_arm(errors, robots[name], seed, name, _fingers(mounted.get(name)))
            for name, errors in self.errors.items()
        }
        efforts = {name: robot.limits.effort for name, robot in robots.items()}
        self._bank = DeviceBank(self.errors, self.sampled, efforts, file.world.timestep)
        self._rows = {name: row for row, name in enumerate(mounted)}
        self._fingers = FingerBank(len(mounted), file.world.timestep)
        self._cups: list[GripperHardware] = []
        self._has_stepped = False
        self.touches_foreign = False

    def add(self, name: str, option: mujoco.MjOption) -> None:
        """Create the devices of an arm that is added to a world with these options."""
        arm = self._file.arms[name]
        robot = self._robots[name]
        errors = self.errors[name]
        friction = JointFriction.none(robot.dof)
        if errors.friction.present:
            friction = replace(robot.friction, uncertainty=errors.friction.coulomb.most)
        model = nominal_model(name, arm, robot, option, rotors=errors.links.rotor)
        self.nominal[name] = NominalArm(
            name, robot, arm.base.pose, model, friction, estimates_payload=not errors.payload.known
        )
        self.hardware[name] = self._bank.begin(name, self._seed)
        if name in self.mounted:
            rng = random_stream(self._seed, f"{name}:gripper")
            self.grippers[name] = GripperHardware(
                self.mounted[name], errors, rng, option.timestep, self._fingers, self._rows[name]
            )

    def open_gripper(self, name: str) -> None:
        """Open the gripper of an arm that was just added."""
        if name in self.grippers:
            self.grippers[name].set_open()

    def sampled_object(self, name: str) -> LinkFactors:
        """Sample the mass of an object within the bounds of the world's `reality`."""
        errors = resolved(self._file.world.reality, None, REALITY_SETS)
        return sample_object(errors.payload, self._seed, name)

    def remove(self, name: str) -> None:
        """Remove the devices of an arm that leaves the world."""
        del self.hardware[name], self.nominal[name]
        self._bank.end(name)
        gripper = self.grippers.pop(name, None)
        if gripper is not None:
            gripper.disconnect()

    def connect(
        self,
        plant: tuple[mujoco.MjModel, mujoco.MjData],
        arms: Mapping[str, ArmBody],
        held: Iterable[Attachment],
        objects: Mapping[str, ObjectSpec],
        passengers: Passengers,
    ) -> None:
        """Connect to the arms of a recompiled plant, and update the loads that they hold."""
        self._model, self._plant = plant
        self._timestep = float(self._model.opt.timestep)
        self._sensed = mujoco.MjData(self._model)
        self._is_sensed = False
        self._sensed_joints = []
        self._sensed_qpos = self._sensed.qpos  # a view: attribute lookups on mjData are slow
        self.reload(arms, held, objects, passengers)
        for name, body in arms.items():
            self.hardware[name].connect(body)
            first = body.qpos_ids[0]
            last = body.qpos_ids[-1]
            self._sensed_joints.append((self.hardware[name], self._sensed_qpos[first : last + 1]))
            if name in self.grippers:
                self.grippers[name].connect(self._model, body.data, name)
        mounted = {name: self.mounted[name] for name in arms if name in self.grippers}
        self._cups = [self.grippers[name] for name in mounted if not mounted[name].fingers]
        self._held_motion = HeldObjectMotion(*plant, mounted)
        self._bank.connect(*plant, arms)
        data = self._plant
        # Views, and a list of contacts that follows the plant: to look them up takes longer than
        # to use them.
        self._state = data.qpos, data.qvel
        self._motors = data.ctrl
        self._contacts = data.contact
        fingers = self._fingers
        self._driven = fingers.numbers, fingers.drives, *self._state
        self._held = self._held_motion.arguments()
        geoms = self._model.ngeom
        self.notice_foreign(np.full(geoms, -1), np.full(geoms, -2))
        self._sensors = (
            *self._driven[:2], fingers.readings, fingers.noise, fingers.widths, data.sensordata,
            data.xmat, *fingers.sensors(),
        )  # fmt: skip

    def reload(
        self,
        arms: Iterable[str],
        held: Iterable[Attachment],
        objects: Mapping[str, ObjectSpec],
        passengers: Passengers,
    ) -> None:
        """Update the loads of some arms' nominal models."""
        loads: dict[str, list[NominalLoad]] = {name: [] for name in arms}
        holders = Counter(one.object for one in held)
        for one in held:
            if one.arm not in loads:
                continue
            known = one.mass_declared and self.errors[one.arm].payload.known
            obj = objects[one.object]
            if obj.joint is not None or one.is_released:  # its joint supports it; it gets free
                continue
            upon = [(objects[each.object], each.relative) for each in passengers.of(one.object)]
            if one.borne_at is None:
                load = NominalLoad.of(one.object, obj, one.relative, known=known, upon=upon)
            else:
                at = one.relative @ one.borne_at
                load = NominalLoad.borne_with_others(one.object, obj, at, known=known, upon=upon)
            if holders[one.object] > 1 or one.share < 1.0:
                load = replace(load, share=one.share, alone=False)
            loads[one.arm].append(load)
        for name in arms:
            self.nominal[name].hold(loads[name])

    def sense(self, time: float) -> None:
        """Read the sensors of all arms at the current simulated time in s."""
        self._is_sensed = False
        encoders = self._bank.encoders
        arguments = encoders.begin_reading(time)
        if self._has_stepped or len(arguments[0]):
            is_used_up = kernels().read_sensors(time, *arguments, *self._sensors)
        else:  # no kernel is loaded yet
            is_used_up = True
            for gripper in self.grippers.values():
                gripper.read_first(time)
        if is_used_up:
            for gripper in self.grippers.values():
                gripper.refill()
        encoders.end_reading(time)
        for cup in self._cups:
            cup.sense_vacuum(time)

    @property
    def sensed(self) -> mujoco.MjData:
        """Estimated state of the world by the last readings, for planning; computed on demand.

        Arms and fingers are at the positions of their encoders, objects at their true poses. Access
        the property again before reading from views of it: that updates them.
        """
        if not self._is_sensed:
            self._is_sensed = True
            self._sensed_qpos[:] = self._plant.qpos
            for hardware, q in self._sensed_joints:
                q[:] = hardware.q
            for gripper in self.grippers.values():
                gripper.set_finger_positions(self._sensed_qpos)
            mujoco.mj_kinematics(self._model, self._sensed)
        return self._sensed

    def drive(self) -> bool:
        """Apply the torques and forces of all drives for the next step.

        Returns:
            Whether all of them are finite.
        """
        self._has_stepped = True
        for cup in self._cups:
            cup.drive_pump()
        is_finite: bool = kernels().drive_plant(
            *self._bank.drives.begin_step(), *self._driven, self._timestep, self._motors
        )
        return is_finite

    def pass_between(self) -> bool:
        """Set friction for the velocities of a step, and correct the motion of held objects.

        To be called after the integration of the step.

        Returns:
            Whether the state is finite and possible; if not, nothing is done.
        """
        contacts = self._contacts
        outcome = kernels().pass_between(
            _MAX_SPEED, *self._state, *self._bank.friction.arguments(), contacts.geom,
            contacts.dist, *self._held, *self._arms_of_geoms,
        )  # fmt: skip
        if outcome < 0:
            return False
        self.touches_foreign = outcome % 2 == 1
        if outcome > 1:
            self._held_motion.correct()
        return True

    def notice_foreign(self, owner: npt.NDArray[np.int64], holder: npt.NDArray[np.int64]) -> None:
        """Watch for contacts of arms with what they neither own nor hold, in `touches_foreign`.

        To be called again after each recompilation; until then there are none.

        Args:
            owner: Number of the arm that owns each geom; -1 for none.
            holder: Number of the arm that holds it; less than -1 for none.
        """
        self._arms_of_geoms = owner, holder

    def alter_encoder(
        self, name: str, joint: int, reading: Callable[[float], float] | None
    ) -> None:
        """Alter the readings of an encoder from now on; see `Encoders.alter`."""
        self._bank.encoders.alter(name, joint, reading)

    def update_friction(self) -> None:
        """Set the joint friction of all arms for the current velocities."""
        friction = self._bank.friction.arguments()
        if len(friction[0]):
            # Without any pads the kernel of a step finds nothing held: only friction is set.
            contacts = self._contacts
            pads, *held = self._held
            kernels().pass_between(
                _MAX_SPEED, *self._state, *friction, contacts.geom, contacts.dist, pads[:0], *held,
                *self._arms_of_geoms,
            )  # fmt: skip


def _fingers(gripper: Gripper | None) -> tuple[str, ...]:
    """Bodies that a gripper adds to its arm besides the palm."""
    return FINGERS if gripper is not None and gripper.fingers else ()
