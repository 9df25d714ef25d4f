"""Event feed of a run: status changes for observers, captured log lines, and journals on disk."""

from __future__ import annotations

import logging
import os
import threading
from collections import deque
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from pathlib import Path
from typing import Final

from bt_dualarm.behaviors.report import StatusChange
from bt_dualarm.runtime.arm_runtime import Observer, RunView

_log = logging.getLogger(__name__)


class StatusFeed:
    """Collects the status changes of a tick and reports them to observers after all trees ticked.

    An observer that raises (a display whose terminal is gone) is dropped: observers cannot affect
    the arms.

    Args:
        observers: Observers, notified in this order.
    """

    def __init__(self, observers: Sequence[Observer] = ()) -> None:
        self.observers = list(observers)
        self._changes: list[StatusChange] = []

    def add(self, change: StatusChange) -> None:
        """Collect a change; called by trees during their ticks."""
        self._changes.append(change)

    def after_ticks(self, run: RunView) -> None:
        """Report the changes, then that trees were ticked."""
        changes = self._changes
        self._changes = []
        for observer in tuple(self.observers):
            try:
                for change in changes:
                    observer.on_event(change)
                observer.after_ticks(run)
            except Exception as error:  # noqa: BLE001 - see `_drop`
                self._drop(observer, error)

    def after_step(self, time: float) -> None:
        """Report a physics step that ended at ``time``, s."""
        for observer in self.observers:
            try:
                observer.after_step(time)
            except Exception as error:  # noqa: BLE001 - see `_drop`
                self._drop(observer, error)

    def _drop(self, observer: Observer, error: Exception) -> None:
        """Remove an observer, so that its error does not end the run."""
        self.observers = [other for other in self.observers if other is not observer]
        _log.warning("observer %s was dropped: %r", type(observer).__name__, error)


LOGGER: Final = logging.getLogger("bt_dualarm")
"""Parent of all loggers of the package and of its skills."""

LOGGER.addHandler(logging.NullHandler())  # a library does not print by itself

MOST_LINES: Final = 10_000
"""Lines buffered until taken; without a record nothing takes them, so the buffer is bounded."""

_active_capture: ContextVar[LogCapture | None] = ContextVar("capture", default=None)


class LogCapture(logging.Handler):
    """Captures log lines, tracebacks included, while its run is advanced.

    Several runs may be open at once, even in several threads: each captures its own lines only.
    The logger's level is restored when none of them is being advanced.
    """

    def __init__(self) -> None:
        super().__init__()
        self._lines: deque[str] = deque(maxlen=MOST_LINES)

    def take(self) -> list[str]:
        """Lines logged since the last call, in order."""
        lines = list(self._lines)
        self._lines.clear()
        return lines

    @contextmanager
    def during(self) -> Iterator[None]:
        """Capture what this thread logs in the block."""
        token = _active_capture.set(self)
        _log_level.enter()
        LOGGER.addHandler(self)
        try:
            yield
        finally:
            LOGGER.removeHandler(self)
            _log_level.leave()
            _active_capture.reset(token)

    def emit(self, record: logging.LogRecord) -> None:
        """Format and keep a line that belongs to this run."""
        if _active_capture.get() is self:
            self._lines.append(self.format(record))


class _LogLevel:
    """Level of the logger: at least INFO while there are captures, otherwise unchanged."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._captures = 0
        self._level = logging.NOTSET

    def enter(self) -> None:
        with self._lock:
            if not self._captures:
                self._level = LOGGER.level
                LOGGER.setLevel(min(LOGGER.getEffectiveLevel(), logging.INFO))
            self._captures += 1

    def leave(self) -> None:
        with self._lock:
            self._captures -= 1
            if not self._captures:
                LOGGER.setLevel(self._level)


_log_level = _LogLevel()


class Journal:
    """Text file that grows line by line; each addition is one system call.

    Its lines survive a run that is killed. A write error does not end the run; `finish` raises it.

    Args:
        path: The file, created with the first lines.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._file: int | None = None
        self._failure: OSError | None = None

    def add(self, text: str) -> None:
        """Append whole lines."""
        if self._failure is not None or not text:
            return
        try:
            self._write(text.encode())
        except OSError as error:
            self._failure = error
            _log.warning("%s is no longer written during the run: %s", self._path.name, error)

    def finish(self) -> None:
        """Flush everything to the disk; creates an empty file if there were no lines.

        Raises:
            OSError: A line could not be written, or the file is gone.
        """
        if self._failure is not None:
            raise self._failure
        self._write(b"")
        if self._file is not None:
            self._path.stat()  # raises if the folder was deleted meanwhile
            os.fsync(self._file)

    def close(self) -> None:
        """Close the file."""
        if self._file is not None:
            os.close(self._file)
            self._file = None

    def _write(self, text: bytes) -> None:
        if self._file is None:
            flags = os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_APPEND
            self._file = os.open(self._path, flags, 0o644)
        while text:
            text = text[os.write(self._file, text) :]
