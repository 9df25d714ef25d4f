"""The encoders of an arm's joints: a position in steps and noise, and a velocity that follows."""

from __future__ import annotations

import math
from collections import deque

import numpy as np

from bt_dualarm.pose import Vector
from bt_dualarm.spec.reality import EncoderErrors


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
        self._timestep = timestep
        self._share = -math.expm1(-2 * math.pi * errors.cutoff * timestep) if errors.cutoff else 1.0
        self._rng = rng
        self._before: deque[Vector] = deque(maxlen=self._steps + 1)
        self._stamp = -math.inf
        self._v_before: Vector = np.zeros(0)
        self.q: Vector = np.zeros(0)
        self.v: Vector = np.zeros(0)

    def read(self, q: Vector, v: Vector, stamp: float) -> None:
        """Read joints at ``q`` that move with ``v``, each of shape (dof,), at a time in s.

        A second reading of one moment takes the place of the first.
        """
        if self._noise:
            q = q + self._noise * self._rng.standard_normal(len(q))
        if self._resolution:
            q = np.rint(q / self._resolution) * self._resolution
        self.q = q
        if self._steps:
            self._forget(stamp)
            self._difference(q)
        else:
            self.v = v

    def _forget(self, stamp: float) -> None:
        """What was read at this moment already, and all of it where time has gone back."""
        if stamp < self._stamp:
            self._before.clear()
        elif stamp == self._stamp:
            self._before.pop()
            self.v = self._v_before
        self._stamp = stamp

    def _difference(self, q: Vector) -> None:
        if not self._before:
            self.v = np.zeros_like(q)  # an arm comes into the world at rest
        self._v_before = self.v
        self._before.append(q)
        span = len(self._before) - 1
        if span:
            slope = (q - self._before[0]) / (span * self._timestep)
            self.v = self.v + self._share * (slope - self.v)
