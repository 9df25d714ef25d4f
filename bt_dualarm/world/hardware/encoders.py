"""The encoders of an arm's joints: a position in steps and noise, and a velocity that follows."""

from __future__ import annotations

import math
from functools import cache
from types import ModuleType

import numpy as np

from bt_dualarm.pose import Matrix, Vector
from bt_dualarm.spec.reality import EncoderErrors

_DRAWN = 512
"""Readings whose noise is drawn at once: one by one that costs as much as all the rest."""


class Encoders:
    """Reads once a physics step.

    Args:
        errors: Resolution, noise, and how a velocity is made of positions.
        timestep: Seconds between two readings.
        rng: Source of the noise.

    Attributes:
        q: Last reading of the positions, of shape (dof,), rad.
        v: Velocities that come of it, of shape (dof,), rad/s.
    """

    def __init__(self, errors: EncoderErrors, timestep: float, rng: np.random.Generator) -> None:
        self._resolution = math.radians(errors.resolution)
        self._noise = math.radians(errors.noise)
        self._steps = max(1, round(errors.window / timestep)) if errors.window else 0
        share = -math.expm1(-2 * math.pi * errors.cutoff * timestep) if errors.cutoff else 1.0
        self._kept = 1.0 - share
        # By how many readings lie between two: what their difference adds to the velocity.
        self._rates = [share / (max(n, 1) * timestep) for n in range(max(1, self._steps) + 1)]
        self._rng = rng
        self._drawn: Matrix = np.zeros((0, 0))
        self._row = 0
        self._past = np.zeros((self._steps + 1, 0))
        self._newest, self._count = -1, 0
        self._stamp = -math.inf
        self._v_before: Vector = np.zeros(0)
        self.q: Vector = np.zeros(0)
        self.v: Vector = np.zeros(0)

    def read(self, q: Vector, v: Vector, stamp: float) -> None:
        """Read joints at ``q`` that move with ``v``, each of shape (dof,), at a time in s.

        A second reading of one moment takes the place of the first.
        """
        if self._row == len(self._drawn):
            self._draw(len(q))
        row, self._row = self._row, self._row + 1
        if self._steps:
            if stamp <= self._stamp:
                self._forget(stamp)
            self._stamp = stamp
        if self._count:
            self._difference(q, row)
            return
        reading = q + self._drawn[row]
        if self._resolution:
            reading = np.rint(reading * (1.0 / self._resolution)) * self._resolution
        self.q = reading
        if self._steps:  # an arm comes into the world at rest
            self._past = np.zeros((self._steps + 1, len(q)))
            self._past[0], self._newest, self._count = reading, 0, 1
            self.v = self._v_before = np.zeros_like(q)
        else:
            self.v = v.copy()

    def _draw(self, dof: int) -> None:
        """Draw the noise of readings to come, of shape (n, dof), rad."""
        count = (_DRAWN, dof)
        drawn = self._rng.standard_normal(count) if self._noise else np.zeros(count)
        self._drawn, self._row = self._noise * drawn, 0

    def _forget(self, stamp: float) -> None:
        """What was read at this moment already, and all of it where time has gone back."""
        if stamp < self._stamp:
            self._count = 0
        else:
            self._count -= 1
            self._newest -= 1
            self.v = self._v_before

    def _difference(self, q: Vector, row: int) -> None:
        """Read with a row of the noise, and take the velocity from the difference to earlier."""
        past, rows, span, before = self._past, self._steps + 1, self._count, self.v
        if span == rows:
            span -= 1
        self._count = span + 1
        self._newest = newest = (self._newest + 1) % rows
        read = np.empty((2, len(before)))
        kernels().difference(
            q,
            self._drawn,
            row,
            self._resolution,
            past,
            newest,
            (newest - span) % rows,
            self._kept,
            self._rates[span],
            before,
            read,
        )
        self.q, self.v, self._v_before = read[0], read[1], before


@cache
def kernels() -> ModuleType:
    """The kernels: an import statement costs as much as they do."""
    from bt_dualarm.world.hardware import hardware_kernels

    return hardware_kernels
