"""Trace events: an event is recorded when its state changes, and only then."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from bt_dualarm.runtime.observations import TraceEvents


@dataclass(frozen=True)
class Held:
    arm: str
    object: str
    by_gripper: bool


CUBE: Any = Held("arm1", "cube", True)
PEG: Any = Held("arm1", "peg", False)
LID: Any = Held("arm2", "lid", True)


def test_holdings_are_recorded_when_they_change() -> None:
    """
    held            | events
    nothing         | none
    cube            | arm1 cube
    cube            | none
    cube, peg, lid  | arm1 cube and peg (by a weld), arm2 lid
    lid             | arm1 nothing
    nothing         | arm2 nothing
    """
    trace = TraceEvents(clock=lambda: 0.5)
    events = []
    for held in ([], [CUBE], [CUBE], [CUBE, PEG, LID], [LID], []):
        trace.of_holding(held)
        events.append([(n["arm"], n["gripped"], n["welded"]) for n in trace.take()])
    assert events == [
        [],
        [("arm1", ["cube"], [])],
        [],
        [("arm1", ["cube"], ["peg"]), ("arm2", ["lid"], [])],
        [("arm1", [], [])],
        [("arm2", [], [])],
    ]
