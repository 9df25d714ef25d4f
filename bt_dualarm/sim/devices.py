"""Sensors, drives and joint friction of all arms.

`DeviceBank` keeps them in common arrays, one row per joint, so that one kernel call per physics
step serves all arms. `ArmHardware` is one arm's interface to its controller.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache
from itertools import accumulate, pairwise
from types import ModuleType
from typing import Any, Final, Protocol

import mujoco
import numpy as np
import numpy.typing as npt

from bt_dualarm.core.pose import Matrix, Vector
from bt_dualarm.robots.robot import JointFriction
from bt_dualarm.sim.arm_models import SampledArm, random_stream
from bt_dualarm.sim.kernel_arrays import (
    COMMANDED,
    COULOMB,
    COUNT,
    COUNTS,
    CREEP,
    DRIVE,
    DRIVES,
    DROP,
    EFFORT,
    ENCODERS,
    FINGER_NUMBERS,
    FINGER_READINGS,
    FRICTION,
    GAIN,
    LATE,
    NARROW,
    NEW_WEIGHT,
    OFFSET,
    OLD_WEIGHT,
    PER_STEP,
    RESOLUTION,
    RISE,
    SHARE,
    TORQUE,
    VISCOUS,
    WHOLE,
    WINDOW,
)
from bt_dualarm.spec.document import DriveErrors, EncoderErrors, RealityErrors

# Indices of an arm's joints


class PlantArm(Protocol):
    """Addresses of an arm in the arrays of the plant."""

    @property
    def model(self) -> mujoco.MjModel:
        """The plant."""

    @property
    def data(self) -> mujoco.MjData:
        """State of the plant."""

    @property
    def qpos_ids(self) -> npt.NDArray[np.int64]:
        """Addresses of the joints' positions, base to tip, of shape (dof,)."""

    @property
    def dof_ids(self) -> npt.NDArray[np.int64]:
        """Addresses of the joints' velocities, in the same order."""

    @property
    def actuator_ids(self) -> npt.NDArray[np.int64]:
        """Addresses of the motors' torques, in the same order."""


def parts_of(dofs: Mapping[str, int]) -> dict[str, slice]:
    """Slice of each arm in arrays with the joints of all arms.

    Args:
        dofs: Number of joints of each arm, by name.
    """
    ends = accumulate(dofs.values(), initial=0)
    return {name: slice(*part) for name, part in zip(dofs, pairwise(ends), strict=True)}


def count_of(parts: Mapping[str, slice]) -> int:
    """Number of joints of all arms together."""
    return max((part.stop for part in parts.values()), default=0)


def joints_of(
    arms: Mapping[str, PlantArm],
    parts: Mapping[str, slice],
    *addresses: Callable[[PlantArm], npt.NDArray[np.int64]],
) -> npt.NDArray[np.int64]:
    """Index table of the joints of some arms.

    Args:
        arms: Arms of the plant, by name.
        parts: Slice of each arm among the joints of all arms.
        addresses: Functions that return an arm's addresses in the plant.

    Returns:
        For each joint its index among all joints, and its addresses, (k, 1 + len(addresses)).
    """
    rows = [
        np.stack((np.arange(parts[name].start, parts[name].stop), *(of(arm) for of in addresses)))
        for name, arm in arms.items()
    ]
    none = np.zeros((1 + len(addresses), 0), dtype=np.int64)
    return np.ascontiguousarray(np.concatenate((none, *rows), axis=1).T, dtype=np.int64)


# Encoders

KEPT_S: Final = 0.25
"""Seconds for which readings are kept, for images with late or early time stamps."""

_NOISE_BATCH = 512
"""Readings per batch of noise: drawing it one by one would dominate the cost of a reading."""


class Encoders:
    """Reads the joints of all present arms, once per physics step, in one call.

    An encoder quantizes a noisy position; the velocity is differenced and low-pass filtered.

    Args:
        errors: Resolution, noise and velocity filter, by arm.
        parts: Columns of each arm's joints among those of all.
        timestep: Seconds between two readings.

    Attributes:
        stamp: Time of the last reading in s.
        readings: Positions and velocities, of shape (2, n), rad and rad/s; a new array with each
            reading.
        past: Readings of the last `KEPT_S` seconds with their stamps, oldest first.
    """

    def __init__(
        self, errors: Mapping[str, EncoderErrors], parts: Mapping[str, slice], timestep: float
    ) -> None:
        count = count_of(parts)
        self.stamp = -math.inf
        self.readings: Matrix = np.zeros((2, count))
        self.past: deque[tuple[float, Matrix]] = deque(maxlen=round(KEPT_S / timestep))
        self._parts = parts
        self._step = timestep
        self._encoders = np.zeros((count, ENCODERS))
        self._counts = np.zeros((count, COUNTS), int)
        self._deviation = {name: math.radians(one.noise) for name, one in errors.items()}
        for name, one in errors.items():
            window = max(1, round(one.window / timestep)) if one.window else 0
            weight = -math.expm1(-2 * math.pi * one.cutoff * timestep) if one.cutoff else 1.0
            self._encoders[parts[name], RESOLUTION] = math.radians(one.resolution)
            self._encoders[parts[name], OLD_WEIGHT] = 1.0 - weight
            self._encoders[parts[name], NEW_WEIGHT] = weight
            self._counts[parts[name], WINDOW] = window
        rows = int(self._counts[:, WINDOW].max(initial=0)) + 1
        self._window = np.zeros((rows, count))
        self._newest = -1
        self._noise = np.zeros((_NOISE_BATCH, count))
        self._row = 0
        self._sources: dict[str, np.random.Generator] = {}
        self._before: Matrix = self.readings
        self._has_read = False
        self._altered: dict[int, Callable[[float], float]] = {}

    def alter(self, name: str, joint: int, reading: Callable[[float], float] | None) -> None:
        """Let the encoder of a joint read something else from now on.

        Args:
            name: Name of the arm.
            joint: Index of the joint, base to tip.
            reading: Turns a position in rad into the reading; None for a sound encoder.
        """
        column = self._parts[name].start + joint
        if reading is None:
            self._altered.pop(column, None)
        else:
            self._altered[column] = reading

    def begin(self, name: str, source: np.random.Generator) -> None:
        """Start the encoders of an arm that is added, with a random stream for their noise."""
        self._counts[self._parts[name], COUNT] = 0
        self._sources[name] = source
        self._draw_noise(name, self._row)

    def end(self, name: str) -> None:
        """Remove the encoders of an arm that leaves the world."""
        del self._sources[name]

    def connect(self, data: mujoco.MjData, arms: Mapping[str, PlantArm]) -> None:
        """Connect to the present arms of the plant; again after each recompilation."""
        self._where = joints_of(
            arms, self._parts, lambda arm: arm.qpos_ids, lambda arm: arm.dof_ids
        )
        # Views: an attribute lookup on mjData costs more than reading the array.
        self._q = data.qpos
        self._v = data.qvel

    def begin_reading(self, time: float) -> tuple[Any, ...]:  # arrays and numbers
        """Begin a reading at a time in s; call `end_reading` after its kernel.

        A second reading at the same time replaces the first.

        Returns:
            Arguments of `read_joints`. The first reading needs no kernel, so that a start does not
            wait for it: no joint is left to be read then.
        """
        if time <= self.stamp:
            self._forget(time)
        row = self._row
        if row == _NOISE_BATCH:
            for name in self._sources:
                self._draw_noise(name, 0)
            row = 0
        self._row = row + 1
        self._newest = (self._newest + 1) % len(self._window)
        self._before = before = self.readings
        self.readings = readings = np.empty(before.shape)
        joints = self._where
        if not self._has_read:
            self._read_first(self._noise[row])
            joints = joints[:0]
        return (
            joints, self._q, self._v, self._encoders, self._counts, self._noise, row,
            self._window, self._newest, self._step, before, readings,
        )  # fmt: skip

    def end_reading(self, time: float) -> None:
        """Store a reading at a time in s, with the joints that read something else."""
        if self._altered:
            for joint, reading in self._altered.items():
                self.readings[0, joint] = reading(float(self.readings[0, joint]))
                if self.readings[0, joint] == self._before[0, joint]:
                    self.readings[1, joint] = 0.0  # a drive differences the readings that it has
        self.stamp = time
        self.past.append((time, self.readings))

    def _draw_noise(self, name: str, first: int) -> None:
        """Draw the noise of an arm's next readings, from row ``first`` on."""
        part = self._parts[name]
        deviation = self._deviation[name]
        if deviation:
            drawn = self._noise[first:, part]
            drawn[:] = deviation * self._sources[name].standard_normal(drawn.shape)

    def _forget(self, time: float) -> None:
        """Drop an earlier reading at this time, and all readings if time went back."""
        counts = self._counts[:, COUNT]
        if time < self.stamp:
            counts[:] = 0
        else:
            np.maximum(counts - 1, 0, out=counts)
            self._newest -= 1
            self.readings = np.stack((self.readings[0], self._before[1]))
        self._has_read = bool(counts.any())
        while self.past and self.past[-1][0] >= time:
            self.past.pop()

    def _read_first(self, noise: Vector) -> None:
        """First reading of all joints, which are at rest."""
        joints, positions, velocities = self._where.T
        reading = self._q[positions] + noise[joints]
        resolution = self._encoders[joints, RESOLUTION]
        is_quantized = resolution > 0.0
        resolution = resolution[is_quantized]
        reading[is_quantized] = np.rint(reading[is_quantized] * (1.0 / resolution)) * resolution
        self._window[self._newest, joints] = self.readings[0, joints] = reading
        is_true_velocity = self._counts[joints, WINDOW] == 0
        self.readings[1, joints] = np.where(is_true_velocity, self._v[velocities], 0.0)
        self._counts[joints, COUNT] = 1
        self._has_read = True


@cache
def kernels() -> ModuleType:
    """The compiled kernels, imported once: an import statement costs as much as a kernel."""
    from bt_dualarm.sim import device_kernels

    return device_kernels


# Drives

_FINEST_QUANTUM = 1e-12
"""Fraction of the effort limit below which quantization is lost in floating-point rounding."""


@dataclass(frozen=True, eq=False)
class ArmDrives:
    """The drives of one arm.

    Attributes:
        errors: Delay, bandwidth and quantization of the torque.
        gain: Factor of each joint's torque, of shape (dof,).
        effort: Effort limits, of shape (dof,), N m.
    """

    errors: DriveErrors
    gain: Vector
    effort: Vector

    @property
    def is_ideal(self) -> bool:
        """Whether the applied torque is the commanded one without delay."""
        errors = self.errors
        is_slow = errors.delay or errors.bandwidth
        return not (is_slow or self.quantum) and bool((self.gain == 1).all())

    @property
    def quantum(self) -> float:
        """Quantum of a torque as a fraction of the effort limit; 0 for none."""
        return self.errors.quantum if self.errors.quantum > _FINEST_QUANTUM else 0.0


class Drives:
    """Turn commanded into applied torques, for all arms with drives that are not ideal.

    A drive quantizes and limits a command, has a gain error, a delay and a first-order lag. A delay
    of a fractional number of steps is interpolated between two of them: over a step this gives the
    impulse of the delayed torque.

    Args:
        arms: Drives by arm.
        parts: Rows of each arm's joints among those of all.
        timestep: Seconds of one physics step.
    """

    def __init__(
        self, arms: Mapping[str, ArmDrives], parts: Mapping[str, slice], timestep: float
    ) -> None:
        self._arms = arms
        self._parts = parts
        self._drives = np.zeros((count_of(parts), DRIVES))
        for name, one in arms.items():
            rows = self.of(name)
            quantum = one.quantum
            effort = one.effort
            rows[:, WHOLE], rows[:, LATE] = divmod(round(one.errors.delay / timestep, 9), 1.0)
            # A command is rounded to quanta, each of which has the joint torque of GAIN.
            rows[:, PER_STEP] = 1.0 / (quantum * effort) if quantum else 0.0
            rows[:, GAIN] = one.gain * quantum * effort if quantum else one.gain
            rows[:, EFFORT] = effort
            corner = 2 * math.pi * one.errors.bandwidth * timestep
            rows[:, SHARE] = -math.expm1(-corner) if corner else 1.0
        self._sent = np.zeros((int(self._drives[:, WHOLE].max(initial=0.0)) + 2, len(self._drives)))
        self._newest = 0
        self._new: set[str] = set()

    def of(self, name: str) -> Matrix:
        """Rows of an arm's drives, through which kernels command them; see `kernel_arrays`."""
        return self._drives[self._parts[name]]

    def is_ideal(self, name: str) -> bool:
        """Whether an arm's applied torques are the commanded ones without delay."""
        return self._arms[name].is_ideal

    def begin(self, name: str) -> None:
        """Start the drives of an arm that is added: the first command applies without delay."""
        self.of(name)[:, COMMANDED] = 0.0
        self._new.add(name)

    def connect(self, arms: Mapping[str, PlantArm]) -> None:
        """Connect to the present arms of the plant; again after each recompilation."""
        real = {name: arm for name, arm in arms.items() if not self._arms[name].is_ideal}
        self._where = joints_of(real, self._parts, lambda arm: arm.actuator_ids)

    def begin_step(self) -> tuple[npt.NDArray[np.int64], Matrix, int, Matrix]:
        """Begin a step: arguments of `apply_torques` besides the motors."""
        while self._new:  # as if the drives had held the arm for long
            name = self._new.pop()
            rows = self.of(name)
            self._sent[:, self._parts[name]] = rows[:, TORQUE] = rows[:, COMMANDED]
        self._newest = (self._newest + 1) % len(self._sent)
        return self._where, self._sent, self._newest, self._drives


# Joint friction

STIFF: Final = (0.004, 1.0), (0.9999, 0.9999)
"""``solref`` and ``solimp`` of MuJoCo's dry friction, which is a soft constraint. With the defaults
a sticking joint creeps at 0.05 rad/s under half its breakaway load, with these at 1e-5 rad/s."""


class JointFrictionModel:
    """Sets MuJoCo's dry friction and damping of all joints at each step, in one call.

    Dry friction is a constraint of MuJoCo, whose level follows the speed (Stribeck effect).
    Friction that builds up over a speed is set as damping: its torque divided by the current speed.
    MuJoCo integrates damping implicitly, so light links stay stable.

    Args:
        friction: Friction of the joints, by arm.
        parts: Rows of each arm's joints among those of all.
    """

    def __init__(self, friction: Mapping[str, JointFriction], parts: Mapping[str, slice]) -> None:
        self._friction = friction
        self._parts = parts
        self._rows = np.concatenate([np.zeros((0, FRICTION)), *map(rows_of, friction.values())])
        # Arms that have not moved yet are set without the kernel: a start need not wait for it.
        self._unmoved: set[str] = set()

    def begin(self, name: str) -> None:
        """Start the friction of an arm that is added, at rest."""
        self._unmoved.add(name)

    def connect(
        self, model: mujoco.MjModel, data: mujoco.MjData, arms: Mapping[str, PlantArm]
    ) -> None:
        """Connect to the present arms of the plant; again after each recompilation."""
        # Views: an attribute lookup on mjData costs more than the arithmetic on it.
        self._v = data.qvel
        self._dry = model.dof_frictionloss
        self._damping = model.dof_damping
        self._arms = {
            name: arm for name, arm in arms.items() if _has_friction(self._friction[name])
        }
        for arm in self._arms.values():
            model.dof_solref[arm.dof_ids] = STIFF[0]
            model.dof_solimp[arm.dof_ids, :2] = STIFF[1]
        self._partition()

    def arguments(self) -> tuple[npt.NDArray[Any], ...]:  # of numbers of several types
        """Arguments of `apply_friction` besides the velocities, before passive forces are computed.

        Sets the friction of arms that have not moved yet, which are not among the joints.
        """
        if self._at_rest:
            self._set_static()
        return self._where, self._rows, self._dry, self._damping

    def _partition(self) -> None:
        """Separate arms that have not moved yet from those that have."""
        self._at_rest = [name for name in self._arms if name in self._unmoved]
        moving = {name: arm for name, arm in self._arms.items() if name not in self._unmoved}
        self._where = joints_of(moving, self._parts, lambda arm: arm.dof_ids)

    def _set_static(self) -> None:
        """Set the friction of arms at rest, and detect those that move now."""
        for name in self._at_rest:
            dofs = self._arms[name].dof_ids
            friction = self._friction[name]
            if self._v[dofs].any():
                self._unmoved.remove(name)
            else:
                is_smooth = friction.rise > 0.0
                creep = np.full_like(is_smooth, CREEP, float)
                slope = friction.static * friction.build_up(creep) / CREEP
                self._dry[dofs] = np.where(is_smooth, 0.0, friction.static)
                self._damping[dofs] = friction.viscous + np.where(is_smooth, slope, 0.0)
        self._partition()


def rows_of(friction: JointFriction) -> Matrix:
    """Rows of one arm's joints for the friction kernel, of shape (dof, FRICTION)."""
    rows = np.empty((len(friction.coulomb), FRICTION))
    rows[:, COULOMB] = friction.coulomb
    rows[:, DROP] = friction.static - friction.coulomb
    rows[:, NARROW] = -1.0 / np.square(friction.stribeck_velocity)
    rows[:, VISCOUS] = friction.viscous
    rows[:, RISE] = friction.rise
    rows[:, OFFSET] = friction.offset
    return rows


def _has_friction(friction: JointFriction) -> bool:
    """Whether any joint has friction."""
    return bool(friction.coulomb.any() or friction.static.any() or friction.viscous.any())


# Devices of one arm


class ArmHardware:
    """The sensors and drives of one arm, for as long as it is in the world.

    Readings belong to the time of the last reading; the plant may have moved on since.

    Args:
        encoders: Encoders of all arms.
        part: Slice of this arm's joints among those of all.
        drives: Drives of all arms.
        name: Name of the arm.

    Attributes:
        commanded: Torques that were commanded last, of shape (dof,), N m.
        drives: Rows of the arm's drives, by which kernels command them (see `kernel_arrays`);
            call `note_command` afterwards.
    """

    def __init__(self, encoders: Encoders, part: slice, drives: Drives, name: str) -> None:
        self._encoders = encoders
        self._part = part
        self._since = encoders.stamp  # earlier readings belong to a previous arm of this name
        self.drives: Matrix = drives.of(name)
        self._is_ideal = drives.is_ideal(name)
        self.commanded: Vector = np.zeros(len(self.drives))

    def connect(self, plant: PlantArm) -> None:
        """Connect to an arm of the plant; again after each recompilation."""
        # A view, as in `Encoders`: the motors of a chain are adjacent.
        self._motors = plant.data.ctrl[plant.actuator_ids[0] : plant.actuator_ids[-1] + 1]

    @property
    def q(self) -> Vector:
        """Positions of the joints from their encoders, base to tip, of shape (dof,), rad."""
        q: Vector = self._encoders.readings[0, self._part]
        return q

    @property
    def v(self) -> Vector:
        """Velocities of the joints as the drives report them, of shape (dof,), rad/s."""
        v: Vector = self._encoders.readings[1, self._part]
        return v

    @property
    def stamp(self) -> float:
        """Simulated time of both in s."""
        return self._encoders.stamp

    def q_at(self, time: float) -> Vector:
        """Positions from the encoders at a time in s, interpolated linearly, of shape (dof,), rad.

        Outside the stored readings the first or the last one is returned.
        """
        later = (self.stamp, self.q)
        for stamp, readings in reversed(self._encoders.past):
            if stamp < self._since:
                break
            q: Vector = readings[0, self._part]
            if stamp <= time:
                span = later[0] - stamp
                share = min(max((time - stamp) / span, 0.0), 1.0) if span > 0 else 0.0
                between: Vector = q + share * (later[1] - q) if share else q
                return between
            later = stamp, q
        return later[1]

    def command(self, torque: Vector) -> None:
        """Command torques, which hold until the next command.

        Args:
            torque: Torques of the joints, of shape (dof,), N m, within their effort limits.
        """
        kernels().command_torques(np.array(torque, dtype=float), self.drives)
        self.note_command(torque)

    def note_command(self, torque: Vector) -> None:
        """Record torques, of shape (dof,), N m, that a kernel has entered into `drives`."""
        self.commanded = torque
        if self._is_ideal:
            self._motors[:] = torque


def warm_up_sensors() -> None:
    """Compile the kernels of a physics step."""
    compiled = kernels()
    one = np.ones(1)
    rows = np.ones((1, 1))
    two = np.zeros((1, 2), np.int64)
    three = np.zeros((1, 3), np.int64)
    counts = np.zeros((1, COUNTS), np.int64)
    table = np.ones((1, ENCODERS))
    past = np.ones((2, 1))
    drives = np.ones((1, DRIVES))
    friction = np.ones((1, FRICTION))
    fingers = np.full((1, FINGER_NUMBERS), -1)
    finger_drives = np.ones((1, DRIVE))
    stack = np.ones((1, 1, 1))
    finger_readings = np.ones((1, FINGER_READINGS))
    sensors = (
        fingers, finger_drives, finger_readings, rows, stack, one, rows, stack, rows, stack, stack
    )  # fmt: skip
    encoders = three, one, one, table, counts, past, 0, past, 0, 1.0, past, past
    compiled.read_sensors(0.0, *encoders, *sensors)
    compiled.drive_plant(two, past, 0, drives, fingers, finger_drives, one, one, 1.0, one)
    compiled.command_torques(one, drives)
    geoms = np.zeros((4, 2), np.int32)
    distances = np.zeros(4)
    bodies = np.zeros(1, np.int32)
    numbers = np.zeros(1, np.int64)
    poses = np.zeros((1, 3, 7))
    held = three, bodies, numbers, np.zeros((1, 3)), np.zeros((1, 4)), numbers, poses
    arms = numbers, numbers
    for some in (slice(None), slice(None, None, 2)):  # one contact is contiguous, several are not
        compiled.pass_between(
            1.0, one, one, two, friction, one, one, geoms[some], distances[some], *held, *arms
        )


# Device bank


class DeviceBank:
    """Encoders, drives and joint friction of all arms.

    Args:
        errors: Error bounds of each arm that may be added.
        sampled: Sampled deviations of each of them.
        efforts: Effort limits of their joints, of shape (dof,) each, N m.
        timestep: Seconds of one physics step.

    Attributes:
        encoders: The encoders.
        drives: The drives.
        friction: The friction of the joints.
    """

    def __init__(
        self,
        errors: Mapping[str, RealityErrors],
        sampled: Mapping[str, SampledArm],
        efforts: Mapping[str, Vector],
        timestep: float,
    ) -> None:
        self._parts = parts = parts_of({name: len(effort) for name, effort in efforts.items()})
        encoders = {name: one.encoder for name, one in errors.items()}
        self.encoders = Encoders(encoders, parts, timestep)
        drives = {
            name: ArmDrives(one.drive, sampled[name].gain, efforts[name])
            for name, one in errors.items()
        }
        self.drives = Drives(drives, parts, timestep)
        self.friction = JointFrictionModel(
            {name: one.friction for name, one in sampled.items()}, parts
        )

    def begin(self, name: str, seed: int) -> ArmHardware:
        """Start and return the sensors and drives of an arm that is added; noise is by ``seed``."""
        self.encoders.begin(name, random_stream(seed, f"{name}:encoders"))
        self.drives.begin(name)
        self.friction.begin(name)
        return ArmHardware(self.encoders, self._parts[name], self.drives, name)

    def end(self, name: str) -> None:
        """Remove the devices of an arm that leaves the world."""
        self.encoders.end(name)

    def connect(
        self, model: mujoco.MjModel, data: mujoco.MjData, arms: Mapping[str, PlantArm]
    ) -> None:
        """Connect to the present arms of the plant; again after each recompilation."""
        self.encoders.connect(data, arms)
        self.drives.connect(arms)
        self.friction.connect(model, data, arms)
