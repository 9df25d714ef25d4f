"""What a gripper's pads feel: the force on each of them, as sensors under them tell it."""

from __future__ import annotations

from functools import cache
from types import ModuleType
from typing import Final

import mujoco
import numpy as np

from bt_dualarm.pose import Matrix, Vector
from bt_dualarm.spec.reality import RealityErrors
from bt_dualarm.world.grippers.gripper import FINGERS, PALM, Gripper, Tactile
from bt_dualarm.world.grippers.mjspec import FELT

_FORCE: Final = 3  # numbers of a reading

_DRAWN: Final = 256
"""Readings whose noise is drawn at once: one by one that costs more than all the rest."""


class TactileSensors:
    """The sensors under both pads of one gripper, for as long as its arm is in the world.

    They feel what presses on the pads and what rubs along them: the force of the last step of
    physics, in the axes of the tool frame, which the fingers keep. With an ideal encoder they are
    exact; else each pad's reading has the noise of its page, and a gain that the seed draws.

    Args:
        gripper: Page of the gripper.
        tactile: What the page says of them.
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
        self._rng, self._turn = rng, gripper.tool.rotation_matrix.copy()
        is_ideal = not (errors.encoder.resolution or errors.encoder.noise)
        self._noise = 0.0 if is_ideal else tactile.noise
        spread = 0.0 if is_ideal else tactile.gain
        self._gains = 1.0 + rng.uniform(-spread, spread, len(FINGERS))
        self._drawn: Matrix = np.zeros((0, len(FINGERS) * _FORCE))
        self._row = 0
        self._every = max(1.0 / tactile.rate - 0.5 * timestep, 0.0)

    def connect(self, model: mujoco.MjModel, data: mujoco.MjData, arm: str) -> None:
        """Belong to the gripper of an arm of the plant; anew after each recompilation."""
        first, second = (int(model.sensor(f"{arm}/{name}/{FELT}").adr[0]) for name in FINGERS)
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
        is_first, self.stamp = self.stamp < 0.0, time
        if self._row == len(self._drawn):
            self._draw()
        row, self._row = self._row, self._row + 1
        if is_first:  # before its first step nothing presses; and who makes none needs no kernel
            self.forces = self._drawn[row].reshape(self.forces.shape)
            return
        self.forces = kernels().felt_in_tool(
            self._felt, self._palm, self._turn, self._gains, self._drawn, row
        )

    def _draw(self) -> None:
        """Draw the noise of readings to come, of shape (n, 6), N."""
        count = (_DRAWN, len(FINGERS) * _FORCE)
        drawn = self._rng.standard_normal(count) if self._noise else np.zeros(count)
        self._drawn, self._row = self._noise * drawn, 0


def tactile_sensors(
    gripper: Gripper, errors: RealityErrors, rng: np.random.Generator, timestep: float
) -> TactileSensors | None:
    """The sensors that the page of a gripper declares; None where it declares none.

    Args:
        gripper: Page of the gripper.
        errors: What sensors do to what goes through them.
        rng: Source of a stream of their own.
        timestep: Seconds of one physics step.
    """
    tactile = gripper.tactile
    if tactile is None:
        return None
    return TactileSensors(gripper, tactile, errors, rng.spawn(1)[0], timestep)


@cache
def kernels() -> ModuleType:
    """The kernels: an import statement costs as much as they do."""
    from bt_dualarm.world.grippers import tactile_kernels

    return tactile_kernels


def feel_something() -> None:
    """Have the kernel of what pads feel compiled."""
    kernels().felt_in_tool(
        np.zeros(6), np.eye(3).ravel(), np.eye(3), np.ones(2), np.zeros((1, 6)), 0
    )
