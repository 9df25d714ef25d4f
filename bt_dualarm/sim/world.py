"""The simulated world: one MuJoCo model whose arms and objects come and go while it runs.

The world keeps an `mujoco.MjSpec` and recompiles it whenever something is added or removed; MuJoCo
carries over the state of everything that stays. `generation` counts recompilations: code that keeps
indices or views of ``model`` and ``data`` must look them up again when it changes. `ArmDevices` has
the sensors and drives; `WorldView` measures poses, velocities and contacts.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Callable, Iterable, Iterator, Mapping

import mujoco

from bt_dualarm.core.errors import OverlapError, WorldError
from bt_dualarm.core.pose import Pose, Vector
from bt_dualarm.robots.gripper import FINGERS
from bt_dualarm.robots.robot import Robot
from bt_dualarm.robots.robot_description import load_arm
from bt_dualarm.sim import composition
from bt_dualarm.sim.arm_devices import ArmDevices
from bt_dualarm.sim.arm_models import mass_with, principal_with
from bt_dualarm.sim.composition import (
    ArmBody,
    MountingSurface,
    Present,
    add_object,
    check_declarations,
    must_be_among,
    noisy_pose,
    surface_below,
)
from bt_dualarm.sim.grippers import Attachment, Attachments
from bt_dualarm.sim.many import drawn
from bt_dualarm.sim.object_body import body_of
from bt_dualarm.sim.passengers import Passenger, Passengers
from bt_dualarm.sim.penetration import MAX_DEPTH, deepest_overlap
from bt_dualarm.sim.shared_body import shared_bodies
from bt_dualarm.sim.stepping import Stepping
from bt_dualarm.sim.world_view import WorldView
from bt_dualarm.spec.document import ArmSpec, ObjectSpec, TreeFile

_log = logging.getLogger(__name__)

_LOOK_S = 0.1
"""Simulated time between two looks for what rides on held objects, s."""


class World(WorldView):
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
        hardware: Sensors and drives of the arms that are present, by name.
        nominal: Nominal models of these arms, by name.
        attachments: Objects that the arms hold.
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
        for name, obj in file.objects.items():
            owner = name if obj.joint is None else obj.joint.owner
            self._poses[name] = noisy_pose(owner, obj, seed)
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
        self.devices = ArmDevices(file, self.robots, mounted, seed)
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
            for name in (error.obj, error.other)
            if name in self.objects
            and any((*self.objects[name].noise.xyz, self.objects[name].noise.yaw))
        ]
        if not moved:
            return error
        text = f"{error}; the noise of {' and '.join(moved)} depends on the seed"
        return OverlapError(error.obj, text, error.depth, error.other)

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
            WorldError: Not declared, already present, a part on a joint of another object, or its
                place, or that of a part on one of its joints, is occupied.
        """
        must_be_among(name, self._file.objects, "object", "declared")
        self._refuse_part_on_joint(name)
        if name in self.objects:
            raise WorldError(f"object {name!r} is already present")
        together = self._with_moved(name)
        for each in together:
            self._put_object(each, pose or self._poses[each])
        self._recompile()
        for each in together:
            error = deepest_overlap(self.model, self.data, "object", each)
            if error is not None:
                self.remove_object(name)
                raise error

    def remove_object(self, name: str) -> None:
        """Remove an object, even one that an arm holds.

        Raises:
            WorldError: The object is not present, or a part on a joint of another object.
        """
        self.objects.require(name)
        self._refuse_part_on_joint(name)
        for each in reversed(self._with_moved(name)):  # what hangs on it is a part of its tree
            if each in self.objects:
                self.attachments.forget(each)
                composition.remove_object(self._spec, each)
                del self.objects[each]
        self._recompile()

    def attach(
        self, arm: str, obj: str, seen: Pose | None = None, *, share: float = 1.0
    ) -> Attachment:
        """Weld an object to an arm's tool link; its nominal pose is the one ``seen``, if given.

        Another arm may hold it as well; the model then supports this ``share`` of the weight.

        Raises:
            WorldError: Arm or object is not present, or the object is fixed.
        """
        relative = self._estimated_in_tool(arm, obj, seen)
        pose = self.object_pose(obj)
        link = f"{arm}/{self.robots[arm].tool_link}"
        held = Attachment(
            arm,
            obj,
            relative,
            self.time,
            bool(seen),
            share=share,
            carrier=self._passengers.carrier_of(obj),
        )
        relative = self.arms[arm].tool_link_pose.inverse @ pose
        return self.attachments.attach(held, link, relative, self._tips_on(arm, obj))

    def _tips_on(self, arm: str, obj: str) -> tuple[str, ...]:
        """Fingers of an arm that are closed and touch an object with their tips.

        Contacts of these fingers with the welded object are ignored: pressed against it, they could
        not slide along it to open.
        """
        gripper = self.devices.grippers.get(arm)
        if gripper is None or not gripper.gripper.fingers:
            return ()
        if gripper.width > gripper.gripper.closed_width or not self.touches(arm, obj):
            return ()
        return tuple(f"{arm}/{finger}" for finger in FINGERS)

    def hold(
        self,
        arm: str,
        obj: str,
        pose: Pose,
        most_force: float = math.inf,
        *,
        mass_declared: bool = True,
        share: float = 1.0,
    ) -> None:
        """Attach an object to an arm's gripper in the nominal model.

        Args:
            arm: Name of the arm.
            obj: Name of the object.
            pose: Estimated pose of the object in the world.
            most_force: Largest grip force that it withstands, N.
            mass_declared: Whether the arm may use the declared mass.
            share: Share of the weight that the model supports, if another arm holds it as well.

        Raises:
            WorldError: Arm or object is not present, or the object is fixed.
        """
        relative = self._estimated_in_tool(arm, obj, pose)
        held = Attachment(
            arm,
            obj,
            relative,
            self.time,
            was_seen=True,
            by_gripper=True,
            most_force=most_force,
            lay=pose,
            mass_declared=mass_declared,
            share=share,
            carrier=self._passengers.carrier_of(obj),
        )
        self.attachments.hold(held)

    def _estimated_in_tool(self, arm: str, obj: str, pose: Pose | None) -> Pose:
        """Pose in the tool link, from the encoders, of an object at ``pose``, or its true one."""
        self.arms.require(arm)
        self.objects.require(obj)
        if self.objects[obj].fixed:
            raise WorldError(self.fixed_reason(obj))
        link = self.nominal[arm].tool_link_pose_at(self.hardware[arm].q)
        return link.inverse @ (pose or self.object_pose(obj))

    def payload_geoms(self, name: str) -> set[int]:
        """Ids of the geoms of an object and of all that is carried with it.

        That is what moves on its joints, and its passengers.
        """
        return {geom for each in self._carried_with(name) for geom in self.object_geoms(each)}

    def moves_on(self, part: str, obj: str) -> bool:
        """Whether a part, named as ``door.hinge``, moves on a joint of an object."""
        joint = self._file.objects[part].joint
        return joint is not None and joint.owner == obj

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

    def passengers_of(self, obj: str, known: Iterable[str] = ()) -> tuple[Passenger, ...]:
        """Objects that ride along with one that is held, or would if it were lifted now.

        Args:
            obj: Name of the object.
            known: Objects that rode on it when it was held: they still do if they touch nothing.
        """
        if self.attachments.holders(obj):
            return self._passengers.of(obj)
        held = {one.object for one in self.attachments}
        return self._passengers.would_ride(self.model, self.data, obj, held, self._hands, known)

    def loaded_mass(self, obj: str) -> float:
        """Mass of an object with what moves on its joints and with its passengers, kg."""
        return mass_with(self.objects[obj], self.placed_on(obj))

    def loaded_center(self, obj: str) -> Vector:
        """Center of mass of the same, in the frame of the object, of shape (3,), m."""
        spec = self.objects[obj]
        upon = self.placed_on(obj)
        if spec.moved or upon:
            return principal_with((spec, Pose.identity()), *upon)[0].position
        return body_of(spec).center

    def placed_on(self, obj: str) -> list[tuple[ObjectSpec, Pose]]:
        """The passengers of an object, with their poses in its frame when they were noticed."""
        upon = self.passengers_of(obj)
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
        hung = {name: obj.joint for name, obj in self.objects.items() if obj.joint}
        composition.refuse_stiff_springs(self.model, hung)
        self._bind()
        for name in self.arms:
            self._set_initial_posture(name)
        self._refresh()

    def _add_objects(self, *, fixed: bool) -> None:
        for name, obj in self._file.objects.items():
            if obj.spawned and obj.fixed == fixed:
                self._put_object(name, self._poses[name])

    def _with_moved(self, name: str) -> list[str]:
        """The object, and what moves on its joints."""
        return [name, *(other for other in self._file.objects if self.moves_on(other, name))]

    def _refuse_part_on_joint(self, name: str) -> None:
        """Refuse to add or remove a part alone: its joint is one of the object it belongs to."""
        hung = self._file.objects[name].joint
        if hung is not None:
            raise WorldError(
                f"{name!r} moves on a joint of {hung.owner!r}: it is added and removed with that"
            )

    def _put_object(self, name: str, pose: Pose) -> None:
        self.objects[name] = obj = self._file.objects[name]
        add_object(self._spec, name, obj, pose, self.devices.sampled_object(name))

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
