"""From a scene to a picture: a camera that shakes, a shutter, a lens."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import mujoco
import numpy as np
import scipy

from bt_dualarm.pose import Vector
from bt_dualarm.world.cameras.frame import focal_length_px
from bt_dualarm.world.cameras.lens import Lens
from bt_dualarm.world.cameras.shutter import Draw, Shutter
from bt_dualarm.world.rendering.renderer import Exposure, Image, Renderer


class Optics:
    """All that is between the scene and the pixels of one camera.

    Args:
        renderer: Renderer of its images.
        exposure_s: Seconds for which its shutter is open.
        bend: Radial distortion of its lens, OpenCV's k1 and k2.
    """

    def __init__(
        self, renderer: Renderer, exposure_s: float = 0.0, bend: tuple[float, float] = (0.0, 0.0)
    ) -> None:
        self._renderer = renderer
        self._shutter = Shutter(exposure_s) if exposure_s else None
        self._bend = bend
        self._lens: Lens | None = None

    def picture(
        self,
        model: mujoco.MjModel,
        data: mujoco.MjData,
        exposure: Exposure,
        shake: Vector,
        suffer: Callable[[Image], Image] | None = None,
    ) -> Image:
        """What an exposure shows: colours of its blocks, of shape (rows, columns, 3).

        Args:
            model: Compiled world.
            data: State of it, its kinematics up to date.
            exposure: Part of the image that is asked for, alone, its corner on the grid of blocks.
            shake: Turn of the camera about its x and y axes meanwhile, of shape (2,), in rad.
            suffer: What the colours of its blocks, of shape (rows, columns, 3), suffer besides.
        """
        shakes = shake.any()

        def draw(state: mujoco.MjData, part: Exposure) -> Image:
            if not shakes:
                return self._renderer.render(model, state, part)
            with _turned(state, part.camera_id, shake):
                return self._renderer.render(model, state, part)

        if exposure.is_empty:
            return np.zeros((0, 0, 3), np.uint8)
        if not any(self._bend):
            blocks = self._exposed(model, data, exposure, draw)
            return blocks if suffer is None else suffer(blocks)
        if self._lens is None:
            fov_rad = math.radians(float(model.cam_fovy[exposure.camera_id]))
            focal_px = focal_length_px(exposure.height, fov_rad)
            self._lens = Lens(*self._bend, exposure.width, exposure.height, focal_px)
        wide = self._lens.widened(exposure)
        seen = self._lens.seen(self._exposed(model, data, wide, draw), exposure)
        return seen if suffer is None else suffer(seen)

    def _exposed(
        self, model: mujoco.MjModel, data: mujoco.MjData, exposure: Exposure, draw: Draw
    ) -> Image:
        if self._shutter is None:
            return draw(data, exposure)
        return self._shutter.picture(model, data, exposure, draw)


@contextmanager
def _turned(data: mujoco.MjData, camera_id: int, angles: Vector) -> Iterator[None]:
    """The camera turned about its x and y axes by ``angles`` of shape (2,), in rad, meanwhile."""
    straight = data.cam_xmat[camera_id].copy()
    turn = scipy.spatial.transform.Rotation.from_rotvec([*angles, 0.0]).as_matrix()
    data.cam_xmat[camera_id] = (straight.reshape(3, 3) @ turn).ravel()
    try:
        yield
    finally:
        data.cam_xmat[camera_id] = straight
