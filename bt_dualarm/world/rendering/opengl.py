"""Images by OpenGL, at the quality that a colour filter needs and a CPU can afford."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import partial

import mujoco
import numpy as np

from bt_dualarm.world.rendering.gl_context import GlContext
from bt_dualarm.world.rendering.renderer import Blocks, Exposure, Image

_SPARE_GEOMS = 100


class GlRenderer:
    """Draws with MuJoCo's classic renderer in a context of its own.

    It changes ``model.vis`` (image buffer, samples), which no physics reads.

    Args:
        context: Result of ``gl_context.open_context``.
        samples: Samples per pixel; 0 is the fastest, 4 make centroids three times finer.
        effects: Draw shadows and reflections: for pictures, 10 times slower without a GPU.
    """

    name = "gl"

    def __init__(self, context: GlContext, samples: int = 4, effects: bool = False) -> None:
        self._context = context
        self._samples = samples
        self._effects = effects
        self._upload: _Upload | None = None
        self._option = mujoco.MjvOption()
        self._option.sitegroup[:] = 0
        self._camera = mujoco.MjvCamera()
        self._camera.type = mujoco.mjtCamera.mjCAMERA_FIXED

    def render(self, model: mujoco.MjModel, data: mujoco.MjData, exposure: Exposure) -> Image:
        """See `Renderer`."""
        return exposure.paint(partial(self._samples_of, model, data, exposure))

    def _samples_of(
        self, model: mujoco.MjModel, data: mujoco.MjData, exposure: Exposure, blocks: Blocks
    ) -> Image:
        """Colours of some blocks of the image, of shape (rows, columns, 3)."""
        self._context.make_current()
        upload = self._uploaded(model, exposure.width, exposure.height)
        self._update(upload.scene, model, data, exposure)
        _narrow(upload.scene, exposure, blocks, float(model.cam_fovy[exposure.camera_id]))
        rows, columns = (part.stop - part.start for part in blocks)
        part = np.empty((rows, columns, 3), dtype=np.uint8)
        rectangle = mujoco.MjrRect(0, 0, columns, rows)
        mujoco.mjr_render(rectangle, upload.scene, upload.buffers)
        mujoco.mjr_readPixels(part, None, rectangle, upload.buffers)
        return np.ascontiguousarray(part[::-1])

    def close(self) -> None:
        """Free the scene's buffers; the context itself lives as long as the process."""
        if self._upload is not None:
            self._context.make_current()
            self._upload.buffers.free()
        self._upload = None

    def _uploaded(self, model: mujoco.MjModel, width: int, height: int) -> _Upload:
        """The model's meshes, once for each model and anew when a larger image is wanted."""
        if self._upload is None or not self._upload.serves(model, width, height):
            self.close()
            visual = model.vis
            visual.quality.offsamples = self._samples
            visual.global_.offwidth = max(width, visual.global_.offwidth)
            visual.global_.offheight = max(height, visual.global_.offheight)
            self._upload = _upload(model, effects=self._effects)
        return self._upload

    def _update(
        self,
        scene: mujoco.MjvScene,
        model: mujoco.MjModel,
        data: mujoco.MjData,
        exposure: Exposure,
    ) -> None:
        """Where everything is now, seen by the camera of the exposure."""
        self._option.geomgroup[:] = 0
        self._option.geomgroup[list(exposure.groups)] = 1
        self._camera.fixedcamid = exposure.camera_id
        visible = mujoco.mjtCatBit.mjCAT_STATIC.value | mujoco.mjtCatBit.mjCAT_DYNAMIC.value
        mujoco.mjv_updateScene(model, data, self._option, None, self._camera, visible, scene)


@dataclass(frozen=True, eq=False)
class _Upload:
    """What OpenGL was given of a model.

    Attributes:
        model: Compiled; its buffer's size is that of ``buffers``.
        scene: Geoms, lights and cameras, for MuJoCo's renderer.
        buffers: Meshes and textures, and the image that is drawn into.
    """

    model: mujoco.MjModel
    scene: mujoco.MjvScene
    buffers: mujoco.MjrContext

    def serves(self, model: mujoco.MjModel, width: int, height: int) -> bool:
        """Whether an image of so many pixels of a model can be drawn."""
        wide, high = self.buffers.offWidth, self.buffers.offHeight
        return model is self.model and width <= wide and height <= high


def _upload(model: mujoco.MjModel, *, effects: bool) -> _Upload:
    scene = mujoco.MjvScene(model, maxgeom=model.ngeom + _SPARE_GEOMS)
    if not effects:
        scene.flags[mujoco.mjtRndFlag.mjRND_SHADOW] = 0
        scene.flags[mujoco.mjtRndFlag.mjRND_REFLECTION] = 0
    buffers = mujoco.MjrContext(model, mujoco.mjtFontScale.mjFONTSCALE_100.value)
    mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN.value, buffers)
    return _Upload(model, scene, buffers)


def _narrow(scene: mujoco.MjvScene, exposure: Exposure, blocks: Blocks, fovy_deg: float) -> None:
    """Narrow the view to some blocks: the rest is then neither transformed nor filled."""
    (top, bottom), (left, right) = (
        (part.start * exposure.stride, part.stop * exposure.stride) for part in blocks
    )
    for camera in scene.camera:
        slope = math.tan(math.radians(fovy_deg) / 2.0)
        pixel = 2.0 * camera.frustum_near * slope / exposure.height
        camera.frustum_top = (exposure.height / 2.0 - top) * pixel
        camera.frustum_bottom = (exposure.height / 2.0 - bottom) * pixel
        camera.frustum_center = ((left + right) / 2.0 - exposure.width / 2.0) * pixel
        camera.frustum_width = 0.5 * (right - left) * pixel
