"""Grippers in the simulation: drives, sensors, suction, objects that move with the palm."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from types import ModuleType
from typing import Final

import mujoco
import numpy as np

from bt_dualarm.core.pose import Matrix, Vector
from bt_dualarm.robots.gripper import FINGERS, PALM, Cup, Gripper, Tactile
from bt_dualarm.robots.mjspec import CUP, PAD, PAD_FORCE
from bt_dualarm.robots.mjspec import DRIVE as DRIVE_NAME
from bt_dualarm.sim.kernel_columns import (
    ASKED_FORCE,
    ASKED_WIDTH,
    DAMPING,
    DRIVE,
    FORCE,
    GRIP_GAIN,
    MOST,
    REFERENCE,
    STIFFNESS,
)
from bt_dualarm.spec.reality import RealityErrors

# Seal of a suction cup: its lip has to be in contact all around for a vacuum


_PLACES: Final = 12
"""Positions of the rim that are looked at."""

_INNER: Final = 0.97
"""Share of the radius at which they lie: an object as wide as the cup is wide enough."""

_YIELDS: Final = 0.25
"""Share of a lip's depth by which it gives way, or reaches out: it follows a slant, and a curve."""


class Seal:
    """The lip of one cup of the plant; to be made anew after a recompilation.

    Args:
        model: The plant.
        data: Its state.
        lip: Shape of the lip: a cylinder whose rim is its end along z.
        cup: Sizes of the cup.
    """

    def __init__(self, model: mujoco.MjModel, data: mujoco.MjData, lip: int, cup: Cup) -> None:
        self._model = model
        self._data = data
        self._lip = lip
        self._cup = cup
        turn = 2.0 * np.pi * np.arange(_PLACES) / _PLACES
        radius = _INNER * cup.radius
        depth = cup.depth
        # From the lip's far end, so that what has sunk in a little is met, too.
        self._starts = np.stack(
            (radius * np.cos(turn), radius * np.sin(turn), np.full(_PLACES, -0.5 * depth)), axis=1
        )

    @property
    def is_tight(self) -> bool:
        """Whether it lies on one object with as much of its rim as it needs."""
        things = self._touched()
        return any(self._share_on(thing) >= self._cup.seal for thing in things)

    def _touched(self) -> set[int]:
        """Shapes that the lip touches."""
        if not self._data.ncon:
            return set()
        geoms = self._data.contact.geom
        mine = (geoms == self._lip).any(axis=1)
        return {int(geom) for pair in geoms[mine].tolist() for geom in pair if geom != self._lip}

    def _share_on(self, thing: int) -> float:
        """Share of the rim's places in front of which the object's surface lies, near enough."""
        data = self._data
        cup = self._cup
        turn = data.geom_xmat[self._lip].reshape(3, 3)
        ahead = turn[:, 2].copy()
        near = _YIELDS * cup.depth
        on = 0
        for start in data.geom_xpos[self._lip] + self._starts @ turn.T:
            away = self._way_to(thing, start, ahead)
            on += away >= 0.0 and abs(away - cup.depth) <= near
        return on / _PLACES

    def _way_to(self, thing: int, start: Vector, ahead: Vector) -> float:
        """Meters along a ray to the object's surface; negative where it misses."""
        model = self._model
        data = self._data
        kind = int(model.geom_type[thing])
        if kind == mujoco.mjtGeom.mjGEOM_MESH:
            return float(mujoco.mj_rayMesh(model, data, thing, start, ahead))
        place = data.geom_xpos[thing]
        turn = data.geom_xmat[thing]
        return float(mujoco.mju_rayGeom(place, turn, model.geom_size[thing], start, ahead, kind))


# Tactile sensors of the pads


_FORCE: Final = 3  # numbers of a reading

_TACTILE_DRAWN: Final = 256
"""Readings whose noise is drawn at once: one by one that costs more than all the rest."""


class TactileSensors:
    """The sensors under both pads of one gripper, for as long as its arm is in the world.

    They feel what presses on the pads and what rubs along them: the force of the last step of
    physics, in the axes of the tool frame, which the fingers keep. With an ideal encoder they are
    exact; else each pad's reading has the noise of its description, and a gain that the seed draws.

    Args:
        gripper: Description of the gripper.
        tactile: What the description says of them.
        errors: What sensors do to what goes through them.
        rng: Source of their gains and noise.
        timestep: Seconds of one physics step.

    Attributes:
        forces: Force of what is held on each pad, in the axes of the tool frame, of shape (2, 3),
            N; a new array with each reading.
        stamp: Simulated time of the reading, s; minus one before the first.
    """

    def __init__(
        self,
        gripper: Gripper,
        tactile: Tactile,
        errors: RealityErrors,
        rng: np.random.Generator,
        timestep: float,
    ) -> None:
        self.forces: Matrix = np.zeros((len(FINGERS), _FORCE))
        self.stamp = -1.0
        self._rng = rng
        self._turn = gripper.tool.rotation_matrix.copy()
        is_ideal = not (errors.encoder.resolution or errors.encoder.noise)
        self._noise = 0.0 if is_ideal else tactile.noise
        spread = 0.0 if is_ideal else tactile.gain
        self._gains = 1.0 + rng.uniform(-spread, spread, len(FINGERS))
        self._drawn: Matrix = np.zeros((0, len(FINGERS) * _FORCE))
        self._row = 0
        self._every = max(1.0 / tactile.rate - 0.5 * timestep, 0.0)

    def connect(self, model: mujoco.MjModel, data: mujoco.MjData, arm: str) -> None:
        """Belong to the gripper of an arm of the plant; anew after each recompilation."""
        first, second = (int(model.sensor(f"{arm}/{name}/{PAD_FORCE}").adr[0]) for name in FINGERS)
        if second != first + _FORCE:
            raise AssertionError("the sensors of two pads follow each other")
        self._felt: Vector = data.sensordata[first : second + _FORCE]
        self._palm: Vector = data.xmat[model.body(f"{arm}/{PALM}").id]

    def sense(self, time: float) -> None:
        """Take a reading if one is due.

        Args:
            time: Simulated time, s.
        """
        if time - self.stamp < self._every:
            return
        is_first = self.stamp < 0.0
        self.stamp = time
        if self._row == len(self._drawn):
            self._draw()
        row = self._row
        self._row = self._row + 1
        if is_first:  # before its first step nothing presses; and who makes none needs no kernel
            self.forces = self._drawn[row].reshape(self.forces.shape)
            return
        self.forces = tactile_kernels().felt_in_tool(
            self._felt, self._palm, self._turn, self._gains, self._drawn, row
        )

    def _draw(self) -> None:
        """Draw the noise of readings to come, of shape (n, 6), N."""
        count = (_TACTILE_DRAWN, len(FINGERS) * _FORCE)
        drawn = self._rng.standard_normal(count) if self._noise else np.zeros(count)
        self._drawn = self._noise * drawn
        self._row = 0


def tactile_sensors(
    gripper: Gripper, errors: RealityErrors, rng: np.random.Generator, timestep: float
) -> TactileSensors | None:
    """The sensors that the description of a gripper declares; None where it declares none.

    Args:
        gripper: Description of the gripper.
        errors: What sensors do to what goes through them.
        rng: Source of a stream of their own.
        timestep: Seconds of one physics step.
    """
    tactile = gripper.tactile
    if tactile is None:
        return None
    return TactileSensors(gripper, tactile, errors, rng.spawn(1)[0], timestep)


@cache
def tactile_kernels() -> ModuleType:
    """The kernels: an import statement costs as much as they do."""
    from bt_dualarm.sim import device_kernels

    return device_kernels


def warm_up_tactile_sensors() -> None:
    """Have the kernel of what pads feel compiled."""
    tactile_kernels().felt_in_tool(
        np.zeros(6), np.eye(3).ravel(), np.eye(3), np.ones(2), np.zeros((1, 6)), 0
    )


# Drive and sensors of a gripper


_STIFFNESS: Final = 0.25
"""Of the drive's speed loop, times the mass of a finger over the step squared: with a damping of
the mass over the step, poles at 0.75 and 0."""

SPEED_S: Final = 0.1
"""Seconds over which the opening is differenced to the speed that is sensed."""

LET_GO: Final = 1.0
"""m; a width that tells a cup to let go."""

_LOOK: Final = 5
"""Steps of physics after which a lip is looked at again: a vacuum does not go at once, either."""

_PUMP_S: Final = 0.05  # in which a cup's vacuum comes and goes

_DRAWN: Final = 512
"""Readings whose noise is drawn at once: one by one that costs as much as all the rest."""


@dataclass(frozen=True)
class GripperCommand:
    """What a gripper was asked for last.

    Attributes:
        width: Opening to go to in m; 0 closes. Of a cup: 0 sucks, else it lets go.
        speed: Speed of the opening, m/s.
        force: Most force of a pad, N; of a cup, that which pulls it off.
    """

    width: float
    speed: float
    force: float


class GripperHardware:
    """The drive and the sensors of one gripper, for as long as its arm is in the world.

    The fingers go at the speed that was asked for until what they meet takes the force that was
    asked for; then they hold that force, however wide they stand.

    Args:
        gripper: Description of the gripper.
        errors: What sensors and drives do to what goes through them.
        rng: Source of the drive's gain and the encoder's noise.
        timestep: Seconds of one physics step.

    Attributes:
        width: Opening by the encoder, m.
        speed: Speed of the opening, positive where it opens, m/s.
        force: Force of a pad as the motor's current tells, N; positive where it closes. Of a cup,
            that with which it holds.
        vacuum: Share of the full vacuum that a cup senses, 0 to 1: 0 where it does not seal.
        tactile: What feels the force on each pad, if the description has something that does.
        stamp: Simulated time of all of them, s.
        commanded: What was asked for last.
    """

    def __init__(
        self, gripper: Gripper, errors: RealityErrors, rng: np.random.Generator, timestep: float
    ) -> None:
        self.gripper = gripper
        self.width = gripper.stroke
        self.speed = 0.0
        self.force = 0.0
        self.vacuum = 0.0
        self.stamp = -1.0
        begin = gripper.stroke if gripper.fingers else LET_GO
        self._gain = 1.0 + float(errors.drive.gain.draw(rng, 1)[0])
        self._rng = rng
        self._step = timestep
        self.tactile = tactile_sensors(gripper, errors, rng, timestep)
        encoder = errors.encoder
        self._resolution = gripper.resolution if encoder.resolution else 0.0
        finer = encoder.noise / encoder.resolution if encoder.resolution else 0.0
        self._noise = self._resolution * min(finer, 1.0)
        self._drawn: list[float] = []  # of readings to come, the last first
        self._past: deque[tuple[float, float]] = deque(maxlen=round(SPEED_S / timestep) + 1)
        self._pump = -math.expm1(-timestep / _PUMP_S)
        mass = gripper.moved_mass
        self._drive = np.zeros(DRIVE)
        # Of the opening, which is twice a finger's way, to the force on each finger.
        self._drive[STIFFNESS] = 0.5 * _STIFFNESS * mass / timestep**2
        self._drive[DAMPING] = 0.5 * mass / timestep
        self._drive[GRIP_GAIN] = self._gain
        self._drive[MOST] = gripper.force.most
        self._drive[REFERENCE] = gripper.stroke
        self.command(GripperCommand(begin, gripper.speed.most, gripper.force.most))
        self._is_connected = False
        self._seal: Seal | None = None
        self._tight = False
        self._looked = 0

    def connect(self, model: mujoco.MjModel, data: mujoco.MjData, arm: str) -> None:
        """Belong to the gripper of an arm of the plant; anew after each recompilation."""
        self._is_connected = True
        drive = int(model.actuator(f"{arm}/{DRIVE_NAME}").id)
        self._motor = data.ctrl[drive : drive + 1]
        if self.gripper.fingers:
            joint = model.joint(f"{arm}/{FINGERS[0]}")
            first = int(joint.dofadr[0])
            address = int(joint.qposadr[0])
            self._address = address  # the second finger follows the first
            self._q = data.qpos[address : address + 2]
            self._v = data.qvel[first : first + 2]
            if self.tactile is not None:
                self.tactile.connect(model, data, arm)
        else:
            lip = int(model.body(f"{arm}/{CUP}").geomadr[0])
            cup = self.gripper.cup
            self._seal = None if cup is None else Seal(model, data, lip, cup)

    def command(self, wanted: GripperCommand) -> None:
        """Ask for something; it holds until the next.

        Args:
            wanted: Width, speed and force within the description's limits.
        """
        self.commanded = wanted
        self._drive[ASKED_WIDTH : ASKED_FORCE + 1] = wanted.width, wanted.speed, wanted.force

    def sense(self, time: float) -> None:
        """Read the sensors at a simulated time in s; again at the same moment changes nothing."""
        if time == self.stamp or not self._is_connected:
            return
        self.stamp = time
        if not self.gripper.fingers:
            self.force = self.vacuum * self.gripper.force.most
            return
        width = float(self._q[0]) + float(self._q[1])  # a sum of numpy's costs ten times that
        if self._noise:
            if not self._drawn:
                self._drawn = (self._noise * self._rng.standard_normal(_DRAWN))[::-1].tolist()
            width += self._drawn.pop()
        if self._resolution:
            width = self._resolution * round(width / self._resolution)
        past = self._past
        past.append((time, width))
        began, first = past[0]
        self.speed = (width - first) / (time - began) if time > began else 0.0
        self.width, self.force = width, -float(self._drive[FORCE])
        if self.tactile is not None:
            self.tactile.sense(time)

    def place(self, positions: Vector) -> None:
        """Put the fingers where they are by the encoder, in positions of the whole plant, (nq,)."""
        if self.gripper.fingers and self._is_connected:
            positions[self._address : self._address + 2] = 0.5 * self.width

    def stand_open(self) -> None:
        """Put the fingers of an arm that has just come where its drive holds them: open."""
        if self.gripper.fingers:
            self._q[:] = 0.5 * self.gripper.stroke
            self.stamp = -1.0

    def drive(self) -> None:
        """Let the drive act during the next step of physics."""
        if not self._is_connected:
            return
        if self.gripper.fingers:
            drive_kernels().push(self._q, self._v, self._drive, self._step, self._motor)
        else:
            self._suck()

    def _suck(self) -> None:
        """The pump: vacuum builds up where the lip seals, up to the force that is asked for."""
        sucks = self.commanded.width <= 0.0
        if sucks and self._seal is not None and self._looked <= 0:
            self._tight = self._seal.is_tight
            self._looked = _LOOK
        self._looked -= 1
        goal = self.commanded.force / self.gripper.force.most if sucks and self._tight else 0.0
        self.vacuum += self._pump * (goal - self.vacuum)
        self._motor[0] = min(self.vacuum * self._gain, 1.0)


@cache
def drive_kernels() -> ModuleType:
    """The kernel: an import statement costs as much as it does."""
    from bt_dualarm.sim import device_kernels

    return device_kernels


def warm_up_fingers() -> None:
    """Have the kernel of fingers compiled."""
    pair = np.zeros(2)
    drive = np.ones(DRIVE)
    drive_kernels().push(pair, pair, drive, 0.002, np.zeros(1))


# Integration of a held object in the palm's frame instead of along straight lines.
#
# MuJoCo moves a free body along its velocity for a step, while the palm of a rotating arm moves
# along an arc. Without this correction a held object creeps outward by half the step times the
# centripetal acceleration: 2 mm/s at 2 m/s² and 2 ms.


class HeldObjectMotion:
    """One gripper of the plant; to be made anew after a recompilation.

    Args:
        model: The plant.
        data: Its state.
        arm: Name of the arm.
        gripper: Description of its gripper.
    """

    def __init__(
        self, model: mujoco.MjModel, data: mujoco.MjData, arm: str, gripper: Gripper
    ) -> None:
        self._model = model
        self._data = data
        bodies = FINGERS if gripper.fingers else (CUP, CUP)
        self._first, self._second = (model.geom(f"{arm}/{body}/{PAD}").id for body in bodies)
        self._palm = int(model.body(f"{arm}/{PALM}").id)
        self._bodies = model.geom_bodyid.copy()
        joints = model.body_jntadr
        free = (joints >= 0) & (model.jnt_type[joints] == mujoco.mjtJoint.mjJNT_FREE)
        self._addresses = np.where(free, model.jnt_qposadr[joints], -1).tolist()
        self._jacobian = np.zeros((6, model.nv))
        self._before = np.zeros((3, 7))
        self._step = float(model.opt.timestep)
        # Views: looking a field up costs more than what is done with it.
        self._places = data.xpos
        self._turns = data.xquat
        self._positions = data.qpos
        self._velocities = data.qvel
        self._parts = self._jacobian[:3], self._jacobian[3:]

    def look(self) -> int:
        """The body that it holds, -1 where there is none; where that and the palm are is kept.

        To be called of all grippers before any of them goes on: positions are then still those
        before the step.
        """
        data = self._data
        palm = self._palm
        compiled = carrying_kernels()
        if not data.ncon:
            return -1
        contact = data.contact
        body = int(
            compiled.gripped(contact.geom, contact.dist, self._first, self._second, self._bodies)
        )
        if body < 0 or self._addresses[body] < 0:
            return -1
        compiled.remember(self._places, self._turns, palm, body, self._before)
        mujoco.mj_jacBody(self._model, data, *self._parts, palm)
        return body

    def carry(self, body: int) -> None:
        """Correct where the body that it holds is, once positions are those after the step."""
        palm = self._palm
        before = self._before
        compiled = carrying_kernels()
        compiled.remember(self._places, self._turns, palm, palm, before[1:])
        start = self._addresses[body]
        pose = self._positions[start : start + 7]
        compiled.go_with(pose, before, self._jacobian, self._velocities, self._step)


def move_held_objects(
    model: mujoco.MjModel, data: mujoco.MjData, grippers: Sequence[HeldObjectMotion]
) -> None:
    """Correct what all grippers hold after the integration of a step.

    What two of them hold goes with the first.
    """
    held: dict[int, HeldObjectMotion] = {}
    for gripper in grippers:
        body = gripper.look()
        if body >= 0:
            held.setdefault(body, gripper)
    if held:
        mujoco.mj_kinematics(model, data)
        for body, gripper in held.items():
            gripper.carry(body)


@cache
def carrying_kernels() -> ModuleType:
    """The kernels: an import statement costs as much as they do."""
    from bt_dualarm.sim import device_kernels

    return device_kernels


def warm_up_held_objects() -> None:
    """Have all kernels of what is held compiled."""
    one = np.zeros(1, np.int32)
    carrying_kernels().gripped(np.zeros((1, 2), np.int32), np.zeros(1), 0, 0, one)
    pose = np.array((0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0))
    before = np.zeros((3, 7))
    carrying_kernels().remember(np.zeros((1, 3)), np.zeros((1, 4)), 0, 0, before)
    carrying_kernels().remember(np.zeros((1, 3)), np.zeros((1, 4)), 0, 0, before[1:])
    carrying_kernels().go_with(pose, before, np.zeros((6, 1)), np.zeros(1), 0.002)
