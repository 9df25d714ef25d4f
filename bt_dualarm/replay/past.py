"""A run that is held against a record while it is made anew: where it first differs."""

from __future__ import annotations

import zlib
from dataclasses import dataclass

import numpy as np

from bt_dualarm.replay.record import Facts, Record
from bt_dualarm.runtime.parts import IdleObserver
from bt_dualarm.tree.report import StatusChange
from bt_dualarm.world.world import World


@dataclass(frozen=True)
class Number:
    """A number of the state that is another one.

    Attributes:
        name: Name of the joint, and which of its coordinates.
        recorded: Value in the record.
        now: Value in the run that was made anew.
    """

    name: str
    recorded: float
    now: float


@dataclass(frozen=True)
class Difference:
    """Where a run first went another way than its record.

    Attributes:
        step: Physics steps that were made until then; the last of them led elsewhere.
        time_s: Simulated time in s.
        numbers: Numbers that differ in the next state that is kept, the largest difference first.
        event: Sentence on the first change of a status that differs, empty if none did until then.
        doing: Leaves that were running: arm and path.
    """

    step: int
    time_s: float
    numbers: tuple[Number, ...]
    event: str
    doing: tuple[str, ...]


class Past(IdleObserver):
    """An observer that compares checksums of all steps, then states, and changes of status.

    Args:
        record: The record.
        world: World of the run that is made anew.
        until: Steps that are compared.
    """

    def __init__(self, record: Record, world: World, until: int) -> None:
        self._record, self._world = record, world
        self._checksums = record.checksums()[:until].tolist()
        self._rows = {row: index for index, row in enumerate(_rows(record))}
        self._steps = self._events = 0
        self._running: dict[str, None] = {}
        self._event, self._event_step = "", 0
        self._step: int | None = None
        self._found: Difference | None = None

    @property
    def steps(self) -> int:
        """Steps that were compared and found to be the same."""
        if self._step is not None:
            return self._step - 1
        return self._event_step if self._event else min(self._steps, len(self._checksums))

    @property
    def differs(self) -> bool:
        """Whether a step has led elsewhere, or a node has done something else."""
        return self._step is not None or bool(self._event)

    @property
    def difference(self) -> Difference | None:
        """Where it first differs, as far as that is known; None if it does not."""
        if self._found is not None or not self.differs:
            return self._found
        step = self._event_step if self._step is None else self._step
        return self._difference(step, ())

    def on_event(self, change: StatusChange) -> None:
        """Compare a change of status with that of the record."""
        here = f"{change.arm}:{change.path}"
        if not self.differs:
            if change.new == "RUNNING":
                self._running[here] = None
            else:
                self._running.pop(here, None)
        self._compare(change)
        self._events += 1

    def after_step(self, time: float) -> None:  # noqa: ARG002 - the world knows it, too
        """Compare a step with that of the record."""
        number = self._steps
        self._steps += 1
        data = self._world.data
        if self._step is None and number < len(self._checksums):
            same = zlib.crc32(data.qvel, zlib.crc32(data.qpos)) == self._checksums[number]
            self._step = None if same else self._steps
        if self._step is not None and self._found is None and number in self._rows:
            self._found = self._difference(self._step, self._numbers(self._rows[number]))

    def _compare(self, change: StatusChange) -> None:
        events = self._record.events
        if self._event or self._events >= len(events) or self._steps >= len(self._checksums):
            return
        was = events[self._events]
        now = {"arm": change.arm, "path": change.path, "new": change.new, "code": change.code}
        if any(was[name] != value for name, value in now.items()):
            self._event_step = self._steps
            self._event = (
                f"{_said(was)} at {was['time_s']:.3f} s in the record; "
                f"now {_said(now)} at {change.time:.3f} s"
            )

    def _difference(self, step: int, numbers: tuple[Number, ...]) -> Difference:
        time = step * self._world.timestep
        return Difference(step, time, numbers, self._event, tuple(self._running))

    def _numbers(self, index: int) -> tuple[Number, ...]:
        """Numbers of the state that differ from those of the record."""
        moment, data = self._record.moment(index), self._world.data
        if moment.qpos.shape != data.qpos.shape:
            count = Number("count of positions", len(moment.qpos), len(data.qpos))
            return (count,)
        was = np.concatenate((moment.qpos, moment.qvel))
        now = np.concatenate((data.qpos, data.qvel))
        away = np.abs(now - was)
        order = np.argsort(-away, kind="stable")
        return tuple(
            Number(self._name(int(place)), float(was[place]), float(now[place]))
            for place in order
            if now[place] != was[place]
        )

    def _name(self, place: int) -> str:
        model = self._world.model
        what, starts = "position", model.jnt_qposadr
        if place >= model.nq:
            what, starts, place = "velocity", model.jnt_dofadr, place - model.nq
        joint = int(np.searchsorted(starts, place, "right")) - 1
        name = model.joint(joint).name or model.body(int(model.jnt_bodyid[joint])).name
        return f"{what} of {name}[{place - int(starts[joint])}]"


def _said(event: Facts) -> str:
    code = f" {event['code']}" if event["code"] else ""
    return f"{event['arm']}:{event['path']} → {event['new']}{code}"


def _rows(record: Record) -> list[int]:
    """Numbers of the steps whose state is kept."""
    kept = [block.arrays["rows"] for block in record.seconds if "states" in block.arrays]
    return [int(row) for rows in kept for row in rows]
