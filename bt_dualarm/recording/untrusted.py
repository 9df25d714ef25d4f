"""Files of a record that somebody else may have written: read within limits, or refused.

Nothing here trusts a length, a type or a kind of file: a record is sent around with bug reports.
"""

from __future__ import annotations

import errno
import math
import os
import re
import stat
from pathlib import Path
from typing import Any, BinaryIO, Final

from pydantic_core import from_json

from bt_dualarm.errors import DualArmError

MOST_MEMORY: Final = 600 * 2**20
"""Bytes that all of a record may take in memory: with Python and MuJoCo less than 1 GB."""

MOST_FILE: Final = 2**30
"""Bytes of one file of a record."""

LARGEST_INT: Final = 2**63 - 1

_SUSPICIOUS: Final = re.compile(rb"[0-9]{19}|[eE]\+?[0-9]{3}")
"""What every number has that does not fit 64 bits; texts may have it, too."""

_KINDS: Final = (
    (stat.S_ISFIFO, "a pipe"),
    (stat.S_ISSOCK, "a socket"),
    (stat.S_ISDIR, "a folder"),
    (stat.S_ISLNK, "a symbolic link"),
)


class HistoryError(DualArmError):
    """A file of a record cannot be read; the message names the file."""


def file_kind(mode: int) -> str:
    """What a file is that is no regular one, in words."""
    return next((words for is_such, words in _KINDS if is_such(mode)), "a device")


class Budget:
    """Memory that one record may still take.

    Args:
        most: Bytes.
    """

    def __init__(self, most: int = MOST_MEMORY) -> None:
        self._most = self._left = most

    def take(self, count: int) -> None:
        """Count bytes that are about to be taken.

        Raises:
            ValueError: There are not so many left.
        """
        self._left -= count
        if self._left < 0:
            raise ValueError(
                f"the record takes more than {self._most // 2**20} MB of memory once it is unpacked"
            )


def open_regular(path: Path, most: int = MOST_FILE, *, links: bool = False) -> tuple[BinaryIO, int]:
    """Open a file for reading; its size as it is now, too.

    Args:
        path: The file.
        most: Bytes that it may have.
        links: Whether the file may be a symbolic link: one of a record may lead anywhere.

    Raises:
        HistoryError: It is not there, no regular file (a link, a pipe, a device), or too large.
    """
    try:
        # Without O_NONBLOCK opening a pipe waits for whoever writes to it.
        flags = os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC
        descriptor = os.open(path, flags if links else flags | os.O_NOFOLLOW)
    except OSError as error:
        if error.errno == errno.ELOOP:
            raise HistoryError(f"{path}: is a symbolic link; expected a regular file") from error
        raise HistoryError(f"cannot read {path}: {error.strerror or error}") from error
    except ValueError as error:  # a null character
        raise HistoryError(f"cannot read {str(path)!r}: {error}") from error
    found = os.fstat(descriptor)
    if not stat.S_ISREG(found.st_mode):
        os.close(descriptor)
        kind = file_kind(found.st_mode)
        raise HistoryError(f"{path}: is {kind}; expected a regular file")
    if found.st_size > most:
        os.close(descriptor)
        raise HistoryError(
            f"{path}: has {found.st_size / 2**20:.0f} MB; expected at most {most // 2**20} MB"
        )
    return os.fdopen(descriptor, "rb"), found.st_size


def read_regular(path: Path, most: int = MOST_FILE, *, links: bool = False) -> bytes:
    """All of a file, as large as it is when it is opened; arguments as of `open_regular`.

    Raises:
        HistoryError: As of `open_regular`, or it cannot be read.
    """
    file, size = open_regular(path, most, links=links)
    with file:
        try:
            return file.read(size)
        except OSError as error:
            raise HistoryError(f"cannot read {path}: {error.strerror or error}") from error


def parsed(text: bytes, budget: Budget) -> Any:  # Any: whatever JSON says
    """What a text in JSON says; every number of it is finite and fits 64 bits.

    Args:
        text: JSON of at most 200 levels.
        budget: Memory that the data is counted against, before it is taken.

    Raises:
        ValueError: It is not such a text, or takes too much memory; the message says where.
    """
    budget.take(_memory(text))
    data = from_json(text, allow_inf_nan=False)
    if _SUSPICIOUS.search(text):
        _refuse_large_numbers(data)
    return data


def _memory(text: bytes) -> int:
    """Bytes that Python takes at most for what a text in JSON says, by its marks."""
    costs = ((b"{", 190), (b"[", 72), (b":", 60), (b",", 36), (b'"', 24))
    # One character outside of the basic plane makes all of a text take four bytes for each.
    wide = 1 if text.isascii() and b"\\u" not in text else 4
    return wide * len(text) + sum(cost * text.count(mark) for mark, cost in costs)


def _refuse_large_numbers(data: object) -> None:
    waiting = [data]
    while waiting:
        value = waiting.pop()
        if isinstance(value, dict):
            waiting += value.values()
        elif isinstance(value, list):
            waiting += value
        elif isinstance(value, float) and not math.isfinite(value):
            raise ValueError("a number is not finite")
        elif isinstance(value, int) and abs(value) > LARGEST_INT:
            raise ValueError(f"a number has {len(str(value))} digits; expected one of 64 bits")
