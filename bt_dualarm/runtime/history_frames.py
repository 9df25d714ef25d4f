"""The numbers of a run, second by second: states, checksums of all steps, arms, grippers."""

from __future__ import annotations

import zlib
from collections.abc import Iterable, Mapping
from fractions import Fraction
from typing import Final, Protocol

import mujoco
import numpy as np
import numpy.typing as npt

from bt_dualarm.motion.setpoints.set_point import SetPoint
from bt_dualarm.pose import Vector
from bt_dualarm.recording.block import Block
from bt_dualarm.runtime.schedule import Periodic, exact
from bt_dualarm.runtime.state_log import HASH_PERIOD

FRAME_PERIOD: Final[Fraction] = HASH_PERIOD
"""Seconds between two states that are kept: those that go into the hash of the run."""

SECOND: Final = 1
"""Simulated seconds in a block: what is lost at most with the process."""

_KEY_STATE = mujoco.mjtState.mjSTATE_INTEGRATION


class Hardware(Protocol):
    """What is read of an arm's drives."""

    @property
    def commanded(self) -> Vector:
        """Torques that were commanded last, of shape (dof,), N m."""


class Command(Protocol):
    """What is read of the last command of a gripper."""

    @property
    def width(self) -> float:
        """Opening to go to, m; of a cup 0 sucks, anything else lets go."""

    @property
    def speed(self) -> float:
        """Speed of the opening, m/s."""

    @property
    def force(self) -> float:
        """Most force of a pad, or of a cup, N."""


class FramedGripper(Protocol):
    """What is read of a gripper; looking at it reads no sensor."""

    @property
    def width(self) -> float:
        """Opening by the encoder, m."""

    @property
    def speed(self) -> float:
        """Speed of the opening, m/s."""

    @property
    def force(self) -> float:
        """Force of a pad, or of a cup, N."""

    @property
    def vacuum(self) -> float:
        """Share of the full vacuum that a cup senses."""

    @property
    def commanded(self) -> Command:
        """What was asked for last."""


class FramedWorld(Protocol):
    """What is read of the world."""

    model: mujoco.MjModel
    data: mujoco.MjData

    @property
    def timestep(self) -> float:
        """Seconds of one step."""

    @property
    def generation(self) -> int:
        """Grows when things came or went, and the state changes its size."""

    @property
    def hardware(self) -> Mapping[str, Hardware]:
        """Drives of the arms that are present, by name."""

    @property
    def grippers(self) -> Mapping[str, FramedGripper]:
        """Grippers of the arms that are present and have one, by name of the arm."""


class FramedController(Protocol):
    """What is read of an arm's controller."""

    @property
    def setpoint(self) -> SetPoint:
        """The last set-point that was sent."""


class Frames:
    """Gathers the numbers of one generation of the world until a block is full.

    Args:
        world: The world.
    """

    def __init__(self, world: FramedWorld) -> None:
        self._world = world
        self._due = Periodic(FRAME_PERIOD, exact(world.timestep))
        self._per_block = max(1, round(SECOND / world.timestep))
        self._steps = 0
        self._begin()

    def _begin(self) -> None:
        self._first = self._steps
        self._generation = self._world.generation
        data = self._world.data
        self._q, self._v = data.qpos, data.qvel  # views: looking them up costs more than reading
        self._checksums: list[int] = []
        self._rows: list[int] = []
        self._states: list[npt.NDArray[np.float64]] = []
        self._arms: dict[str, list[npt.NDArray[np.float64]]] = {}
        self._grippers: dict[str, list[tuple[float, ...]]] = {}

    @property
    def outdated(self) -> bool:
        """Whether the world was recompiled: what has been gathered belongs to another model."""
        return self._world.generation != self._generation

    @property
    def full(self) -> bool:
        """Whether there is enough for a block."""
        return len(self._checksums) >= self._per_block

    def after_step(self) -> bool:
        """Take up the step that was made; whether its state is to be kept, too."""
        self._checksums.append(zlib.crc32(self._v, zlib.crc32(self._q)))
        self._steps += 1
        return self._due.due(self._steps - 1)

    def keep(self, controllers: Iterable[tuple[str, FramedController]]) -> None:
        """Keep the state after the step that was made, and what arms and grippers were sent.

        Args:
            controllers: Arms that are present, with their controllers.
        """
        self._rows.append(self._steps - 1)
        self._states.append(np.concatenate(((self._world.data.time,), self._q, self._v)))
        for name, controller in controllers:
            sent, drives = controller.setpoint, self._world.hardware[name]
            row = np.concatenate((sent.q, sent.v, sent.a, drives.commanded))
            self._arms.setdefault(name, []).append(row)
            gripper = self._world.grippers.get(name)
            if gripper is not None:
                asked = gripper.commanded
                sensed = gripper.width, gripper.speed, gripper.force, gripper.vacuum
                self._grippers.setdefault(name, []).append(
                    (*sensed, asked.width, asked.speed, asked.force)
                )

    def block(self, notes: list[dict[str, object]]) -> Block:
        """All that was gathered, and begin anew.

        Args:
            notes: What else has happened meanwhile, ready for JSON.
        """
        arrays: dict[str, npt.NDArray[np.generic]] = {
            "checksums": np.array(self._checksums, np.uint32),
            "rows": np.array(self._rows, np.uint32),
        }
        if self._states:
            arrays["states"] = np.array(self._states)
        if not self.outdated:
            arrays["key"] = self._key()
        for name, rows in self._arms.items():
            arrays[f"arm:{name}"] = np.array(rows, np.float32)
        for name, states in self._grippers.items():
            arrays[f"gripper:{name}"] = np.array(states, np.float32)
        data = {"first_step": self._first, "generation": self._generation, "notes": notes}
        self._begin()
        return Block("second", data, arrays)

    def _key(self) -> npt.NDArray[np.float64]:
        """The whole state after the last step, from which it could be stepped on."""
        model = self._world.model
        state = np.empty(mujoco.mj_stateSize(model, _KEY_STATE))
        mujoco.mj_getState(model, self._world.data, state, _KEY_STATE)
        return state
