"""Reading an image file that may be anything: too large, cut off, or no file at all."""

from __future__ import annotations

import io
import stat
import warnings
from pathlib import Path
from typing import Final

import cv2
import numpy as np
import PIL.Image

from bt_dualarm.errors import DualArmError
from bt_dualarm.world.rendering.renderer import Image

IMAGE_SUFFIXES: Final = (".png", ".jpg", ".jpeg", ".bmp", ".ppm", ".webp", ".tif", ".tiff")

_LARGEST_FILE: Final = 256 * 1024 * 1024
_LARGEST_IMAGE_PX: Final = 50_000_000
"""More than any camera of a robot has; an image takes some ten bytes a pixel while it is read."""


class ImageFileError(DualArmError):
    """A file is no image that can be read; the message says why."""


def read_image(path: Path) -> Image:
    """The image in a file: red, green, blue, of shape (height, width, 3).

    Raises:
        ImageFileError: It is no file, no image, cut off, or larger than 50 million pixels.
    """
    content = _content(path)
    _refuse_huge(path, content)
    try:
        image = cv2.imdecode(np.frombuffer(content, np.uint8), cv2.IMREAD_COLOR)
    except cv2.error as error:
        raise ImageFileError(f"{path}: is not an image that can be read") from error
    if image is None:
        raise ImageFileError(f"{path}: is not an image that can be read")
    return np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2RGB), np.uint8)


def _content(path: Path) -> bytes:
    """All bytes of a file; a pipe or a device, which may have no end, is not even opened."""
    try:
        status = path.stat()
        if not (stat.S_ISREG(status.st_mode) or stat.S_ISDIR(status.st_mode)):
            raise ImageFileError(f"{path}: is a pipe or a device, not an image file")
        if status.st_size > _LARGEST_FILE:
            limit = f"at most {_LARGEST_FILE >> 20} MiB are read"
            raise ImageFileError(f"{path}: has {status.st_size >> 20} MiB, {limit}")
        return path.read_bytes()
    except OSError as error:
        raise ImageFileError(f"{path}: cannot be read: {error.strerror or error}") from error


def _refuse_huge(path: Path, content: bytes) -> None:
    """Look at the head alone: a few kilobytes may unpack to gigabytes."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # the limit below is lower than those it warns of
            with PIL.Image.open(io.BytesIO(content)) as image:
                width, height = image.size
    except PIL.Image.DecompressionBombError as error:
        limit = f"images have at most {_LARGEST_IMAGE_PX // 1_000_000} million pixels"
        raise ImageFileError(f"{path}: is too large: {limit}") from error
    except (OSError, ValueError, SyntaxError) as error:
        raise ImageFileError(f"{path}: is not an image that can be read") from error
    if width * height > _LARGEST_IMAGE_PX:
        limit = f"at most {_LARGEST_IMAGE_PX // 1_000_000} million pixels are read"
        raise ImageFileError(f"{path}: is {width} x {height} pixels, {limit}")
