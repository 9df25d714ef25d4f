"""Files that are there whole or not at all: written beside their place, then moved into it."""

from __future__ import annotations

import os
import re
from collections.abc import Callable
from pathlib import Path
from secrets import token_hex
from typing import BinaryIO


def write_atomically(path: Path, write: Callable[[BinaryIO], object]) -> None:
    """Create or replace a file; a reader sees the old content or all of the new.

    Args:
        path: File in a folder that exists.
        write: Writer of the content into the open file.

    Raises:
        OSError: The disk is full or the folder is not writable; nothing is left behind.
    """
    # Threads share the number of their process, and containers that of their first process.
    beside = path.with_name(f".{path.name}.{os.getpid()}.{token_hex(4)}")
    try:
        with beside.open("xb") as file:
            write(file)
            file.flush()
            os.fsync(file.fileno())
        beside.replace(path)
    finally:
        beside.unlink(missing_ok=True)


def leftovers(path: Path) -> list[Path]:
    """Files beside that place which a process left there when it was killed while it wrote."""
    ending = re.compile(re.escape(f".{path.name}.") + r"\d+\.[0-9a-f]{8}")
    return [beside for beside in path.parent.iterdir() if ending.fullmatch(beside.name)]


def write_text(path: Path, text: str) -> None:
    """As `write_atomically`, of text in UTF-8."""
    write_atomically(path, lambda file: file.write(text.encode()))
