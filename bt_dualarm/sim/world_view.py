"""Access to a world: its devices, and measurements of poses, velocities and contacts."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import replace

import mujoco
import numpy as np

from bt_dualarm.core.errors import WorldError
from bt_dualarm.core.pose import Pose, Vector
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
from bt_dualarm.sim.attachments import Attachment, Attachments
from bt_dualarm.sim.composition import ArmBody, must_be_among, nominal_model
from bt_dualarm.sim.devices import ArmHardware, DeviceBank
from bt_dualarm.sim.grippers import GripperHardware, HeldObjectMotion, move_held_objects
from bt_dualarm.spec.document import ObjectSpec, TreeFile
from bt_dualarm.spec.reality import REALITY_SETS, RealityErrors, resolved

# Devices


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
        self.hardware: dict[str, ArmHardware] = {}
        self.nominal: dict[str, NominalArm] = {}
        self.mounted = mounted
        self.grippers: dict[str, GripperHardware] = {}
        self._sensed_joints: list[tuple[ArmHardware, Vector]] = []
        self._held_motions: list[HeldObjectMotion] = []
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
            self.grippers[name] = GripperHardware(self.mounted[name], errors, rng, option.timestep)

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
        self.grippers.pop(name, None)

    def connect(
        self,
        plant: tuple[mujoco.MjModel, mujoco.MjData],
        arms: Mapping[str, ArmBody],
        held: Iterable[Attachment],
        objects: Mapping[str, ObjectSpec],
    ) -> None:
        """Connect to the arms of a recompiled plant, and update the loads that they hold."""
        self._model, self._plant = plant
        self._sensed = mujoco.MjData(self._model)
        self._is_sensed = False
        self._sensed_joints = []
        self._held_motions = []
        self._sensed_qpos = self._sensed.qpos  # a view: attribute lookups on mjData are slow
        loads: dict[str, list[NominalLoad]] = {name: [] for name in arms}
        for one in held:
            known = one.mass_declared and self.errors[one.arm].payload.known
            load = NominalLoad.of(one.object, objects[one.object], one.relative, known=known)
            loads[one.arm].append(load)
        for name, body in arms.items():
            self.hardware[name].connect(body)
            first = body.qpos_ids[0]
            last = body.qpos_ids[-1]
            self._sensed_joints.append((self.hardware[name], self._sensed_qpos[first : last + 1]))
            self.nominal[name].hold(loads[name])
            if name in self.grippers:
                self.grippers[name].connect(self._model, body.data, name)
                self._held_motions.append(
                    HeldObjectMotion(self._model, body.data, name, self.mounted[name])
                )
        self._bank.connect(*plant, arms)

    def sense(self, time: float) -> None:
        """Read the sensors of all arms at the current simulated time in s."""
        self._is_sensed = False
        self._bank.sense(time)
        for gripper in self.grippers.values():
            gripper.sense(time)

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

    def drive(self) -> None:
        """Apply the torques and forces of all drives for the next step."""
        self._bank.drive()
        for gripper in self.grippers.values():
            gripper.drive()

    def move_held_objects(self) -> None:
        """Correct the motion of held objects after the integration of a step."""
        move_held_objects(self._model, self._plant, self._held_motions)

    def update_friction(self) -> None:
        """Set the joint friction of all arms for the current velocities."""
        self._bank.update_friction()


def _fingers(gripper: Gripper | None) -> tuple[str, ...]:
    """Bodies that a gripper adds to its arm besides the palm."""
    return FINGERS if gripper is not None and gripper.fingers else ()


# Measurements

_MAX_DISTANCE_M = 1e3
"""Cutoff in m of distance queries, larger than any world."""


class WorldView:
    """Measurements of a world's true state, for set-up, scoring and tests.

    Perception does not read them: it has only camera images.

    Attributes:
        model: Compiled model; a new object after every recompilation.
        data: State of the model; likewise.
        devices: Hardware and nominal model of the arms.
        arms: Arms that are present, by name.
        objects: Objects that are present, by name.
    """

    model: mujoco.MjModel
    data: mujoco.MjData
    devices: Devices
    arms: dict[str, ArmBody]
    objects: dict[str, ObjectSpec]

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
        must_be_among(name, self.objects, "object", "in the world")
        return int(self.model.body(name).id)

    def object_geom(self, name: str) -> int:
        """Id of an object's geom."""
        must_be_among(name, self.objects, "object", "in the world")
        return int(self.model.geom(name).id)

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

    def surface_point(self, name: str, direction: Vector, pose: Pose | None = None) -> Vector:
        """Point at which a ray from an object's center leaves it, of shape (3,), in the world, m.

        Args:
            name: Name of the object.
            direction: Direction of the ray in the world, of unit length.
            pose: Estimated pose of the object; its true one by default.
        """
        pose = self.object_pose(name) if pose is None else pose
        ray = np.abs(direction @ pose.rotation_matrix) + 1e-12
        thing = self.objects[name]
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

    def object_velocity(self, name: str) -> Vector:
        """Angular (rad/s) then linear (m/s) velocity at an object's center, of shape (6,)."""
        velocity = np.empty(6)
        kind = mujoco.mjtObj.mjOBJ_BODY
        mujoco.mj_objectVelocity(self.model, self.data, kind, self.object_body(name), velocity, 0)
        return velocity

    def tool_gap(self, arm: str, thing: str) -> float:
        """Smallest distance in meters between an arm's tool and an object; negative inside it."""
        must_be_among(arm, self.arms, "arm", "in the world")
        geom = self.object_geom(thing)
        return min(
            float(mujoco.mj_geomDistance(self.model, self.data, tool, geom, _MAX_DISTANCE_M, None))
            for tool in self.arms[arm].tool_geom_ids
        )

    def touches(self, arm: str, thing: str) -> bool:
        """Whether an arm's tool and an object are in contact."""
        geom = self.object_geom(thing)
        tool = self.arms[arm].tool_geom_ids
        contact = self.data.contact
        return any(
            (geom1 == geom and geom2 in tool) or (geom2 == geom and geom1 in tool)
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
    hardware: dict[str, ArmHardware]
    nominal: dict[str, NominalArm]
    attachments: Attachments

    def attach(self, arm: str, thing: str, seen: Pose | None = None) -> Attachment:
        """Weld an object to an arm's tool link; its nominal pose is the one ``seen``, if given.

        Raises:
            WorldError: Arm or object is not present, or the object is fixed.
        """
        relative = self._estimated_in_tool(arm, thing, seen)
        pose = self.object_pose(thing)
        link = f"{arm}/{self.robots[arm].tool_link}"
        held = Attachment(arm, thing, relative, self.time, bool(seen))
        relative = self.arms[arm].tool_link_pose.inverse @ pose
        return self.attachments.attach(held, link, relative, self._tips_on(arm, thing))

    def _tips_on(self, arm: str, thing: str) -> tuple[str, ...]:
        """Fingers of an arm that are closed on an object and hold it with their tips.

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
    ) -> None:
        """Attach an object to an arm's gripper in the nominal model.

        Args:
            arm: Name of the arm.
            thing: Name of the object.
            pose: Estimated pose of the object in the world.
            most_force: Largest grip force that it withstands, N.
            mass_declared: Whether the arm may use the declared mass.

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
        )
        self.attachments.hold(held)

    def _estimated_in_tool(self, arm: str, thing: str, pose: Pose | None) -> Pose:
        """Pose in the tool link, by the encoders, of an object at ``pose`` (default: true pose)."""
        must_be_among(arm, self.arms, "arm", "in the world")
        must_be_among(thing, self.objects, "object", "in the world")
        if self.objects[thing].fixed:
            raise WorldError(f"object {thing!r} is fixed: no arm can carry it")
        link = self.nominal[arm].tool_link_pose_at(self.hardware[arm].q)
        return link.inverse @ (pose or self.object_pose(thing))
