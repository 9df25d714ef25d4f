"""Images by ray casting: slower than OpenGL on whole images, faster on small parts, no library."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import lru_cache
from typing import Any

import numpy as np
import numpy.typing as npt

from bt_dualarm.world.ray_fan import Fan
from bt_dualarm.world.ray_scene import RayScene
from bt_dualarm.world.ray_shading import Shading
from bt_dualarm.world.rendering import LOOP_GROUPS, Image, Region, blocks_of, clip_region, fill
from bt_dualarm.world.viewpoint import Viewpoint

_JITTER_SEED = 7


class RayRenderer:
    """One ray a pixel, or a block of pixels, through a random but fixed point of it.

    The jitter makes centroids finer: rays on a grid all cross a straight edge at the same
    moment, jittered ones one after the other (0.15 against 0.05 px standard deviation).
    """

    name = "ray"

    def __init__(self) -> None:
        self._model: Any = None
        self._shading: Any = None
        self._scenes: dict[tuple[int, ...], RayScene] = {}

    def render(
        self,
        model: Any,
        data: Any,
        camera_id: int,
        width: int,
        height: int,
        region: Region | None = None,
        *,
        groups: Sequence[int] = LOOP_GROUPS,
        stride: int = 1,
    ) -> Image:
        """See ``rendering.Renderer``."""
        image: Image = np.zeros((height, width, 3), dtype=np.uint8)
        left, top, right, bottom = clip_region(region, width, height)
        if right <= left or bottom <= top:
            return image
        scene = self._scene(model, tuple(groups))
        rows, columns = blocks_of(top, bottom, stride), blocks_of(left, right, stride)
        fan = _fan(model, data, camera_id, (width, height), rows, columns, stride)
        blocks = self._shading.colors(data, fan, scene.trace(data, fan))
        fill(image, (left, top, right, bottom), blocks, stride)
        return image

    def close(self) -> None:
        """Let go of the last model."""
        self._model = self._shading = None
        self._scenes.clear()

    def _scene(self, model: Any, groups: tuple[int, ...]) -> RayScene:
        if model is not self._model:
            self.close()
            self._model, self._shading = model, Shading(model)
        if groups not in self._scenes:
            self._scenes[groups] = RayScene(model, groups)
        return self._scenes[groups]


def fan_of(viewpoint: Viewpoint, width: int, height: int) -> Fan:
    """The rays of a whole picture, one a pixel."""
    return Fan(
        eye=viewpoint.eye,
        axes=viewpoint.axes,
        rays=camera_rays(width, height, viewpoint.fov_deg, 1),
        spacing=2.0 * math.tan(math.radians(viewpoint.fov_deg) / 2.0) / height,
        centre=(width / 2.0, height / 2.0),
    )


def _fan(
    model: Any,
    data: Any,
    camera_id: int,
    size: tuple[int, int],
    rows: slice,
    columns: slice,
    stride: int,
) -> Fan:
    """The rays of some blocks of a camera's image."""
    fovy_deg = float(model.cam_fovy[camera_id])
    width, height = size
    return Fan(
        eye=data.cam_xpos[camera_id].copy(),
        axes=data.cam_xmat[camera_id].reshape(3, 3).copy(),
        rays=np.ascontiguousarray(camera_rays(width, height, fovy_deg, stride)[:, rows, columns]),
        spacing=stride * 2.0 * math.tan(math.radians(fovy_deg) / 2.0) / height,
        centre=(width / 2.0 / stride - columns.start, height / 2.0 / stride - rows.start),
    )


@lru_cache(maxsize=16)
def camera_rays(width: int, height: int, fovy_deg: float, stride: int) -> npt.NDArray[np.float64]:
    """Unit vectors in MuJoCo's camera frame (x right, y up, looking along -z).

    Returns:
        Array of shape (3, ceil(height / stride), ceil(width / stride)), read-only.
    """
    focal_px = height / 2.0 / math.tan(math.radians(fovy_deg) / 2.0)
    rows, columns = -(-height // stride), -(-width // stride)
    within = np.random.default_rng(_JITTER_SEED).random((2, rows, columns))
    y, x = (np.indices((rows, columns)) + within) * stride
    rays = np.stack([x - width / 2.0, height / 2.0 - y, np.full_like(x, -focal_px)])
    rays /= np.linalg.norm(rays, axis=0)
    rays.flags.writeable = False
    return rays
