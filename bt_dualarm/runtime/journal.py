"""Lines that are on the disk as soon as they are known: what is left of a run that is killed."""

from __future__ import annotations

import logging
import os
from pathlib import Path

_log = logging.getLogger(__name__)


class Journal:
    """A text file that grows line by line; each addition is one call of the system.

    Where it cannot be written, the run goes on without it, and its end says so.

    Args:
        path: The file; it is made with the first lines.
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
            _log.warning("%s is not kept while the run goes on: %s", self._path.name, error)

    def finish(self) -> None:
        """Make sure that all is on the disk; an empty file if there was nothing.

        Raises:
            OSError: Something could not be written, or the file is gone.
        """
        if self._failure is not None:
            raise self._failure
        self._write(b"")
        if self._file is not None:
            self._path.stat()  # a folder that was taken away meanwhile has no record
            os.fsync(self._file)

    def close(self) -> None:
        """Let go of the file, which stays as it is."""
        if self._file is not None:
            os.close(self._file)
            self._file = None

    def _write(self, text: bytes) -> None:
        if self._file is None:
            flags = os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_APPEND
            self._file = os.open(self._path, flags, 0o644)
        while text:
            text = text[os.write(self._file, text) :]
