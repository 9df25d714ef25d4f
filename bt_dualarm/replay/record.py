"""A record, read again: all that is known of a run, up to the last second that is whole."""

from __future__ import annotations

import json
from bisect import bisect_right
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Final, TypeAlias

import mujoco
import numpy as np
import numpy.typing as npt

from bt_dualarm.errors import DualArmError
from bt_dualarm.pose import Vector
from bt_dualarm.recording.block import Block
from bt_dualarm.recording.history_file import HistoryError, read_history
from bt_dualarm.recording.model_pieces import ModelReader
from bt_dualarm.runtime.record_folder import EVENTS, HISTORY, SUMMARY

Facts: TypeAlias = dict[str, Any]
"""An object of JSON: an event, a note, the summary, what the run began with."""

_SLACK_S: Final = 1e-9


class ReplayError(DualArmError):
    """A record cannot be used as asked; the message says what is there instead."""


@dataclass(frozen=True, eq=False)
class Moment:
    """The run at one of the times whose state is kept.

    Attributes:
        time: Simulated time in s.
        generation: Number of the model that the state belongs to.
        qpos: Positions in MuJoCo's order, of shape (nq,).
        qvel: Velocities in MuJoCo's order, of shape (nv,).
    """

    time: float
    generation: int
    qpos: Vector
    qvel: Vector


@dataclass(frozen=True)
class GripperState:
    """A gripper at one of the times whose state is kept.

    Attributes:
        width: Opening by the encoder, m; 0 of a cup.
        speed: Speed of the opening, positive where it opens, m/s; 0 of a cup.
        force: Force of a pad by the motor's current, positive where it closes, or of a cup, N.
        vacuum: Share of the full vacuum that a cup senses, from 0 to 1; 0 of fingers.
        commanded_width: Opening that was asked for, m; of a cup 0 sucks, else it lets go.
        commanded_speed: Speed of the opening that was asked for, m/s.
        commanded_force: Most force of a pad, or of a cup, that was asked for, N.
    """

    width: float
    speed: float
    force: float
    vacuum: float
    commanded_width: float
    commanded_speed: float
    commanded_force: float


@dataclass(frozen=True, eq=False)
class Record:
    """What a run left behind.

    Attributes:
        folder: Folder of the record.
        start: Facts that the run began with: the tree, seeds, versions, the processor.
        seconds: Blocks of the history with states and checksums, in order.
        models: Block of each compiled model, by its generation, in MuJoCo's binary form.
        events: Changes of status, in order.
        notes: Notes of trees, cameras and guards, in order.
        summary: Content of the summary; None of a run that was killed.
        end: Facts at the end of the history; None of a run that was killed.
        torn: Sentence on what the end of the history lacks; empty if it is whole.
    """

    folder: Path
    start: Facts
    seconds: tuple[Block, ...]
    models: Mapping[int, bytes]
    events: tuple[Facts, ...]
    notes: tuple[Facts, ...]
    summary: Facts | None
    end: Facts | None
    torn: str

    @classmethod
    def read(cls, folder: Path) -> Record:
        """Read a record.

        Args:
            folder: Folder that ``--record`` was given.

        Raises:
            ReplayError: There is no such folder, or no record in it.
            HistoryError: Its history cannot be read.
        """
        if not folder.is_dir():
            raise ReplayError(f"there is no folder {folder}")
        if not (folder / HISTORY).exists():
            raise ReplayError(f"{folder} holds no record: there is no {HISTORY} in it")
        file = read_history(folder / HISTORY)
        if not file.blocks or file.blocks[0].kind != "start":
            raise HistoryError(f"{folder / HISTORY} has no whole block: the run had hardly begun")
        of_kind = {
            kind: tuple(block for block in file.blocks if block.kind == kind)
            for kind in ("second", "end")
        }
        return cls(
            folder=folder,
            start=dict(file.blocks[0].data),
            seconds=of_kind["second"],
            models=_models(file.blocks),
            events=tuple(_lines(folder / EVENTS)),
            notes=tuple(note for block in of_kind["second"] for note in _notes(block)),
            summary=_summary(folder / SUMMARY),
            end=next((dict(block.data) for block in of_kind["end"]), None),
            torn=file.torn,
        )

    @property
    def name(self) -> str:
        """Name of the tree file."""
        return str(self.start["name"])

    @property
    def arms(self) -> Mapping[str, Facts]:
        """What the file says of each arm, its tree included, by name."""
        arms: Mapping[str, Facts] = self.start["arms"]
        return arms

    @cached_property
    def times(self) -> npt.NDArray[np.float64]:
        """Simulated seconds of all states that are kept, of shape (n,)."""
        found = [block.arrays["states"][:, 0] for block in self._framed]
        return np.concatenate(found) if found else np.empty(0)

    @cached_property
    def _framed(self) -> list[Block]:
        return [block for block in self.seconds if "states" in block.arrays]

    @cached_property
    def _firsts(self) -> list[int]:
        """Number of the first state of each block."""
        counts = [len(block.arrays["states"]) for block in self._framed]
        return [0, *np.cumsum(counts).tolist()]

    @property
    def until(self) -> float:
        """Simulated time of the last state in s; 0 if there is none."""
        return float(self.times[-1]) if len(self.times) else 0.0

    @property
    def steps(self) -> int:
        """Physics steps that are known."""
        return sum(len(block.arrays["checksums"]) for block in self.seconds)

    def checksums(self) -> npt.NDArray[np.uint32]:
        """Checksum of the state after each physics step, of shape (steps,)."""
        found = [block.arrays["checksums"] for block in self.seconds]
        return np.concatenate(found).astype(np.uint32) if found else np.empty(0, np.uint32)

    def index_at(self, time: float) -> int:
        """Number of the last state at or before a time; the first one for times before it.

        Raises:
            ReplayError: The time is outside of the record.
        """
        if not len(self.times) or not -_SLACK_S <= time <= self.until + 1.0:
            raise ReplayError(
                f"{time:g} s is outside of the record, which goes from 0 to {self.until:.2f} s"
            )
        return max(0, int(np.searchsorted(self.times, time + _SLACK_S, "right")) - 1)

    def moment(self, index: int) -> Moment:
        """A state by its number."""
        number = bisect_right(self._firsts, index) - 1
        block = self._framed[number]
        row = block.arrays["states"][index - self._firsts[number]]
        generation = _generation(block)
        nq = self.model(generation).nq
        return Moment(float(row[0]), generation, row[1 : 1 + nq].copy(), row[1 + nq :].copy())

    def arm_row(self, arm: str, index: int) -> tuple[Vector, Vector, Vector, Vector] | None:
        """Set-point's position, velocity, acceleration and torque of an arm, each of shape (dof,).

        None where the arm was not in the world. Units are rad, rad/s, rad/s² and N m.
        """
        number = bisect_right(self._firsts, index) - 1
        rows = self._framed[number].arrays.get(f"arm:{arm}")
        at = index - self._firsts[number]
        if rows is None or at >= len(rows):
            return None
        q, v, a, torque = rows[at].astype(float).reshape(4, -1)
        return q, v, a, torque

    def gripper(self, arm: str, index: int) -> GripperState | None:
        """State and command of an arm's gripper.

        None where the arm has none or was not in the world, and in records of versions that did
        not keep it.
        """
        number = bisect_right(self._firsts, index) - 1
        rows = self._framed[number].arrays.get(f"gripper:{arm}")
        at = index - self._firsts[number]
        if rows is None or at >= len(rows):
            return None
        return GripperState(*rows[at].astype(float).tolist())

    @cached_property
    def _compiled(self) -> dict[int, mujoco.MjModel]:
        return {}

    def model(self, generation: int) -> mujoco.MjModel:
        """A compiled model of the run.

        Raises:
            ReplayError: This MuJoCo cannot read it: it was written by another version.
        """
        if generation not in self._compiled:
            if generation not in self.models:
                raise ReplayError(f"{self.folder} lacks the model of generation {generation}")
            name = f"generation_{generation}.mjb"
            try:
                model = mujoco.MjModel.from_binary_path(name, {name: self.models[generation]})
            except (ValueError, mujoco.FatalError) as error:
                wrote = self.start["versions"].get("mujoco", "?")
                raise ReplayError(
                    f"MuJoCo {mujoco.__version__} cannot read a model that {wrote} wrote: {error}"
                ) from error
            self._compiled[generation] = model
        return self._compiled[generation]


def _generation(block: Block) -> int:
    number: Any = block.data["generation"]
    return int(number)


def _models(blocks: tuple[Block, ...]) -> dict[int, bytes]:
    reader = ModelReader()
    return {_generation(each): reader.content(each) for each in blocks if each.kind == "model"}


def _notes(block: Block) -> list[Facts]:
    notes: Any = block.data.get("notes", [])
    return list(notes)


def _lines(path: Path) -> Iterator[Facts]:
    """Objects of a file, a line each; a last line that is not whole is left out."""
    try:
        text = path.read_text(encoding="utf-8")
    except OSError:
        return
    for line in text.splitlines(keepends=True):
        if line.endswith("\n"):
            try:
                yield json.loads(line)
            except ValueError:
                return


def _summary(path: Path) -> Facts | None:
    try:
        content = json.loads(path.read_bytes())
    except (OSError, ValueError):
        return None
    return content if isinstance(content, dict) else None
