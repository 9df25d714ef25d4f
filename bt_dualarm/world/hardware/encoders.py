"""The encoders of all joints: a position in steps and noise, and a velocity that follows."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Mapping
from functools import cache
from types import ModuleType
from typing import Final

import mujoco
import numpy as np

from bt_dualarm.pose import Matrix, Vector
from bt_dualarm.spec.reality import EncoderErrors
from bt_dualarm.world.hardware.kernel_columns import (
    COUNT,
    COUNTS,
    ENCODERS,
    KEPT,
    RESOLUTION,
    TAKEN,
    WINDOW,
)
from bt_dualarm.world.hardware.plant_arm import PlantArm, count_of, joints_of

KEPT_S: Final = 0.25
"""Seconds for which readings are kept, for pictures whose stamp is late or early."""

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
        self._parts, self._step = parts, timestep
        self._encoders, self._counts = np.zeros((count, ENCODERS)), np.zeros((count, COUNTS), int)
        self._deviation = {name: math.radians(one.noise) for name, one in errors.items()}
        for name, one in errors.items():
            window = max(1, round(one.window / timestep)) if one.window else 0
            share = -math.expm1(-2 * math.pi * one.cutoff * timestep) if one.cutoff else 1.0
            self._encoders[parts[name], RESOLUTION] = math.radians(one.resolution)
            self._encoders[parts[name], KEPT] = 1.0 - share
            self._encoders[parts[name], TAKEN] = share
            self._counts[parts[name], WINDOW] = window
        rows = int(self._counts[:, WINDOW].max(initial=0)) + 1
        self._window, self._newest = np.zeros((rows, count)), -1
        self._noise, self._row = np.zeros((_DRAWN, count)), 0
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
        self._q, self._v = data.qpos, data.qvel

    def read(self, time: float) -> None:
        """Read all joints at a time in s.

        A second reading of one moment takes the place of the first.
        """
        if time <= self.stamp:
            self._forget(time)
        if self._row == _DRAWN:
            for name in self._sources:
                self._draw(name, 0)
            self._row = 0
        row, self._row = self._row, self._row + 1
        self._newest = (self._newest + 1) % len(self._window)
        before, self.readings = self.readings, np.empty(self.readings.shape)
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
        self.stamp, self._before = time, before
        self.past.append((time, self.readings))

    def _draw(self, name: str, first: int) -> None:
        """Draw the noise of an arm's readings to come, from a row on."""
        part, deviation = self._parts[name], self._deviation[name]
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
        reading, resolution = self._q[places] + noise[joints], self._encoders[joints, RESOLUTION]
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
    from bt_dualarm.world.hardware import hardware_kernels

    return hardware_kernels
