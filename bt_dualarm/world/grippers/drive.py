"""A gripper's drive and sensors: what moves the fingers, and what is known of them."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass
from functools import cache
from types import ModuleType
from typing import Final

import mujoco
import numpy as np

from bt_dualarm.pose import Vector
from bt_dualarm.spec.reality import RealityErrors
from bt_dualarm.world.grippers.gripper import FINGERS, Gripper
from bt_dualarm.world.grippers.kernel_columns import (
    ASKED_FORCE,
    ASKED_WIDTH,
    DAMPING,
    DRIVE,
    FORCE,
    GAIN,
    MOST,
    REFERENCE,
    STIFFNESS,
)
from bt_dualarm.world.grippers.mjspec import CUP
from bt_dualarm.world.grippers.mjspec import DRIVE as DRIVE_NAME
from bt_dualarm.world.grippers.sealing import Seal
from bt_dualarm.world.grippers.tactile import tactile_sensors

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
        gripper: Page of the gripper.
        errors: What sensors and drives do to what goes through them.
        rng: Source of the drive's gain and the encoder's noise.
        timestep: Seconds of one physics step.

    Attributes:
        width: Opening by the encoder, m.
        speed: Speed of the opening, positive where it opens, m/s.
        force: Force of a pad as the motor's current tells, N; positive where it closes. Of a cup,
            that with which it holds.
        vacuum: Share of the full vacuum that a cup senses, 0 to 1: 0 where it does not seal.
        tactile: What feels the force on each pad, if the page has something that does.
        stamp: Simulated time of all of them, s.
        commanded: What was asked for last.
    """

    def __init__(
        self, gripper: Gripper, errors: RealityErrors, rng: np.random.Generator, timestep: float
    ) -> None:
        self.gripper = gripper
        self.width, self.speed, self.force = gripper.stroke, 0.0, 0.0
        self.vacuum, self.stamp = 0.0, -1.0
        begin = gripper.stroke if gripper.fingers else LET_GO
        self._gain = 1.0 + float(errors.drive.gain.draw(rng, 1)[0])
        self._rng, self._step = rng, timestep
        self.tactile = tactile_sensors(gripper, errors, rng, timestep)
        encoder = errors.encoder
        self._resolution = gripper.resolution if encoder.resolution else 0.0
        finer = encoder.noise / encoder.resolution if encoder.resolution else 0.0
        self._noise = self._resolution * min(finer, 1.0)
        self._drawn: list[float] = []  # of readings to come, the last first
        self._past: deque[tuple[float, float]] = deque(maxlen=round(SPEED_S / timestep) + 1)
        self._pump = -math.expm1(-timestep / _PUMP_S)
        mass, self._drive = gripper.moved_mass, np.zeros(DRIVE)
        # Of the opening, which is twice a finger's way, to the force on each finger.
        self._drive[STIFFNESS] = 0.5 * _STIFFNESS * mass / timestep**2
        self._drive[DAMPING] = 0.5 * mass / timestep
        self._drive[GAIN], self._drive[MOST] = self._gain, gripper.force.most
        self._drive[REFERENCE] = gripper.stroke
        self.command(GripperCommand(begin, gripper.speed.most, gripper.force.most))
        self._is_connected = False
        self._seal: Seal | None = None
        self._tight, self._looked = False, 0

    def connect(self, model: mujoco.MjModel, data: mujoco.MjData, arm: str) -> None:
        """Belong to the gripper of an arm of the plant; anew after each recompilation."""
        self._is_connected = True
        drive = int(model.actuator(f"{arm}/{DRIVE_NAME}").id)
        self._motor = data.ctrl[drive : drive + 1]
        if self.gripper.fingers:
            joint = model.joint(f"{arm}/{FINGERS[0]}")
            first, address = int(joint.dofadr[0]), int(joint.qposadr[0])
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
            wanted: Width, speed and force within the page's limits.
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
            kernels().push(self._q, self._v, self._drive, self._step, self._motor)
        else:
            self._suck()

    def _suck(self) -> None:
        """The pump: vacuum builds up where the lip seals, up to the force that is asked for."""
        sucks = self.commanded.width <= 0.0
        if sucks and self._seal is not None and self._looked <= 0:
            self._tight, self._looked = self._seal.is_tight, _LOOK
        self._looked -= 1
        goal = self.commanded.force / self.gripper.force.most if sucks and self._tight else 0.0
        self.vacuum += self._pump * (goal - self.vacuum)
        self._motor[0] = min(self.vacuum * self._gain, 1.0)


@cache
def kernels() -> ModuleType:
    """The kernel: an import statement costs as much as it does."""
    from bt_dualarm.world.grippers import finger_kernels

    return finger_kernels


def finger_something() -> None:
    """Have the kernel of fingers compiled."""
    pair, drive = np.zeros(2), np.ones(DRIVE)
    kernels().push(pair, pair, drive, 0.002, np.zeros(1))
