"""The state of the simulation as evidence: one hash of all of it, and the last states whole."""

from __future__ import annotations

import hashlib
from fractions import Fraction
from typing import BinaryIO, Protocol

import mujoco
import numpy as np

from bt_dualarm.pose import Matrix, Vector
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
        self._count = 0  # states of this size that there have been: the last are in the ring
        self._times: Vector = np.zeros(LAST_STATES)
        self._ring: list[Matrix] = []

    @property
    def sha256(self) -> str:
        """In hexadecimal: equal for runs that went through the same states."""
        return self._hash.hexdigest()

    def after_step(self, time: float) -> None:
        """Keep the state, and hash it if that is due."""
        if self._world.data is not self._data:
            self._take_up(self._world.data)
        row = self._count % LAST_STATES
        self._times[row] = time
        places, speeds, torques = self._views
        self._q[row], self._v[row], self._torque[row] = places, speeds, torques
        self._count += 1
        if self._due.due(self._steps):
            for part in (np.float64(time), places, speeds):
                self._hash.update(part.tobytes())
        self._steps += 1

    def _take_up(self, data: mujoco.MjData) -> None:
        """Look at another state; of one of another size, those before it are forgotten."""
        # Views: looking a field up costs more than copying it.
        self._data, self._views = data, (data.qpos, data.qvel, data.ctrl)
        if [part.shape[1] for part in self._ring] != [len(view) for view in self._views]:
            self._count = 0
            self._ring = [np.empty((LAST_STATES, len(view))) for view in self._views]
            self._q, self._v, self._torque = self._ring

    def write_last(self, file: BinaryIO) -> None:
        """The last states that have the size of the very last one, as a NumPy archive.

        Arrays ``time`` in s, ``qpos``, ``qvel``, ``ctrl`` in MuJoCo's order, a row a step.
        """
        kept = min(self._count, LAST_STATES)
        rows = np.arange(self._count - kept, self._count) % LAST_STATES
        names = ("time", "qpos", "qvel", "ctrl")
        states = (self._times, *(self._ring or np.empty((3, 0))))
        columns = {name: state[rows] for name, state in zip(names, states, strict=True)}
        np.savez_compressed(file, allow_pickle=False, **columns)
