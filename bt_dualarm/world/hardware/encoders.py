"""The encoders of an arm's joints: a position in steps and noise, and a velocity that follows."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterator

import numpy as np

from bt_dualarm.pose import Vector
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
        # Numbers are arrays of no dimension where they meet arrays: that costs half as much.
        self._resolution = np.array(math.radians(errors.resolution))
        self._steps_of = np.array(1.0 / self._resolution) if self._resolution else None
        self._noise = math.radians(errors.noise)
        self._steps = max(1, round(errors.window / timestep)) if errors.window else 0
        share = -math.expm1(-2 * math.pi * errors.cutoff * timestep) if errors.cutoff else 1.0
        self._kept = np.array(1.0 - share)
        # By how many readings lie between two: what their difference adds to the velocity.
        self._rates = [np.array(share / (n * timestep)) for n in range(1, max(1, self._steps) + 1)]
        self._rng = rng
        self._drawn: Iterator[Vector] = iter(())
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
            q = q + self._noise_of(len(q))
        if self._steps_of is not None:
            q = q * self._steps_of
            np.rint(q, q)
            np.multiply(q, self._resolution, q)
        self.q = q
        if self._steps:
            self._forget(stamp)
            self._difference(q)
        else:
            self.v = v.copy()

    def _noise_of(self, dof: int) -> Vector:
        noise = next(self._drawn, None)
        if noise is None:
            self._drawn = iter(self._noise * self._rng.standard_normal((_DRAWN, dof)))
            noise = next(self._drawn)
        return noise

    def _forget(self, stamp: float) -> None:
        """What was read at this moment already, and all of it where time has gone back."""
        if stamp < self._stamp:
            self._before.clear()
        elif stamp == self._stamp:
            self._before.pop()
            self.v = self._v_before
        self._stamp = stamp

    def _difference(self, q: Vector) -> None:
        before = self._before
        if not before:
            self.v = np.zeros_like(q)  # an arm comes into the world at rest
        self._v_before = self.v
        before.append(q)
        span = len(before) - 1
        if span:
            v, new = self.v * self._kept, q - before[0]
            np.multiply(new, self._rates[span - 1], new)
            np.add(v, new, v)
            self.v = v
