"""One arm's sensors and drives: what its controller reads, and what obeys it."""

from __future__ import annotations

from typing import Protocol

import mujoco
import numpy as np
import numpy.typing as npt

from bt_dualarm.pose import Vector


class PlantArm(Protocol):
    """Where an arm lies in the arrays of the plant."""

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
        dof: Number of joints.

    Attributes:
        q: Positions of the joints by their encoders, base to tip, of shape (dof,), rad.
        v: Velocities of the joints as the drives report them, of shape (dof,), rad/s.
        stamp: Simulated time of both in s.
        commanded: Torques that were commanded last, of shape (dof,), N m.
    """

    def __init__(self, dof: int) -> None:
        self.q: Vector = np.zeros(dof)
        self.v: Vector = np.zeros(dof)
        self.stamp = 0.0
        self.commanded: Vector = np.zeros(dof)
        self._plant: PlantArm | None = None

    def connect(self, plant: PlantArm) -> None:
        """Belong to an arm of the plant; anew after each recompilation."""
        self._plant = plant

    def sense(self) -> None:
        """Read the sensors."""
        if self._plant is not None:
            data = self._plant.data
            self.q = data.qpos[self._plant.qpos_ids]
            self.v = data.qvel[self._plant.dof_ids]
            self.stamp = float(data.time)

    def command(self, torque: Vector) -> None:
        """Give the motors torques that hold until the next command.

        Args:
            torque: Torques of the joints, of shape (dof,), N m, within their efforts.
        """
        self.commanded = torque
        if self._plant is not None:
            self._plant.data.ctrl[self._plant.actuator_ids] = torque
