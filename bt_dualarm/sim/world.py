"""The simulated world: one MuJoCo model whose arms and objects come and go while it runs.

The world keeps an `mujoco.MjSpec` and recompiles it whenever something is added or removed; MuJoCo
carries over the state of everything that stays. `generation` counts recompilations: code that keeps
indices or views of ``model`` and ``data`` must look them up again when it changes. `Devices` has
the sensors and drives; `WorldView` measures poses, velocities and contacts.
"""

from __future__ import annotations

import logging
import math
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import replace

import mujoco
import numpy as np
import numpy.typing as npt

from bt_dualarm.core.errors import DivergenceError, OverlapError, WorldError
from bt_dualarm.core.pose import Pose, Vector
from bt_dualarm.grasping.grasp import Solid
from bt_dualarm.robots.gripper import FINGERS, Gripper
from bt_dualarm.robots.robot import JointFriction, Robot
from bt_dualarm.robots.robot_description import load_arm
from bt_dualarm.sim import composition
from bt_dualarm.sim.arm_models import (
    LinkFactors,
    NominalArm,
    NominalLoad,
    SampledArm,
    mass_with,
    random_stream,
    sample_arm,
    sample_object,
)
from bt_dualarm.sim.composition import (
    ArmBody,
    MountingSurface,
    Present,
    add_object,
    check_declarations,
    must_be_among,
    name_of_geom,
    noisy_pose,
    nominal_model,
    surface_below,
)
from bt_dualarm.sim.devices import ArmHardware, DeviceBank, kernels
from bt_dualarm.sim.grippers import (
    Attachment,
    Attachments,
    FingerBank,
    GripperHardware,
    HeldObjectMotion,
)
from bt_dualarm.sim.many import drawn
from bt_dualarm.sim.object_body import body_of, body_of_part
from bt_dualarm.sim.passengers import Passenger, Passengers
from bt_dualarm.sim.shared_body import shared_bodies
from bt_dualarm.spec.document import (
    REALITY_SETS,
    ArmSpec,
    ObjectSpec,
    RealityErrors,
    TreeFile,
    resolved,
)
from bt_dualarm.spec.joints import Articulation

# Devices

_MAX_SPEED = 1e4  # rad/s or m/s: no valid state comes near it


class Devices:
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
            thing = objects[one.object]
            if thing.joint is not None:  # its joint supports it
                continue
            upon = [(objects[each.object], each.relative) for each in passengers.of(one.object)]
            if one.borne_at is None:
                load = NominalLoad.of(one.object, thing, one.relative, known=known, upon=upon)
            else:
                at = one.relative @ one.borne_at
                load = NominalLoad.borne_with_others(one.object, thing, at, known=known, upon=upon)
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


# Measurements

_MAX_DISTANCE_M = 1e3
"""Cutoff in m of distance queries, larger than any world."""


class WorldView:
    """Measurements of a world's true state, for setup, scoring and tests.

    Perception does not read them: it has only camera images.

    Attributes:
        model: Compiled model; a new object after every recompilation.
        data: State of the model; also replaced.
        devices: Hardware and nominal model of the arms.
        arms: Arms that are present, by name.
        objects: Objects that are present, by name.
        declared_objects: Every object of the file, present or not.
    """

    model: mujoco.MjModel
    data: mujoco.MjData
    devices: Devices
    arms: Present[ArmBody]
    objects: Present[ObjectSpec]
    declared_objects: Mapping[str, ObjectSpec]

    @property
    def sensed(self) -> mujoco.MjData:
        """Estimated state of the world by the last sensor readings; see `Devices.sensed`."""
        return self.devices.sensed

    @property
    def time(self) -> float:
        """Simulated time in seconds."""
        return float(self.data.time)

    @property
    def timestep(self) -> float:
        """Seconds of one physics step."""
        return float(self.model.opt.timestep)

    def state(self) -> Vector:
        """The complete state of the simulation (``mjSTATE_INTEGRATION``), of shape (n,)."""
        kind = mujoco.mjtState.mjSTATE_INTEGRATION
        state = np.empty(mujoco.mj_stateSize(self.model, kind))
        mujoco.mj_getState(self.model, self.data, state, kind)
        return state

    def object_body(self, name: str) -> int:
        """Id of an object's body."""
        self.objects.require(name)
        return int(self.model.body(name).id)

    def object_geom(self, name: str) -> int:
        """Id of an object's geom; of the first one if it has several parts."""
        self.objects.require(name)
        return int(self.model.geom(name).id)

    def object_geoms(self, name: str) -> tuple[int, ...]:
        """Ids of the geoms of an object's convex parts, in the order of `ObjectBody.parts`."""
        first = self.object_geom(name)
        return tuple(range(first, first + len(body_of(self.objects[name]).parts)))

    def object_solid(self, name: str) -> Solid:
        """Shape of a present object in its own frame."""
        self.objects.require(name)
        return body_of(self.objects[name]).solid

    def joint_of(self, name: str) -> Articulation | None:
        """Joint on which a present object moves; None for one that is free or fixed."""
        self.objects.require(name)
        return self.objects[name].joint

    def part_owner(self, name: str, part: str | None) -> str:
        """Name of the object that has a part of a declared one: its own, or that of a joint."""
        declared = self.declared_objects.get(name)
        if part is None or declared is None or part in declared.parts:
            return name
        for other, thing in self.declared_objects.items():
            if thing.joint is not None and thing.joint.owner == name and part in thing.parts:
                return other
        return name

    def joint_position(self, name: str) -> float:
        """True position in rad or m of the joint on which an object moves.

        Raises:
            WorldError: The object is not present, or moves on no joint.
        """
        return float(self.data.qpos[self._joint_address(name)])

    def joint_reading(self, name: str) -> float | None:
        """Position in rad or m by the sensor of the joint on which an object moves.

        None without a sensor. The sensor is part of the fixture, and has no errors.

        Raises:
            WorldError: The object is not present, or moves on no joint.
        """
        address = self._joint_address(name)
        hung = self.objects[name].joint
        if hung is None or not hung.spec.sensor:
            return None
        return float(self.data.qpos[address])

    def _joint_address(self, name: str) -> int:
        if self.joint_of(name) is None:
            raise WorldError(f"object {name!r} moves on no joint")
        return int(self.model.jnt_qposadr[self.model.body_jntadr[self.object_body(name)]])

    def pose_address(self, name: str) -> int:
        """Address in ``qpos`` of a free object's pose, of seven numbers."""
        joint = self.model.body_jntadr[self.object_body(name)]
        return int(self.model.jnt_qposadr[joint])

    def object_pose(self, name: str) -> Pose:
        """An object's true pose in the world.

        Raises:
            WorldError: The object is not present.
        """
        body = self.object_body(name)
        return Pose(self.data.xpos[body].copy(), self.data.xquat[body].copy())

    def surface_point(
        self, name: str, direction: Vector, pose: Pose | None = None, part: str | None = None
    ) -> Vector:
        """Point at which a ray from an object's center of mass leaves it, (3,), in the world, m.

        Args:
            name: Name of the object.
            direction: Direction of the ray in the world, of unit length.
            pose: Estimated pose of the object; its true one by default.
            part: Part of a compound that stands for the whole object.
        """
        pose = self.object_pose(name) if pose is None else pose
        thing = self.objects[name]
        if part is not None and part in thing.parts:
            pose = pose @ thing.parts[part].pose.pose
            alone = body_of_part(thing.parts[part])
            away = alone.way_out(direction @ pose.rotation_matrix)
            on_part: Vector = pose.apply(alone.center) + away * direction
            return on_part
        body = body_of(thing)
        if not body.is_simple:
            along = direction @ pose.rotation_matrix
            out: Vector = pose.apply(body.center) + body.way_out(along) * direction
            return out
        ray = np.abs(direction @ pose.rotation_matrix) + 1e-12
        if thing.shape == "box":
            reach = float((0.5 * np.asarray(thing.size) / ray).min())
        elif thing.shape == "cylinder":
            radius, length = thing.size
            reach = min(radius / float(np.hypot(ray[0], ray[1])), 0.5 * length / float(ray[2]))
        elif thing.shape == "capsule":
            reach = _ray_out_of_capsule(thing.size[0], thing.size[1], ray)
        else:
            reach = thing.size[0]
        point: Vector = pose.position + reach * direction
        return point

    def edge_point(
        self, name: str, direction: Vector, pose: Pose | None = None, part: str | None = None
    ) -> Vector | None:
        """Point on the nearest edge of something open in a direction, (3,), in the world, m.

        None if the surface is above its center of mass. Arguments as those of `surface_point`.
        """
        thing = self.objects[name]
        pose = self.object_pose(name) if pose is None else pose
        body = body_of(thing)
        if part is not None and part in thing.parts:
            pose = pose @ thing.parts[part].pose.pose
            body = body_of_part(thing.parts[part])
        if body.is_simple:
            return None
        edge = body.edge(direction @ pose.rotation_matrix)
        return None if edge is None else pose.apply(edge)

    def object_velocity(self, name: str) -> Vector:
        """Angular (rad/s) then linear (m/s) velocity at an object's center, of shape (6,)."""
        velocity = np.empty(6)
        kind = mujoco.mjtObj.mjOBJ_BODY
        mujoco.mj_objectVelocity(self.model, self.data, kind, self.object_body(name), velocity, 0)
        return velocity

    def tool_gap(self, arm: str, thing: str) -> float:
        """Smallest distance in meters between an arm's tool and an object; negative inside it."""
        self.arms.require(arm)
        return min(
            float(mujoco.mj_geomDistance(self.model, self.data, tool, geom, _MAX_DISTANCE_M, None))
            for geom in self.object_geoms(thing)
            for tool in self.arms[arm].tool_geom_ids
        )

    def touches(self, arm: str, thing: str) -> bool:
        """Whether an arm's tool and an object are in contact."""
        geoms = self.object_geoms(thing)
        tool = self.arms[arm].tool_geom_ids
        contact = self.data.contact
        return any(
            (geom1 in geoms and geom2 in tool) or (geom2 in geoms and geom1 in tool)
            for geom1, geom2 in contact.geom[contact.dist <= 0.0]
        )


def _ray_out_of_capsule(radius: float, length: float, ray: Vector) -> float:
    """Distance in m at which a ray, of shape (3,), all positive, leaves a capsule's center."""
    across = float(np.hypot(ray[0], ray[1]))
    along = float(ray[2])
    half = 0.5 * length
    to_wall = radius / across
    if to_wall * along <= half:
        return to_wall
    # Beyond the wall the ray leaves through the cap, a sphere about (0, 0, half).
    return half * along + float(np.sqrt(radius**2 - (half * across) ** 2))


# Attachments


class HoldingView(WorldView):
    """Attachment of objects to arms in a world.

    Attributes:
        robots: Robot of each declared arm, its gripper mounted.
        hardware: Sensors and drives of the arms that are present, by name.
        nominal: Nominal models of these arms, by name.
        attachments: Objects that the arms hold.
    """

    robots: dict[str, Robot]
    hardware: Present[ArmHardware]
    nominal: Present[NominalArm]
    attachments: Attachments
    _passengers: Passengers

    def attach(
        self, arm: str, thing: str, seen: Pose | None = None, *, share: float = 1.0
    ) -> Attachment:
        """Weld an object to an arm's tool link; its nominal pose is the one ``seen``, if given.

        Another arm may hold it as well; the model then supports this ``share`` of the weight.

        Raises:
            WorldError: Arm or object is not present, or the object is fixed.
        """
        relative = self._estimated_in_tool(arm, thing, seen)
        pose = self.object_pose(thing)
        link = f"{arm}/{self.robots[arm].tool_link}"
        held = Attachment(
            arm,
            thing,
            relative,
            self.time,
            bool(seen),
            share=share,
            carrier=self._passengers.carrier_of(thing),
        )
        relative = self.arms[arm].tool_link_pose.inverse @ pose
        return self.attachments.attach(held, link, relative, self._tips_on(arm, thing))

    def _tips_on(self, arm: str, thing: str) -> tuple[str, ...]:
        """Fingers of an arm that are closed and touch an object with their tips.

        Contacts of these fingers with the welded object are ignored: pressed against it, they could
        not slide along it to open.
        """
        gripper = self.devices.grippers.get(arm)
        if gripper is None or not gripper.gripper.fingers:
            return ()
        if gripper.width > gripper.gripper.closed_width or not self.touches(arm, thing):
            return ()
        return tuple(f"{arm}/{finger}" for finger in FINGERS)

    def hold(
        self,
        arm: str,
        thing: str,
        pose: Pose,
        most_force: float = math.inf,
        *,
        mass_declared: bool = True,
        share: float = 1.0,
    ) -> None:
        """Attach an object to an arm's gripper in the nominal model.

        Args:
            arm: Name of the arm.
            thing: Name of the object.
            pose: Estimated pose of the object in the world.
            most_force: Largest grip force that it withstands, N.
            mass_declared: Whether the arm may use the declared mass.
            share: Share of the weight that the model supports, if another arm holds it as well.

        Raises:
            WorldError: Arm or object is not present, or the object is fixed.
        """
        relative = self._estimated_in_tool(arm, thing, pose)
        held = Attachment(
            arm,
            thing,
            relative,
            self.time,
            was_seen=True,
            by_gripper=True,
            most_force=most_force,
            lay=pose,
            mass_declared=mass_declared,
            share=share,
            carrier=self._passengers.carrier_of(thing),
        )
        self.attachments.hold(held)

    def _estimated_in_tool(self, arm: str, thing: str, pose: Pose | None) -> Pose:
        """Pose in the tool link, from the encoders, of an object at ``pose``, or its true one."""
        self.arms.require(arm)
        self.objects.require(thing)
        if self.objects[thing].fixed:
            raise WorldError(f"object {thing!r} is fixed: no arm can carry it")
        link = self.nominal[arm].tool_link_pose_at(self.hardware[arm].q)
        return link.inverse @ (pose or self.object_pose(thing))


# Physics step


class Stepping:
    """Steps one compiled model and detects divergence.

    Args:
        model: Compiled world.
        data: Its state.
        devices: Sensors and drives of its arms.
    """

    def __init__(self, model: mujoco.MjModel, data: mujoco.MjData, devices: Devices) -> None:
        self._model = model
        self._data = data
        self._devices = devices

    def advance(self, between: Iterable[Callable[[], None]]) -> None:
        """Drive, advance by one step, bring positions and contacts up to date, and sense.

        ``mj_step`` leaves the derived quantities at the state before the step, 2 ms old. Calling
        its two halves in reverse order (``mj_step2``, then ``mj_step1``) avoids that.

        Args:
            between: Functions called between the halves: velocities are new, while contacts and
                their forces are still those of the step.

        Raises:
            DivergenceError: A torque or the state is not finite, or time did not advance.
        """
        model = self._model
        data = self._data
        devices = self._devices
        if not devices.drive():
            raise DivergenceError(_divergence(model, data, "has a command that is not finite"))
        before = data.time
        mujoco.mj_step2(model, data)
        if not devices.pass_between():
            raise DivergenceError(
                _divergence(model, data, "moves impossibly fast or has a state that is not finite")
            )
        for callback in between:
            callback()
        mujoco.mj_step1(model, data)
        now = data.time
        if now <= before:
            raise DivergenceError(f"simulated time went from {before} s back to {now} s")
        devices.sense(now)


def _divergence(model: mujoco.MjModel, data: mujoco.MjData, what: str) -> str:
    return f"the simulation diverged at {data.time:.3f} s: {_culprit(model, data)} {what}"


def _culprit(model: mujoco.MjModel, data: mujoco.MjData) -> str:
    """Name the actuator or joint with a non-finite value, otherwise the fastest joint."""
    if not np.isfinite(data.ctrl).all():
        actuator = int(np.argmin(np.isfinite(data.ctrl)))
        is_joint = model.actuator_trntype[actuator] == mujoco.mjtTrn.mjTRN_JOINT  # or a gripper
        return f"{'joint' if is_joint else 'drive'} {model.actuator(actuator).name!r}"
    if not np.isfinite(data.qpos).all():
        address = int(np.argmin(np.isfinite(data.qpos)))
        joint = int(np.searchsorted(model.jnt_qposadr, address, "right")) - 1
        return f"joint {model.joint(joint).name!r}"
    fastest = int(np.argmax(np.nan_to_num(np.abs(data.qvel), nan=np.inf)))
    return f"joint {model.joint(model.dof_jntid[fastest]).name!r}"


# Penetration of a spawned object or arm

MAX_DEPTH = 0.005
"""Penetration in m up to which something may be spawned inside another: contacts push it out."""

SHALLOW_DEPTH = 0.001
"""Penetration in m beyond which the push may throw a light object away: 4 mm threw one of 0.09 kg
off its table. Objects that rest on the ground penetrate it by less."""


def deepest_overlap(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    kind: str,
    name: str,
    tolerated: float = MAX_DEPTH,
) -> OverlapError | None:
    """Find the deepest penetration of an arm or object into another, or of an arm into itself.

    Args:
        model: Compiled model.
        data: Its state, with current contacts.
        kind: ``"arm"`` or ``"object"``, for the message.
        name: Name of the arm or object.
        tolerated: Depth that is not reported, m.

    Returns:
        An error that describes it; None if no depth exceeds the tolerated one.
    """
    worst: tuple[float, list[str], list[bool]] | None = None
    for geoms, distance in zip(data.contact.geom.tolist(), data.contact.dist, strict=True):
        names = [name_of_geom(model, geom) for geom in geoms]
        own = [part == name or part.startswith(f"{name}/") for part in names]
        if any(own) and -distance > max(tolerated, worst[0] if worst else 0.0):
            worst = float(-distance), names, own
    if worst is None:
        return None
    depth, names, own = worst
    millimeters = f"{1000 * depth:.0f} mm deep in"
    if all(own):
        reason = f"{kind} {name!r} would collide with itself: {names[0]} {millimeters} {names[1]}"
        return OverlapError(name, reason, depth, name)
    other = names[own.index(False)]
    reason = f"{kind} {name!r} would be {millimeters} {other}"
    return OverlapError(name, reason, depth, other.partition("/")[0])


_log = logging.getLogger(__name__)

_LOOK_S = 0.1
"""Simulated time between two looks for what rides on held objects, s."""


class World(HoldingView):
    """The composed world; ``model`` and ``data`` are replaced when ``generation`` increases.

    They are the plant. Controllers must not read them, but only `hardware` and `nominal`.

    Args:
        file: Tree file that declares scene, objects and arms.
        seed: Seed of the noise on object poses and of all sampled errors.
        visuals: Load the full visual meshes, for images.

    Attributes:
        before_removal: Functions called with the name of an arm just before it is removed.
        on_forces: Functions called in each step while contacts and their forces are consistent.
        declared_arms: Every arm of the file, present or not.
        declared_objects: Every object of the file, present or not.
        robots: Robot of each declared arm, with its gripper mounted.
        generation: Number of recompilations so far.
        devices: Hardware, grippers and nominal model of each arm that is present.

    Raises:
        CatalogError: A robot or scene is unknown or broken.
        WorldError: The parts do not compile to one world, or a spring is too stiff for its steps.
    """

    def __init__(self, file: TreeFile, seed: int = 0, *, visuals: bool = False) -> None:
        mujoco.set_mju_user_warning(_log.warning)  # by default MuJoCo writes MUJOCO_LOG.TXT
        file = drawn(file, seed)
        self._file = file
        self._visuals = visuals
        self.declared_arms: Mapping[str, ArmSpec] = file.arms
        self.declared_objects: Mapping[str, ObjectSpec] = file.objects
        self._poses = {}
        for name, thing in file.objects.items():
            owner = name if thing.joint is None else thing.joint.owner
            self._poses[name] = noisy_pose(owner, thing, seed)
        loaded = {name: load_arm(arm, file.root) for name, arm in file.arms.items()}
        self.robots: dict[str, Robot] = {
            name: robot.derated(file.arms[name].limits) for name, (robot, _) in loaded.items()
        }
        self._bodies = {
            arm: body for body in shared_bodies(file.arms, self.robots) for arm in body.robots
        }
        mounted = {name: gripper for name, (_, gripper) in loaded.items() if gripper is not None}
        self.arms: Present[ArmBody] = Present.arms()
        self.objects: Present[ObjectSpec] = Present.objects()
        self.before_removal: list[Callable[[str], None]] = []
        self.generation = 0
        self.devices = Devices(file, self.robots, mounted, seed)
        self.hardware = self.devices.hardware
        self.nominal = self.devices.nominal
        self.grippers = self.devices.grippers
        self.on_forces: list[Callable[[], None]] = []
        self._spec = composition.scene_spec(file.world)
        if mounted:
            composition.set_grasp_contact_options(self._spec)
        check_declarations(file, self.robots, composition.names_in(self._spec))
        self.attachments = Attachments(self._spec, self._recompile, self._rebind, self._reload)
        self._passengers = Passengers(self.objects)
        self._looked_at = 0.0
        self._compile_first()

    def step(self) -> None:
        """Advance by one physics step; positions, contacts and inertias are up to date afterwards.

        Raises:
            DivergenceError: A torque or the state is not finite, or time did not advance.
        """
        self._stepping.advance(self.on_forces)

    def sense(self) -> None:
        """Read all sensors; `step` does so at its end."""
        self.devices.sense(self.data.time)

    def overlaps(self, tolerated: float = MAX_DEPTH) -> Iterator[OverlapError]:
        """Yield one error for each pair of arms or objects that penetrate each other.

        Args:
            tolerated: Depth that is not reported, m.
        """
        reported: set[tuple[str, str]] = set()
        for kind, names in (("arm", self.arms), ("object", self.objects)):
            for name in names:
                error = deepest_overlap(self.model, self.data, kind, name, tolerated)
                if error is not None and (error.other, name) not in reported:
                    reported.add((name, error.other))
                    yield self._with_noise(error)

    def _with_noise(self, error: OverlapError) -> OverlapError:
        """The error, with the objects whose `noise` puts them there with this seed only."""
        moved = [
            name
            for name in (error.thing, error.other)
            if name in self.objects
            and any((*self.objects[name].noise.xyz, self.objects[name].noise.yaw))
        ]
        if not moved:
            return error
        text = f"{error}; the noise of {' and '.join(moved)} depends on the seed"
        return OverlapError(error.thing, text, error.depth, error.other)

    def refuse_overlaps(self) -> None:
        """Raise an `OverlapError` if any arm or object penetrates another."""
        for error in self.overlaps():
            raise error

    def spawn_arm(self, name: str) -> None:
        """Add a declared arm in its initial posture.

        Raises:
            WorldError: Not declared, already present, or its place is occupied.
        """
        must_be_among(name, self._file.arms, "arm", "declared")
        if name in self.arms:
            raise WorldError(f"arm {name!r} is already present")
        self._add_arm(name)
        self._recompile()
        self._set_initial_posture(name)
        self._refresh()
        error = deepest_overlap(self.model, self.data, "arm", name)
        if error is not None:
            self.remove_arm(name)
            raise error

    def remove_arm(self, name: str) -> None:
        """Remove an arm; the objects that it held fall.

        Raises:
            WorldError: The arm is not present.
        """
        self.arms.require(name)
        for notify in self.before_removal:
            notify(name)
        if name not in self.arms:  # a callback has removed it already
            return
        self.attachments.forget(name)
        composition.remove_arm(self._spec, name, self.robots[name])
        del self.arms[name]
        self.devices.remove(name)
        self._recompile()

    def spawn_object(self, name: str, pose: Pose | None = None) -> None:
        """Add a declared object at rest, at its declared pose or at ``pose``.

        Raises:
            WorldError: Not declared, already present, or its place is occupied.
        """
        must_be_among(name, self._file.objects, "object", "declared")
        if name in self.objects:
            raise WorldError(f"object {name!r} is already present")
        for each in self._with_moved(name):
            self._put_object(each, pose or self._poses[each])
        self._recompile()
        error = deepest_overlap(self.model, self.data, "object", name)
        if error is not None:
            self.remove_object(name)
            raise error

    def remove_object(self, name: str) -> None:
        """Remove an object, even one that an arm holds.

        Raises:
            WorldError: The object is not present.
        """
        self.objects.require(name)
        for each in reversed(self._with_moved(name)):  # what hangs on it is a part of its tree
            if each in self.objects:
                self.attachments.forget(each)
                composition.remove_object(self._spec, each)
                del self.objects[each]
        self._recompile()

    def payload_geoms(self, name: str) -> set[int]:
        """Ids of the geoms of an object and of all that is carried with it.

        That is what moves on its joints, and its passengers.
        """
        return {geom for each in self._carried_with(name) for geom in self.object_geoms(each)}

    def carried_by(self, arm: str) -> tuple[str, ...]:
        """Names of the objects that an arm holds, what moves on their joints, and passengers."""
        return tuple(
            each for name in self.attachments.attached_to(arm) for each in self._carried_with(name)
        )

    def _carried_with(self, name: str) -> Iterator[str]:
        """Names of an object, of what moves on its joints, and of its passengers."""
        for rider in (name, *(one.object for one in self.passengers_of(name))):
            for each in self._with_moved(rider):
                if each in self.objects:
                    yield each

    def passengers_of(self, thing: str, known: Iterable[str] = ()) -> tuple[Passenger, ...]:
        """Objects that ride along with one that is held, or would if it were lifted now.

        Args:
            thing: Name of the object.
            known: Objects that rode on it when it was held: they still do if they touch nothing.
        """
        if self.attachments.holders(thing):
            return self._passengers.of(thing)
        held = {one.object for one in self.attachments}
        return self._passengers.would_ride(self.model, self.data, thing, held, self._hands, known)

    def loaded_mass(self, thing: str) -> float:
        """Mass of an object with what moves on its joints and with its passengers, kg."""
        return mass_with(self.objects[thing], self.placed_on(thing))

    def placed_on(self, thing: str) -> list[tuple[ObjectSpec, Pose]]:
        """The passengers of an object, with their poses in its frame when they were noticed."""
        upon = self.passengers_of(thing)
        return [(self.objects[one.object], one.relative) for one in upon]

    def look_for_passengers(self) -> None:
        """Notice what fell off held objects, or onto them; ten times a second at most.

        What an arm has just taken or released is noticed at once.
        """
        if not len(self.attachments) or self.time - self._looked_at < _LOOK_S:
            return
        self._looked_at = self.time
        if self._notice_passengers():
            self._rebind()

    def _notice_passengers(self) -> bool:
        held = [one.object for one in self.attachments]
        return self._passengers.look(self.model, self.data, held, self._hands)

    def arm_of(self, body: str) -> str:
        """Name of the arm that a body belongs to, as a link, ``arm1/link``, or as a held object.

        Returns:
            The name of an object that no arm holds itself.
        """
        if body in self.objects:
            return next((arm for arm in self.arms if body in self.carried_by(arm)), body)
        return body.partition("/")[0]

    def restore(self, state: Vector) -> None:
        """Restore a state of the same generation, bit for bit; drives keep their own state."""
        mujoco.mj_setState(self.model, self.data, state, mujoco.mjtState.mjSTATE_INTEGRATION)
        self._refresh()

    def _compile_first(self) -> None:
        """Compile the fixed objects first: they may be the surfaces that arms are mounted on."""
        self._add_objects(fixed=True)
        self._compile()
        self._surfaces: dict[str, MountingSurface | None] = {
            name: surface_below(self.model, self.data, arm.base.pose)
            for name, arm in self._file.arms.items()
        }
        self._add_objects(fixed=False)
        for body in dict.fromkeys(self._bodies.values()):
            surface = self._surfaces[next(iter(body.robots))]
            composition.add_shared_body(self._spec, body, surface, visuals=self._visuals)
        for name, arm in self._file.arms.items():
            if arm.spawned:
                self._add_arm(name)
        self._compile()
        hung = {name: thing.joint for name, thing in self.objects.items() if thing.joint}
        composition.refuse_stiff_springs(self.model, hung)
        self._bind()
        for name in self.arms:
            self._set_initial_posture(name)
        self._refresh()

    def _add_objects(self, *, fixed: bool) -> None:
        for name, thing in self._file.objects.items():
            if thing.spawned and thing.fixed == fixed:
                self._put_object(name, self._poses[name])

    def _with_moved(self, name: str) -> list[str]:
        """The object, and what moves on its joints."""
        moved = [
            other
            for other, thing in self._file.objects.items()
            if thing.joint is not None and thing.joint.owner == name
        ]
        return [name, *moved]

    def _put_object(self, name: str, pose: Pose) -> None:
        self.objects[name] = thing = self._file.objects[name]
        add_object(self._spec, name, thing, pose, self.devices.sampled_object(name))

    def _compile(self) -> None:
        try:
            self.model = self._spec.compile()
        except ValueError as error:
            raise WorldError(f"MuJoCo cannot compile the world: {error}") from error
        self.data = mujoco.MjData(self.model)
        mujoco.mj_step1(self.model, self.data)

    def _recompile(self) -> None:
        """Compile the changed spec, keeping the state of everything that remains."""
        try:
            self.model, self.data = self._spec.recompile(self.model, self.data)
        except ValueError as error:
            raise WorldError(f"MuJoCo cannot recompile the world: {error}") from error
        self._rebind()

    def _rebind(self) -> None:
        """Start a new generation: bind arms and devices to model, data and attachments."""
        self.generation += 1
        self._bind()
        self._refresh()
        if self._notice_passengers():  # contacts are up to date only now
            for arm in self.arms:
                self._reload(arm)

    def _reload(self, arm: str) -> None:
        """Update the loads of an arm's model; everything else is unchanged."""
        self.devices.reload([arm], self.attachments, self.objects, self._passengers)

    def _refresh(self) -> None:
        """Update everything derived from the state, and read the sensors."""
        self.devices.update_friction()
        mujoco.mj_step1(self.model, self.data)
        self.sense()

    def _bind(self) -> None:
        plant = self.model, self.data
        self._stepping = Stepping(*plant, self.devices)
        bodies = {
            name: ArmBody.find(name, self.robots[name], self._file.arms[name].base.pose, *plant)
            for name in self.arms
        }
        self.arms = Present.arms(bodies)
        self._hands = {geom for body in self.arms.values() for geom in body.tool_geom_ids}
        self.devices.connect(plant, self.arms, self.attachments, self.objects, self._passengers)

    def _add_arm(self, name: str) -> None:
        arm = self._file.arms[name]
        robot = self.robots[name]
        sampled = self.devices.sampled[name]
        surface = self._surfaces[name]
        visuals = self._visuals
        gripper = self.devices.mounted.get(name)
        composition.add_arm(
            self._spec, name, arm, robot, sampled, gripper, surface=surface,
            shared=self._bodies.get(name), visuals=visuals,
        )  # fmt: skip
        self.devices.add(name, self._spec.option)
        self.arms[name] = None  # type: ignore[assignment]  # bound when the model is compiled

    def _set_initial_posture(self, name: str) -> None:
        """Put an arm that was just added into its initial posture, before its first step."""
        posture = self.robots[name].postures[self._file.arms[name].posture]
        self.data.qpos[self.arms[name].qpos_ids] = posture
        self.devices.open_gripper(name)
