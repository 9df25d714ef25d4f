"""Export of a record as CSV tables: states, arms, grippers, events, notes."""

from __future__ import annotations

import csv
import io
import json
import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import astuple
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Final

import mujoco

from bt_dualarm.core.share import write_text
from bt_dualarm.replay.record import Record, ReplayError
from bt_dualarm.replay.timeline import file_part, gripper_states
from bt_dualarm.spec.node_types import escaped

_FORMULAS: Final = frozenset("=+-@\t\r\n\uff1d\uff0b\uff0d\uff20")
"""First characters of cells that spreadsheets interpret as formulas, with full-width forms."""

_TABLE: Final = re.compile(r"(events|notes|arm_.+|gripper_.+|states_\d+)\.csv")


def write_tables(record: Record, folder: Path) -> None:
    """Write all tables of a record to a folder; those of an earlier export are replaced.

    Args:
        record: The record.
        folder: The folder; created if missing.

    Raises:
        ReplayError: The folder has a table that this record does not, so that those of two runs
            would be mixed; an arm has a name that is invalid in tree files. Nothing is replaced.
        OSError: The folder cannot be written to.
    """
    folder.mkdir(parents=True, exist_ok=True)
    with TemporaryDirectory(prefix=".", dir=folder) as scratch:
        names = []
        for name, content in tables_of(record):
            write_text(Path(scratch) / name, content)
            names.append(name)
        there = sorted(path.name for path in folder.iterdir() if _TABLE.fullmatch(path.name))
        stale = [name for name in there if name not in names]
        if stale:
            raise ReplayError(
                f"cannot write {folder}: it has tables that this record does not, "
                f"{', '.join(stale[:3])}{' …' if len(stale) > 3 else ''}; "
                "delete them, or write to another folder"
            )
        for name in names:
            (Path(scratch) / name).replace(folder / name)


def tables_of(record: Record) -> Iterator[tuple[str, str]]:
    """Yields the name and content of each table, with numbers in SI units.

    ``events.csv`` has status changes; ``notes.csv`` ports, blackboard keys, images and detections;
    ``arm_NAME.csv`` set-points and torques; ``gripper_NAME.csv`` state, command and held objects of
    a gripper; and ``states_N.csv`` positions and velocities of generation N of the world, all at
    50 Hz.

    Raises:
        ReplayError: An arm has a name that is invalid in tree files.
    """
    columns = ("time_s", "arm", "path", "kind", "old", "new", "code", "reason", "metrics")
    events = [[_cell(event[name]) for name in columns] for event in record.events]
    yield "events.csv", _table(columns, events)
    yield "notes.csv", _table(("time_s", "arm", "kind", "content"), _notes(record))
    for arm in record.arms:
        rows = [*_arm_rows(record, arm)]
        if rows:
            yield f"arm_{file_part(arm)}.csv", _table(_arm_columns(len(rows[0]) // 4), rows)
        rows = [*_gripper_rows(record, arm)]
        if rows:
            yield f"gripper_{file_part(arm)}.csv", _table(_GRIPPER_COLUMNS, rows)
    for generation in sorted(record.models):
        states = [*_state_rows(record, generation)]
        if states:
            yield f"states_{generation}.csv", _table(_state_columns(record, generation), states)


def _table(columns: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(map(_inert, columns))
    writer.writerows([*map(_inert, row)] for row in rows)
    return text.getvalue()


def _notes(record: Record) -> Iterator[Sequence[object]]:
    for note in record.notes:
        rest = {name: note[name] for name in note.keys() - {"kind", "arm", "time_s"}}
        yield note["time_s"], note["arm"], note["kind"], json.dumps(rest, sort_keys=True)


def _cell(value: object) -> object:
    return json.dumps(value) if isinstance(value, dict) else value


def _inert(cell: object) -> object:
    """A cell that no spreadsheet interprets as a formula, as OWASP recommends (CSV injection).

    Numbers stay as they are. Characters that a terminal would act on are written out.
    """
    if not isinstance(cell, str):
        return cell
    text = escaped(cell)
    return f"'{text}" if cell and cell[0] in _FORMULAS else text


def _arm_columns(dof: int) -> list[str]:
    names = ("q_rad", "v_rad_s", "a_rad_s2", "torque_nm")
    return ["time_s", *(f"{name}[{joint}]" for name in names for joint in range(dof))]


def _arm_rows(record: Record, arm: str) -> Iterator[list[object]]:
    for index, time in enumerate(record.times.tolist()):
        row = record.arm_row(arm, index)
        if row is not None:
            yield [time, *(float(f"{x:.7g}") for part in row for x in part)]


_GRIPPER_COLUMNS: Final = (
    "time_s",
    "width_m",
    "speed_m_s",
    "force_n",
    "vacuum",
    "commanded_width_m",
    "commanded_speed_m_s",
    "commanded_force_n",
    "held",
)


def _gripper_rows(record: Record, arm: str) -> Iterator[list[object]]:
    """State and command of a gripper, and the objects that it was assumed to hold."""
    for index, state, held in gripper_states(record, arm):
        numbers = (float(f"{value:.7g}") for value in astuple(state))
        yield [float(record.times[index]), *numbers, " ".join(held)]


def _state_columns(record: Record, generation: int) -> list[str]:
    model = record.model(generation)
    columns = ["time_s"]
    kinds = (("q", model.jnt_qposadr, model.nq), ("v", model.jnt_dofadr, model.nv))
    for what, starts, count in kinds:
        ends = [*starts[1:].tolist(), count]
        for joint, (first, end) in enumerate(zip(starts.tolist(), ends, strict=True)):
            columns += [f"{what} {_joint(model, joint)}[{place}]" for place in range(end - first)]
    return columns


def _joint(model: mujoco.MjModel, joint: int) -> str:
    return str(model.joint(joint).name or model.body(int(model.jnt_bodyid[joint])).name)


def _state_rows(record: Record, generation: int) -> Iterator[list[object]]:
    for index in range(len(record.times)):
        moment = record.moment(index)
        if moment.generation == generation:
            yield [moment.time, *moment.qpos.tolist(), *moment.qvel.tolist()]
