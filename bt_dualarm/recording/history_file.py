"""A file of blocks that grows: each is whole or not there, whatever ends the process."""

from __future__ import annotations

import os
import struct
import zlib
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from mmap import ACCESS_READ, mmap
from pathlib import Path
from typing import Final

from bt_dualarm.errors import DualArmError
from bt_dualarm.recording.block import Block

MAGIC: Final = b"bt_dualarm history 1\n"
"""First bytes of the file, with the version of its format."""

_HEAD: Final = struct.Struct("<4sII")
_MARK: Final = b"BLCK"
_MOST_BYTES: Final = 1 << 28


class HistoryError(DualArmError):
    """A history cannot be read; the message names the file."""


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


def read_history(path: Path) -> HistoryFile:
    """Read a file, up to where it is damaged.

    Raises:
        HistoryError: It is not there, cannot be read, or is no history of a known format.
    """
    try:
        content = path.read_bytes()
    except OSError as error:
        raise HistoryError(f"cannot read {path}: {error.strerror or error}") from error
    if not content.startswith(MAGIC):
        if content[: len(MAGIC)].startswith(MAGIC[:-2]):
            raise HistoryError(f"{path} is of another version: {content[:40]!r}")
        raise HistoryError(f"{path} is no history of a run")
    blocks: list[Block] = []
    try:
        for block in _blocks(content):
            blocks.append(block)  # noqa: PERF402 - those before the damage are kept
    except _TornError as torn:
        return HistoryFile(tuple(blocks), str(torn))
    return HistoryFile(tuple(blocks), "")


def blocks_of(path: Path) -> Iterator[Block]:
    """Blocks of a file one by one, up to where it is damaged; no more than one is in memory.

    Raises:
        HistoryError: It cannot be read, or is no history of a known format.
    """
    try:
        with path.open("rb") as file, mmap(file.fileno(), 0, access=ACCESS_READ) as content:
            if content[: len(MAGIC)] != MAGIC:
                raise HistoryError(f"{path} is no history of a run")
            with suppress(_TornError):
                yield from _blocks(content)
    except (OSError, ValueError) as error:
        raise HistoryError(f"cannot read {path}: {error}") from error


class _TornError(Exception):
    """The file ends, or is damaged, in the middle of a block."""


def _blocks(content: bytes | mmap) -> Iterator[Block]:
    at = len(MAGIC)
    while at < len(content):
        if at + _HEAD.size > len(content):
            raise _TornError(f"its last {len(content) - at} bytes are part of a block")
        mark, length, checksum = _HEAD.unpack_from(content, at)
        if mark != _MARK or length > _MOST_BYTES:
            raise _TornError(f"it is damaged from byte {at} on")
        body = content[at + _HEAD.size : at + _HEAD.size + length]
        if len(body) < length:
            raise _TornError(f"its last {len(content) - at} bytes are part of a block")
        if zlib.crc32(body) != checksum:
            raise _TornError(f"it is damaged from byte {at} on")
        try:
            yield Block.decoded(body)
        except ValueError as error:
            raise _TornError(f"it is damaged from byte {at} on: {error}") from error
        at += _HEAD.size + length
