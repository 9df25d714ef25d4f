"""What can be measured in a world: poses, velocities, contacts, attachments."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import mujoco
import numpy as np

from bt_dualarm.core.errors import WorldError
from bt_dualarm.core.pose import Pose, Vector
from bt_dualarm.core.share import weakly
from bt_dualarm.robots.gripper import FINGERS, Gripper
from bt_dualarm.robots.robot import JointFriction, Robot
from bt_dualarm.sim import composition
from bt_dualarm.sim.arm_models import (
    LinkFactors,
    NominalArm,
    NominalLoad,
    SampledArm,
    random_stream,
    sample_arm,
    sample_object,
)
from bt_dualarm.sim.composition import ArmBody, must_be_among, nominal_model
from bt_dualarm.sim.devices import ArmHardware, DeviceBank
from bt_dualarm.sim.grippers import GripperHardware, HeldObjectMotion, move_held_objects
from bt_dualarm.spec.document import ObjectSpec, TreeFile
from bt_dualarm.spec.reality import REALITY_SETS, RealityErrors, resolved


@dataclass(frozen=True, eq=False)
class Attachment:
    """An object held by an arm.

    Attributes:
        relative: Pose of the object in the arm's tool link at the moment of attaching, by the
            arm's encoders; of one that was seen, by where it was seen.
        since: Simulated time in seconds.
        was_seen: Whether that pose is by sight, and not the true one.
        by_gripper: Whether fingers or a cup hold it, and no weld: then it is only believed.
        most_force: Force of each pad, or of a cup, that it may be held with at most, N.
        lay: Pose in the world at which fingers or a cup were believed to take it.
        is_told: Whether the file tells its mass, where arms are told any: it was taken by name.
    """

    arm: str
    object: str
    relative: Pose
    since: float
    was_seen: bool = False
    by_gripper: bool = False
    most_force: float = math.inf
    is_told: bool = True
    lay: Pose | None = None

    @property
    def name(self) -> str:
        """Name of the weld in the model."""
        return f"{self.arm}+{self.object}"


class Attachments:
    """The registry of a world's attachments.

    Args:
        spec: MjSpec of the world.
        recompile: Method of the world that takes up a change of the spec.
        rebind: Method of the world that takes up a change of what is held, and of nothing else.
    """

    def __init__(
        self, spec: mujoco.MjSpec, recompile: Callable[[], None], rebind: Callable[[], None]
    ) -> None:
        self._spec = spec
        self._recompile = weakly(recompile)
        self._rebind = weakly(rebind)
        self._held: dict[tuple[str, str], Attachment] = {}

    def __iter__(self) -> Iterator[Attachment]:
        return iter(self._held.values())

    def __len__(self) -> int:
        return len(self._held)

    def attached_to(self, arm: str) -> tuple[str, ...]:
        """Objects that the arm holds, in the order in which they were attached."""
        return tuple(a.object for a in self._held.values() if a.arm == arm)

    def find(self, arm: str, thing: str) -> Attachment | None:
        """The attachment of this pair, if there is one."""
        return self._held.get((arm, thing))

    def gripped_by(self, arm: str) -> tuple[Attachment, ...]:
        """Objects that the arm's fingers or cup are assumed to hold, in the order of picking."""
        return tuple(a for a in self._held.values() if a.arm == arm and a.by_gripper)

    def attach(
        self, new: Attachment, link: str, relative: Pose, tips: Sequence[str] = ()
    ) -> Attachment:
        """Weld an object to an arm's link; a second time changes nothing.

        Args:
            new: What is to be held.
            link: Name of the arm's tool link.
            relative: Pose of the object in it, as it truly is.
            tips: Names of the fingers by whose tips it is held, if it is.
        """
        held = self._held.get((new.arm, new.object))
        if held is not None:
            return held
        composition.add_weld(self._spec, new.name, link, new.object, relative, tips)
        self._held[new.arm, new.object] = new
        self._recompile()
        return new

    def hold(self, new: Attachment) -> None:
        """Believe that a gripper holds an object; what was believed of the pair is replaced.

        What is welded to the arm stays so: nothing holds more firmly.
        """
        held = self._held.get((new.arm, new.object))
        if held is not None and not held.by_gripper:
            return
        self._held[new.arm, new.object] = new
        self._rebind()

    def detach(self, arm: str, thing: str) -> bool:
        """Release an object; returns whether it was held."""
        held = self._held.pop((arm, thing), None)
        if held is None:
            return False
        if held.by_gripper:
            self._rebind()
        else:
            composition.remove_weld(self._spec, held.name)
            self._recompile()
        return True

    def forget(self, name: str) -> None:
        """Take away every weld of an arm or object that is about to leave (no recompilation)."""
        for key, held in list(self._held.items()):
            if name in key:
                if not held.by_gripper:
                    composition.remove_weld(self._spec, held.name)
                del self._held[key]


# Interface of arms to their controllers: hardware and nominal model


class Devices:
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
        self._file = file
        self._robots = robots
        self._seed = seed
        self.hardware: dict[str, ArmHardware] = {}
        self.nominal: dict[str, NominalArm] = {}
        self.mounted = mounted
        self.grippers: dict[str, GripperHardware] = {}
        self._places: list[tuple[ArmHardware, Vector]] = []
        self._carrying: list[HeldObjectMotion] = []
        self.errors: dict[str, RealityErrors] = {
            name: resolved(file.world.reality, arm.reality, REALITY_SETS)
            for name, arm in file.arms.items()
        }
        self.drawn: dict[str, SampledArm] = {
            name: sample_arm(errors, robots[name], seed, name, _fingers(mounted.get(name)))
            for name, errors in self.errors.items()
        }
        efforts = {name: robot.limits.effort for name, robot in robots.items()}
        self._electronics = DeviceBank(self.errors, self.drawn, efforts, file.world.timestep)

    def add(self, name: str, option: mujoco.MjOption) -> None:
        """Equip an arm that comes into a world with these options."""
        arm = self._file.arms[name]
        robot = self._robots[name]
        errors = self.errors[name]
        friction = JointFriction.none(robot.dof)
        if errors.friction.present:
            friction = replace(robot.friction, uncertainty=errors.friction.coulomb.most)
        model = nominal_model(name, arm, robot, option, rotors=errors.links.rotor)
        self.nominal[name] = NominalArm(
            name, robot, arm.base.pose, model, friction, weighs=not errors.payload.known
        )
        self.hardware[name] = self._electronics.begin(name, self._seed)
        if name in self.mounted:
            rng = random_stream(self._seed, f"{name}:gripper")
            self.grippers[name] = GripperHardware(self.mounted[name], errors, rng, option.timestep)

    def open_gripper(self, name: str) -> None:
        """Put the fingers of an arm that has just come to where its drive holds them: open."""
        if name in self.grippers:
            self.grippers[name].stand_open()

    def drawn_object(self, name: str) -> LinkFactors:
        """What the seed has made of an object's mass: the world's reality has the spread."""
        errors = resolved(self._file.world.reality, None, REALITY_SETS)
        return sample_object(errors.payload, self._seed, name)

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
        self._sensed = mujoco.MjData(self._model)
        self._is_sensed = False
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
            first = body.qpos_ids[0]
            last = body.qpos_ids[-1]
            self._places.append((self.hardware[name], self._everywhere[first : last + 1]))
            self.nominal[name].hold(loads[name])
            if name in self.grippers:
                self.grippers[name].connect(self._model, body.data, name)
                self._carrying.append(
                    HeldObjectMotion(self._model, body.data, name, self.mounted[name])
                )
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
        move_held_objects(self._model, self._plant, self._carrying)

    def rub(self) -> None:
        """Set the friction of all arms for the velocities of now."""
        self._electronics.rub()


def _fingers(gripper: Gripper | None) -> tuple[str, ...]:
    """Bodies of an arm that its description does not contain."""
    return FINGERS if gripper is not None and gripper.fingers else ()


# Measurements in a world: poses, motions and contacts


_FARTHEST = 1e3
"""Meters to which a distance is measured: larger than any world that can be reached across."""


class WorldView:
    """The measurable side of a world; what a camera is meant to see is not taken from here.

    Attributes:
        model: Compiled model; a new object after every change of the world's parts.
        data: State of the model; likewise.
        equipment: All that arms are controlled through: sensors and drives, and what is believed of
            them.
        arms: Arms that are present, by name.
        objects: Objects that are present, by name.
    """

    model: mujoco.MjModel
    data: mujoco.MjData
    equipment: Devices
    arms: dict[str, ArmBody]
    objects: dict[str, ObjectSpec]

    @property
    def sensed(self) -> mujoco.MjData:
        """Positions by the sensors, and where all bodies are by them; see `Devices.sensed`."""
        return self.equipment.sensed

    @property
    def time(self) -> float:
        """Simulated time in seconds."""
        return float(self.data.time)

    @property
    def timestep(self) -> float:
        """Seconds of one physics step."""
        return float(self.model.opt.timestep)

    def state(self) -> Vector:
        """Everything the simulation goes on from (``mjSTATE_INTEGRATION``), of shape (n,)."""
        kind = mujoco.mjtState.mjSTATE_INTEGRATION
        state = np.empty(mujoco.mj_stateSize(self.model, kind))
        mujoco.mj_getState(self.model, self.data, state, kind)
        return state

    def object_body(self, name: str) -> int:
        """Id of an object's body."""
        must_be_among(name, self.objects, "object", "in the world")
        return int(self.model.body(name).id)

    def object_geom(self, name: str) -> int:
        """Id of an object's shape."""
        must_be_among(name, self.objects, "object", "in the world")
        return int(self.model.geom(name).id)

    def pose_address(self, name: str) -> int:
        """Where the seven numbers of a free object's pose begin in ``qpos``."""
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
        """Where a ray from an object's center leaves it, of shape (3,), in the world.

        Args:
            name: Name of the object.
            direction: Direction of the ray in the world, of unit length.
            pose: Pose that it is believed to have; its true one by default.
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
            reach = _out_of_capsule(thing.size[0], thing.size[1], ray)
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
            float(mujoco.mj_geomDistance(self.model, self.data, tool, geom, _FARTHEST, None))
            for tool in self.arms[arm].tool_geom_ids
        )

    def touches(self, arm: str, thing: str) -> bool:
        """Whether an arm's tool and an object touch now."""
        geom = self.object_geom(thing)
        tool = self.arms[arm].tool_geom_ids
        contact = self.data.contact
        return any(
            (geom1 == geom and geom2 in tool) or (geom2 == geom and geom1 in tool)
            for geom1, geom2 in contact.geom[contact.dist <= 0.0]
        )


def _out_of_capsule(radius: float, length: float, ray: Vector) -> float:
    """Meters from a capsule's center along a ray, of shape (3,), all of it positive."""
    across = float(np.hypot(ray[0], ray[1]))
    along = float(ray[2])
    half = 0.5 * length
    aside = radius / across
    if aside * along <= half:
        return aside
    return half * along + float(np.sqrt(radius**2 - (half * across) ** 2))


# Attachments of objects to arms, by weld or gripper


class HoldingView(WorldView):
    """Attachment of objects to arms in a world.

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
        pose = self.object_pose(thing)
        link = f"{arm}/{self.robots[arm].tool_link}"
        held = Attachment(arm, thing, relative, self.time, bool(seen))
        relative = self.arms[arm].tool_link_pose.inverse @ pose
        return self.attachments.attach(held, link, relative, self._tips_on(arm, thing))

    def _tips_on(self, arm: str, thing: str) -> tuple[str, ...]:
        """Fingers of an arm that are shut and touch an object: it is their tips that it hangs on.

        Welded to the hand and pressed on by its tips, they could not slide along it to open.
        """
        gripper = self.equipment.grippers.get(arm)
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
        told: bool = True,
    ) -> None:
        """Attach an object to an arm's gripper in the nominal model.

        Args:
            arm: Name of the arm.
            thing: Name of the object.
            pose: Estimated pose of the object in the world.
            most_force: Largest grip force that it withstands, N.
            told: Whether the arm may use the declared mass.

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
