"""What pages show of the notes of a run: blackboards, and what was found in pictures."""

from __future__ import annotations

import json
from typing import Final

from bt_dualarm.spec.source import Json

_LONGEST: Final = 400
"""Characters of a value that are shown."""

_MOST_KEYS: Final = 300


class NotesSeen:
    """The latest of all notes that were added."""

    def __init__(self) -> None:
        self._boards: dict[str, dict[str, Json]] = {}
        self._looks: dict[str, Json] = {}
        self._frames: dict[str, Json] = {}
        self._guards: dict[str, Json] = {}

    def add(self, note: Json) -> None:
        """Take up a note, as the record has it."""
        kind, arm = note["kind"], str(note["arm"])
        if kind == "wrote":
            board = self._boards.setdefault(arm, {})
            if len(board) < _MOST_KEYS or note["key"] in board:
                board[str(note["key"])] = note
        elif kind == "look":
            self._looks[arm] = note
        elif kind == "frame":
            self._frames[arm] = note
        elif kind == "guard":
            self._guards[arm] = note

    def board(self, arm: str) -> list[Json]:
        """Keys of an arm's blackboard with value, writer and time."""
        return [
            {
                "key": key,
                "value": _text(note["value"]),
                "leaf": note["leaf"],
                "time": round(float(note["time_s"]), 3),
            }
            for key, note in tuple(self._boards.get(arm, {}).items())
        ]

    def look(self, arm: str) -> Json | None:
        """What was found last in a picture of an arm's camera; None before the first."""
        found, frame = self._looks.get(arm), self._frames.get(arm)
        if found is None and frame is None:
            return None
        said = {} if found is None else {k: found[k] for k in ("pixel", "area_px", "locked")}
        region = None if frame is None else frame["region"]
        stamp = (found or frame or {})["stamp"]
        return {**said, "region": region, "stamp": round(float(stamp), 3)}

    def guard(self, arm: str) -> str:
        """What the arm's guard did last, as a sentence; empty if nothing."""
        note = self._guards.get(arm)
        if note is None:
            return ""
        return f"at {float(note['time_s']):.2f} s its guard {note['does']} it: {note['reason']}"


def _text(value: object) -> str:
    text = value if isinstance(value, str) else json.dumps(value)
    return text if len(text) <= _LONGEST else f"{text[: _LONGEST - 1]}…"
