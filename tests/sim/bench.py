"""Sensors and drives of arms on a bench: without a plant, joint states are set directly."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import numpy as np

from bt_dualarm.core.pose import Vector
from bt_dualarm.sim.device_kernels import apply_torques, read_joints
from bt_dualarm.sim.devices import ArmDrives, ArmHardware, Drives, Encoders, parts_of
from bt_dualarm.spec.document import DriveErrors, EncoderErrors

STEP = 0.002
ARM = "arm"


@dataclass(frozen=True)
class Joints:
    """An arm whose joints have the same indices in all arrays."""

    qpos_ids: Any
    dof_ids: Any
    actuator_ids: Any
    data: Any
    model: Any = None


class Bench:
    """Arms whose joint states are set and whose drives get given commands.

    Args:
        sensed: Errors of the encoders, by arm.
        driven: Errors, gains and effort limits of the drives, by arm.
    """

    def __init__(
        self, sensed: Mapping[str, EncoderErrors], driven: Mapping[str, ArmDrives]
    ) -> None:
        self._parts = parts_of({name: len(one.effort) for name, one in driven.items()})
        self.encoders = Encoders(sensed, self._parts, STEP)
        self.drives = Drives(driven, self._parts, STEP)
        n = sum(len(one.effort) for one in driven.values())
        self._true: Any = SimpleNamespace(qpos=np.zeros(n), qvel=np.zeros(n), ctrl=np.zeros(n))
        self._present: dict[str, Joints] = {}
        self.hardware: dict[str, ArmHardware] = {}
        self._connect()

    def begin(self, name: str, seed: int = 0) -> None:
        """Add an arm."""
        part = self._parts[name]
        ids = np.arange(part.start, part.stop)
        self._present[name] = Joints(ids, ids, ids, self._true)
        self.encoders.begin(name, np.random.default_rng(seed))
        self.drives.begin(name)
        self.hardware[name] = ArmHardware(self.encoders, part, self.drives, name)
        self.hardware[name].connect(self._present[name])
        self._connect()

    def _connect(self) -> None:
        self.encoders.connect(self._true, self._present)
        self.drives.connect(self._present)

    def read(self, time: float) -> None:
        """Let the encoders take readings."""
        read_joints(*self.encoders.begin_reading(time))
        self.encoders.end_reading(time)

    def drive(self) -> None:
        """Let the drives apply their torques for a step."""
        apply_torques(*self.drives.begin_step(), self._true.ctrl)

    def place(self, name: str, q: Vector, v: Vector) -> None:
        """Set joint positions and velocities of an arm, each of shape (dof,)."""
        self._true.qpos[self._parts[name]] = q
        self._true.qvel[self._parts[name]] = v

    def torque(self, name: str) -> Vector:
        """Torques that the joints of an arm get, of shape (dof,)."""
        torque: Vector = self._true.ctrl[self._parts[name]].copy()
        return torque


class BenchEncoders:
    """Encoders of one arm that read given joint states.

    Args:
        errors: Errors of the encoders.
        dof: Number of joints.
        seed: Seed of the noise.
    """

    def __init__(self, errors: EncoderErrors, dof: int, seed: int) -> None:
        self._bench = Bench({ARM: errors}, {ARM: ArmDrives(DriveErrors(), *np.ones((2, dof)))})
        self._bench.begin(ARM, seed)

    @property
    def q(self) -> Vector:
        return self._bench.hardware[ARM].q

    @property
    def v(self) -> Vector:
        return self._bench.hardware[ARM].v

    def read(self, q: Vector, v: Vector, stamp: float) -> None:
        self._bench.place(ARM, q, v)
        self._bench.read(stamp)


class BenchDrives:
    """Drives of one arm, with access to the motor torques.

    Args:
        errors: Errors of the drives.
        gain: Factor of each joint's torque, of shape (dof,).
        effort: Effort limits, of shape (dof,), N m.
    """

    def __init__(self, errors: DriveErrors, gain: Vector, effort: Vector) -> None:
        self._bench = Bench({ARM: EncoderErrors()}, {ARM: ArmDrives(errors, gain, effort)})
        self._bench.begin(ARM)

    def passed(self, torque: Vector) -> Vector:
        """Torques that the joints get in the step after a command."""
        self._bench.hardware[ARM].command(torque)
        self._bench.drive()
        return self._bench.torque(ARM)
