"""Data for the viewer page: tree rows, event log and annotations, from a run or a record."""

from __future__ import annotations

import json
import logging
from collections import Counter, deque
from collections.abc import Callable, Iterable, Iterator, Mapping
from threading import Lock
from typing import Final

import mujoco
import numpy as np

from bt_dualarm.behaviors.report import NodeView, StatusChange
from bt_dualarm.core.pose import Vector
from bt_dualarm.diagnosis.story import Story, stories, story_text
from bt_dualarm.replay.record import Record
from bt_dualarm.replay.timeline import Change, TimelineNode
from bt_dualarm.runtime.arm_runtime import IdleObserver
from bt_dualarm.runtime.observations import LOGGER
from bt_dualarm.skill.cell import waiting_sentence
from bt_dualarm.spec.yaml_reader import Json
from bt_dualarm.viewer.signals import COLUMNS, ModelIndices, Row, model_indices, row_of, series_text


def rows_of(root: NodeView | None) -> list[Json]:
    """Rows of the current tree, with depth and path; empty for an arm that is not in the world."""
    return [] if root is None else [*_current_rows(root, root.name, 0)]


def rows_at(root: TimelineNode, time: float, notes: Iterable[Json] = ()) -> list[Json]:
    """Rows of a recorded tree at ``time``, s.

    Args:
        root: Root of the tree.
        time: Simulated time in s.
        notes: Trace events of the record, which show what nodes wait for.
    """
    waits = {
        str(note["leaf"]): note
        for note in notes
        if note["kind"] == "waits" and note["arm"] == root.arm and note["time_s"] <= time + 1e-9
    }
    return [*_past_rows(root, root.standing_at(time), 0, waits)]


def _current_rows(node: NodeView, path: str, depth: int) -> Iterator[Json]:
    yield _row(
        path,
        depth,
        node.kind,
        status=node.status,
        halted=node.halted,
        since=round(node.since, 3),
        progress=node.progress,
        reason=node.reason,
        waiting=node.waiting,
    )
    seen: Counter[str] = Counter()
    for child in node.children:
        seen[child.name] += 1
        count = seen[child.name]
        shown = child.name if count == 1 else f"{child.name}#{count}"
        yield from _current_rows(child, f"{path}/{shown}", depth + 1)


def _past_rows(
    node: TimelineNode, standing: Mapping[str, Change], depth: int, waits: Mapping[str, Json]
) -> Iterator[Json]:
    change = standing.get(node.path)
    failed = change is not None and change.new == "FAILURE" and change.code
    yield _row(
        node.path,
        depth,
        node.kind,
        status="INVALID" if change is None else change.new,
        halted=change is not None and change.new == "INVALID" and change.old == "RUNNING",
        since=0.0 if change is None else round(change.time, 3),
        progress=None,
        reason=f"{change.code}: {change.reason}" if change is not None and failed else "",
        waiting=_waiting_then(node, standing, waits.get(node.path)),
    )
    for child in node.children:
        yield from _past_rows(child, standing, depth + 1, waits)


def _waiting_then(node: TimelineNode, standing: Mapping[str, Change], wait: Json | None) -> str:
    """Clause on the other arms that a running node waited for; empty if it waited for none."""
    change = standing.get(node.path)
    children = (standing.get(child.path) for child in node.children)
    if wait is None or wait.get("ended") or change is None or change.new != "RUNNING":
        return ""
    if float(wait["since"]) < change.time - 1e-9 or any(
        child is not None and child.new == "RUNNING" for child in children
    ):
        return ""
    return waiting_sentence(str(wait["target"]), list(wait["others"]), float(wait["since"]))


def _row(path: str, depth: int, kind: str, **fields: object) -> Json:
    name = path.rpartition("/")[2]
    return {"path": path, "depth": depth, "name": name, "kind": kind, **fields}


MOST_POINTS: Final = 2000
"""Largest number of points of a curve sent to a page."""

MOST_FAILURES: Final = 500
"""Largest number of failures marked on a page's time line; the first ones are kept."""

MARKED: Final = ("FAILURE", "FAULT")
"""Levels of lines that a page marks on its time line."""

_MOST_LINES: Final = 5000


def series_of(record: Record) -> Json:
    """Signals of all arms over a whole record, in the format of `Signals.since`."""
    rows: dict[str, list[Row]] = {name: [] for name in record.arms}
    count = len(record.times)
    data = None
    indices = {}
    generation = -1
    for index in range(0, count, max(1, -(-count // MOST_POINTS))):
        moment = record.moment(index)
        model = record.model(moment.generation)
        if data is None or moment.generation != generation:
            data = mujoco.MjData(model)
            indices = model_indices(model, record.arms)
            generation = moment.generation
        data.qpos[:] = moment.qpos
        data.time = moment.time
        mujoco.mj_kinematics(model, data)
        for name, arm in indices.items():
            sent = sent_to(record, arm, index)
            if sent is not None:
                row = row_of(model, data, arm, sent[0], sent[3])
                force = gripper_force(record, name, index)
                rows[name].append((*row, force, record.lives(name, generation)))
    return series_text(
        {name: np.array(points).reshape(-1, len(COLUMNS)) for name, points in rows.items()}
    )


def sent_to(
    record: Record, arm: ModelIndices, index: int
) -> tuple[Vector, Vector, Vector, Vector] | None:
    """Set-point and torque of an arm at a state, by its index, as in `Record.arm_row`.

    None if the arm was not in the world, or if the record has another number of joints.
    """
    row = record.arm_row(arm.name, index)
    return row if row is not None and len(row[0]) == len(arm.qpos) else None


def gripper_force(record: Record, arm: str, index: int) -> float:
    """Force of a pad or cup in N at a state, by its index; NaN if unknown."""
    state = record.gripper(arm, index)
    return np.nan if state is None else state.force


def log_of(record: Record) -> Json:
    """Log lines and failures of a record, in the format of `EventFeed.since`.

    A line has a time in s, an arm, a text and a level: a status, ``GUARD`` or ``FAULT``.
    """
    lines = sorted(
        [*_changes(record), *_interventions(record)], key=lambda line: float(line["time"])
    )
    failures = [line for line in lines if line["level"] in MARKED]
    return {"next": len(lines), "lines": lines[-_MOST_LINES:], "failures": failures[:MOST_FAILURES]}


def why_of(record: Record, asked: str | None, time: float | None = None) -> Json:
    """Diagnoses as from ``bt-why``, of a node, of a time, or of the failures of the run.

    Args:
        record: The record.
        asked: ``ARM:PATH`` of a node, a time, or None.
        time: Simulated time in s: if the node was running then, what it was waiting for.

    Raises:
        ReplayError: No node has this name, or it never ran; the time is outside the record.
    """
    found: list[Story] = []
    if asked is not None and time is not None:
        running = stories(record, f"{min(time, record.until):.4f}")
        found = [
            story for story in running if story.status == "RUNNING" and _is_below(story, asked)
        ]
    found = found or [*stories(record, asked)]
    return {"stories": [{**each.as_dict(), "text": story_text(each)} for each in found]}


def _is_below(story: Story, asked: str) -> bool:
    return f"{story.arm}:{story.leaf}/".startswith(f"{asked}/")


def line(time: float, arm: str, text: str, level: str) -> Json:
    """A line of the log."""
    return {"time": round(time, 3), "arm": arm, "text": text, "level": level}


def change_line(time: float, arm: str, path: str, new: str, code: str, reason: str) -> Json:
    """A line of the log for a status change."""
    shown = "HALTED" if code == "HALTED" and new == "INVALID" else new
    why = f" {code}: {reason}" if reason and new == "FAILURE" else ""
    return line(time, arm, f"{path} → {shown}{why}", shown)


def _changes(record: Record) -> Iterator[Json]:
    for event in record.events:
        texts = (str(event[name]) for name in ("arm", "path", "new", "code", "reason"))
        yield change_line(float(event["time_s"]), *texts)


def _interventions(record: Record) -> Iterator[Json]:
    for note in record.notes:
        if note["kind"] in ("guard", "fault"):
            yield intervention_line(note)


def intervention_line(note: Json) -> Json:
    """A line of the log for an intervention of a guard, or an injected fault."""
    if note["kind"] == "guard":
        text = f"the guard {note['does']} it: {note['reason']}"
        return line(float(note["time_s"]), str(note["arm"]), text, "GUARD")
    state = "injected" if note["active"] else "ended"
    text = f"fault '{note['name']}' {state}: {note['sentence']}"
    return line(float(note["time_s"]), str(note["arm"]) or "world", text, "FAULT")


_MOST_LIVE_LINES: Final = 2000
_LONGEST_LINE: Final = 1000


class EventFeed(IdleObserver):
    """Latest status changes, guard interventions and log lines of a running run.

    Args:
        clock: Returns simulated time in s.
    """

    def __init__(self, clock: Callable[[], float]) -> None:
        self._clock = clock
        self._lines: deque[Json] = deque(maxlen=_MOST_LIVE_LINES)
        self._failures: list[Json] = []
        self._count = 0
        self._lock = Lock()
        self._handler = _CallbackHandler(self._logged)

    def since(self, number: int) -> Json:
        """Lines after the first ``number``, oldest first; their total; the first failures."""
        with self._lock:
            new = max(0, min(self._count - number, len(self._lines)))
            lines = [*self._lines][len(self._lines) - new :]
            return {"next": self._count, "lines": lines, "failures": [*self._failures]}

    def on_event(self, change: StatusChange) -> None:
        """Add a status change."""
        self._add(
            change_line(
                change.time, change.arm, change.path, change.new, change.code, change.reason
            )
        )

    def add_event(self, note: Json) -> None:
        """Add a trace event, if it is an intervention of a guard or an injected fault."""
        if note["kind"] in ("guard", "fault"):
            self._add(intervention_line(note))

    def listen(self) -> None:
        """Start to add log lines."""
        LOGGER.addHandler(self._handler)

    def close(self) -> None:
        """Stop adding log lines."""
        LOGGER.removeHandler(self._handler)

    def _logged(self, record: logging.LogRecord) -> None:
        arm = record.name.removeprefix("bt_dualarm.skills.")
        text = self._handler.format(record)[:_LONGEST_LINE]
        self._add(line(self._clock(), "" if arm == record.name else arm, text, record.levelname))

    def _add(self, added: Json) -> None:
        with self._lock:
            self._lines.append(added)
            if added["level"] in MARKED and len(self._failures) < MOST_FAILURES:
                self._failures.append(added)
            self._count += 1


class _CallbackHandler(logging.Handler):
    def __init__(self, take: Callable[[logging.LogRecord], None]) -> None:
        super().__init__()
        self._take = take

    def emit(self, record: logging.LogRecord) -> None:
        self._take(record)


_LONGEST_NOTE: Final = 400
"""Longest text of a value, in characters."""

_MOST_KEYS: Final = 300


class Annotations:
    """Latest trace events of each arm: blackboard keys, frames, findings in frames, guards."""

    def __init__(self) -> None:
        self._blackboards: dict[str, dict[str, Json]] = {}
        self._findings: dict[str, Json] = {}
        self._frames: dict[str, Json] = {}
        self._guards: dict[str, Json] = {}

    def add(self, note: Json) -> None:
        """Add a trace event, as in the record."""
        kind = note["kind"]
        arm = str(note["arm"])
        if kind == "wrote":
            blackboard = self._blackboards.setdefault(arm, {})
            if len(blackboard) < _MOST_KEYS or note["key"] in blackboard:
                blackboard[str(note["key"])] = note
        elif kind == "look":
            self._findings[arm] = note
        elif kind == "frame":
            self._frames[arm] = note
        elif kind == "guard":
            self._guards[arm] = note

    def blackboard(self, arm: str) -> list[Json]:
        """Keys of an arm's blackboard with value, writing leaf and time in s."""
        return [
            {
                "key": key,
                "value": _text(note["value"]),
                "leaf": note["leaf"],
                "time": round(float(note["time_s"]), 3),
            }
            for key, note in tuple(self._blackboards.get(arm, {}).items())
        ]

    def look(self, arm: str) -> Json | None:
        """Last finding in a frame of an arm's camera; None before the first frame."""
        found = self._findings.get(arm)
        frame = self._frames.get(arm)
        if found is None and frame is None:
            return None
        finding = {} if found is None else {k: found[k] for k in ("pixel", "area_px", "locked")}
        region = None if frame is None else frame["region"]
        stamp = (found or frame or {})["stamp"]
        return {**finding, "region": region, "stamp": round(float(stamp), 3)}

    def guard(self, arm: str) -> str:
        """Sentence on the last intervention of the arm's guard; empty if there is none."""
        note = self._guards.get(arm)
        if note is None:
            return ""
        return f"at {float(note['time_s']):.2f} s its guard {note['does']} it: {note['reason']}"


def _text(value: object) -> str:
    text = value if isinstance(value, str) else json.dumps(value)
    return text if len(text) <= _LONGEST_NOTE else f"{text[: _LONGEST_NOTE - 1]}…"
