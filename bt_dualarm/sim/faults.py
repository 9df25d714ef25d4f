"""Faults of hardware and world, injected into the simulation at exact physics steps.

Skills and controllers are not informed of anything here: a frozen joint is dry friction that no
drive can overcome, a weak one is a smaller gain of its motor, a stuck encoder repeats a reading.
They notice from their sensors, or not at all.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from functools import reduce
from typing import Any, Final

import mujoco
import numpy as np

from bt_dualarm.core.pose import Pose
from bt_dualarm.core.share import weakly
from bt_dualarm.sim.arm_models import random_stream
from bt_dualarm.sim.camera import CameraDisturbance
from bt_dualarm.sim.devices import STIFF
from bt_dualarm.sim.world import World
from bt_dualarm.spec.faults import (
    CAMERA_FAULTS,
    AbsentPartner,
    DarkCamera,
    FaultEvent,
    FaultSpec,
    FrozenCamera,
    FrozenJoint,
    LateCamera,
    LeafFault,
    LooseJoint,
    NoPlan,
    PushedObject,
    ReducedFriction,
    RemovedObject,
    SaturatedDrive,
    ShakingCamera,
    StuckEncoder,
    SwappedObject,
    WeakJoint,
)

_TOLERANCE_S: Final = 1e-9

_LOCK: Final = 100.0
"""Dry friction of a frozen joint, in effort limits: no drive and no load turns it."""

_AWAY_M: Final = (50.0, 5.0)
"""Height at which removed objects are kept, and their distance: out of sight and reach."""

_CONDIM_WITH_TORSION: Final = 4

_Reading = Callable[[float], float]


class WorldFaults:
    """Starts and ends the faults of hardware and world, planner and partners, of one run.

    Whether a fault happens at all is drawn with the run's seed and the fault's name.

    Args:
        world: World of the run.
        faults: Faults by name; those of leaves are ignored.
        seed: Seed of the run.
        report: Receives the start and the end of each fault.
    """

    def __init__(
        self,
        world: World,
        faults: Mapping[str, FaultSpec],
        seed: int,
        report: Callable[[FaultEvent], None],
    ) -> None:
        self._world = world
        self._report = report
        self._waiting = {
            name: one
            for name, one in faults.items()
            if not isinstance(one, LeafFault)
            and random_stream(seed, f"fault:{name}").random() < one.probability
        }
        self._active: dict[str, FaultSpec] = {}
        self._cameras = {
            one.arm: CameraDisturbance(rng=random_stream(seed, f"{one.arm}:shaking"))
            for one in faults.values()
            if isinstance(one, CAMERA_FAULTS)
        }
        self._generation = world.generation
        self._written: list[tuple[Any, Any, Any]] = []
        self._locked: list[tuple[int, float]] = []
        self._readings: dict[str, _Reading] = {}
        self._pushed: set[str] = set()
        self._away: dict[str, Pose] = {}
        self._loosened: dict[tuple[str, str], float] = {}
        if self._waiting:
            world.on_forces.append(weakly(self._lock_again))

    @property
    def is_idle(self) -> bool:
        """Whether no fault is active or to come."""
        return not (self._waiting or self._active or self._loosened)

    def camera(self, arm: str) -> CameraDisturbance | None:
        """What faults do to the camera of an arm; None if the file has none for it."""
        return self._cameras.get(arm)

    def no_plan(self, arm: str) -> str:
        """Name of the fault by which the planner finds no path for an arm; empty for none."""
        return self._active_on(arm, NoPlan)

    def is_absent(self, arm: str) -> bool:
        """Whether the tree of an arm does not tick."""
        return bool(self._active_on(arm, AbsentPartner))

    def takes_away(self, name: str) -> str:
        """Name of the fault that has taken an object away; empty if none has."""
        found = (
            n
            for n, one in self._active.items()
            if isinstance(one, RemovedObject) and one.object == name
        )
        return next(found, "")

    def _active_on(self, arm: str, kind: type[FaultSpec]) -> str:
        found = (
            n for n, one in self._active.items() if isinstance(one, kind) and one.on_arm == arm
        )
        return next(found, "")

    def update(self) -> None:
        """Start and end what is due; called before each physics step."""
        if self.is_idle:
            return
        time = self._world.time
        ended = [n for n, one in self._active.items() if one.until <= time + _TOLERANCE_S]
        begun = [n for n, one in self._waiting.items() if one.begin <= time + _TOLERANCE_S]
        if ended or begun or self._generation != self._world.generation:
            self._restore()
            for name in ended:
                self._end(name, self._active.pop(name), time)
            for name in begun:
                self._begin(name, self._waiting.pop(name), time)
            self._apply()
            # Contacts and constraints of the next step follow the new parameters and poses.
            mujoco.mj_step1(self._world.model, self._world.data)
        self._hold()

    def _begin(self, name: str, fault: FaultSpec, time: float) -> None:
        self._active[name] = fault
        if isinstance(fault, SwappedObject):
            self._exchange(fault.object, fault.other)
        elif isinstance(fault, StuckEncoder):
            self._readings[name] = _Stuck()
        elif isinstance(fault, LooseJoint):
            self._readings[name] = _Play(0.5 * math.radians(fault.play))
        self._report(self._event(name, fault, time, is_active=True))

    def _end(self, name: str, fault: FaultSpec, time: float) -> None:
        if isinstance(fault, SwappedObject):
            self._exchange(fault.object, fault.other)
        elif isinstance(fault, RemovedObject) and fault.object in self._away:
            pose = self._away.pop(fault.object)
            if fault.object in self._world.objects:
                self._put(fault.object, pose)
        self._readings.pop(name, None)
        self._report(self._event(name, fault, time, is_active=False))

    def _event(self, name: str, fault: FaultSpec, time: float, *, is_active: bool) -> FaultEvent:
        objects = tuple(
            str(getattr(fault, field)) for field, noun in fault.refers.items() if noun == "object"
        )
        return FaultEvent(
            time, name, fault.kind, fault.on_arm, fault.sentence, is_active, objects=objects
        )

    # Parameters of the model: written again whenever the set of active faults or the model changes,
    # so that overlapping faults cannot restore each other's values.

    def _restore(self) -> None:
        """Restore the parameters of the model; those of an earlier model are gone."""
        if self._generation == self._world.generation:
            for array, index, old in reversed(self._written):
                array[index] = old
        self._generation = self._world.generation
        self._written.clear()
        self._locked.clear()
        for name in self._pushed & self._world.objects.keys():
            self._world.data.xfrc_applied[self._world.object_body(name)] = 0.0
        self._pushed.clear()

    def _write(
        self,
        array: Any,  # field of MuJoCo's model or data, of any type and shape
        index: Any,  # whatever such an array takes as one
        value: Any,  # what NumPy casts to its type
    ) -> None:
        self._written.append((array, index, np.copy(array[index])))
        array[index] = value

    def _apply(self) -> None:
        world = self._world
        for fault in self._active.values():
            if isinstance(fault, (FrozenJoint, WeakJoint, SaturatedDrive)):
                if fault.arm in world.arms:
                    self._impair(fault)
            elif isinstance(fault, ReducedFriction) and fault.object in world.objects:
                self._make_slippery(fault)
            elif isinstance(fault, PushedObject) and fault.object in world.objects:
                world.data.xfrc_applied[world.object_body(fault.object), :3] += fault.force
                self._pushed.add(fault.object)
        self._disturb_cameras()
        self._alter_encoders()

    def _impair(self, fault: FrozenJoint | WeakJoint | SaturatedDrive) -> None:
        """Change the motor or the friction of a joint."""
        model = self._world.model
        robot = self._world.robots[fault.arm]
        body = self._world.arms[fault.arm]
        index = robot.joints.index(fault.joint)
        effort = float(robot.limits.effort[index])
        motor = int(body.actuator_ids[index])
        if isinstance(fault, WeakJoint):
            gain = float(model.actuator_gainprm[motor, 0])
            self._write(model.actuator_gainprm, (motor, 0), fault.strength * gain)
        elif isinstance(fault, SaturatedDrive):
            most = fault.limit * effort
            self._write(model.actuator_forcelimited, motor, 1)
            self._write(model.actuator_forcerange, motor, (-most, most))
        else:
            dof = int(body.dof_ids[index])
            self._write(model.dof_frictionloss, dof, _LOCK * effort)
            self._write(model.dof_solref, dof, STIFF[0])
            self._write(model.dof_solimp, (dof, slice(0, 2)), STIFF[1])
            self._locked.append((dof, _LOCK * effort))

    def _lock_again(self) -> None:
        """Keep joints frozen: the friction model sets their friction in each step."""
        for dof, level in self._locked:
            if self._generation == self._world.generation:
                self._world.model.dof_frictionloss[dof] = level

    def _make_slippery(self, fault: ReducedFriction) -> None:
        """Let the object's friction count in each of its contacts, not the larger of the two."""
        for geom in self._world.object_geoms(fault.object):
            self._reduce_friction(geom, fault)

    def _reduce_friction(self, geom: int, fault: ReducedFriction) -> None:
        model = self._world.model
        _, torsion, rolling = model.geom_friction[geom]
        share = min(1.0, fault.friction / max(float(model.geom_friction[geom, 0]), 1e-9))
        self._write(model.geom_friction, geom, (fault.friction, share * torsion, share * rolling))
        self._write(model.geom_priority, geom, 1)
        # The contacts of a geom with priority have its dimension; pads need torsion.
        most = max(int(model.geom_condim[geom]), _CONDIM_WITH_TORSION)
        self._write(model.geom_condim, geom, most)

    def _disturb_cameras(self) -> None:
        for arm, camera in self._cameras.items():
            mine = [one for one in self._active.values() if one.on_arm == arm]
            camera.is_frozen = any(isinstance(one, FrozenCamera) for one in mine)
            camera.brightness = math.prod(
                one.brightness for one in mine if isinstance(one, DarkCamera)
            )
            camera.delay = sum(one.delay for one in mine if isinstance(one, LateCamera))
            camera.shake = math.hypot(
                *(math.radians(one.angle) for one in mine if isinstance(one, ShakingCamera))
            )

    def _alter_encoders(self) -> None:
        # Those of removed arms are sound, so that an arm that is spawned again is not impaired by a
        # fault that has ended meanwhile.
        by_joint: dict[tuple[str, int], list[_Reading]] = {
            (arm, index): []
            for arm, robot in self._world.robots.items()
            for index in range(robot.dof)
        }
        for name, reading in self._readings.items():
            fault = self._active[name]
            if isinstance(fault, (StuckEncoder, LooseJoint)) and fault.arm in self._world.arms:
                index = self._world.robots[fault.arm].joints.index(fault.joint)
                by_joint[fault.arm, index].append(reading)
        for (arm, index), readings in by_joint.items():
            self._world.devices.alter_encoder(arm, index, _chained(readings))

    # Objects

    def _hold(self) -> None:
        """Keep removed objects away, and welds to moved objects loose."""
        world = self._world
        for fault in self._removals():
            if fault.object not in self._away:
                self._away[fault.object] = world.object_pose(fault.object)
                self._loosen(fault.object)
            number = list(self._away).index(fault.object)
            self._place(fault.object, Pose.from_rpy((0.0, 0.0, _AWAY_M[0] + number * _AWAY_M[1])))
        for (arm, obj), since in self._loosened.items():
            held = world.attachments.find(arm, obj)
            if held is not None and held.since == since:
                world.data.eq_active[world.model.equality(held.name).id] = 0

    def _removals(self) -> Iterator[RemovedObject]:
        for fault in self._active.values():
            if isinstance(fault, RemovedObject) and fault.object in self._world.objects:
                yield fault

    def _exchange(self, one: str, other: str) -> None:
        """Let two objects change places, each with its lowest point where that of the other was."""
        world = self._world
        if one not in world.objects or other not in world.objects:
            return
        poses = {name: world.object_pose(name) for name in (one, other)}
        down = np.array((0.0, 0.0, -1.0))
        for name, goal in ((one, other), (other, one)):
            lowest = world.surface_point(goal, down, poses[goal])[2]
            lift = lowest - world.surface_point(name, down, poses[goal])[2]
            self._put(name, Pose(poses[goal].position - lift * down, poses[goal].quaternion))

    def _put(self, name: str, pose: Pose) -> None:
        """Put an object somewhere else, at rest; an arm that holds it does not follow."""
        self._loosen(name)
        self._place(name, pose)

    def _place(self, name: str, pose: Pose) -> None:
        world = self._world
        address = world.pose_address(name)
        joint = int(world.model.body_jntadr[world.object_body(name)])
        speed = int(world.model.jnt_dofadr[joint])
        world.data.qpos[address : address + 7] = (*pose.position, *pose.quaternion)
        world.data.qvel[speed : speed + 6] = 0.0

    def _loosen(self, name: str) -> None:
        """Open the welds of an object, without the knowledge of the arms that hold it."""
        for held in self._world.attachments:
            if held.object == name and not held.by_gripper:
                self._loosened[held.arm, name] = held.since


class _Stuck:
    """Reading of an encoder that repeats its last one."""

    def __init__(self) -> None:
        self._held: float | None = None

    def __call__(self, position: float) -> float:
        if self._held is None:
            self._held = position
        return self._held


class _Play:
    """Reading of an encoder behind a play: it follows once the link has crossed the play.

    The play operator of G. Tao and P. V. Kokotovic, Adaptive Control of Systems with Actuator and
    Sensor Nonlinearities, 1996.

    Args:
        half: Half of the play, rad.
    """

    def __init__(self, half: float) -> None:
        self._half = half
        self._held: float | None = None

    def __call__(self, position: float) -> float:
        held = position if self._held is None else self._held
        self._held = min(max(held, position - self._half), position + self._half)
        return self._held


def _chained(readings: list[_Reading]) -> _Reading | None:
    if not readings:
        return None
    return lambda position: reduce(lambda value, reading: reading(value), readings, position)
