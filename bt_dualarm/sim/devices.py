"""Sensors, drives and joint friction of all arms: what controllers read and command."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache
from itertools import accumulate, pairwise
from types import ModuleType
from typing import Final, Protocol

import mujoco
import numpy as np
import numpy.typing as npt

from bt_dualarm.core.pose import Matrix, Vector
from bt_dualarm.robots.robot import JointFriction
from bt_dualarm.sim.arm_models import SampledArm, random_stream
from bt_dualarm.sim.kernel_columns import (
    COULOMB,
    COUNT,
    COUNTS,
    CREEP,
    DRIVES,
    DROP,
    EFFORT,
    ENCODERS,
    FRICTION,
    GAIN,
    KEPT,
    LATE,
    NARROW,
    OFFSET,
    PER_STEP,
    RESOLUTION,
    RISE,
    SHARE,
    TAKEN,
    TORQUE,
    VISCOUS,
    WANTED,
    WHOLE,
    WINDOW,
)
from bt_dualarm.spec.reality import DriveErrors, EncoderErrors, RealityErrors

# Indices of an arm in the arrays of the plant and of the device bank


class PlantArm(Protocol):
    """Where an arm lies in the arrays of the plant."""

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
        """Addresses of the joints' velocities, likewise."""

    @property
    def actuator_ids(self) -> npt.NDArray[np.int64]:
        """Addresses of the motors' torques, likewise."""


def parts_of(dofs: Mapping[str, int]) -> dict[str, slice]:
    """Which joints are whose where those of all arms lie side by side.

    Args:
        dofs: Number of joints of each arm, by name.
    """
    ends = accumulate(dofs.values(), initial=0)
    return {name: slice(*part) for name, part in zip(dofs, pairwise(ends), strict=True)}


def count_of(parts: Mapping[str, slice]) -> int:
    """Joints of all arms together."""
    return max((part.stop for part in parts.values()), default=0)


def joints_of(
    arms: Mapping[str, PlantArm],
    parts: Mapping[str, slice],
    *addresses: Callable[[PlantArm], npt.NDArray[np.int64]],
) -> npt.NDArray[np.int64]:
    """Joints of some arms: which they are among those of all, and where they lie in the plant.

    Args:
        arms: Arms of the plant, by name.
        parts: Which joints are whose among those of all arms.
        addresses: What is asked of where an arm lies.

    Returns:
        A row a joint, of shape (k, 1 + len(addresses)).
    """
    rows = [
        np.stack((np.arange(parts[name].start, parts[name].stop), *(of(arm) for of in addresses)))
        for name, arm in arms.items()
    ]
    none = np.zeros((1 + len(addresses), 0), dtype=np.int64)
    return np.ascontiguousarray(np.concatenate((none, *rows), axis=1).T, dtype=np.int64)


# Encoders: quantized, noisy position and the velocity derived from it


KEPT_S: Final = 0.25
"""Seconds for which readings are kept, for images whose stamp is late or early."""

_DRAWN = 512
"""Readings whose noise is drawn at once: one by one that costs as much as all the rest."""


class Encoders:
    """Reads all arms that are there once a physics step, in one call.

    Args:
        errors: Resolution, noise, and how a velocity is made of positions, by arm.
        parts: Columns of each arm's joints among those of all.
        timestep: Seconds between two readings.

    Attributes:
        stamp: Time of the last reading in s.
        readings: Positions of it and velocities, of shape (2, n), rad and rad/s; a new array with
            each reading.
        past: Earlier readings with their stamps, those of `KEPT_S`, the last one too.
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
            share = -math.expm1(-2 * math.pi * one.cutoff * timestep) if one.cutoff else 1.0
            self._encoders[parts[name], RESOLUTION] = math.radians(one.resolution)
            self._encoders[parts[name], KEPT] = 1.0 - share
            self._encoders[parts[name], TAKEN] = share
            self._counts[parts[name], WINDOW] = window
        rows = int(self._counts[:, WINDOW].max(initial=0)) + 1
        self._window = np.zeros((rows, count))
        self._newest = -1
        self._noise = np.zeros((_DRAWN, count))
        self._row = 0
        self._sources: dict[str, np.random.Generator] = {}
        self._before: Matrix = self.readings
        self._has_read = False

    def begin(self, name: str, source: np.random.Generator) -> None:
        """Have an arm's encoders, which come into the world, read with noise from a source."""
        self._counts[self._parts[name], COUNT] = 0
        self._sources[name] = source
        self._draw(name, self._row)

    def end(self, name: str) -> None:
        """Forget those of an arm that goes."""
        del self._sources[name]

    def connect(self, data: mujoco.MjData, arms: Mapping[str, PlantArm]) -> None:
        """Belong to the arms of the plant that are there; anew after each recompilation."""
        self._where = joints_of(
            arms, self._parts, lambda arm: arm.qpos_ids, lambda arm: arm.dof_ids
        )
        # Views: looking a field up costs more than reading it.
        self._q = data.qpos
        self._v = data.qvel

    def read(self, time: float) -> None:
        """Read all joints at a time in s.

        A second reading at the same time replaces the first.
        """
        if time <= self.stamp:
            self._forget(time)
        if self._row == _DRAWN:
            for name in self._sources:
                self._draw(name, 0)
            self._row = 0
        row = self._row
        self._row = self._row + 1
        self._newest = (self._newest + 1) % len(self._window)
        before = self.readings
        self.readings = np.empty(self.readings.shape)
        if self._has_read:
            kernels().read_joints(
                self._where,
                self._q,
                self._v,
                self._encoders,
                self._counts,
                self._noise,
                row,
                self._window,
                self._newest,
                self._step,
                before,
                self.readings,
            )
        else:  # before anything moves nobody waits for machine code
            self._read_first(self._noise[row])
        self.stamp = time
        self._before = before
        self.past.append((time, self.readings))

    def _draw(self, name: str, first: int) -> None:
        """Draw the noise of an arm's readings to come, from a row on."""
        part = self._parts[name]
        deviation = self._deviation[name]
        if deviation:
            drawn = self._noise[first:, part]
            drawn[:] = deviation * self._sources[name].standard_normal(drawn.shape)

    def _forget(self, time: float) -> None:
        """What was read at this moment already, and all of it where time has gone back."""
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
        """Read joints that were not read before; they come into the world at rest."""
        joints, places, rates = self._where.T
        reading = self._q[places] + noise[joints]
        resolution = self._encoders[joints, RESOLUTION]
        steps = resolution > 0.0
        resolution = resolution[steps]
        reading[steps] = np.rint(reading[steps] * (1.0 / resolution)) * resolution
        self._window[self._newest, joints] = self.readings[0, joints] = reading
        is_read = self._counts[joints, WINDOW] == 0
        self.readings[1, joints] = np.where(is_read, self._v[rates], 0.0)
        self._counts[joints, COUNT] = 1
        self._has_read = True


@cache
def kernels() -> ModuleType:
    """The kernels: an import statement costs as much as they do."""
    from bt_dualarm.sim import device_kernels

    return device_kernels


# Drives: from commanded to applied torque


_FINEST = 1e-12
"""Step of a torque, as a share of the effort limit, that numbers themselves have."""


@dataclass(frozen=True, eq=False)
class ArmDrives:
    """The drives of one arm.

    Attributes:
        errors: Delay, lag, steps of the torque.
        gain: Factor of each joint's torque, of shape (dof,).
        effort: Effort limits, of shape (dof,), N m.
    """

    errors: DriveErrors
    gain: Vector
    effort: Vector

    @property
    def is_ideal(self) -> bool:
        """Whether they give what is commanded at once."""
        errors = self.errors
        is_slow = errors.delay or errors.bandwidth
        return not (is_slow or self.quantum) and bool((self.gain == 1).all())

    @property
    def quantum(self) -> float:
        """Step of a torque as a share of the effort limit; 0 for none."""
        return self.errors.quantum if self.errors.quantum > _FINEST else 0.0


class Drives:
    """Act once a physics step, all in one call; those that are ideal need not.

    A delay that is no multiple of the step is the mean of two steps: over a step it gives the
    impulse that the delayed torque has.

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
            # What a torque is rounded in, and what it then is at the joint.
            rows[:, PER_STEP] = 1.0 / (quantum * effort) if quantum else 0.0
            rows[:, GAIN] = one.gain * quantum * effort if quantum else one.gain
            rows[:, EFFORT] = effort
            corner = 2 * math.pi * one.errors.bandwidth * timestep
            rows[:, SHARE] = -math.expm1(-corner) if corner else 1.0
        self._sent = np.zeros((int(self._drives[:, WHOLE].max(initial=0.0)) + 2, len(self._drives)))
        self._newest = 0
        self._new: set[str] = set()

    def of(self, name: str) -> Matrix:
        """What machine code commands the drives of an arm by, see `kernel_columns`."""
        return self._drives[self._parts[name]]

    def is_ideal(self, name: str) -> bool:
        """Whether the drives of an arm give what is commanded at once."""
        return self._arms[name].is_ideal

    def begin(self, name: str) -> None:
        """Have an arm's drives, which come into the world, hold what they are asked for first."""
        self.of(name)[:, WANTED] = 0.0
        self._new.add(name)

    def connect(self, data: mujoco.MjData, arms: Mapping[str, PlantArm]) -> None:
        """Belong to the arms of the plant that are there; anew after each recompilation."""
        acting = {name: arm for name, arm in arms.items() if not self._arms[name].is_ideal}
        self._where = joints_of(acting, self._parts, lambda arm: arm.actuator_ids)
        self._motors = data.ctrl  # a view, as in `Encoders`

    def drive(self) -> None:
        """Have the motors give the torques of the next step."""
        if not len(self._where):
            return
        while self._new:  # an arm comes as if its drives had held it for long
            name = self._new.pop()
            rows = self.of(name)
            self._sent[:, self._parts[name]] = rows[:, TORQUE] = rows[:, WANTED]
        self._newest = (self._newest + 1) % len(self._sent)
        kernels().pass_on(self._where, self._sent, self._newest, self._drives, self._motors)


# Joint friction: MuJoCo's dry friction and damping, updated at each step


STIFF: Final = (0.004, 1.0), (0.9999, 0.9999)
"""Reference and impedance of the constraint by which MuJoCo has dry friction: with its defaults a
joint that sticks creeps at 0.05 rad/s under half of the load that it bears, with these at 1e-5."""


class JointFrictionModel:
    """Friction of the joints of all arms in the plant, set in one call.

    Dry friction is a constraint of MuJoCo, whose level follows the speed (Stribeck). Friction that
    builds up over a speed is damping, of so many N m s/rad as give its torque at the speed of now:
    MuJoCo integrates damping implicitly, so light links stay stable.

    Args:
        friction: Friction of the joints, by arm.
        parts: Rows of each arm's joints among those of all.
    """

    def __init__(self, friction: Mapping[str, JointFriction], parts: Mapping[str, slice]) -> None:
        self._friction = friction
        self._parts = parts
        self._rows = np.concatenate([np.zeros((0, FRICTION)), *map(rows_of, friction.values())])
        self._still: set[str] = set()  # arms that have not moved: nobody waits for machine code

    def begin(self, name: str) -> None:
        """Have an arm that comes into the world stand."""
        self._still.add(name)

    def connect(
        self, model: mujoco.MjModel, data: mujoco.MjData, arms: Mapping[str, PlantArm]
    ) -> None:
        """Belong to the arms of the plant that are there; anew after each recompilation."""
        # Views: looking a field up costs more than what is done with it.
        self._v = data.qvel
        self._dry = model.dof_frictionloss
        self._damping = model.dof_damping
        self._arms = {name: arm for name, arm in arms.items() if _is_some(self._friction[name])}
        for arm in self._arms.values():
            model.dof_solref[arm.dof_ids] = STIFF[0]
            model.dof_solimp[arm.dof_ids, :2] = STIFF[1]
        self._take_up()

    def act(self) -> None:
        """Set friction for the velocities of now; before MuJoCo works out passive forces."""
        if self._standing:
            self._look_at_standing()
        if len(self._where):
            kernels().apply_friction(self._where, self._rows, self._v, self._dry, self._damping)

    def _take_up(self) -> None:
        """Tell arms that stand from those that have moved."""
        self._standing = [name for name in self._arms if name in self._still]
        moving = {name: arm for name, arm in self._arms.items() if name not in self._still}
        self._where = joints_of(moving, self._parts, lambda arm: arm.dof_ids)

    def _look_at_standing(self) -> None:
        """Set friction of arms that stand, and take up those that move now."""
        for name in self._standing:
            dofs = self._arms[name].dof_ids
            friction = self._friction[name]
            if self._v[dofs].any():
                self._still.remove(name)
            else:
                gentle = friction.rise > 0.0
                slope = friction.static * friction.build_up(np.full_like(gentle, CREEP, float))
                self._dry[dofs] = np.where(gentle, 0.0, friction.static)
                self._damping[dofs] = friction.viscous + np.where(gentle, slope / CREEP, 0.0)
        self._take_up()


def rows_of(friction: JointFriction) -> Matrix:
    """Friction of one arm's joints as the kernel reads it, of shape (dof, FRICTION)."""
    rows = np.empty((len(friction.coulomb), FRICTION))
    rows[:, COULOMB] = friction.coulomb
    rows[:, DROP] = friction.static - friction.coulomb
    rows[:, NARROW] = -1.0 / np.square(friction.stribeck_velocity)
    rows[:, VISCOUS] = friction.viscous
    rows[:, RISE] = friction.rise
    rows[:, OFFSET] = friction.offset
    return rows


def _is_some(friction: JointFriction) -> bool:
    """Whether there is any."""
    return bool(friction.coulomb.any() or friction.static.any() or friction.viscous.any())


# Devices of one arm


class ArmHardware:
    """The sensors and drives of one arm, for as long as it is in the world.

    Readings are those of the moment at which sensors were read: what becomes of the plant after
    that is not known to anybody who reads here.

    Args:
        encoders: Encoders of all arms.
        part: Its joints among those of all.
        drives: Drives of all arms.
        name: The arm's name.

    Attributes:
        commanded: Torques that were commanded last, of shape (dof,), N m.
        drives: What machine code commands its drives by, see `kernel_columns`; it then says so.
    """

    def __init__(self, encoders: Encoders, part: slice, drives: Drives, name: str) -> None:
        self._encoders = encoders
        self._part = part
        self._since = encoders.stamp  # earlier readings are not of this arm
        self.drives: Matrix = drives.of(name)
        self._is_ideal = drives.is_ideal(name)
        self.commanded: Vector = np.zeros(len(self.drives))

    def connect(self, plant: PlantArm) -> None:
        """Belong to an arm of the plant; anew after each recompilation."""
        # A view, as in `Encoders`. A chain's joints follow each other.
        self._motors = plant.data.ctrl[plant.actuator_ids[0] : plant.actuator_ids[-1] + 1]

    @property
    def q(self) -> Vector:
        """Positions of the joints by their encoders, base to tip, of shape (dof,), rad."""
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
        """Positions by the encoders at a time in s, between readings on a line, of shape (dof,).

        Before the first that is kept, and after the last, that one.
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
        """Give the drives torques that hold until the next command.

        Args:
            torque: Torques of the joints, of shape (dof,), N m, within their efforts.
        """
        kernels().take_torques(np.array(torque, dtype=float), self.drives)
        self.note_command(torque)

    def note_command(self, torque: Vector) -> None:
        """Note that the drives have been given torques, of shape (dof,), N m; see `command`."""
        self.commanded = torque
        if self._is_ideal:
            self._motors[:] = torque


def warm_up_sensors() -> None:
    """Have all kernels of sensors and drives compiled."""
    compiled = kernels()
    one = np.ones(1)
    two = np.zeros((1, 2), np.int64)
    three = np.zeros((1, 3), np.int64)
    counts = np.zeros((1, COUNTS), np.int64)
    table = np.ones((1, ENCODERS))
    past = np.ones((2, 1))
    compiled.read_joints(three, one, one, table, counts, past, 0, past, 0, 1.0, past, past)
    compiled.pass_on(two, past, 0, np.ones((1, DRIVES)), one)
    compiled.take_torques(one, np.ones((1, DRIVES)))
    compiled.apply_friction(two, np.ones((1, FRICTION)), one, one, one)


# Device bank: the devices of all arms in common arrays, so that one call serves all


class DeviceBank:
    """What the joints of all arms are sensed and driven by, and how they rub.

    Args:
        errors: What sensors and drives do to what goes through them, by arm that may come.
        drawn: The robot of the batch that each of them is.
        efforts: Effort limits of their joints, of shape (dof,) each, N m.
        timestep: Seconds of one physics step.
    """

    def __init__(
        self,
        errors: Mapping[str, RealityErrors],
        drawn: Mapping[str, SampledArm],
        efforts: Mapping[str, Vector],
        timestep: float,
    ) -> None:
        self._parts = parts = parts_of({name: len(effort) for name, effort in efforts.items()})
        encoders = {name: one.encoder for name, one in errors.items()}
        self._encoders = Encoders(encoders, parts, timestep)
        drives = {
            name: ArmDrives(one.drive, drawn[name].gain, efforts[name])
            for name, one in errors.items()
        }
        self._drives = Drives(drives, parts, timestep)
        self._friction_model = JointFrictionModel(
            {name: one.friction for name, one in drawn.items()}, parts
        )

    def begin(self, name: str, seed: int) -> ArmHardware:
        """The sensors and drives of an arm that comes, whose noise a seed draws."""
        self._encoders.begin(name, random_stream(seed, f"{name}:encoders"))
        self._drives.begin(name)
        self._friction_model.begin(name)
        return ArmHardware(self._encoders, self._parts[name], self._drives, name)

    def end(self, name: str) -> None:
        """Forget an arm that goes."""
        self._encoders.end(name)

    def connect(
        self, model: mujoco.MjModel, data: mujoco.MjData, arms: Mapping[str, PlantArm]
    ) -> None:
        """Belong to the arms of the plant that are there; anew after each recompilation."""
        self._encoders.connect(data, arms)
        self._drives.connect(data, arms)
        self._friction_model.connect(model, data, arms)

    def sense(self, time: float) -> None:
        """Read the sensors at a simulated time in s, instead of what they read at this moment."""
        self._encoders.read(time)

    def drive(self) -> None:
        """Let the drives act during the next step of physics."""
        self._drives.drive()

    def update_friction(self) -> None:
        """Set the joints' friction for the velocities that the plant has now."""
        self._friction_model.act()
