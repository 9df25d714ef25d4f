"""A record looked at at any of its times, whole or while it is still being written."""

from __future__ import annotations

import time as wall
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from threading import RLock
from typing import Final, TypeAlias

import mujoco
import numpy as np

from bt_dualarm.live import physics
from bt_dualarm.live.meshes import Looks, Mounted, arm_of, looks_of
from bt_dualarm.live.notes_seen import NotesSeen
from bt_dualarm.live.past_series import gripper_force, sent_to
from bt_dualarm.live.places import Places, places_of
from bt_dualarm.live.signals import row_of
from bt_dualarm.live.trees import rows_at
from bt_dualarm.replay.record import Record
from bt_dualarm.replay.timeline import Node, Timeline
from bt_dualarm.runtime.record_folder import EVENTS, HISTORY
from bt_dualarm.spec.source import Json

_AGAIN_S: Final = 0.5
_SHARE: Final = 10.0
"""A record that grows is read again after half a second, and ten times what reading it took."""

_AHEAD_S: Final = 3.0
_AHEAD_POINTS: Final = 40


Posed: TypeAlias = tuple[mujoco.MjModel, mujoco.MjData, dict[str, Places]]
"""A model, a state of it, and the arms that are in it."""


class Past:
    """A record, and what pages ask of it.

    Args:
        folder: Folder of the record.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._lock = RLock()
        self._record: Record | None = None
        self._sizes: tuple[int, ...] = ()
        self._again_at = -np.inf
        self._scratch: dict[int, tuple[mujoco.MjData, dict[str, Places]]] = {}
        self._looks: dict[int, Looks] = {}
        self._ahead: dict[int, mujoco.MjData] = {}
        self._noted: tuple[Record | None, float, int, NotesSeen] = (None, 0.0, 0, NotesSeen())
        self._trees: tuple[Record, int, Mapping[str, Node]] | None = None

    @property
    def record(self) -> Record:
        """The record as far as it is written.

        Raises:
            ReplayError: There is none in the folder.
            HistoryError: It cannot be read, or has hardly begun.
        """
        with self._lock:
            now = wall.monotonic()
            if self._record is None or now >= self._again_at:
                sizes = _sizes(self._folder)
                if self._record is None or sizes != self._sizes:
                    self._record, self._sizes = Record.read(self._folder), sizes
                took = wall.monotonic() - now
                self._again_at = now + took + max(_AGAIN_S, _SHARE * took)
            return self._record

    def _up_to(self, time: float) -> Record:
        """A record that has this time, if there is one: no more is read than is asked for."""
        if self._record is not None and time <= self._record.until:
            return self._record
        return self.record

    def moment(self, time: float) -> Json:
        """The run at a time in s: trees and notes of that time, the last state kept until then.

        Raises:
            ReplayError: There is no state, or this MuJoCo cannot read the model.
        """
        with self._lock:
            record = self._up_to(time)
            time = min(max(time, 0.0), record.until)
            index = record.index_at(time)
            moment = record.moment(index)
            model = record.model(moment.generation)
            data, places = self._posed(record, index)
            notes = self._notes_until(record, time)
            roots = self._trees_at(record, time)
            # A run that broke within a step ended after the last state that is kept.
            until = np.inf if record.end is not None and time >= record.until else time
            arms = [self._arm(record, roots[name], index, until, notes) for name in record.arms]
            return {
                "time": round(time, 4),
                "generation": moment.generation,
                "poses": physics.bodies(data),
                "contacts": physics.contacts(model, data),
                "cameras": [
                    {**camera, "look": notes.look(str(camera["arm"]))}
                    for camera in physics.cameras(model, data, places)
                ],
                "arms": arms,
            }

    def _notes_until(self, record: Record, time: float) -> NotesSeen:
        """All that was noted up to a time in s; from one time to a later one only what is new."""
        whose, until, count, seen = self._noted
        if whose is not record or time < until:
            count, seen = 0, NotesSeen()
        while count < len(record.notes) and record.notes[count]["time_s"] <= time + 1e-9:
            seen.add(record.notes[count])
            count += 1
        self._noted = record, time, count, seen
        return seen

    def _trees_at(self, record: Record, time: float) -> Mapping[str, Node]:
        """Roots of the trees that were valid at a time in s: another set after each edit."""
        edits = [note for note in record.notes if note["kind"] == "edited"]
        count = sum(note["time_s"] <= time + 1e-9 for note in edits)
        if self._trees is None or self._trees[0] is not record or self._trees[1] != count:
            self._trees = record, count, Timeline(record, time).roots
        return self._trees[2]

    @contextmanager
    def at(self, time: float) -> Iterator[Posed]:
        """Model, state and arms at a time in s; they are others' again after the block.

        Raises:
            ReplayError: There is no state, or this MuJoCo cannot read the model.
        """
        with self._lock:
            record = self._up_to(time)
            index = record.index_at(min(max(time, 0.0), record.until))
            data, places = self._posed(record, index)
            yield record.model(record.moment(index).generation), data, places

    def _posed(self, record: Record, index: int) -> tuple[mujoco.MjData, dict[str, Places]]:
        """The world at a state by its number, with the forces that the torques then bring about."""
        moment = record.moment(index)
        model = record.model(moment.generation)
        if moment.generation not in self._scratch:
            places = places_of(model, record.arms)
            self._scratch[moment.generation] = mujoco.MjData(model), places
        data, places = self._scratch[moment.generation]
        mujoco.mj_resetData(model, data)
        data.qpos[:], data.qvel[:], data.time = moment.qpos, moment.qvel, moment.time
        for arm in places.values():
            row = sent_to(record, arm, index)
            if row is not None:
                data.ctrl[arm.motors] = row[3]
        mujoco.mj_forward(model, data)
        return data, places

    def looks(self, generation: int) -> Looks:
        """Shapes and meshes of a model; raises as `Record.model` does."""
        with self._lock:
            if generation not in self._looks:
                model = self.record.model(generation)
                self._looks[generation] = looks_of(model, self._mounted())
            return self._looks[generation]

    def mesh(self, name: str) -> bytes | None:
        """A mesh of any model that has been asked for; None if there is none of this name."""
        found = [looks.meshes[name] for looks in self._looks.values() if name in looks.meshes]
        return found[0] if found else None

    def _mounted(self) -> Mapping[str, Mounted]:
        record = self.record
        root = Path(str(record.start["path"])).parent
        found = {name: arm_of(arm, root) for name, arm in record.arms.items()}
        return {name: arm for name, arm in found.items() if arm is not None}

    def _arm(self, record: Record, root: Node, index: int, time: float, notes: NotesSeen) -> Json:
        name, generation = root.arm, record.moment(index).generation
        data, places = self._scratch[generation]
        rows = rows_at(root, time)
        said: Json = {
            "arm": name,
            "robot": record.arms[name]["robot"],
            "outcome": _outcome(rows),
            "nodes": rows,
            "board": notes.board(name),
            "guard": notes.guard(name),
        }
        arm = places.get(name)
        row = None if arm is None else sent_to(record, arm, index)
        if arm is None or row is None:
            return said
        model = record.model(generation)
        said |= physics.arm_numbers(row_of(model, data, arm, row[0], row[3]))
        if record.arms[name].get("gripper") is not None:
            called, force = str(record.arms[name]["gripper"]), gripper_force(record, name, index)
            said["gripper"] = physics.gripper(model, data, arm, called, force)
        return {**said, "ahead": self._way_ahead(record, arm, index)}

    def _way_ahead(self, record: Record, arm: Places, index: int) -> str:
        """Where the set-points of the next seconds lead the tool: points in m, as base64."""
        moment = record.moment(index)
        model = record.model(moment.generation)
        if moment.generation not in self._ahead:
            self._ahead[moment.generation] = mujoco.MjData(model)
        data = self._ahead[moment.generation]
        data.qpos[:] = moment.qpos
        last = record.index_at(min(moment.time + _AHEAD_S, record.until))
        points = []
        for number in np.unique(np.linspace(index, last, _AHEAD_POINTS).round().astype(int)):
            row = sent_to(record, arm, int(number))
            if row is None:
                break
            data.qpos[arm.qpos] = row[0]
            mujoco.mj_kinematics(model, data)
            points.append(data.site_xpos[arm.tool].copy())
        return physics.as_text(np.array(points).reshape(-1, 3))


def _outcome(rows: list[Json]) -> str | None:
    status = str(rows[0]["status"])
    return status if status in ("SUCCESS", "FAILURE") else None


def _sizes(folder: Path) -> tuple[int, ...]:
    """Bytes of the files that grow; 0 of those that are not there."""
    paths = [folder / name for name in (HISTORY, EVENTS, "summary.json")]
    return tuple(path.stat().st_size if path.exists() else 0 for path in paths)
