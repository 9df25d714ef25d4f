"""The drives of all joints: what becomes of a torque on its way to the joint."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import mujoco
import numpy as np

from bt_dualarm.pose import Matrix, Vector
from bt_dualarm.spec.reality import DriveErrors
from bt_dualarm.world.hardware.encoders import kernels
from bt_dualarm.world.hardware.kernel_columns import (
    DRIVES,
    EFFORT,
    GAIN,
    LATE,
    PER_STEP,
    SHARE,
    TORQUE,
    WANTED,
    WHOLE,
)
from bt_dualarm.world.hardware.plant_arm import PlantArm, count_of, joints_of

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
        self._arms, self._parts = arms, parts
        self._drives = np.zeros((count_of(parts), DRIVES))
        for name, one in arms.items():
            rows, quantum, effort = self.of(name), one.quantum, one.effort
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
