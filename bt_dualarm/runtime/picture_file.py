"""Pictures of cameras in a file that grows: as they were exposed, compressed, up to a size."""

from __future__ import annotations

import logging
from pathlib import Path
from typing import Final

import cv2
import numpy as np

from bt_dualarm.recording.block import Block
from bt_dualarm.recording.history_file import HistoryWriter
from bt_dualarm.world.cameras.frame import Frame

MOST_BYTES: Final = 500 * 2**20
"""Bytes that the pictures of a run may take; later ones are left out, which the file says."""

QUALITY: Final = 92
"""Quality of JPEG: noise of a sensor is most of what a picture without loss would take."""

_log = logging.getLogger(__name__)


class PictureFile:
    """Keeps the exposed part of every picture, a block each.

    Args:
        path: File to write, which is made with the first picture.
        most_bytes: Bytes that it may take.
    """

    def __init__(self, path: Path, most_bytes: int = MOST_BYTES) -> None:
        self._writer = HistoryWriter(path)
        self._left: int | None = most_bytes

    def add(self, arm: str, time: float, frame: Frame) -> None:
        """Keep a picture; one that cannot be written ends the file, and not the run.

        Args:
            arm: Name of the camera's arm.
            time: Simulated time of the exposure in s; the stamp is that of the camera's clock.
            frame: The picture.
        """
        left, top, right, bottom = frame.region
        if self._left is None or right <= left or bottom <= top:
            return
        part = frame.image[top : bottom : frame.stride, left : right : frame.stride, ::-1]
        options = (cv2.IMWRITE_JPEG_QUALITY, QUALITY)
        content = cv2.imencode(".jpg", np.ascontiguousarray(part), options)[1]
        said = {
            "arm": arm,
            "time_s": time,
            "stamp": float(frame.stamp),
            "region": list(frame.region),
            "stride": frame.stride,
            "size": [frame.width, frame.height],
        }
        self._left -= len(content)
        if self._left < 0:
            self._end(time, "they would take more than the pictures of a run may")
        else:
            self._write(time, Block("picture", said, {"jpeg": content.ravel()}))

    def _end(self, time: float, why: str) -> None:
        if self._left is not None:
            self._left = None
            _log.warning("pictures are kept up to %.2f s: %s", time, why)
            self._write(time, Block("end", {"time_s": time, "why": why}))

    def _write(self, time: float, block: Block) -> None:
        try:
            self._writer.add(block)
        except OSError as error:
            self._end(time, error.strerror or str(error))

    def close(self) -> None:
        """Let go of the file."""
        self._writer.close()
