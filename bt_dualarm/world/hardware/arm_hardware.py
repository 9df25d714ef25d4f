"""One arm's sensors and drives: what its controller reads, and what obeys it."""

from __future__ import annotations

from collections import deque
from typing import Final, Protocol

import mujoco
import numpy as np
import numpy.typing as npt

from bt_dualarm.pose import Matrix, Vector
from bt_dualarm.spec.reality import RealityErrors
from bt_dualarm.world.hardware.drawn_arm import DrawnArm, stream
from bt_dualarm.world.hardware.drives import Drives
from bt_dualarm.world.hardware.encoders import Encoders
from bt_dualarm.world.hardware.kernel_rows import DRIVES, FRICTION
from bt_dualarm.world.hardware.rubbing import Rubbing

KEPT_S: Final = 0.25
"""Seconds for which readings are kept, for pictures whose stamp is late or early."""


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


class ArmHardware:
    """The sensors and drives of one arm, for as long as it is in the world.

    Readings are those of the moment of `sense`: what becomes of the plant after that is not known
    to anybody who reads here.

    Args:
        errors: What sensors and drives do to what goes through them.
        drawn: The robot of the batch that it is.
        effort: Effort limits of its joints, of shape (dof,), N m.
        timestep: Seconds of one physics step.
        seed: Seed of the run, and the arm's name: source of the sensors' noise.

    Attributes:
        q: Positions of the joints by their encoders, base to tip, of shape (dof,), rad.
        v: Velocities of the joints as the drives report them, of shape (dof,), rad/s.
        stamp: Simulated time of both in s.
        commanded: Torques that were commanded last, of shape (dof,), N m.
    """

    def __init__(
        self,
        errors: RealityErrors,
        drawn: DrawnArm,
        effort: Vector,
        timestep: float,
        seed: tuple[int, str],
    ) -> None:
        number, name = seed
        self.q: Vector = np.zeros_like(effort)
        self.v: Vector = np.zeros_like(effort)
        self.stamp = 0.0
        self.commanded: Vector = np.zeros_like(effort)
        self._encoders = Encoders(errors.encoder, timestep, stream(number, f"{name}:encoders"))
        self._drives = Drives(errors.drive, drawn.gain, effort, timestep)
        self._rubbing = Rubbing(drawn.friction)
        self._past: deque[tuple[float, Vector]] = deque(maxlen=round(KEPT_S / timestep))

    def connect(self, plant: PlantArm) -> None:
        """Belong to an arm of the plant; anew after each recompilation."""
        data = plant.data
        # Views: looking a field up costs more than reading it. A chain's joints follow each other.
        self._true_q = data.qpos[plant.qpos_ids[0] : plant.qpos_ids[-1] + 1]
        self._true_v = data.qvel[plant.dof_ids[0] : plant.dof_ids[-1] + 1]
        self._motors = data.ctrl[plant.actuator_ids[0] : plant.actuator_ids[-1] + 1]
        self._rubbing.connect(plant.model, plant.data, plant.dof_ids)

    @property
    def is_ideal(self) -> bool:
        """Whether the drives give what is commanded at once, and need not act at each step."""
        return self._drives.is_ideal

    @property
    def rubs(self) -> bool:
        """Whether the joints have friction."""
        return not self._rubbing.is_none

    def sense(self, time: float) -> None:
        """Read the sensors at a simulated time in s; again at the same moment changes nothing."""
        encoders, past = self._encoders, self._past
        encoders.read(self._true_q, self._true_v, time)
        self.stamp, self.q, self.v = time, encoders.q, encoders.v
        while past and past[-1][0] >= time:
            past.pop()
        past.append((time, self.q))

    def q_at(self, time: float) -> Vector:
        """Positions by the encoders at a time in s, between readings on a line, of shape (dof,).

        Before the first that is kept, and after the last, that one.
        """
        later = (self.stamp, self.q)
        for stamp, q in reversed(self._past):
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
        self._drives.command(torque)
        self.was_commanded(torque)

    @property
    def drives(self) -> Matrix:
        """What machine code commands the drives by, see `kernel_rows`; it then says so."""
        return self._drives.rows

    def was_commanded(self, torque: Vector) -> None:
        """Note that the drives have been given torques, of shape (dof,), N m; see `command`."""
        self.commanded = torque
        if self._drives.is_ideal:
            self._motors[:] = torque

    def drive(self) -> None:
        """Let the drives act during the next step of physics."""
        self._drives.drive(self._motors)

    def rub(self) -> None:
        """Set the joints' friction for the velocities that the plant has now."""
        self._rubbing.act()


def sense_something() -> None:
    """Have all kernels of sensors and drives compiled."""
    from bt_dualarm.world.hardware import hardware_kernels as kernels

    one, table = np.ones(1), np.ones((FRICTION, 1))
    kernels.difference(one, table, 0, 1.0, table, 0, 1, 1.0, 1.0, one, np.ones((2, 1)))
    kernels.pass_on(table, 0, one, 1.0, 1.0, one, one)
    kernels.take_torques(one, np.ones((DRIVES, 1)))
    kernels.rub(table, one, one, one)
