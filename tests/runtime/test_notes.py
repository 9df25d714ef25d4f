"""What happens between two frames is noted when it changes, and then only."""

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


def test_who_holds_what_is_noted_as_it_changes() -> None:
    """
    asked with      | notes
    nothing         | none
    cube            | arm1 cube
    cube            | none
    cube, peg, lid  | arm1 cube and peg (by a weld), arm2 lid
    lid             | arm1 nothing
    nothing         | arm2 nothing
    """
    notes = TraceEvents(clock=lambda: 0.5)
    noted = []
    for held in ([], [CUBE], [CUBE], [CUBE, PEG, LID], [LID], []):
        notes.of_holding(held)
        noted.append([(n["arm"], n["gripped"], n["welded"]) for n in notes.take()])
    assert noted == [
        [],
        [("arm1", ["cube"], [])],
        [],
        [("arm1", ["cube"], ["peg"]), ("arm2", ["lid"], [])],
        [("arm1", [], [])],
        [("arm2", [], [])],
    ]
