"""One arm's sensors and drives: what its controller reads, and what obeys it."""

from __future__ import annotations

import numpy as np

from bt_dualarm.pose import Matrix, Vector
from bt_dualarm.world.hardware.drives import Drives
from bt_dualarm.world.hardware.encoders import Encoders, kernels
from bt_dualarm.world.hardware.kernel_columns import COUNTS, DRIVES, ENCODERS, FRICTION
from bt_dualarm.world.hardware.plant_arm import PlantArm


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
        self._encoders, self._part = encoders, part
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
        self.was_commanded(torque)

    def was_commanded(self, torque: Vector) -> None:
        """Note that the drives have been given torques, of shape (dof,), N m; see `command`."""
        self.commanded = torque
        if self._is_ideal:
            self._motors[:] = torque


def sense_something() -> None:
    """Have all kernels of sensors and drives compiled."""
    compiled, one = kernels(), np.ones(1)
    two, three = np.zeros((1, 2), np.int64), np.zeros((1, 3), np.int64)
    counts, table, past = np.zeros((1, COUNTS), np.int64), np.ones((1, ENCODERS)), np.ones((2, 1))
    compiled.read_joints(three, one, one, table, counts, past, 0, past, 0, 1.0, past, past)
    compiled.pass_on(two, past, 0, np.ones((1, DRIVES)), one)
    compiled.take_torques(one, np.ones((1, DRIVES)))
    compiled.rub(two, np.ones((1, FRICTION)), one, one, one)
