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
from bt_dualarm.live.places import Places, places_of
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
        """The run at the last kept state at or before a time in s.

        Raises:
            ReplayError: There is no state, or this MuJoCo cannot read the model.
        """
        with self._lock:
            record = self._up_to(time)
            index = record.index_at(min(max(time, 0.0), record.until))
            moment = record.moment(index)
            model = record.model(moment.generation)
            data, places = self._posed(record, index)
            notes = NotesSeen.of(record.notes, moment.time)
            roots = Timeline(record, moment.time).roots
            return {
                "time": round(moment.time, 4),
                "generation": moment.generation,
                "poses": physics.bodies(data),
                "contacts": physics.contacts(model, data),
                "cameras": [
                    {**camera, "look": notes.look(str(camera["arm"]))}
                    for camera in physics.cameras(model, data, places)
                ],
                "arms": [self._arm(record, roots[name], index, notes) for name in record.arms],
            }

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
        for name, arm in places.items():
            row = record.arm_row(name, index)
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

    def _arm(self, record: Record, root: Node, index: int, notes: NotesSeen) -> Json:
        name, moment = root.arm, record.moment(index)
        generation, time = moment.generation, moment.time
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
        arm, row = places.get(name), record.arm_row(name, index)
        if arm is None or row is None:
            return said
        error = np.abs(row[0] - data.qpos[arm.qpos]).max()
        said["tool"] = data.site_xpos[arm.tool].round(4).tolist()
        said["error_deg"] = round(float(np.degrees(error)), 4)
        share = arm.torque_share(record.model(generation), row[3])
        return {**said, "torque": round(share, 4), "ahead": _ahead(record, name, arm, index)}


def _ahead(record: Record, name: str, arm: Places, index: int) -> str:
    """Where the set-points of the next seconds lead the tool: points in m, as base64."""
    generation = record.moment(index).generation
    last = record.index_at(min(record.times[index] + _AHEAD_S, record.until))
    model, data = record.model(generation), mujoco.MjData(record.model(generation))
    data.qpos[:] = record.moment(index).qpos
    points = []
    for number in np.unique(np.linspace(index, last, _AHEAD_POINTS).round().astype(int)):
        row = record.arm_row(name, int(number))
        if row is None or len(row[0]) != len(arm.qpos):
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
