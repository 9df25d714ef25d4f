"""What a run says while it goes on: changes of status, log lines, what guards did."""

from __future__ import annotations

import logging
from collections import deque
from collections.abc import Callable
from threading import Lock
from typing import Final

from bt_dualarm.live.past_series import MOST_FAILURES, change_line, line
from bt_dualarm.runtime.log_capture import LOGGER
from bt_dualarm.runtime.parts import IdleObserver
from bt_dualarm.spec.source import Json
from bt_dualarm.tree.report import StatusChange

_MOST: Final = 2000
_LONGEST: Final = 1000


class Happenings(IdleObserver):
    """Keeps the latest lines; an observer of changes, and a handler of what is logged.

    Args:
        clock: Function that gives simulated time in s.
    """

    def __init__(self, clock: Callable[[], float]) -> None:
        self._clock = clock
        self._lines: deque[Json] = deque(maxlen=_MOST)
        self._failures: list[Json] = []
        self._count = 0
        self._lock = Lock()
        self._handler = _Handler(self._logged)

    def since(self, number: int) -> Json:
        """Lines after that many, oldest first; how many there have been; the first failures."""
        with self._lock:
            new = max(0, min(self._count - number, len(self._lines)))
            lines = [*self._lines][len(self._lines) - new :]
            return {"next": self._count, "lines": lines, "failures": [*self._failures]}

    def on_event(self, change: StatusChange) -> None:
        """Keep a change of status."""
        self._add(
            change_line(
                change.time, change.arm, change.path, change.new, change.code, change.reason
            )
        )

    def noted(self, note: Json) -> None:
        """Keep what a guard did."""
        if note["kind"] == "guard":
            text = f"the guard {note['does']} it: {note['reason']}"
            self._add(line(float(note["time_s"]), str(note["arm"]), text, "GUARD"))

    def listen(self) -> None:
        """Keep what is logged from now on."""
        LOGGER.addHandler(self._handler)

    def close(self) -> None:
        """Listen no more."""
        LOGGER.removeHandler(self._handler)

    def _logged(self, record: logging.LogRecord) -> None:
        arm = record.name.removeprefix("bt_dualarm.skills.")
        said = self._handler.format(record)[:_LONGEST]
        self._add(line(self._clock(), "" if arm == record.name else arm, said, record.levelname))

    def _add(self, added: Json) -> None:
        with self._lock:
            self._lines.append(added)
            if added["level"] == "FAILURE" and len(self._failures) < MOST_FAILURES:
                self._failures.append(added)
            self._count += 1


class _Handler(logging.Handler):
    def __init__(self, take: Callable[[logging.LogRecord], None]) -> None:
        super().__init__()
        self._take = take

    def emit(self, record: logging.LogRecord) -> None:
        self._take(record)
