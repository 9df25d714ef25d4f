"""A record over all of its time, for a page: ways of tools, signals, what happened, reasons."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

import mujoco
import numpy as np

from bt_dualarm.live.places import Places, places_of
from bt_dualarm.live.signals import COLUMNS, Row, row_of, series_text
from bt_dualarm.pose import Vector
from bt_dualarm.replay.record import Record
from bt_dualarm.replay.story import Story, stories
from bt_dualarm.replay.story_text import story_text
from bt_dualarm.spec.source import Json

MOST_POINTS: Final = 2000
"""Points of a curve that a page gets at most."""

MOST_FAILURES: Final = 500
"""Failures that are marked on a page's time line: the first ones."""

_MOST_LINES: Final = 5000


def series_of(record: Record) -> Json:
    """Signals of all arms over the whole of a record, as `Signals.since` gives them of a run."""
    rows: dict[str, list[Row]] = {name: [] for name in record.arms}
    count = len(record.times)
    data, places, of = None, {}, -1
    for index in range(0, count, max(1, -(-count // MOST_POINTS))):
        moment = record.moment(index)
        model = record.model(moment.generation)
        if data is None or moment.generation != of:
            data, places = mujoco.MjData(model), places_of(model, record.arms)
            of = moment.generation
        data.qpos[:], data.time = moment.qpos, moment.time
        mujoco.mj_kinematics(model, data)
        for name, arm in places.items():
            sent = sent_to(record, arm, index)
            if sent is not None:
                row = row_of(model, data, arm, sent[0], sent[3])
                rows[name].append((*row, gripper_force(record, name, index)))
    return series_text(
        {name: np.array(points).reshape(-1, len(COLUMNS)) for name, points in rows.items()}
    )


def sent_to(
    record: Record, arm: Places, index: int
) -> tuple[Vector, Vector, Vector, Vector] | None:
    """What an arm was sent at a state by its number, as `Record.arm_row` has it.

    None where the arm was not in the world, and where the record has another number of joints.
    """
    row = record.arm_row(arm.name, index)
    return row if row is not None and len(row[0]) == len(arm.qpos) else None


def gripper_force(record: Record, arm: str, index: int) -> float:
    """Force of a pad or cup in N at a state by its number; NaN where it is not known."""
    state = record.gripper(arm, index)
    return np.nan if state is None else state.force


def log_of(record: Record) -> Json:
    """What happened in a record, as `Happenings.since` gives it of a run: lines, and failures.

    A line has a time in s, an arm, a text, and what it is: a status, or ``GUARD``.
    """
    lines = sorted([*_changes(record), *_guards(record)], key=lambda line: float(line["time"]))
    failures = [line for line in lines if line["level"] == "FAILURE"]
    return {"next": len(lines), "lines": lines[-_MOST_LINES:], "failures": failures[:MOST_FAILURES]}


def why_of(record: Record, asked: str | None, time: float | None = None) -> Json:
    """The stories that ``bt-why`` tells of a node or a time, or of whatever failed.

    Args:
        record: The record.
        asked: ``ARM:PATH`` of a node, a time, or None.
        time: Simulated time in s: of a node that was running then, what it was waiting for.

    Raises:
        ReplayError: No node has such a name, or it never ran; the time is outside of the record.
    """
    told: list[Story] = []
    if asked is not None and time is not None:
        then = stories(record, f"{min(time, record.until):.4f}")
        told = [story for story in then if story.status == "RUNNING" and _is_below(story, asked)]
    told = told or [*stories(record, asked)]
    return {"stories": [{**each.as_dict(), "text": story_text(each)} for each in told]}


def _is_below(story: Story, asked: str) -> bool:
    return f"{story.arm}:{story.leaf}/".startswith(f"{asked}/")


def line(time: float, arm: str, text: str, level: str) -> Json:
    """A line of the log."""
    return {"time": round(time, 3), "arm": arm, "text": text, "level": level}


def change_line(time: float, arm: str, path: str, new: str, code: str, reason: str) -> Json:
    """A change of a status as a line of the log."""
    became = "HALTED" if code == "HALTED" and new == "INVALID" else new
    why = f" {code}: {reason}" if reason and new == "FAILURE" else ""
    return line(time, arm, f"{path} → {became}{why}", became)


def _changes(record: Record) -> Iterator[Json]:
    for event in record.events:
        texts = (str(event[name]) for name in ("arm", "path", "new", "code", "reason"))
        yield change_line(float(event["time_s"]), *texts)


def _guards(record: Record) -> Iterator[Json]:
    for note in record.notes:
        if note["kind"] == "guard":
            text = f"the guard {note['does']} it: {note['reason']}"
            yield line(float(note["time_s"]), str(note["arm"]), text, "GUARD")
