"""The simulated world: one MuJoCo model whose arms and objects come and go while it runs.

The world keeps an `mujoco.MjSpec` and recompiles it whenever something is added or removed; MuJoCo
carries over the state of everything that stays. `generation` counts recompilations: code that keeps
indices or views of ``model`` and ``data`` must look them up again when it changes.
"""

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

# Physics step

_MAX_SPEED = 1e4  # rad/s or m/s: no valid state comes near it


class Stepping:
    """Steps one compiled model and detects divergence.

    Args:
        model: Compiled world.
        data: Its state.
    """

    def __init__(self, model: mujoco.MjModel, data: mujoco.MjData) -> None:
        self._model = model
        self._data = data
        # Views: an attribute lookup on mjData costs more than the arithmetic on it.
        self._ctrl = data.ctrl
        self._qvel = data.qvel
        self._qpos = data.qpos

    def advance(self, between: Iterable[Callable[[], None]] = ()) -> float:
        """Advance by one step and bring positions, contacts and inertias up to date.

        ``mj_step`` leaves the derived quantities at the state before the step, 2 ms old. Calling
        its two halves in reverse order (``mj_step2``, then ``mj_step1``) avoids that.

        Args:
            between: Functions called between the halves: velocities are new, while contacts and
                their forces are still those of the step.

        Returns:
            Simulated time in s.

        Raises:
            DivergenceError: A torque or the state is not finite, or time did not advance.
        """
        model = self._model
        data = self._data
        ctrl = self._ctrl
        if not math.isfinite(ctrl.dot(ctrl)):  # MuJoCo would replace all controls by zero
            raise DivergenceError(_divergence(model, data, "has a command that is not finite"))
        before = data.time
        mujoco.mj_step2(model, data)
        qvel = self._qvel
        qpos = self._qpos
        # A dot product costs a tenth of a test of each element.
        if not (qvel.dot(qvel) < _MAX_SPEED**2 and math.isfinite(qpos.dot(qpos))):
            raise DivergenceError(
                _divergence(model, data, "moves impossibly fast or has a state that is not finite")
            )
        for callback in between:
            callback()
        mujoco.mj_step1(model, data)
        now: float = data.time
        if now <= before:
            raise DivergenceError(f"simulated time went from {before} s back to {now} s")
        return now


def _divergence(model: mujoco.MjModel, data: mujoco.MjData, what: str) -> str:
    return f"the simulation diverged at {data.time:.3f} s: {_culprit(model, data)} {what}"


def _culprit(model: mujoco.MjModel, data: mujoco.MjData) -> str:
    """Name the actuator or joint with a non-finite value, else the fastest joint."""
    if not np.isfinite(data.ctrl).all():
        actuator = int(np.argmin(np.isfinite(data.ctrl)))
        is_joint = model.actuator_trntype[actuator] == mujoco.mjtTrn.mjTRN_JOINT  # else a gripper
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


def deepest_overlap(
    model: mujoco.MjModel, data: mujoco.MjData, name: str
) -> tuple[str, float] | None:
    """Find the deepest penetration of an arm or object into another.

    Args:
        model: Compiled model.
        data: Its state, with current contacts.
        name: Name of the arm or object.

    Returns:
        Name of the other and the depth in m; None if no depth exceeds ``MAX_DEPTH``.
    """
    worst = None
    for geoms, distance in zip(data.contact.geom.tolist(), data.contact.dist, strict=True):
        names = [name_of_geom(model, geom) for geom in geoms]
        own = [part == name or part.startswith(f"{name}/") for part in names]
        if own[0] != own[1] and -distance > max(MAX_DEPTH, worst[1] if worst else 0.0):
            worst = names[own.index(False)], float(-distance)
    return worst


def overlap_error(kind: str, name: str, other: str, depth: float) -> OverlapError:
    """Error for an arm or object (``kind``) that would penetrate another by ``depth`` in m."""
    return OverlapError(name, f"{kind} {name!r} would be {1000 * depth:.0f} mm deep in {other}")


_log = logging.getLogger(__name__)


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
        declared_objects: Every object of the file, likewise.
        robots: Robot of each declared arm, with its gripper mounted.
        generation: Number of recompilations so far.
        devices: Hardware, grippers and nominal model of each arm that is present.

    Raises:
        CatalogError: A robot or scene is unknown or broken.
        WorldError: The parts do not compile to one world.
    """

    def __init__(self, file: TreeFile, seed: int = 0, *, visuals: bool = False) -> None:
        mujoco.set_mju_user_warning(_log.warning)  # by default MuJoCo writes MUJOCO_LOG.TXT
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
            composition.set_grasp_contact_options(self._spec)
        check_declarations(file, self.robots, composition.names_in(self._spec))
        self.attachments = Attachments(self._spec, self._recompile, self._rebind)
        self._compile_first()

    def step(self) -> None:
        """Advance by one physics step; positions, contacts and inertias are up to date afterwards.

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
        """Yield one error for each pair of arms or objects that penetrate each other."""
        reported: set[tuple[str, str]] = set()
        for kind, names in (("arm", self.arms), ("object", self.objects)):
            for name in names:
                inside = deepest_overlap(self.model, self.data, name)
                if inside is not None and (inside[0].partition("/")[0], name) not in reported:
                    reported.add((name, inside[0].partition("/")[0]))
                    yield overlap_error(kind, name, *inside)

    def refuse_overlaps(self) -> None:
        """Raise an `OverlapError` if any arm or object penetrates another."""
        for error in self.overlaps():
            raise error

    def spawn_arm(self, name: str) -> None:
        """Add a declared arm in its initial posture.

        Raises:
            WorldError: Not declared, present already, or its place is taken.
        """
        must_be_among(name, self._file.arms, "arm", "declared")
        if name in self.arms:
            raise WorldError(f"arm {name!r} is present already")
        self._add_arm(name)
        self._recompile()
        self._set_initial_posture(name)
        self._refresh()
        inside = deepest_overlap(self.model, self.data, name)
        if inside is not None:
            self.remove_arm(name)
            raise overlap_error("arm", name, *inside)

    def remove_arm(self, name: str) -> None:
        """Remove an arm; the objects that it held fall.

        Raises:
            WorldError: The arm is not present.
        """
        must_be_among(name, self.arms, "arm", "in the world")
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
            WorldError: Not declared, present already, or its place is taken.
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
        """Remove an object, even one that an arm holds.

        Raises:
            WorldError: The object is not present.
        """
        must_be_among(name, self.objects, "object", "in the world")
        self.attachments.forget(name)
        self._spec.delete(self._spec.body(name))
        del self.objects[name]
        self._recompile()

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
        for name, arm in self._file.arms.items():
            if arm.spawned:
                self._add_arm(name)
        self._compile()
        self._bind()
        for name in self.arms:
            self._set_initial_posture(name)
        self._refresh()

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
        """Compile the changed spec, keeping the state of everything that stays."""
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

    def _refresh(self) -> None:
        """Update everything derived from the state, and read the sensors."""
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
        sampled = self.devices.sampled[name]
        surface = self._surfaces[name]
        visuals = self._visuals
        gripper = self.devices.mounted.get(name)
        composition.add_arm(
            self._spec, name, arm, robot, sampled, gripper, surface=surface, visuals=visuals
        )
        self.devices.add(name, self._spec.option)
        self.arms[name] = None  # type: ignore[assignment]  # bound when the model is compiled

    def _set_initial_posture(self, name: str) -> None:
        """Put an arm that was just added into its initial posture, before its first step."""
        posture = self.robots[name].postures[self._file.arms[name].posture]
        self.data.qpos[self.arms[name].qpos_ids] = posture
        self.devices.open_gripper(name)
