"""Reading any image file gives an image or an error, in bounded time and memory."""

from __future__ import annotations

import contextlib
import os
import struct
import zlib
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from bt_dualarm.tuning import IMAGE_SUFFIXES, ImageFileError, read_image
from tests.tuning.test_look import two_squares

FILES = {suffix: cv2.imencode(suffix, two_squares())[1].tobytes() for suffix in IMAGE_SUFFIXES}
LOSSLESS = [suffix for suffix in IMAGE_SUFFIXES if suffix not in (".jpg", ".jpeg", ".webp")]


def png(width: int, height: int) -> bytes:
    """A PNG file of a hundred bytes with a given size in its header."""

    def chunk(kind: bytes, content: bytes) -> bytes:
        check = struct.pack(">I", zlib.crc32(kind + content))
        return struct.pack(">I", len(content)) + kind + content + check

    head = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    parts = chunk(b"IHDR", head), chunk(b"IDAT", zlib.compress(bytes(9))), chunk(b"IEND", b"")
    return b"\x89PNG\r\n\x1a\n" + b"".join(parts)


@pytest.mark.parametrize("suffix", LOSSLESS)
def test_lossless_image_is_read_exactly(suffix: str, tmp_path: Path) -> None:
    path = tmp_path / f"photo{suffix}"
    path.write_bytes(FILES[suffix])
    assert (read_image(path)[..., ::-1] == two_squares()).all()


@given(
    suffix=st.sampled_from(IMAGE_SUFFIXES),
    changes=st.lists(st.tuples(st.floats(0, 1, exclude_max=True), st.integers(0, 255)), max_size=9),
    end=st.floats(0, 1),
)
@settings(max_examples=250, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_damaged_image_is_read_or_refused(
    tmp_path: Path, suffix: str, changes: list[tuple[float, int]], end: float
) -> None:
    """Bytes are replaced, half of them in the first hundred, and the end is cut off."""
    content = bytearray(FILES[suffix])
    for number, (place, byte) in enumerate(changes):
        content[int(place * (len(content) if number % 2 else min(100, len(content))))] = byte
    path = tmp_path / f"photo{suffix}"
    path.write_bytes(content[: 1 + int(end * len(content))])
    with contextlib.suppress(ImageFileError):
        image = read_image(path)
        assert image.dtype == np.uint8
        assert image.shape[2:] == (3,)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (None, "cannot be read: No such file"),
        (b"", "is not an image"),
        (b"GIF89a?", "is not an image"),
        (png(60_000, 60_000), "is too large: images may have at most 50 million pixels"),
        (png(8000, 8000), "is 8000 x 8000 pixels, at most 50 million pixels are read"),
    ],
    ids=["none", "empty", "another", "huge", "large"],
)
def test_invalid_image_file_is_an_error(
    content: bytes | None, message: str, tmp_path: Path
) -> None:
    path = tmp_path / "photo.png"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(ImageFileError, match=message):
        read_image(path)


def test_endless_file_is_not_opened(tmp_path: Path) -> None:
    """A pipe without a writer would block its reader forever."""
    pipe, device, folder, sparse = (tmp_path / f"{name}.png" for name in ("a", "b", "c", "d"))
    os.mkfifo(pipe)
    device.symlink_to("/dev/zero")
    folder.mkdir()
    with sparse.open("wb") as file:
        file.truncate(300 * 1024 * 1024)
    for path, message in (
        (pipe, "is a pipe or a device"),
        (device, "is a pipe or a device"),
        (folder, "cannot be read: Is a directory"),
        (sparse, "has 300 MiB, at most 256 MiB are read"),
    ):
        with pytest.raises(ImageFileError, match=message):
            read_image(path)
