"""One MuJoCo world with arms and objects that come and go while it runs."""

from __future__ import annotations

import logging
import math
from collections.abc import Callable, Iterable, Iterator, Mapping

import mujoco
import numpy as np

from bt_dualarm.core.errors import DivergenceError, OverlapError, WorldError
from bt_dualarm.core.pose import Pose, Vector
from bt_dualarm.robots.mounting import load_arm
from bt_dualarm.robots.robot import Robot
from bt_dualarm.sim import composition
from bt_dualarm.sim.attachments import Attachments
from bt_dualarm.sim.composition import (
    ArmBody,
    MountingSurface,
    add_object,
    check_declarations,
    must_be_among,
    name_of_geom,
    noisy_pose,
    surface_below,
)
from bt_dualarm.sim.world_view import Devices, HoldingView
from bt_dualarm.spec.document import ArmSpec, ObjectSpec, TreeFile

# Physics step, with a check for divergence


_ABSURD_SPEED = 1e4  # rad/s or m/s: nothing on a table moves like this


class Stepping:
    """Makes the steps of a world, until it is compiled anew.

    Args:
        model: Compiled world.
        data: State of it.
    """

    def __init__(self, model: mujoco.MjModel, data: mujoco.MjData) -> None:
        self._model = model
        self._data = data
        # Views: looking a field up costs more than what is done with it.
        self._torque = data.ctrl
        self._speed = data.qvel
        self._place = data.qpos

    def advance(self, between: Iterable[Callable[[], None]] = ()) -> float:
        """Advance by one step; positions, contacts and inertias are then those of now.

        ``mj_step`` would leave them as they were before the step, 2 ms old: its two halves are
        called in the other order.

        Args:
            between: Functions that are called when velocities are those of now, and forces that
                hang on them are not; contacts are those of before, with the forces that they had in
                the step.

        Returns:
            Simulated time in s.

        Raises:
            DivergenceError: A torque or the state is not finite, or time did not advance.
        """
        model = self._model
        data = self._data
        torque = self._torque
        if not math.isfinite(torque.dot(torque)):  # MuJoCo would take all torques for zero
            raise DivergenceError(_diagnosis(model, data, "is driven by what is not a number"))
        before = data.time
        mujoco.mj_step2(model, data)
        speed = self._speed
        place = self._place
        # Squares, because one product of vectors costs a tenth of looking at each element.
        if not (speed.dot(speed) < _ABSURD_SPEED**2 and math.isfinite(place.dot(place))):
            raise DivergenceError(_diagnosis(model, data, "moves absurdly fast or is not a number"))
        for look in between:
            look()
        mujoco.mj_step1(model, data)
        now: float = data.time
        if now <= before:
            raise DivergenceError(f"simulated time went from {before} s back to {now} s")
        return now


def _diagnosis(model: mujoco.MjModel, data: mujoco.MjData, what: str) -> str:
    return f"the simulation diverged at {data.time:.3f} s: {_culprit(model, data)} {what}"


def _culprit(model: mujoco.MjModel, data: mujoco.MjData) -> str:
    """What has a force or position that is not finite, else the fastest joint."""
    if not np.isfinite(data.ctrl).all():
        actuator = int(np.argmin(np.isfinite(data.ctrl)))
        turns = model.actuator_trntype[actuator] == mujoco.mjtTrn.mjTRN_JOINT  # else a gripper's
        return f"{'joint' if turns else 'drive'} {model.actuator(actuator).name!r}"
    if not np.isfinite(data.qpos).all():
        address = int(np.argmin(np.isfinite(data.qpos)))
        joint = int(np.searchsorted(model.jnt_qposadr, address, "right")) - 1
        return f"joint {model.joint(joint).name!r}"
    fastest = int(np.argmax(np.nan_to_num(np.abs(data.qvel), nan=np.inf)))
    return f"joint {model.joint(model.dof_jntid[fastest]).name!r}"


# Penetration check of a spawned object or arm


MOST_DEPTH = 0.005
"""Depth in meters up to which an object that comes may be inside another: contacts push it out."""


def deepest_overlap(
    model: mujoco.MjModel, data: mujoco.MjData, name: str
) -> tuple[str, float] | None:
    """What an arm or object is deepest inside of, and how deep in m; None below ``MOST_DEPTH``.

    Args:
        model: Compiled model.
        data: State of it, with the contacts of now.
        name: Name of the arm or object.
    """
    worst = None
    for geoms, distance in zip(data.contact.geom.tolist(), data.contact.dist, strict=True):
        names = [name_of_geom(model, geom) for geom in geoms]
        own = [part == name or part.startswith(f"{name}/") for part in names]
        if own[0] != own[1] and -distance > max(MOST_DEPTH, worst[1] if worst else 0.0):
            worst = names[own.index(False)], float(-distance)
    return worst


def overlap_error(kind: str, name: str, other: str, depth: float) -> OverlapError:
    """What is said of an arm or object that would be so many meters deep in another object."""
    return OverlapError(name, f"{kind} {name!r} would be {1000 * depth:.0f} mm deep in {other}")


_log = logging.getLogger(__name__)


class World(HoldingView):
    """The composed world: ``model`` and ``data`` change identity when ``generation`` grows.

    They are the plant: who controls an arm reads its `hardware` and `nominal`.

    Args:
        file: Declares scene, objects and arms.
        seed: Moves objects by their noise.
        visuals: Load the full visual meshes, for images.

    Attributes:
        before_removal: Functions that are told the name of an arm that is about to be taken away.
        on_forces: Functions that are called in each step, when contacts have the forces of it.
        declared_arms: Every arm of the file, present or not.
        declared_objects: Every object of the file, likewise.
        devices: Hardware, grippers and nominal model of each arm that is present, by name.

    Raises:
        CatalogError: A robot or scene is unknown or broken.
        WorldError: The parts do not compile to one world.
    """

    def __init__(self, file: TreeFile, seed: int = 0, *, visuals: bool = False) -> None:
        mujoco.set_mju_user_warning(_log.warning)  # else it writes a file where the user stands
        self._file = file
        self._visuals = visuals
        self.declared_arms: Mapping[str, ArmSpec] = file.arms
        self.declared_objects: Mapping[str, ObjectSpec] = file.objects
        self._poses = {name: noisy_pose(name, thing, seed) for name, thing in file.objects.items()}
        loaded = {name: load_arm(arm, file.root) for name, arm in file.arms.items()}
        self.robots: dict[str, Robot] = {
            name: robot.derated(file.arms[name].limits) for name, (robot, _) in loaded.items()
        }
        mounted = {name: gripper for name, (_, gripper) in loaded.items() if gripper is not None}
        self.arms: dict[str, ArmBody] = {}
        self.objects: dict[str, ObjectSpec] = {}
        self.before_removal: list[Callable[[str], None]] = []
        self.generation = 0
        self.devices = Devices(file, self.robots, mounted, seed)
        self.hardware = self.devices.hardware
        self.nominal = self.devices.nominal
        self.grippers = self.devices.grippers
        self.on_forces: list[Callable[[], None]] = [self.devices.update_friction]
        self._spec = composition.scene_spec(file.world, file.root)
        if mounted:
            self.on_forces.append(self.devices.move_held_objects)
            composition.copy_contact_options(self._spec)
        check_declarations(file, self.robots, composition.names_in(self._spec))
        self.attachments = Attachments(self._spec, self._recompile, self._take_up)
        self._compile_first()

    def step(self) -> None:
        """Advance by one physics step; positions, contacts and inertias are then those of now.

        Raises:
            DivergenceError: A torque or the state is not finite, or time did not advance.
        """
        self.devices.drive()
        time = self._stepping.advance(self.on_forces)
        self.devices.sense(time)

    def sense(self) -> None:
        """Read all sensors; `step` does so at its end."""
        self.devices.sense(self.data.time)

    def overlaps(self) -> Iterator[OverlapError]:
        """Each arm or object that is inside another object now; of two in each other the first."""
        said: set[tuple[str, str]] = set()
        for kind, names in (("arm", self.arms), ("object", self.objects)):
            for name in names:
                inside = deepest_overlap(self.model, self.data, name)
                if inside is not None and (inside[0].partition("/")[0], name) not in said:
                    said.add((name, inside[0].partition("/")[0]))
                    yield overlap_error(kind, name, *inside)

    def refuse_overlaps(self) -> None:
        """Raise an `OverlapError` if an arm or object is inside another object at the start."""
        for error in self.overlaps():
            raise error

    def spawn_arm(self, name: str) -> None:
        """Add a declared arm in its initial posture.

        Raises:
            WorldError: Not declared, present already, or something is in its place.
        """
        must_be_among(name, self._file.arms, "arm", "declared")
        if name in self.arms:
            raise WorldError(f"arm {name!r} is present already")
        self._add_arm(name)
        self._recompile()
        self._take_posture(name)
        self._look_again()
        inside = deepest_overlap(self.model, self.data, name)
        if inside is not None:
            self.remove_arm(name)
            raise overlap_error("arm", name, *inside)

    def remove_arm(self, name: str) -> None:
        """Take an arm away; what it held falls.

        Raises:
            WorldError: The arm is not present.
        """
        must_be_among(name, self.arms, "arm", "in the world")
        for notify in self.before_removal:
            notify(name)
        if name not in self.arms:  # who was told has taken it away
            return
        self.attachments.forget(name)
        composition.remove_arm(self._spec, name, self.robots[name])
        del self.arms[name]
        self.devices.remove(name)
        self._recompile()

    def spawn_object(self, name: str, pose: Pose | None = None) -> None:
        """Add a declared object at rest, at its declared pose or at ``pose``.

        Raises:
            WorldError: Not declared, present already, or something is in its place.
        """
        must_be_among(name, self._file.objects, "object", "declared")
        if name in self.objects:
            raise WorldError(f"object {name!r} is present already")
        self._put_object(name, pose or self._poses[name])
        self._recompile()
        inside = deepest_overlap(self.model, self.data, name)
        if inside is not None:
            self.remove_object(name)
            raise overlap_error("object", name, *inside)

    def remove_object(self, name: str) -> None:
        """Take an object away, out of any arm's hold.

        Raises:
            WorldError: The object is not present.
        """
        must_be_among(name, self.objects, "object", "in the world")
        self.attachments.forget(name)
        self._spec.delete(self._spec.body(name))
        del self.objects[name]
        self._recompile()

    def restore(self, state: Vector) -> None:
        """Go back to a state of the same generation, bit for bit; drives keep theirs."""
        mujoco.mj_setState(self.model, self.data, state, mujoco.mjtState.mjSTATE_INTEGRATION)
        self._look_again()

    def _compile_first(self) -> None:
        """What does not move comes first: the arms' bases may stand on it."""
        self._add_objects(fixed=True)
        self._compile()
        self._surfaces: dict[str, MountingSurface | None] = {
            name: surface_below(self.model, self.data, arm.base.pose)
            for name, arm in self._file.arms.items()
        }
        self._add_objects(fixed=False)
        for name, arm in self._file.arms.items():
            if arm.spawned:
                self._add_arm(name)
        self._compile()
        self._bind()
        for name in self.arms:
            self._take_posture(name)
        self._look_again()

    def _add_objects(self, *, fixed: bool) -> None:
        for name, thing in self._file.objects.items():
            if thing.spawned and thing.fixed == fixed:
                self._put_object(name, self._poses[name])

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
        """Take up changes of the spec; the state of everything that stays is kept."""
        try:
            self.model, self.data = self._spec.recompile(self.model, self.data)
        except ValueError as error:
            raise WorldError(f"MuJoCo cannot recompile the world: {error}") from error
        self._take_up()

    def _take_up(self) -> None:
        """Let everybody look again at what there is, and at who holds what."""
        self.generation += 1
        self._bind()
        self._look_again()

    def _look_again(self) -> None:
        """Bring up to date what hangs on the state, and read the sensors."""
        self.devices.update_friction()
        mujoco.mj_step1(self.model, self.data)
        self.sense()

    def _bind(self) -> None:
        plant = self.model, self.data
        self._stepping = Stepping(*plant)
        self.arms = {
            name: ArmBody.find(name, self.robots[name], self._file.arms[name].base.pose, *plant)
            for name in self.arms
        }
        self.devices.connect(plant, self.arms, self.attachments, self.objects)

    def _add_arm(self, name: str) -> None:
        arm = self._file.arms[name]
        robot = self.robots[name]
        drawn = self.devices.sampled[name]
        surface = self._surfaces[name]
        visuals = self._visuals
        gripper = self.devices.mounted.get(name)
        composition.add_arm(
            self._spec, name, arm, robot, drawn, gripper, surface=surface, visuals=visuals
        )
        self.devices.add(name, self._spec.option)
        self.arms[name] = None  # type: ignore[assignment]  # bound when the model is compiled

    def _take_posture(self, name: str) -> None:
        """Put an arm that has just come into its initial posture: before its first step only."""
        posture = self.robots[name].postures[self._file.arms[name].posture]
        self.data.qpos[self.arms[name].qpos_ids] = posture
        self.devices.open_gripper(name)
