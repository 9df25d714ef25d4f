"""Pictures of the arms' cameras for a page: as they were taken, or drawn again from a record."""

from __future__ import annotations

from bisect import bisect_right
from threading import Lock
from typing import Final

import cv2
import numpy as np

from bt_dualarm.live.past import Past
from bt_dualarm.replay.kept_pictures import KeptPicture, kept_pictures
from bt_dualarm.runtime.record_folder import FRAMES
from bt_dualarm.world.cameras.frame import Frame
from bt_dualarm.world.rendering.raycast import RayRenderer
from bt_dualarm.world.rendering.renderer import Exposure, Image

_QUALITY: Final = 85
_MOST_BYTES: Final = 64 * 2**20
"""Bytes of kept pictures that are read; of more, pictures are drawn again."""

_SLACK_S: Final = 1e-3


class Pictures:
    """The last picture of each camera of a run."""

    def __init__(self) -> None:
        self._latest: dict[str, Frame] = {}

    def take(self, arm: str, frame: Frame) -> None:
        """Keep a picture; nobody changes its pixels any more."""
        self._latest[arm] = frame

    def jpeg(self, arm: str) -> bytes | None:
        """The last picture of an arm's camera, None before the first."""
        frame = self._latest.get(arm)
        return None if frame is None else as_jpeg(frame.image)


class PastPictures:
    """What cameras saw: as it was kept, else drawn again by rays, without the cameras' faults.

    Args:
        past: The record.
    """

    def __init__(self, past: Past) -> None:
        self._past = past
        self._renderer = RayRenderer()
        self._lock = Lock()
        self._kept: dict[str, list[KeptPicture]] = {}
        self._size = 0

    def jpeg(self, arm: str, time: float) -> bytes | None:
        """What the camera of an arm saw last at a time in s; None of an arm without one.

        Raises:
            ReplayError: There is no state at that time.
        """
        with self._lock:
            self._read()
            kept = self._kept.get(arm, [])
            number = bisect_right(kept, time + _SLACK_S, key=lambda picture: picture.stamp)
            return kept[number - 1].whole if number else self._drawn(arm, time)

    def _read(self) -> None:
        """Read what was kept, if that is more than it was; too much of it is left where it is."""
        path = self._past.record.folder / FRAMES
        size = path.stat().st_size if path.exists() else 0
        if size == self._size or size > _MOST_BYTES:
            return
        self._size, self._kept = size, {}
        for picture in kept_pictures(self._past.record):
            self._kept.setdefault(picture.arm, []).append(picture)

    def _drawn(self, arm: str, time: float) -> bytes | None:
        with self._past.at(time) as (model, data, places):
            if arm not in places or places[arm].camera < 0:
                return None
            camera = places[arm].camera
            width, height = model.cam_resolution[camera].tolist()
            return as_jpeg(self._renderer.render(model, data, Exposure(camera, width, height)))


def as_jpeg(image: Image) -> bytes:
    """An image of shape (height, width, 3), red, green, blue, as JPEG."""
    in_order = np.ascontiguousarray(image[:, :, ::-1])
    return bytes(cv2.imencode(".jpg", in_order, (cv2.IMWRITE_JPEG_QUALITY, _QUALITY))[1])
