"""Simulated grippers: drives, sensors, suction, and the objects that arms hold.

`GripperHardware` is the interface of a gripper to its controller. The fingers hold objects by
friction, a cup by MuJoCo's adhesion; `move_held_objects` corrects an integration error of objects
that rotate with the palm. `Attachments` has which objects the arms hold, by a weld or by the
gripper.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Final

import mujoco
import numpy as np
import numpy.typing as npt

from bt_dualarm.core.pose import Matrix, Pose, Vector
from bt_dualarm.core.share import weakly
from bt_dualarm.robots.gripper import FINGERS, PALM, Cup, Gripper, Tactile
from bt_dualarm.robots.mjspec import CUP, PAD, PAD_FORCE
from bt_dualarm.robots.mjspec import DRIVE as DRIVE_NAME
from bt_dualarm.sim import composition
from bt_dualarm.sim.devices import kernels
from bt_dualarm.sim.kernel_arrays import (
    COMMANDED_FORCE,
    COMMANDED_WIDTH,
    DAMPING,
    DRIVE,
    FINGER_NUMBERS,
    FINGER_READINGS,
    GRIP_GAIN,
    KEPT,
    MOST,
    MOTOR,
    NEWEST,
    NOISE_ROW,
    PADS,
    PADS_PERIOD,
    PADS_ROW,
    PADS_S,
    PALM_BODY,
    PRESSED,
    Q_ADDRESS,
    QUANTUM,
    REFERENCE,
    SENSED_S,
    SPEED,
    STIFFNESS,
    V_ADDRESS,
    WIDTH,
)
from bt_dualarm.spec.document import RealityErrors

# Suction cups

_RIM_POINTS: Final = 12
"""Points of the rim at which the seal is tested."""

_RIM_SHARE: Final = 0.97
"""Fraction of the radius at which they lie: an object as wide as the cup is wide enough."""

_COMPLIANCE: Final = 0.25
"""Fraction of a lip's depth by which it compresses or stretches to follow a slanted or curved
surface."""


class Seal:
    """Tests whether the lip of a cup seals; create a new one after a recompilation.

    Args:
        model: The plant.
        data: Its state.
        lip: Id of the lip's geom: a cylinder whose rim is its end along z.
        cup: Dimensions of the cup.
    """

    def __init__(self, model: mujoco.MjModel, data: mujoco.MjData, lip: int, cup: Cup) -> None:
        self._model = model
        self._data = data
        self._lip = lip
        self._cup = cup
        angle = 2.0 * np.pi * np.arange(_RIM_POINTS) / _RIM_POINTS
        radius = _RIM_SHARE * cup.radius
        depth = cup.depth
        # Rays start at the lip's far end, so that they also hit objects that penetrate the lip.
        self._starts = np.stack(
            (radius * np.cos(angle), radius * np.sin(angle), np.full(_RIM_POINTS, -0.5 * depth)),
            axis=1,
        )

    @property
    def is_tight(self) -> bool:
        """Whether the required share of the rim lies on one and the same object."""
        return any(self._share_on(geom) >= self._cup.seal for geom in self._geoms_in_contact())

    def _geoms_in_contact(self) -> set[int]:
        """Ids of the geoms in contact with the lip."""
        if not self._data.ncon:
            return set()
        geoms = self._data.contact.geom
        mine = (geoms == self._lip).any(axis=1)
        return {int(geom) for pair in geoms[mine].tolist() for geom in pair if geom != self._lip}

    def _share_on(self, geom: int) -> float:
        """Fraction of the rim's points at which a geom's surface is within the lip's compliance."""
        data = self._data
        cup = self._cup
        rotation = data.geom_xmat[self._lip].reshape(3, 3)
        direction = rotation[:, 2].copy()
        tolerance = _COMPLIANCE * cup.depth
        count = 0
        for start in data.geom_xpos[self._lip] + self._starts @ rotation.T:
            distance = self._ray_distance(geom, start, direction)
            count += distance >= 0.0 and abs(distance - cup.depth) <= tolerance
        return count / _RIM_POINTS

    def _ray_distance(self, geom: int, start: Vector, direction: Vector) -> float:
        """Distance in m along a ray to the surface of a geom; negative if it misses."""
        model = self._model
        data = self._data
        kind = int(model.geom_type[geom])
        if kind == mujoco.mjtGeom.mjGEOM_MESH:
            return float(mujoco.mj_rayMesh(model, data, geom, start, direction))
        position = data.geom_xpos[geom]
        rotation = data.geom_xmat[geom]
        size = model.geom_size[geom]
        return float(mujoco.mju_rayGeom(position, rotation, size, start, direction, kind))


# Fingers

_NOISE_BATCH: Final = 512
"""Readings per batch of noise: drawing it one by one would dominate the cost of a reading."""

_PADS_BATCH: Final = 256
"""Likewise for the sensors of the pads."""

_AXES: Final = 3  # of the force on a pad

SPEED_S: Final = 0.1
"""Seconds over which the opening is differenced to the measured speed."""


class FingerBank:
    """Common arrays of all grippers, one row each, so that one kernel call serves all of them.

    Args:
        count: Number of grippers.
        timestep: Seconds of one physics step.

    Attributes:
        numbers: Addresses in the plant and rows of batches, see `kernel_arrays`; a suction cup,
            and a gripper that is not in the world, has no address.
        drives: Constants, commands and states of the drives, see there.
        readings: Readings of the sensors, see there.
        noise: Batches of noise of the openings, of shape (k, l), m.
        widths: Ring buffers of times and openings, of shape (k, r, 2), s and m.
        tools: Rotation matrix of each tool frame in its palm, of shape (k, 3, 3).
        gains: Factors of the pads' readings, of shape (k, 2).
        pad_noise: Batches of noise of the pads, of shape (k, m, 6), N.
        forces: Forces on the pads, of shape (k, 2, 3), N.
    """

    def __init__(self, count: int, timestep: float) -> None:
        pads = len(FINGERS)
        self.numbers = np.zeros((count, FINGER_NUMBERS), np.int64)
        self.numbers[:, (Q_ADDRESS, PADS)] = -1
        self.drives = np.zeros((count, DRIVE))
        self.readings = np.zeros((count, FINGER_READINGS))
        self.noise = np.zeros((count, _NOISE_BATCH))
        self.widths = np.zeros((count, round(SPEED_S / timestep) + 1, 2))
        self.tools = np.zeros((count, _AXES, _AXES))
        self.gains = np.ones((count, pads))
        self.pad_noise = np.zeros((count, _PADS_BATCH, pads * _AXES))
        self.forces = np.zeros((count, pads, _AXES))

    def sensors(self) -> tuple[Matrix, ...]:
        """Arrays of the sensors after those of the plant, in the order of `read_fingers`."""
        return self.tools, self.gains, self.pad_noise, self.forces


class TactileSensors:
    """The force sensors under both pads of one gripper, for as long as its arm is in the world.

    They measure normal and tangential force in the last physics step, in the axes of the tool
    frame, which the fingers keep. With an ideal encoder they are exact; otherwise each pad's
    reading has the noise of its description and a sampled gain error.

    Args:
        gripper: Description of the gripper.
        tactile: Description of the sensors.
        errors: Error bounds of sensors and drives.
        rng: Random stream of gains and noise.
        timestep: Seconds of one physics step.
        bank: Arrays of all grippers.
        row: Row of this gripper.
    """

    def __init__(
        self,
        gripper: Gripper,
        tactile: Tactile,
        errors: RealityErrors,
        rng: np.random.Generator,
        timestep: float,
        bank: FingerBank,
        row: int,
    ) -> None:
        self._numbers = bank.numbers[row]
        self._readings = bank.readings[row]
        self._forces = bank.forces[row]
        self._batch = bank.pad_noise[row]
        self._rng = rng
        is_ideal = not (errors.encoder.resolution or errors.encoder.noise)
        self._noise = 0.0 if is_ideal else tactile.noise
        spread = 0.0 if is_ideal else tactile.gain
        bank.gains[row] = 1.0 + rng.uniform(-spread, spread, len(FINGERS))
        bank.tools[row] = gripper.tool.rotation_matrix
        self._forces[:] = 0.0
        self._readings[PADS_S] = -1.0
        self._readings[PADS_PERIOD] = max(1.0 / tactile.rate - 0.5 * timestep, 0.0)
        self._numbers[PADS_ROW] = len(self._batch)
        self.refill()

    @property
    def forces(self) -> Matrix:
        """Force of the held object on each pad, axes of the tool frame, (2, 3), N; a copy."""
        forces: Matrix = self._forces.copy()
        return forces

    @property
    def stamp(self) -> float:
        """Simulated time of the reading, s; -1 before the first."""
        return float(self._readings[PADS_S])

    def connect(self, model: mujoco.MjModel, arm: str) -> None:
        """Connect to the gripper of an arm in the plant; again after each recompilation."""
        first, second = (int(model.sensor(f"{arm}/{name}/{PAD_FORCE}").adr[0]) for name in FINGERS)
        if second != first + _AXES:
            raise AssertionError("the sensors of the two pads must be adjacent")
        self._numbers[PADS] = first
        self._numbers[PALM_BODY] = model.body(f"{arm}/{PALM}").id

    def read_first(self, time: float) -> None:
        """Read the pads before the first step, in which nothing presses on them."""
        self._forces[:] = self._batch[self._numbers[PADS_ROW]].reshape(self._forces.shape)
        self._numbers[PADS_ROW] += 1
        self._readings[PADS_S] = time

    def refill(self) -> None:
        """Draw the noise of the next readings if that of the last ones is used up."""
        if self._numbers[PADS_ROW] < len(self._batch):
            return
        self._numbers[PADS_ROW] = 0
        if self._noise:
            self._batch[:] = self._noise * self._rng.standard_normal(self._batch.shape)
        else:
            self._batch[:] = 0.0


# Drive and sensors

_STIFFNESS_SHARE: Final = 0.25
"""Stiffness of the drive's speed loop, times the mass of a finger over the step squared. With a
damping of the mass over the step, its discrete poles are at 0.75 and 0."""

LET_GO: Final = 1.0
"""Commanded width in m that makes a cup release."""

_SEAL_PERIOD: Final = 5
"""Physics steps between two tests of a cup's seal: a vacuum does not vanish at once."""

_PUMP_S: Final = 0.05  # time constant of a cup's vacuum


@dataclass(frozen=True)
class GripperCommand:
    """Command to a gripper; it holds until the next one.

    Attributes:
        width: Target opening in m; 0 closes. For a cup, 0 applies the vacuum; any other value
            releases.
        speed: Speed of the opening, m/s.
        force: Largest force of a pad, N; for a cup, its holding force.
    """

    width: float
    speed: float
    force: float


class GripperHardware:
    """The drive and the sensors of one gripper, for as long as its arm is in the world.

    The fingers move at the commanded speed until the object between them takes the commanded
    force; then they hold that force, whatever their opening.

    Args:
        gripper: Description of the gripper.
        errors: Error bounds of sensors and drives.
        rng: Random stream of the drive's gain and the encoder's noise.
        timestep: Seconds of one physics step.
        bank: Arrays of all grippers.
        row: Row of this gripper.

    Attributes:
        vacuum: Measured share of a cup's full vacuum, 0 to 1; 0 if it does not seal.
        tactile: Sensors of the force on each pad, if the gripper has any.
        commanded: The current command.
    """

    def __init__(
        self,
        gripper: Gripper,
        errors: RealityErrors,
        rng: np.random.Generator,
        timestep: float,
        bank: FingerBank,
        row: int,
    ) -> None:
        self.gripper = gripper
        self.vacuum = 0.0
        self._numbers = bank.numbers[row]
        self._readings = bank.readings[row]
        self._widths = bank.widths[row]
        self._batch = bank.noise[row]
        self._drive = bank.drives[row]
        self._numbers[:] = 0
        self._numbers[Q_ADDRESS] = self._numbers[PADS] = -1
        self._readings[:] = 0.0
        self._readings[WIDTH] = gripper.stroke
        self._readings[SENSED_S] = -1.0
        initial = gripper.stroke if gripper.fingers else LET_GO
        self._gain = 1.0 + float(errors.drive.gain.draw(rng, 1)[0])
        self._rng = rng
        self.tactile: TactileSensors | None = None
        if gripper.tactile is not None:
            stream = rng.spawn(1)[0]
            self.tactile = TactileSensors(
                gripper, gripper.tactile, errors, stream, timestep, bank, row
            )
        encoder = errors.encoder
        resolution = gripper.resolution if encoder.resolution else 0.0
        self._readings[QUANTUM] = resolution
        share = encoder.noise / encoder.resolution if encoder.resolution else 0.0
        self._noise = resolution * min(share, 1.0)
        self._numbers[NOISE_ROW] = len(self._batch)
        self.refill()
        self._pump_rate = -math.expm1(-timestep / _PUMP_S)
        mass = gripper.moved_mass
        self._drive[:] = 0.0
        # From the opening, twice the travel of a finger, to the force on each finger.
        self._drive[STIFFNESS] = 0.5 * _STIFFNESS_SHARE * mass / timestep**2
        self._drive[DAMPING] = 0.5 * mass / timestep
        self._drive[GRIP_GAIN] = self._gain
        self._drive[MOST] = gripper.force.most
        self._drive[REFERENCE] = gripper.stroke
        self.command(GripperCommand(initial, gripper.speed.most, gripper.force.most))
        self._is_connected = False
        self._seal: Seal | None = None
        self._is_sealed = False
        self._steps_to_test = 0

    @property
    def width(self) -> float:
        """Opening from the encoder, m."""
        return float(self._readings[WIDTH])

    @property
    def speed(self) -> float:
        """Speed of the opening, positive when it opens, m/s."""
        return float(self._readings[SPEED])

    @property
    def force(self) -> float:
        """Force of a pad from the motor's current, N, positive when it closes.

        For a cup, its holding force.
        """
        return float(self._readings[PRESSED])

    @property
    def stamp(self) -> float:
        """Simulated time of all readings, s."""
        return float(self._readings[SENSED_S])

    def connect(self, model: mujoco.MjModel, data: mujoco.MjData, arm: str) -> None:
        """Connect to the gripper of an arm in the plant; again after each recompilation."""
        self._is_connected = True
        drive = int(model.actuator(f"{arm}/{DRIVE_NAME}").id)
        self._motor = data.ctrl[drive : drive + 1]
        if self.gripper.fingers:
            joint = model.joint(f"{arm}/{FINGERS[0]}")
            first = int(joint.dofadr[0])
            address = int(joint.qposadr[0])
            self._numbers[Q_ADDRESS] = address  # the second finger is next to the first
            self._numbers[V_ADDRESS] = first
            self._numbers[MOTOR] = drive
            self._q = data.qpos[address : address + 2]
            if self.tactile is not None:
                self.tactile.connect(model, arm)
        else:
            lip = int(model.body(f"{arm}/{CUP}").geomadr[0])
            cup = self.gripper.cup
            self._seal = None if cup is None else Seal(model, data, lip, cup)

    def command(self, wanted: GripperCommand) -> None:
        """Set the command, which holds until the next one.

        Args:
            wanted: Width, speed and force within the description's limits.
        """
        self.commanded = wanted
        self._drive[COMMANDED_WIDTH : COMMANDED_FORCE + 1] = (
            wanted.width,
            wanted.speed,
            wanted.force,
        )

    def disconnect(self) -> None:
        """Leave the world: nothing is driven or read any more."""
        self._is_connected = False
        self._numbers[Q_ADDRESS] = -1

    def read_first(self, time: float) -> None:
        """Read the fingers before the first step, which needs no kernel."""
        if time == self.stamp or self._numbers[Q_ADDRESS] < 0:
            return
        noise = self._batch[self._numbers[NOISE_ROW]]
        width = float(self._q[0]) + float(self._q[1]) + float(noise)
        quantum = float(self._readings[QUANTUM])
        if quantum:
            width = quantum * round(width / quantum)
        self._numbers[NOISE_ROW] += 1
        newest = (self._numbers[NEWEST] + 1) % len(self._widths)
        self._numbers[NEWEST] = newest
        self._numbers[KEPT] = min(self._numbers[KEPT] + 1, len(self._widths))
        self._widths[newest] = time, width
        self._readings[WIDTH] = width
        self._readings[SENSED_S] = time
        if self.tactile is not None and self.tactile.stamp < 0.0:
            self.tactile.read_first(time)

    def refill(self) -> None:
        """Draw the noise of the next readings if that of the last ones is used up."""
        if self._numbers[NOISE_ROW] >= len(self._batch):
            self._numbers[NOISE_ROW] = 0
            if self._noise:
                self._batch[:] = self._noise * self._rng.standard_normal(len(self._batch))
            else:
                self._batch[:] = 0.0
        if self.tactile is not None:
            self.tactile.refill()

    def set_finger_positions(self, positions: Vector) -> None:
        """Write finger positions from the encoder into plant positions, of shape (nq,)."""
        if self.gripper.fingers and self._is_connected:
            first = self._numbers[Q_ADDRESS]
            positions[first : first + 2] = 0.5 * self.width

    def set_open(self) -> None:
        """Put the fingers of an arm that was just added into the open position."""
        if self.gripper.fingers:
            self._q[:] = 0.5 * self.gripper.stroke
            self._readings[SENSED_S] = -1.0

    def drive_pump(self) -> None:
        """Build up a cup's vacuum for the next step while the lip seals, up to the set force."""
        is_on = self.commanded.width <= 0.0
        if is_on and self._seal is not None and self._steps_to_test <= 0:
            self._is_sealed = self._seal.is_tight
            self._steps_to_test = _SEAL_PERIOD
        self._steps_to_test -= 1
        share = self.commanded.force / self.gripper.force.most
        goal = share if is_on and self._is_sealed else 0.0
        self.vacuum += self._pump_rate * (goal - self.vacuum)
        self._motor[0] = min(self.vacuum * self._gain, 1.0)

    def sense_vacuum(self, time: float) -> None:
        """Read the sensor of a cup's vacuum at a simulated time in s."""
        self._readings[PRESSED] = self.vacuum * self.gripper.force.most
        self._readings[SENSED_S] = time


# Held objects
#
# MuJoCo moves a free body along its velocity for a step (a straight line), while the palm of a
# rotating arm moves along an arc. Without a correction a held object creeps outward by half the
# step times the centripetal acceleration: 2 mm/s at 2 m/s² and 2 ms.


class HeldObjectMotion:
    """Moves the objects that grippers hold; create a new one after a recompilation.

    Args:
        model: The plant.
        data: Its state.
        grippers: Descriptions of the grippers, by the arm's name.
    """

    def __init__(
        self, model: mujoco.MjModel, data: mujoco.MjData, grippers: Mapping[str, Gripper]
    ) -> None:
        self._model = model
        self._data = data
        self._pads = np.zeros((len(grippers), 3), np.int64)
        for row, (arm, gripper) in zip(self._pads, grippers.items(), strict=True):
            bodies = FINGERS if gripper.fingers else (CUP, CUP)
            row[:2] = [model.geom(f"{arm}/{body}/{PAD}").id for body in bodies]
            row[2] = model.body(f"{arm}/{PALM}").id
        self._joints = np.full((len(grippers), 1 + model.nv), -1, np.int64)
        for row, palm in zip(self._joints, self._pads[:, 2].tolist(), strict=True):
            joints = joints_above(model, palm)
            row[0] = model.body_rootid[palm]
            row[1 : 1 + len(joints)] = joints
        self._geom_bodies = model.geom_bodyid.copy()
        free = model.jnt_type == mujoco.mjtJoint.mjJNT_FREE
        self._addresses = np.full(model.nbody, -1, np.int64)
        self._addresses[model.jnt_bodyid[free]] = model.jnt_qposadr[free]
        self._held = np.full(len(grippers), -1)
        self._poses = np.zeros((len(grippers), 3, 7))
        self._step = float(model.opt.timestep)
        # Views: an attribute lookup on mjData costs more than the arithmetic on it.
        self._bodies = data.xpos, data.xquat
        self._motions = data.cdof, data.subtree_com
        self._qpos = data.qpos
        self._qvel = data.qvel

    def arguments(self) -> tuple[npt.NDArray[Any], ...]:  # of numbers of several types
        """Arguments of `find_held` after those of the contacts."""
        return (
            self._pads, self._geom_bodies, self._addresses, *self._bodies, self._held, self._poses
        )  # fmt: skip

    def correct(self) -> None:
        """Correct the poses of the objects that `find_held` has found, after the integration.

        Positions of bodies and contacts are still those before it. An object that two grippers hold
        moves with the first.
        """
        # Axes of motion remain those before the step, for which the velocities are.
        mujoco.mj_kinematics(self._model, self._data)
        kernels().move_held(
            self._pads, self._addresses, *self._bodies, self._held, self._poses, self._joints,
            *self._motions, self._qvel, self._step, self._qpos,
        )  # fmt: skip


def joints_above(model: mujoco.MjModel, body: int) -> list[int]:
    """Ids of the velocities that move a body, from the root of its tree to the body."""
    while body > 0 and not model.body_dofnum[body]:
        body = int(model.body_parentid[body])
    found = []
    dof = int(model.body_dofadr[body] + model.body_dofnum[body]) - 1 if body else -1
    while dof >= 0:
        found.append(dof)
        dof = int(model.dof_parentid[dof])
    return found[::-1]


def warm_up_held_objects() -> None:
    """Compile the kernel that moves held objects."""
    pads = np.zeros((1, 3), np.int64)
    held = np.zeros(1, np.int64)
    plant = np.zeros((1, 3)), np.array(((1.0, 0.0, 0.0, 0.0),))
    poses = np.zeros((1, 3, 7))
    q = np.zeros(7)
    motions = np.zeros((1, 6)), plant[0]
    joints = np.zeros((1, 2), np.int64)
    kernels().move_held(pads, held, *plant, held, poses, joints, *motions, q[:1], 0.002, q)


@dataclass(frozen=True, eq=False)
class Attachment:
    """An object held by an arm.

    Attributes:
        relative: Pose of the object in the arm's tool link when it was attached, by the arm's
            encoders, and by vision if the object was seen.
        since: Simulated time in seconds.
        was_seen: Whether that pose is estimated from vision, and not the true one.
        by_gripper: Whether a gripper holds the object instead of a weld: it is then only assumed
            to be held.
        most_force: Largest force of each pad, or of a cup, that the object withstands, N.
        lay: Estimated pose in the world at which the gripper picked the object.
        mass_declared: Whether the arm may use the declared mass; it may not for an object that it
            picked without its name.
        share: Fraction of the object's weight that the arm's model bears, from 0 to 1; less than 1
            only while another arm holds the object, too.
        borne_at: Where the arm's model bears its share, in the object's frame; None for the center
            of mass.
        carrier: Object in another arm's hand on which it rode when it was taken, or on which it is
            being placed: the two may touch. Empty if there is none.
        is_released: Whether the gripper is opening: the arm's model bears nothing of it any more.
    """

    arm: str
    object: str
    relative: Pose
    since: float
    was_seen: bool = False
    by_gripper: bool = False
    most_force: float = math.inf
    mass_declared: bool = True
    lay: Pose | None = None
    share: float = 1.0
    borne_at: Pose | None = None
    carrier: str = ""
    is_released: bool = False

    @property
    def name(self) -> str:
        """Name of the weld in the model."""
        return f"{self.arm}+{self.object}"


@dataclass(frozen=True)
class SharedGrasp:
    """Consent of an arm and a partner that both may hold one object at the same time.

    The partner's hand may then touch the object, and both hands may come nearer to each other than
    arms otherwise do.

    Attributes:
        partner: Name of the other arm.
        object: Name of the object.
        hands_m: Distance that the hands keep from each other, m.
    """

    partner: str
    object: str
    hands_m: float


class Attachments:
    """The attachments of a world, each with its weld in the world's MjSpec.

    Two arms may hold one object. Each then has an attachment of its own, with its share of the
    weight; the object stays held when one of them releases it.

    Args:
        spec: MjSpec of the world.
        recompile: Method of the world that compiles a changed spec.
        rebind: Method of the world that updates what depends on attachments, without compiling.
        reload: Method of the world that updates only the loads of an arm's model.
    """

    def __init__(
        self,
        spec: mujoco.MjSpec,
        recompile: Callable[[], None],
        rebind: Callable[[], None],
        reload: Callable[[str], None],
    ) -> None:
        self._spec = spec
        self._recompile = weakly(recompile)
        self._rebind = weakly(rebind)
        self._reload = weakly(reload)
        self._held: dict[tuple[str, str], Attachment] = {}
        self._consents: dict[tuple[str, str, str], float] = {}

    def __iter__(self) -> Iterator[Attachment]:
        return iter(self._held.values())

    def __len__(self) -> int:
        return len(self._held)

    def attached_to(self, arm: str) -> tuple[str, ...]:
        """Objects that the arm holds, in the order in which they were attached."""
        return tuple(a.object for a in self._held.values() if a.arm == arm)

    def find(self, arm: str, obj: str) -> Attachment | None:
        """The attachment of this pair, if there is one."""
        return self._held.get((arm, obj))

    def holders(self, obj: str) -> tuple[str, ...]:
        """Names of the arms that hold an object, in the order in which they took it."""
        return tuple(a.arm for a in self._held.values() if a.object == obj)

    def gripped_by(self, arm: str) -> tuple[Attachment, ...]:
        """Objects that the gripper is assumed to hold, in the order of picking."""
        return tuple(a for a in self._held.values() if a.arm == arm and a.by_gripper)

    def on_carriers(self, arm: str) -> list[tuple[str, str]]:
        """Held objects with the carrier that each may touch, of which an arm holds either."""
        return [
            (one.object, one.carrier)
            for one in self._held.values()
            if one.carrier and arm in (one.arm, *self.holders(one.carrier))
        ]

    def attach(
        self, new: Attachment, link: str, relative: Pose, tips: Sequence[str] = ()
    ) -> Attachment:
        """Weld an object to an arm's link; does nothing if it is held already.

        Args:
            new: The attachment.
            link: Name of the arm's tool link.
            relative: True pose of the object in that link.
            tips: Names of the fingers that hold it, whose contacts with it are ignored.

        Returns:
            The attachment of this arm and object, new or not.
        """
        held = self._held.get((new.arm, new.object))
        if held is not None:
            return held
        composition.add_weld(self._spec, new.name, link, new.object, relative, tips)
        self._held[new.arm, new.object] = new
        self._recompile()
        return new

    def hold(self, new: Attachment) -> None:
        """Assume that a gripper holds an object; replaces an earlier assumption about the pair.

        An object that is welded to the arm stays welded.
        """
        held = self._held.get((new.arm, new.object))
        if held is not None and not held.by_gripper:
            return
        self._held[new.arm, new.object] = new
        self._rebind()

    def detach(self, arm: str, obj: str, *, stands: bool = False) -> bool:
        """Release an object; returns whether it was held.

        Args:
            arm: Name of the arm.
            obj: Name of the object.
            stands: Whether something else supports the object, so that its weight does not fall to
                an arm that still holds it.
        """
        held = self._held.pop((arm, obj), None)
        if held is None:
            return False
        if not stands:
            self._leave_all_to_the_last(obj)
        if held.by_gripper:
            self._rebind()
        else:
            composition.remove_weld(self._spec, held.name)
            self._recompile()
        return True

    def _leave_all_to_the_last(self, obj: str) -> None:
        """Let the only arm that still holds an object bear what nobody else bears any more.

        It is still modeled at the grasp, if it was there: a long object may lie on something;
        torques that turn all of it would shake the arm.
        """
        left = self.holders(obj)
        if len(left) == 1:
            key = left[0], obj
            self._held[key] = replace(self._held[key], share=1.0)

    def bear(self, arm: str, obj: str, share: float, at: Pose | None = None) -> None:
        """Set the share of an object's weight that an arm's model bears.

        Does nothing if the arm does not hold the object.

        Args:
            arm: Name of the arm.
            obj: Name of the object.
            share: Share, from 0 to 1.
            at: Where it bears its share, in the object's frame; by default at the center of mass.
        """
        held = self._held.get((arm, obj))
        if held is not None and (held.share != share or held.borne_at is not at):
            self._held[arm, obj] = replace(held, share=share, borne_at=at)
            self._reload(arm)

    def release(self, arm: str, *, opens: bool) -> None:
        """Take what a gripper holds out of the arm's model while it opens, or put it back.

        Args:
            arm: Name of the arm.
            opens: Whether the gripper opens.
        """
        gripped = [one for one in self.gripped_by(arm) if one.is_released != opens]
        for one in gripped:
            self._held[arm, one.object] = replace(one, is_released=opens)
        if gripped:
            self._reload(arm)

    def place_on(self, arm: str, obj: str, carrier: str) -> None:
        """Let a held object touch a carrier in another arm's hand; none if that is empty.

        Does nothing if the arm does not hold the object.
        """
        held = self._held.get((arm, obj))
        if held is not None and held.carrier != carrier:
            self._held[arm, obj] = replace(held, carrier=carrier)
            self._rebind()

    def consent(self, arm: str, partner: str, obj: str, hands_m: float) -> None:
        """Let a partner hold an object together with an arm, once the partner consents as well.

        To be revoked by `dissent`, whatever ends the reason for it.

        Args:
            arm: Name of the arm.
            partner: Name of the other arm.
            obj: Name of the object.
            hands_m: Distance that the hands keep from each other, m.
        """
        self._consents[arm, partner, obj] = hands_m
        if (partner, arm, obj) in self._consents:
            self._rebind()

    def dissent(self, arm: str, partner: str, obj: str) -> None:
        """Revoke a consent; no effect if there is none."""
        revoked = self._consents.pop((arm, partner, obj), None)
        if revoked is not None and (partner, arm, obj) in self._consents:
            self._rebind()

    def shared_grasps(self, arm: str) -> tuple[SharedGrasp, ...]:
        """Objects that others may hold together with an arm: both sides have consented."""
        return tuple(
            SharedGrasp(partner, obj, max(hands_m, self._consents[partner, arm, obj]))
            for (one, partner, obj), hands_m in self._consents.items()
            if one == arm and (partner, arm, obj) in self._consents
        )

    def forget(self, name: str) -> None:
        """Remove every attachment of an arm or object that leaves the world, without compiling."""
        for key, held in list(self._held.items()):
            if name in key:
                if not held.by_gripper:
                    composition.remove_weld(self._spec, held.name)
                del self._held[key]
                self._leave_all_to_the_last(held.object)
            elif held.carrier == name:
                self._held[key] = replace(held, carrier="")
        for consent in [one for one in self._consents if name in one]:
            del self._consents[consent]
