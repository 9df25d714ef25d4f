"""A record, read again: all that is known of a run, up to the last second that is whole."""

from __future__ import annotations

import os
from bisect import bisect_right
from collections import OrderedDict
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, fields
from functools import cached_property
from pathlib import Path
from typing import Any, Final

import mujoco
import numpy as np
import numpy.typing as npt

from bt_dualarm.errors import DualArmError
from bt_dualarm.pose import Vector
from bt_dualarm.recording.block import Block
from bt_dualarm.recording.history_file import read_history
from bt_dualarm.recording.model_pieces import ModelReader
from bt_dualarm.recording.stored_model import stored_model
from bt_dualarm.recording.untrusted import (
    MOST_MEMORY,
    Budget,
    HistoryError,
    parsed,
    read_regular,
)
from bt_dualarm.replay.record_facts import (
    LONGEST_S,
    Facts,
    check_end,
    check_events,
    check_model,
    check_second,
    check_start,
    check_summary,
)
from bt_dualarm.runtime.record_folder import EVENTS, HISTORY, SUMMARY
from bt_dualarm.world.robots.mjspec import joint_motors

__all__ = ["Facts", "HistoryError", "Moment", "Record", "ReplayError"]

_MOST_COMPILED: Final = 4
"""Compiled models that are kept: one of a large world takes some megabytes."""

_MOST_JOINTS: Final = 4 * 64
_CLOCK: Final = 1e-6
"""Rounding of MuJoCo's clock, which is a sum of steps, as a share of the time."""

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
    def read(cls, folder: Path, most_memory: int = MOST_MEMORY) -> Record:
        """Read a record, whoever wrote it.

        All of it is checked before anybody relies on it: files, sizes, types, names, shapes, and
        that its parts fit each other. Models are checked when they are first asked for.

        Args:
            folder: Folder that ``--record`` was given.
            most_memory: Bytes that the record may take in memory.

        Raises:
            ReplayError: There is no such folder, or no record in it.
            HistoryError: A file of it cannot be read, is not what a run writes, or takes too much
                memory; the message names the file, what is wrong, and what is expected.
        """
        if not folder.is_dir():
            raise ReplayError(f"there is no folder {folder}")
        if not os.path.lexists(folder / HISTORY):
            raise ReplayError(f"{folder} holds no record: there is no {HISTORY} in it")
        budget = Budget(most_memory)
        file = read_history(folder / HISTORY, budget)
        if not file.blocks or file.blocks[0].kind != "start":
            raise HistoryError(f"{folder / HISTORY} has no whole block: the run had hardly begun")
        start: Facts = dict(file.blocks[0].data)
        with _said_of(folder / HISTORY):
            check_start(start)
            models, seconds, ends = _blocks_of_run(start, file.blocks[1:])
        arms: Mapping[str, Facts] = start["arms"]
        with _said_of(folder / EVENTS):
            events = _lines(folder / EVENTS, budget)
            check_events(events, arms)
        with _said_of(folder / SUMMARY):
            summary = _summary(folder / SUMMARY, budget)
        return cls(
            folder=folder,
            start=start,
            seconds=seconds,
            models=models,
            events=tuple(events),
            notes=tuple(note for block in seconds for note in _notes(block)),
            summary=summary,
            end=ends[0] if ends else None,
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
    def _compiled(self) -> OrderedDict[int, mujoco.MjModel]:
        return OrderedDict()

    def model(self, generation: int) -> mujoco.MjModel:
        """A compiled model of the run; the last few that were asked for are kept.

        Raises:
            ReplayError: It is not there, this MuJoCo cannot read it (it was written by another
                version, or is damaged), or the states of the record are not its.
        """
        if generation not in self.models:
            raise ReplayError(f"{self.folder} lacks the model of generation {generation}")
        if generation not in self._compiled:
            rows = [
                block.arrays["states"] for block in self._framed if _generation(block) == generation
            ]
            where = f"{self.folder / HISTORY}: the model of generation {generation}"
            try:
                model = stored_model(self.models[generation], [each[0] for each in rows[:1]])
                self._compare_with(model, generation)
            except ValueError as error:
                wrote = self.start["versions"].get("mujoco", "?")
                other = (
                    ""
                    if wrote == mujoco.__version__
                    else (f"; MuJoCo {mujoco.__version__} reads it, {wrote} wrote it")
                )
                raise ReplayError(f"{where}: {error}{other}") from error
            self._compiled[generation] = model
        self._compiled.move_to_end(generation)
        while len(self._compiled) > _MOST_COMPILED:
            self._compiled.popitem(last=False)
        return self._compiled[generation]

    def _compare_with(self, model: mujoco.MjModel, generation: int) -> None:
        """Compare states and arms' rows with a model.

        Raises:
            ValueError: They are of another one.
        """
        for block in self._framed:
            if _generation(block) != generation:
                continue
            columns = block.arrays["states"].shape[1]
            if columns != 1 + model.nq + model.nv:
                raise ValueError(
                    f"states have {columns} columns; it has {model.nq} positions and {model.nv} "
                    "velocities"
                )
            for kind, arm, rows in _rows_of_arms(block):
                dof = rows.shape[1] // 4
                if kind == "arm" and len(joint_motors(model, arm)) != dof:
                    raise ValueError(
                        f"{arm} has {len(joint_motors(model, arm))} joints with motors; the record "
                        f"has set-points of {dof}"
                    )
        for name in self.start["objects"]:
            body = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, name)
            if body >= 0 and not model.body_geomnum[body]:
                raise ValueError(f"object {name} has no shape")
        for name, said in self.arms.items():
            camera = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_CAMERA, f"{name}/camera")
            if camera >= 0 and not said["camera"]:
                raise ValueError(f"{name} has a camera, which the file did not give it")


def _generation(block: Block) -> int:
    number: Any = block.data["generation"]
    return int(number)


def _notes(block: Block) -> list[Facts]:
    notes: Any = block.data.get("notes", [])
    return list(notes)


def _blocks_of_run(
    start: Facts, blocks: Sequence[Block]
) -> tuple[ModelReader, tuple[Block, ...], list[Facts]]:
    """Models, seconds, and facts of the end; blocks of other kinds are passed over.

    Raises:
        ValueError: A block is not what a run writes.
    """
    models, seconds, ends = ModelReader(), list[Block](), list[Facts]()
    steps, time = 0, 0.0
    for number, block in enumerate(blocks, 1):
        try:
            if block.kind == "model":
                check_model(dict(block.data))
                models.add(block)
            elif block.kind == "second":
                check_second(dict(block.data), start["arms"])
                steps, time = _checked_numbers(block, start, models, steps, time)
                seconds.append(block)
            elif block.kind == "end":
                check_end(dict(block.data))
                ends.append(dict(block.data))
        except ValueError as error:
            raise ValueError(f"block {number}: {error}") from error
    return models, tuple(seconds), ends


def _checked_numbers(
    block: Block, start: Facts, models: Mapping[int, bytes], steps: int, time: float
) -> tuple[int, float]:
    """Check the arrays of a second.

    Args:
        block: The second.
        start: Facts that the run began with.
        models: Models until then.
        steps: Steps of the seconds before.
        time: Time of the last state before.

    Returns:
        Steps, and the time of the last state, with this second.

    Raises:
        ValueError: They do not fit each other, the model or the seconds before.
    """
    if _generation(block) not in models:
        raise ValueError(f"there is no model of generation {_generation(block)} before it")
    if block.data["first_step"] != steps:
        raise ValueError(f"first_step is {block.data['first_step']}; expected {steps}")
    checksums = _array(block, "checksums", np.uint32, 1)
    rows = _array(block, "rows", np.uint32, 1).astype(np.int64)
    if len(rows) and not (
        (np.diff(rows) > 0).all() and steps <= rows[0] and rows[-1] < steps + len(checksums)
    ):
        raise ValueError(
            f"rows are not ascending numbers of steps from {steps} to {steps + len(checksums) - 1}"
        )
    if "states" not in block.arrays:
        if len(rows):
            raise ValueError(f"array 'states' is missing; rows has {len(rows)}")
        return steps + len(checksums), time
    states = _array(block, "states", np.float64, 2)
    if not len(rows) or states.shape[0] != len(rows) or states.shape[1] < 1:
        raise ValueError(f"states is of shape {states.shape}; rows has {len(rows)}")
    expected = (rows + 1) * float(start["timestep"])
    if (np.abs(states[:, 0] - expected) > _CLOCK * (1.0 + expected)).any():
        raise ValueError("times of states are not those of their steps")
    if expected[-1] > LONGEST_S:
        raise ValueError(f"the run is longer than {LONGEST_S:g} s")
    for kind, arm, sent in _rows_of_arms(block):
        name = f"{kind}:{arm[:80]}"
        if arm not in start["arms"]:
            raise ValueError(f"array {name!r} is of no arm of the run")
        if sent.ndim != 2 or sent.dtype != np.float32 or len(sent) > len(rows):
            raise ValueError(
                f"array {name!r} is {sent.dtype} of shape {sent.shape}; "
                f"expected float32 of up to {len(rows)} rows"
            )
        columns = sent.shape[1]
        if kind == "arm" and (not 4 <= columns <= _MOST_JOINTS or columns % 4):
            raise ValueError(f"array {name!r} has {columns} columns; expected 4 for each joint")
        if kind == "gripper" and columns != len(fields(GripperState)):
            raise ValueError(
                f"array {name!r} has {columns} columns; expected {len(fields(GripperState))}"
            )
        _refuse_infinite(sent, name)
    _refuse_infinite(states, "states")
    return steps + len(checksums), float(states[-1, 0])


def _rows_of_arms(block: Block) -> Iterator[tuple[str, str, npt.NDArray[np.generic]]]:
    """What each arm and gripper was sent: ``arm`` or ``gripper``, name of the arm, and the rows."""
    for name, rows in block.arrays.items():
        kind, colon, arm = name.partition(":")
        if colon and kind in ("arm", "gripper"):
            yield kind, arm, rows


def _array(
    block: Block, name: str, kind: type[np.generic], dimensions: int
) -> npt.NDArray[Any]:  # Any: of the kind that is asked for
    if name not in block.arrays:
        raise ValueError(f"array {name!r} is missing")
    array = block.arrays[name]
    if array.dtype != np.dtype(kind) or array.ndim != dimensions:
        raise ValueError(
            f"array {name!r} is {array.dtype} of shape {array.shape}; "
            f"expected {np.dtype(kind)} of {dimensions} dimensions"
        )
    return array


def _refuse_infinite(array: npt.NDArray[Any], name: str) -> None:  # Any: of any numbers
    # Beyond MuJoCo's mjMAXVAL a simulation has diverged: no state is kept then.
    if not (np.abs(array) <= mujoco.mjMAXVAL).all():
        raise ValueError(f"array {name!r} has numbers that are not finite, or beyond 1e10")


def _lines(path: Path, budget: Budget) -> list[Facts]:
    """Objects of a file, a line each; a last line that is not whole is left out.

    Raises:
        ValueError: A line is no object of JSON.
    """
    if not os.path.lexists(path):
        return []
    events = []
    for number, line in enumerate(read_regular(path).split(b"\n")[:-1], 1):
        try:
            event = parsed(line, budget)
        except ValueError as error:
            raise ValueError(f"line {number}: {error}") from error
        events.append(event)
    return events


def _summary(path: Path, budget: Budget) -> Facts | None:
    """The summary; None of a run that was killed.

    Raises:
        ValueError: It is not what a run writes.
    """
    if not os.path.lexists(path):
        return None
    content: Facts = parsed(read_regular(path), budget)
    check_summary(content)
    return content


@contextmanager
def _said_of(path: Path) -> Iterator[None]:
    """Have whatever is wrong with a file say which one it is."""
    try:
        yield
    except ValueError as error:
        raise HistoryError(f"{path}: {error}") from error
