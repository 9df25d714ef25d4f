"""Untrusted records: their files are read within limits, or refused in one sentence."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from bt_dualarm.runtime.history_file import HistoryError, ReadBudget, parsed, read_regular


@pytest.mark.parametrize(
    ("make", "expected"),
    [
        (os.mkfifo, "a pipe"),
        (Path.mkdir, "a folder"),
        (lambda path: path.symlink_to("/dev/zero"), "a symbolic link"),
        (lambda path: path.symlink_to(path), "a symbolic link"),
        (lambda path: path.write_bytes(b"x" * 11), "expected at most 0 MB"),
        (lambda _: None, "No such file"),
    ],
)
def test_only_regular_files_of_a_size_are_read(
    make: Callable[[Path], object], expected: str, tmp_path: Path
) -> None:
    path = tmp_path / "file"
    make(path)
    with pytest.raises(HistoryError, match=expected):
        read_regular(path, most=10)


def test_a_device_is_not_read() -> None:
    with pytest.raises(HistoryError, match="is a device"):
        read_regular(Path("/dev/zero"))


@pytest.mark.parametrize(
    "text",
    [
        b"NaN", b"[Infinity]", b"1e999", b"1" * 30, b"[" * 300 + b"]" * 300, b'"\\ud800"', b"\xff",
        b"", b"{", b'"\x1b"', b'{"a": 1} x',
    ],
)  # fmt: skip
def test_invalid_and_non_finite_json_is_refused(text: bytes) -> None:
    with pytest.raises(ValueError, match=r".+"):
        parsed(text, ReadBudget())


@pytest.mark.parametrize("text", [b'"1234567890123456789012"', b"1e-300", b"[1.7976e+308]"])
def test_json_that_only_looks_large_is_read(text: bytes) -> None:
    assert parsed(text, ReadBudget()) is not None


@pytest.mark.parametrize(
    "text",
    [
        b"[" + b",".join([b"{}"] * 30_000) + b"]",
        b"[" + b",".join([b'{"a":1}'] * 30_000) + b"]",
        b"[" + b",".join([b"[]"] * 30_000) + b"]",
        b"[" + b",".join(b"%d.5" % number for number in range(30_000)) + b"]",
        b"[" + b",".join(b'"%x"' % number for number in range(30_000)) + b"]",
        ('"' + "a" * 300_000 + "\U0001f600" + '"').encode(),
    ],
)
def test_json_that_needs_too_much_memory_is_refused(text: bytes) -> None:
    """The estimated memory is no less than what Python actually uses."""
    import tracemalloc

    tracemalloc.start()
    data: Any = parsed(text, ReadBudget())
    taken = tracemalloc.get_traced_memory()[0]
    tracemalloc.stop()
    assert data
    with pytest.raises(ValueError, match="of memory"):
        parsed(text, ReadBudget(int(0.99 * taken) - 1000))
