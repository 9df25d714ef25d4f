"""One MuJoCo world with arms and objects that come and go while it runs."""

from __future__ import annotations

import logging
import math
from collections.abc import Callable, Iterable, Iterator, Mapping

import mujoco
import numpy as np

from bt_dualarm.core.errors import DivergenceError, OverlapError, WorldError
from bt_dualarm.core.pose import Pose, Vector
from bt_dualarm.core.share import weakly
from bt_dualarm.robots.gripper_mjspec import load_arm
from bt_dualarm.robots.robot import Robot
from bt_dualarm.sim import composition
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
from bt_dualarm.sim.world_view import Attachments, Devices, HoldingView
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


def overlap(model: mujoco.MjModel, data: mujoco.MjData, name: str) -> tuple[str, float] | None:
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


def no_room(kind: str, name: str, other: str, depth: float) -> OverlapError:
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
        equipment: Hardware, grippers and nominal model of each arm that is present, by name.

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
        self.equipment = Devices(file, self.robots, mounted, seed)
        self.hardware = self.equipment.hardware
        self.nominal = self.equipment.nominal
        self.grippers = self.equipment.grippers
        self.on_forces: list[Callable[[], None]] = [self.equipment.rub]
        self._spec = composition.scene_spec(file.world, file.root)
        if mounted:
            self.on_forces.append(self.equipment.carry)
            composition.copy_contact_options(self._spec)
        check_declarations(file, self.robots, composition.names_in(self._spec))
        self.attachments = Attachments(self._spec, self._recompile, self._take_up)
        self._compile_first()

    def step(self) -> None:
        """Advance by one physics step; positions, contacts and inertias are then those of now.

        Raises:
            DivergenceError: A torque or the state is not finite, or time did not advance.
        """
        self.equipment.drive()
        time = self._stepping.advance(self.on_forces)
        self.equipment.sense(time)

    def sense(self) -> None:
        """Read all sensors; `step` does so at its end."""
        self.equipment.sense(self.data.time)

    def overlaps(self) -> Iterator[OverlapError]:
        """Each arm or object that is inside another object now; of two in each other the first."""
        said: set[tuple[str, str]] = set()
        for kind, names in (("arm", self.arms), ("object", self.objects)):
            for name in names:
                inside = overlap(self.model, self.data, name)
                if inside is not None and (inside[0].partition("/")[0], name) not in said:
                    said.add((name, inside[0].partition("/")[0]))
                    yield no_room(kind, name, *inside)

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
        inside = overlap(self.model, self.data, name)
        if inside is not None:
            self.remove_arm(name)
            raise no_room("arm", name, *inside)

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
        self.equipment.remove(name)
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
        inside = overlap(self.model, self.data, name)
        if inside is not None:
            self.remove_object(name)
            raise no_room("object", name, *inside)

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
        add_object(self._spec, name, thing, pose, self.equipment.drawn_object(name))

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
        self.equipment.rub()
        mujoco.mj_step1(self.model, self.data)
        self.sense()

    def _bind(self) -> None:
        plant = self.model, self.data
        self._stepping = Stepping(*plant)
        self.arms = {
            name: ArmBody.find(name, self.robots[name], self._file.arms[name].base.pose, *plant)
            for name in self.arms
        }
        self.equipment.connect(plant, self.arms, self.attachments, self.objects)

    def _add_arm(self, name: str) -> None:
        arm = self._file.arms[name]
        robot = self.robots[name]
        drawn = self.equipment.drawn[name]
        surface = self._surfaces[name]
        visuals = self._visuals
        gripper = self.equipment.mounted.get(name)
        composition.add_arm(
            self._spec, name, arm, robot, drawn, gripper, surface=surface, visuals=visuals
        )
        self.equipment.add(name, self._spec.option)
        self.arms[name] = None  # type: ignore[assignment]  # bound when the model is compiled

    def _take_posture(self, name: str) -> None:
        """Put an arm that has just come into its initial posture: before its first step only."""
        posture = self.robots[name].postures[self._file.arms[name].posture]
        self.data.qpos[self.arms[name].qpos_ids] = posture
        self.equipment.open_gripper(name)


# True contacts of the arms and their forces, for scoring only.
#
# No arm senses these. An arm senses a contact only by a joint that lags behind its set-point, is
# too fast, or needs more than its effort; its motions fail by that alone.


_NOBODY = -1


class ContactMonitor:
    """What one arm touches from now on, what it touches already and what it holds aside.

    Args:
        arm: Name of the arm.
        already: Names of the objects that it touches when the watch begins.

    Attributes:
        forces_n: Largest normal force of a contact, by the name of the object, N.
    """

    def __init__(self, arm: str, already: frozenset[str]) -> None:
        self.arm = arm
        self.forces_n: dict[str, float] = {}
        self._already = already

    def note(self, thing: str, force_n: float) -> None:
        """Take up one contact."""
        if thing not in self._already and force_n > self.forces_n.get(thing, 0.0):
            self.forces_n[thing] = force_n


class Contacts:
    """Looks at the contacts of a world in each of its steps, for those who watch.

    After a step MuJoCo has found the contacts of now, and has no forces for them yet.

    Args:
        world: World whose arms and objects may come and go.
    """

    def __init__(self, world: World) -> None:
        self._world = world
        self._watches: list[ContactMonitor] = []
        self._generation = -1
        world.on_forces.append(weakly(self._look))

    def watch(self, arm: str) -> ContactMonitor:
        """Begin to watch an arm that is in the world."""
        watch = ContactMonitor(
            arm, frozenset(thing for one, thing, _ in self._touching() if one == arm)
        )
        self._watches.append(watch)
        return watch

    def end(self, watch: ContactMonitor) -> None:
        """Watch no more; harmless when that has ended."""
        self._watches = [one for one in self._watches if one is not watch]

    def _look(self) -> None:
        """Take up what was touched in this step."""
        if not self._watches:
            return
        for arm, thing, force in self._touching():
            for watch in self._watches:
                if watch.arm == arm:
                    watch.note(thing, force)

    def _touching(self) -> list[tuple[str, str, float]]:
        """Arm, object and normal force in N of each contact of an arm with what is not its own."""
        model = self._world.model
        data = self._world.data
        if not data.ncon:
            return []
        if self._generation != self._world.generation:
            self._bind()
        geoms = data.contact.geom
        if not self._meets(geoms, self._owner, self._holder):
            return []
        owners = self._owner[geoms]
        holders = self._holder[geoms]
        strange = (owners[:, 0] != owners[:, 1]) & (owners.max(axis=1) != _NOBODY)
        strange &= data.contact.dist <= 0.0  # a cup's lip feels what is near, too
        strange &= (holders[:, 0] != owners[:, 1]) & (holders[:, 1] != owners[:, 0])
        found = []
        force = np.empty(6)
        for i in np.flatnonzero(strange).tolist():
            mujoco.mj_contactForce(model, data, i, force)
            for mine, other in ((0, 1), (1, 0)):
                arm = self._arms[owners[i, mine]]
                thing = name_of_geom(model, int(geoms[i, other])).partition("/")[0]
                if owners[i, mine] != _NOBODY and thing != arm:  # its pedestal bears its name
                    found.append((arm, thing, float(force[0])))
        return found

    def _bind(self) -> None:
        """Look up whose the shapes are, and who holds what."""
        from bt_dualarm.sim.device_kernels import any_unrequested

        world = self._world
        self._meets = any_unrequested
        self._generation = world.generation
        self._arms = tuple(world.arms)
        self._owner = np.full(world.model.ngeom, _NOBODY)
        self._holder = np.full(world.model.ngeom, _NOBODY - 1)
        for index, body in enumerate(world.arms.values()):
            self._owner[list(body.geom_ids)] = index
        for held in world.attachments:
            self._holder[world.object_geom(held.object)] = self._arms.index(held.arm)


def warm_up_contacts() -> None:
    """Have all kernels of contacts compiled."""
    from bt_dualarm.sim.device_kernels import any_unrequested

    pairs = np.zeros((4, 2), np.int32)
    numbers = np.zeros(1, np.int64)
    for one in (pairs, pairs[::2]):  # a single contact lies in one piece, several do not
        any_unrequested(one, numbers, numbers)
