"""A file of blocks that grows: each is whole or not there, whatever ends the process."""

from __future__ import annotations

import os
import struct
import zlib
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO, Final

from bt_dualarm.recording.block import Block
from bt_dualarm.recording.untrusted import MOST_FILE, Budget, HistoryError, open_regular

__all__ = ["MAGIC", "HistoryError", "HistoryFile", "HistoryWriter", "blocks_of", "read_history"]

MAGIC: Final = b"bt_dualarm history 1\n"
"""First bytes of the file, with the version of its format."""

_HEAD: Final = struct.Struct("<4sII")
_MARK: Final = b"BLCK"
_MOST_BYTES: Final = 1 << 26
"""Bytes of one block on the disk."""


class HistoryWriter:
    """Appends blocks; each is one call of the system.

    Args:
        path: File, which is made with the first block.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._file: int | None = None

    def add(self, block: Block) -> None:
        """Append a block.

        Raises:
            OSError: The disk is full, the file is there already, or it cannot be made.
        """
        content = block.encoded()
        head = _HEAD.pack(_MARK, len(content), zlib.crc32(content))
        if self._file is None:
            flags = os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_APPEND
            self._file = os.open(self.path, flags, 0o644)
            head = MAGIC + head
        left = head + content
        while left:
            left = left[os.write(self._file, left) :]

    def finish(self) -> None:
        """Make sure that all is on the disk.

        Raises:
            OSError: It is not, or the file is gone.
        """
        if self._file is not None:
            self.path.stat()
            os.fsync(self._file)

    def close(self) -> None:
        """Let go of the file, which stays as it is."""
        if self._file is not None:
            os.close(self._file)
            self._file = None


@dataclass(frozen=True, eq=False)
class HistoryFile:
    """What could be read of a file.

    Attributes:
        blocks: Blocks in their order, up to the last that is whole.
        torn: Sentence on why the rest was left out; empty if the file ends with a whole block.
    """

    blocks: tuple[Block, ...]
    torn: str


def read_history(path: Path, budget: Budget | None = None, most: int = MOST_FILE) -> HistoryFile:
    """Read a file, up to where it is damaged.

    Args:
        path: The file.
        budget: Memory that the blocks are counted against; by default that of one record.
        most: Bytes that the file may have.

    Raises:
        HistoryError: It is not there, no regular file, too large, cannot be read, or is no history
            of a known format.
    """
    blocks: list[Block] = []
    file, size = open_regular(path, most)
    with file:
        try:
            for block in _blocks(path, file, size, budget or Budget()):
                blocks.append(block)  # noqa: PERF402 - those before the damage are kept
        except _TornError as torn:
            return HistoryFile(tuple(blocks), str(torn))
    return HistoryFile(tuple(blocks), "")


def blocks_of(path: Path, most: int = MOST_FILE) -> Iterator[Block]:
    """Blocks of a file one by one, up to where it is damaged; no more than one is in memory.

    Args:
        path: The file.
        most: Bytes that the file may have.

    Raises:
        HistoryError: As of `read_history`.
    """
    file, size = open_regular(path, most)
    with file, suppress(_TornError):
        yield from _blocks(path, file, size, None)


class _TornError(Exception):
    """The file ends, or is damaged, in the middle of a block."""


def _blocks(path: Path, file: BinaryIO, size: int, budget: Budget | None) -> Iterator[Block]:
    """Blocks of a file of that size; without a budget each may take as much as a whole record."""
    start = _read(path, file, len(MAGIC))
    if start != MAGIC:
        if start.startswith(MAGIC[:-2]):
            raise HistoryError(f"{path} is of another version: {start!r}")
        raise HistoryError(f"{path} is no history of a run")
    at = len(MAGIC)
    while at < size:
        if at + _HEAD.size > size:
            raise _TornError(f"its last {size - at} bytes are part of a block")
        head = _read(path, file, _HEAD.size)
        mark, length, checksum = _HEAD.unpack(head) if len(head) == _HEAD.size else (b"", 0, 0)
        if mark != _MARK or length > _MOST_BYTES:
            raise _TornError(f"it is damaged from byte {at} on")
        if at + _HEAD.size + length > size:
            raise _TornError(f"its last {size - at} bytes are part of a block")
        body = _read(path, file, length)
        if len(body) < length or zlib.crc32(body) != checksum:
            raise _TornError(f"it is damaged from byte {at} on")
        try:
            yield Block.decoded(body, budget or Budget())
        except ValueError as error:
            raise HistoryError(f"{path}: the block at byte {at}: {error}") from error
        at += _HEAD.size + length


def _read(path: Path, file: BinaryIO, count: int) -> bytes:
    try:
        return file.read(count)
    except OSError as error:
        raise HistoryError(f"cannot read {path}: {error.strerror or error}") from error
