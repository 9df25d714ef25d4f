"""The state of the simulation as evidence: one hash of all of it, and the last states whole."""

from __future__ import annotations

import hashlib
from collections import deque
from fractions import Fraction
from typing import BinaryIO, Protocol

import mujoco
import numpy as np

from bt_dualarm.pose import Vector
from bt_dualarm.runtime.parts import IdleObserver
from bt_dualarm.runtime.schedule import Periodic, exact

HASH_PERIOD = Fraction(1, 50)
"""Seconds between two states that go into the hash."""

LAST_STATES = 250
"""States kept for the case that the simulation diverges: half a second at 2 ms a step."""


class HashedWorld(Protocol):
    """What is read of the world."""

    data: mujoco.MjData

    @property
    def timestep(self) -> float:
        """Seconds of one step."""


class StateLog(IdleObserver):
    """SHA-256 over time, positions and velocities; and a ring of the last states.

    Args:
        world: The world, whose state may change its size.
    """

    def __init__(self, world: HashedWorld) -> None:
        self._world = world
        self._due = Periodic(HASH_PERIOD, exact(world.timestep))
        self._steps = 0
        self._data: mujoco.MjData | None = None
        self._hash = hashlib.sha256()
        self._last: deque[tuple[float, Vector, Vector, Vector]] = deque(maxlen=LAST_STATES)

    @property
    def sha256(self) -> str:
        """In hexadecimal: equal for runs that went through the same states."""
        return self._hash.hexdigest()

    def after_step(self, time: float) -> None:
        """Keep the state, and hash it if that is due."""
        data = self._world.data
        if data is not self._data:  # views: looking a field up costs more than copying it
            self._data, self._views = data, (data.qpos, data.qvel, data.ctrl)
        places, speeds, torques = self._views
        q, v = places.copy(), speeds.copy()
        self._last.append((time, q, v, torques.copy()))
        if self._due.due(self._steps):
            for part in (np.float64(time), q, v):
                self._hash.update(part.tobytes())
        self._steps += 1

    def write_last(self, file: BinaryIO) -> None:
        """The last states that have the size of the very last one, as a NumPy archive.

        Arrays ``time`` in s, ``qpos``, ``qvel``, ``ctrl`` in MuJoCo's order, a row a step.
        """
        size = len(self._last[-1][1]) if self._last else 0
        states = [state for state in self._last if len(state[1]) == size]
        names = ("time", "qpos", "qvel", "ctrl")
        columns = {name: np.array([s[i] for s in states]) for i, name in enumerate(names)}
        np.savez_compressed(file, allow_pickle=False, **columns)
