"""What is logged while one run is advanced, kept apart from what others log."""

from __future__ import annotations

import logging
import threading
from collections import deque
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from typing import Final

LOGGER: Final = logging.getLogger("bt_dualarm")
"""Parent of every logger of the package and of its skills."""

LOGGER.addHandler(logging.NullHandler())  # a library prints nothing of its own accord

MOST_LINES: Final = 10_000
"""Lines that wait for somebody to take them; nobody does where there is no record."""

_of_now: ContextVar[LogCapture | None] = ContextVar("capture", default=None)


class LogCapture(logging.Handler):
    """Keeps what is logged, tracebacks included, while its run is advanced.

    Several runs may be open at once, in several threads too: each keeps its own lines only, and
    the logger is left as it was whenever none of them is being advanced.
    """

    def __init__(self) -> None:
        super().__init__()
        self._lines: deque[str] = deque(maxlen=MOST_LINES)

    def take(self) -> list[str]:
        """Lines that were logged since they were last taken, in order."""
        lines = list(self._lines)
        self._lines.clear()
        return lines

    @contextmanager
    def during(self) -> Iterator[None]:
        """Keep what this thread logs in the block."""
        token = _of_now.set(self)
        _open.enter()
        LOGGER.addHandler(self)
        try:
            yield
        finally:
            LOGGER.removeHandler(self)
            _open.leave()
            _of_now.reset(token)

    def emit(self, record: logging.LogRecord) -> None:
        """Keep it, formatted, if it is of the run's own."""
        if _of_now.get() is self:
            self._lines.append(self.format(record))


class _Openness:
    """The level of the logger: as it was, but at least INFO while somebody listens."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._listeners = 0
        self._level = logging.NOTSET

    def enter(self) -> None:
        with self._lock:
            if not self._listeners:
                self._level = LOGGER.level
                LOGGER.setLevel(min(LOGGER.getEffectiveLevel(), logging.INFO))
            self._listeners += 1

    def leave(self) -> None:
        with self._lock:
            self._listeners -= 1
            if not self._listeners:
                LOGGER.setLevel(self._level)


_open = _Openness()
