"""Files that are there whole or not at all: written beside their place, then moved into it."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from typing import BinaryIO


def write_whole(path: Path, write: Callable[[BinaryIO], object]) -> None:
    """Create or replace a file; a reader sees the old content or all of the new.

    Args:
        path: In a folder that exists.
        write: Puts the content into the open file.

    Raises:
        OSError: The disk is full or the folder is not writable; nothing is left behind.
    """
    beside = path.with_name(f".{path.name}.{os.getpid()}")
    try:
        with beside.open("wb") as file:
            write(file)
            file.flush()
            os.fsync(file.fileno())
        beside.replace(path)
    finally:
        beside.unlink(missing_ok=True)


def write_text(path: Path, text: str) -> None:
    """As `write_whole`, of text in UTF-8."""
    write_whole(path, lambda file: file.write(text.encode()))
