"""Atomic writes: a file is complete or absent, whoever writes it at the same time."""

from __future__ import annotations

import os
import threading
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import BinaryIO

import pytest

from bt_dualarm.core.share import write_atomically, write_text

WRITERS = 8
ROUNDS = 25
LONG = 40_000
"""Characters of a content: more than one write of a buffer."""


def test_many_writers_of_one_file_at_once(tmp_path: Path) -> None:
    """No writer fails, a reader sees one complete content, and no other file is left behind."""
    path = tmp_path / "tree.yaml"
    contents = [letter * LONG for letter in "abcdefgh"]
    write_text(path, contents[0])
    torn: list[str] = []
    done = threading.Event()

    def read() -> None:
        while not done.is_set():
            text = path.read_text(encoding="utf-8")
            if text not in contents:
                torn.append(text[:20])

    def write(number: int) -> None:
        for _ in range(ROUNDS):
            write_text(path, contents[number])

    with ThreadPoolExecutor(WRITERS + 1) as pool:
        reader = pool.submit(read)
        writers = [pool.submit(write, number) for number in range(WRITERS)]
        try:
            for writer in writers:
                writer.result()
        finally:
            done.set()
        reader.result()
    assert torn == []
    assert [found.name for found in tmp_path.iterdir()] == [path.name]


def test_a_writer_that_fails_leaves_the_old_file(tmp_path: Path) -> None:
    path = tmp_path / "tree.yaml"
    write_text(path, "before")

    def fail(file: BinaryIO) -> None:
        file.write(b"half")
        raise RuntimeError("in the middle")

    with pytest.raises(RuntimeError):
        write_atomically(path, fail)
    assert path.read_text(encoding="utf-8") == "before"
    assert [found.name for found in tmp_path.iterdir()] == [path.name]


def test_a_device_or_pipe_is_not_replaced(tmp_path: Path) -> None:
    """An export to `/dev/stdout` put a file in the place of the device."""
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    link = tmp_path / "link"
    link.symlink_to(pipe)
    for path in (pipe, link):
        with pytest.raises(OSError, match="not a regular file"):
            write_text(path, "text")
    assert pipe.is_fifo()
    assert link.is_symlink()
