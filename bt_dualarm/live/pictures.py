"""Pictures of the arms' cameras for a page: as they were taken; what was not exposed is drawn."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Callable
from threading import Lock
from typing import Final

import cv2
import mujoco
import numpy as np

from bt_dualarm.live.past import Past
from bt_dualarm.replay.kept_pictures import KeptPicture, kept_pictures
from bt_dualarm.runtime.record_folder import FRAMES
from bt_dualarm.world.cameras.camera import SeenWorld
from bt_dualarm.world.cameras.frame import Frame
from bt_dualarm.world.cameras.undrawn import Scenery
from bt_dualarm.world.composition import CAMERA
from bt_dualarm.world.rendering.raycast import RayRenderer
from bt_dualarm.world.rendering.renderer import Exposure, Image

_QUALITY: Final = 85
_MOST_BYTES: Final = 64 * 2**20
"""Bytes of kept pictures that are read; of more, pictures are drawn again."""

_SLACK_S: Final = 1e-3


class Pictures:
    """The last picture of each camera of a run, the whole of it.

    A tracker exposes a part of the image only. The rest is drawn for whoever looks, when it is
    asked for, from a copy of the world at the exposure: nothing of the run depends on it.

    Args:
        world: The world that the cameras are in.
        is_watched: Function that says whether somebody looks: else no copies are made.
    """

    def __init__(self, world: SeenWorld, is_watched: Callable[[], bool]) -> None:
        self._world, self._is_watched = world, is_watched
        self._latest: dict[str, tuple[Frame, Scenery | None]] = {}
        self._renderer = RayRenderer()
        self._lock = Lock()

    def take(self, arm: str, frame: Frame) -> None:
        """Keep a picture that was exposed now; nobody changes its pixels any more."""
        is_part = frame.region != (0, 0, frame.width, frame.height)
        world = self._world if is_part and self._is_watched() else None
        scenery = None if world is None else Scenery.of(world.model, world.data)
        self._latest[arm] = frame, scenery

    def jpeg(self, arm: str) -> bytes | None:
        """The last picture of an arm's camera, None before the first."""
        if arm not in self._latest:
            return None
        frame, scenery = self._latest[arm]
        if scenery is None:
            return as_jpeg(frame.image)
        with self._lock:
            whole = drawn(self._renderer, scenery.model, scenery.data(), f"{arm}/{CAMERA}")
        left, top, right, bottom = frame.region
        whole[top:bottom, left:right] = frame.image[top:bottom, left:right]
        return as_jpeg(whole)


def drawn(renderer: RayRenderer, model: mujoco.MjModel, data: mujoco.MjData, name: str) -> Image:
    """What a camera has before it, of shape (height, width, 3), without the camera's faults."""
    camera = model.camera(name).id
    width, height = model.cam_resolution[camera].tolist()
    return renderer.render(model, data, Exposure(camera, width, height))


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
            if not number:
                whole = self._drawn(arm, time)
                return None if whole is None else as_jpeg(whole)
            picture = kept[number - 1]
            if picture.region == (0, 0, *picture.size):
                return picture.whole
            whole = self._drawn(arm, picture.time)
            left, top, right, bottom = picture.region
            if whole is None or whole.shape[1::-1] != picture.size:
                return picture.whole
            whole[top:bottom, left:right] = picture.image[top:bottom, left:right]
            return as_jpeg(whole)

    def _read(self) -> None:
        """Read what was kept, if that is more than it was; too much of it is left where it is."""
        path = self._past.record.folder / FRAMES
        size = path.stat().st_size if path.exists() else 0
        if size == self._size or size > _MOST_BYTES:
            return
        self._size, self._kept = size, {}
        for picture in kept_pictures(self._past.record):
            self._kept.setdefault(picture.arm, []).append(picture)

    def _drawn(self, arm: str, time: float) -> Image | None:
        with self._past.at(time) as (model, data, places):
            if arm not in places or places[arm].camera < 0:
                return None
            return drawn(self._renderer, model, data, f"{arm}/{CAMERA}")


def as_jpeg(image: Image) -> bytes:
    """An image of shape (height, width, 3), red, green, blue, as JPEG."""
    in_order = np.ascontiguousarray(image[:, :, ::-1])
    return bytes(cv2.imencode(".jpg", in_order, (cv2.IMWRITE_JPEG_QUALITY, _QUALITY))[1])
