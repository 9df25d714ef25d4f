"""Images by OpenGL, at the quality that a colour filter needs and a CPU can afford."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import mujoco
import numpy as np

from bt_dualarm.world.gl_context import GlContext
from bt_dualarm.world.rendering import LOOP_GROUPS, Image, Region, blocks_of, clip_region, fill

_SPARE_GEOMS = 100


class GlRenderer:
    """Draws with MuJoCo's classic renderer in a context of its own.

    It changes ``model.vis`` (image buffer, samples), which no physics reads.

    Args:
        context: From ``gl_context.open_context``.
        samples: Samples per pixel; 0 is the fastest, 4 make centroids three times finer.
        effects: Draw shadows and reflections: for pictures, 10 times slower without a GPU.
    """

    name = "gl"

    def __init__(self, context: GlContext, samples: int = 4, effects: bool = False) -> None:
        self._context = context
        self._samples = samples
        self._effects = effects
        self._model: Any = None
        self._size = (0, 0)
        self._scene: Any = None
        self._buffers: Any = None
        self._option = mujoco.MjvOption()
        self._option.sitegroup[:] = 0
        self._camera = mujoco.MjvCamera()
        self._camera.type = mujoco.mjtCamera.mjCAMERA_FIXED

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
        self._context.make_current()
        self._bind(model, width, height)
        self._update(model, data, camera_id, groups)
        rows, columns = blocks_of(top, bottom, stride), blocks_of(left, right, stride)
        covered = tuple(
            edge * stride for edge in (columns.start, rows.start, columns.stop, rows.stop)
        )
        self._narrow(covered, width, height, float(model.cam_fovy[camera_id]))
        size = rows.stop - rows.start, columns.stop - columns.start
        part = np.empty((*size, 3), dtype=np.uint8)
        rectangle = mujoco.MjrRect(0, 0, size[1], size[0])
        mujoco.mjr_render(rectangle, self._scene, self._buffers)
        mujoco.mjr_readPixels(part, None, rectangle, self._buffers)
        fill(image, (left, top, right, bottom), part[::-1], stride)
        return image

    def close(self) -> None:
        """Free the scene's buffers; the context itself lives as long as the process."""
        if self._buffers is not None:
            self._context.make_current()
            self._buffers.free()
        self._buffers = self._scene = self._model = None

    def _bind(self, model: Any, width: int, height: int) -> None:
        """Upload the model's meshes, once for each model and when a larger image is wanted."""
        if model is self._model and width <= self._size[0] and height <= self._size[1]:
            return
        self.close()
        visual = model.vis
        visual.quality.offsamples = self._samples
        visual.global_.offwidth = max(width, visual.global_.offwidth)
        visual.global_.offheight = max(height, visual.global_.offheight)
        self._size = (visual.global_.offwidth, visual.global_.offheight)
        self._scene = mujoco.MjvScene(model, maxgeom=model.ngeom + _SPARE_GEOMS)
        if not self._effects:
            self._scene.flags[mujoco.mjtRndFlag.mjRND_SHADOW] = 0
            self._scene.flags[mujoco.mjtRndFlag.mjRND_REFLECTION] = 0
        self._buffers = mujoco.MjrContext(model, mujoco.mjtFontScale.mjFONTSCALE_100.value)
        mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN.value, self._buffers)
        self._model = model

    def _update(self, model: Any, data: Any, camera_id: int, groups: Sequence[int]) -> None:
        self._option.geomgroup[:] = 0
        self._option.geomgroup[list(groups)] = 1
        self._camera.fixedcamid = camera_id
        visible = mujoco.mjtCatBit.mjCAT_STATIC.value | mujoco.mjtCatBit.mjCAT_DYNAMIC.value
        mujoco.mjv_updateScene(model, data, self._option, None, self._camera, visible, self._scene)

    def _narrow(self, region: Region, width: int, height: int, fovy_deg: float) -> None:
        """Narrow the view to the region: the rest is then neither transformed nor filled."""
        left, top, right, bottom = region
        for camera in self._scene.camera:
            pixel = 2.0 * camera.frustum_near * math.tan(math.radians(fovy_deg) / 2.0) / height
            camera.frustum_top = (height / 2.0 - top) * pixel
            camera.frustum_bottom = (height / 2.0 - bottom) * pixel
            camera.frustum_center = ((left + right) / 2.0 - width / 2.0) * pixel
            camera.frustum_width = 0.5 * (right - left) * pixel
