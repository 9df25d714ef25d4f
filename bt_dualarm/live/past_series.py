"""A record over all of its time, for a page: ways of tools, signals, what happened, reasons."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

import mujoco
import numpy as np

from bt_dualarm.live.physics import as_text
from bt_dualarm.live.places import places_of
from bt_dualarm.replay.record import Record
from bt_dualarm.replay.story import Story, stories
from bt_dualarm.replay.story_text import story_text
from bt_dualarm.spec.source import Json

MOST_POINTS: Final = 2000
"""Points of a curve that a page gets at most."""

_MOST_LINES: Final = 5000


def series_of(record: Record) -> Json:
    """For each arm rows of six numbers: time in s, tool in m, error in degrees, torque's share.

    Error is the largest distance of a joint from its set-point; the torque's share is that of the
    motor that gives most of what it can. Rows are 32-bit numbers, as base64.
    """
    rows: dict[str, list[tuple[float, ...]]] = {name: [] for name in record.arms}
    count = len(record.times)
    data, places, of = None, {}, -1
    for index in range(0, count, max(1, -(-count // MOST_POINTS))):
        moment = record.moment(index)
        model = record.model(moment.generation)
        if data is None or moment.generation != of:
            data, places = mujoco.MjData(model), places_of(model, record.arms)
            of = moment.generation
        data.qpos[:] = moment.qpos
        mujoco.mj_kinematics(model, data)
        for name, arm in places.items():
            row = record.arm_row(name, index)
            if row is not None:
                error = float(np.degrees(np.abs(row[0] - moment.qpos[arm.qpos]).max()))
                tool = data.site_xpos[arm.tool].tolist()
                share = arm.torque_share(model, row[3])
                rows[name].append((moment.time, *tool, error, share))
    return {name: as_text(np.array(points).reshape(-1, 6)) for name, points in rows.items()}


def log_of(record: Record) -> list[Json]:
    """Changes of status and what the guards did, in order: time in s, arm, text, what it is."""
    lines = sorted([*_changes(record), *_guards(record)], key=lambda line: float(line["time"]))
    return lines[-_MOST_LINES:]


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
