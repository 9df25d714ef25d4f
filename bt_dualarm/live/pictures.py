"""Pictures of the arms' cameras for a page: as they were taken, or drawn again from a record."""

from __future__ import annotations

from threading import Lock
from typing import Final

import cv2
import numpy as np

from bt_dualarm.live.past import Past
from bt_dualarm.world.cameras.frame import Frame
from bt_dualarm.world.rendering.raycast import RayRenderer
from bt_dualarm.world.rendering.renderer import Exposure, Image

_QUALITY: Final = 85


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
    """What cameras saw, drawn again by rays from the states of a record, without their faults.

    Args:
        past: The record.
    """

    def __init__(self, past: Past) -> None:
        self._past = past
        self._renderer = RayRenderer()
        self._lock = Lock()

    def jpeg(self, arm: str, time: float) -> bytes | None:
        """What the camera of an arm saw at a time in s; None of an arm without one.

        Raises:
            ReplayError: There is no state at that time.
        """
        with self._lock, self._past.at(time) as (model, data, places):
            if arm not in places or places[arm].camera < 0:
                return None
            camera = places[arm].camera
            width, height = model.cam_resolution[camera].tolist()
            return as_jpeg(self._renderer.render(model, data, Exposure(camera, width, height)))


def as_jpeg(image: Image) -> bytes:
    """An image of shape (height, width, 3), red, green, blue, as JPEG."""
    in_order = np.ascontiguousarray(image[:, :, ::-1])
    return bytes(cv2.imencode(".jpg", in_order, (cv2.IMWRITE_JPEG_QUALITY, _QUALITY))[1])
