"""Causes that were injected: faults of the file that explain the end of a leaf."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from bt_dualarm.diagnosis.evidence import COMPARING_LEAVES, Cause, Evidence
from bt_dualarm.replay.record import Facts, Record
from bt_dualarm.spec.faults import CAMERA_FAULTS, KINDS, AbsentPartner, NoPlan

_WAITING_CODES: Final = ("", "HALTED", "TIMEOUT", "TIMED_OUT", "PARTNER_GONE")
"""Codes of leaves that may have waited for another arm."""

_MOVED_M: Final = 0.005
"""Distance from where an object was before a fault at which the fault has moved it, m."""


@dataclass(frozen=True)
class _Injected:
    """A fault of a record, with the times in s between which it was active."""

    event: Facts
    begin: float
    until: float

    @property
    def sentence(self) -> str:
        lasted = f"from {self.begin:.2f} s on"
        if self.until < float("inf"):
            lasted = f"from {self.begin:.2f} to {self.until:.2f} s"
        return f"the fault '{self.event['name']}' was injected {lasted}: {self.event['sentence']}"


def _injected(record: Record) -> list[_Injected]:
    found: dict[tuple[str, float], _Injected] = {}
    for note in record.notes:
        if note["kind"] != "fault":
            continue
        time = float(note["time_s"])
        name = str(note["name"])
        if note["active"]:
            found[name, time] = _Injected(note, time, float("inf"))
            continue
        open_ = [key for key, one in found.items() if key[0] == name and one.until == float("inf")]
        for key in open_:
            found[key] = _Injected(found[key].event, found[key].begin, time)
    return [*found.values()]


def injected_causes(e: Evidence) -> Iterator[Cause]:
    """Yields injected faults that explain the end of a leaf, those of its own arm first.

    A fault explains it if it was active while the leaf ran, and concerns what the leaf works with:
    its arm, its camera if it took images, an object that it names or holds, the planner if no path
    was found, the partner if it waited. So does one that was over by then, but has moved such an
    object, which has lain where it came to rest ever since.

    What compares keys depends on what ended before, such as a loop whose condition no longer held.
    """
    before = e.decided_before if e.leaf.kind in COMPARING_LEAVES else None
    if before is not None:
        what = f"{before.leaf.path!r} had failed at {before.ended:.2f} s"
        for cause in injected_causes(before):
            yield replace(cause, sentence=f"{cause.sentence}; {what}")
    found = [
        one
        for one in _injected(e.record)
        if one.begin <= e.ended + 1e-9
        and (one.until >= e.began - 1e-9 or _has_moved_something(e, one))
        and _concerns(e, one.event)
    ]
    for one in sorted(found, key=lambda one: str(one.event["arm"]) != e.arm):
        remedy = "it is a test: remove the fault, or let the tree handle it"
        yield e.cause("INJECTED", one.sentence, remedy, time_s=one.begin)


def _has_moved_something(e: Evidence, one: _Injected) -> bool:
    """Whether an object is no longer where it was before a fault, and no arm has held it since."""
    before, after = e.scene(one.begin), e.scene(e.began)
    held = {
        name
        for note in e.record.notes
        if note["kind"] == "holds" and one.begin <= note["time_s"] <= e.began
        for name in note["gripped"]
    }
    return any(
        name not in held
        and before.has(name)
        and after.has(name)
        and np.linalg.norm(after.position(name) - before.position(name)) > _MOVED_M
        for name in map(str, one.event["objects"])
    )


def _concerns(e: Evidence, event: Facts) -> bool:
    kind = KINDS.get(str(event["fault"]))
    arm = str(event["arm"])
    if kind is None:
        return False
    if event["leaf"]:
        return arm == e.arm and event["leaf"] == e.leaf.path
    if event["objects"]:
        return _works_with(e, [str(name) for name in event["objects"]])
    if kind is AbsentPartner and arm != e.arm:
        waits = e.notes("waits", since=e.began, until=e.ended)
        return bool(waits) or e.code in _WAITING_CODES or arm in json.dumps(e.ports)
    if arm != e.arm:
        return arm in [value for value in e.ports.values() if isinstance(value, str)]
    if kind is NoPlan:
        return e.code == "NO_PLAN"
    if kind in CAMERA_FAULTS:
        return bool(e.notes("frame", since=e.began, until=e.ended))
    return True


def _works_with(e: Evidence, objects: list[str]) -> bool:
    """Whether a leaf names one of these objects, its arm holds one, or it looked for something."""
    named = json.dumps(e.ports)
    held = [name for note in e.notes("holds", until=e.ended) for name in note["gripped"]]
    if any(json.dumps(name) in named or name in held for name in objects):
        return True
    return bool(e.notes("look", since=e.began, until=e.ended))
