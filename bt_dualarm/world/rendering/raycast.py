"""Images by ray casting: the same pixels on every machine, and no library of the system."""

from __future__ import annotations

import math
from functools import lru_cache

import mujoco
import numpy as np
import numpy.typing as npt

from bt_dualarm.world.rendering.kernel_arrays import Fan
from bt_dualarm.world.rendering.ray_scene import RayScene
from bt_dualarm.world.rendering.ray_shading import Shading
from bt_dualarm.world.rendering.renderer import Blocks, Exposure, Image
from bt_dualarm.world.rendering.viewpoint import Viewpoint

_JITTER_SEED = 7


class RayRenderer:
    """One ray a pixel, or a block of pixels, through a random but fixed point of it.

    The jitter makes centroids finer: rays on a grid all cross a straight edge at the same
    moment, jittered ones one after the other (0.15 against 0.05 px standard deviation).
    """

    name = "ray"

    def __init__(self) -> None:
        self._drawn: _Drawn | None = None

    def render(self, model: mujoco.MjModel, data: mujoco.MjData, exposure: Exposure) -> Image:
        """See `Renderer`."""
        return exposure.paint(lambda blocks: self._colors(model, data, exposure, blocks))

    def _colors(
        self, model: mujoco.MjModel, data: mujoco.MjData, exposure: Exposure, blocks: Blocks
    ) -> Image:
        """Colours of some blocks of the image, of shape (rows, columns, 3)."""
        if self._drawn is None or self._drawn.model is not model:
            self._drawn = _Drawn(model)
        scene, fan = self._drawn.scene(exposure.groups), _fan(model, data, exposure, blocks)
        return scene.colors(self._drawn.shading, data, fan)

    def close(self) -> None:
        """Let go of the last model."""
        self._drawn = None


class _Drawn:
    """What was read of a model, once for all images of it.

    Args:
        model: Compiled.
    """

    def __init__(self, model: mujoco.MjModel) -> None:
        self.model = model
        self.shading = Shading(model)
        self._scenes: dict[tuple[int, ...], RayScene] = {}

    def scene(self, groups: tuple[int, ...]) -> RayScene:
        """What rays meet of the geoms in these groups."""
        if groups not in self._scenes:
            self._scenes[groups] = RayScene(self.model, groups)
        return self._scenes[groups]


def draw_something() -> None:
    """Have all kernels of the ray caster compiled."""
    spec = mujoco.MjSpec()
    spec.worldbody.add_geom(size=(0.1, 0.1, 0.1))
    spec.worldbody.add_camera()
    model = spec.compile()
    RayRenderer().render(model, mujoco.MjData(model), Exposure(0, 2, 2))


def fan_of(viewpoint: Viewpoint, width: int, height: int) -> Fan:
    """The rays of a whole picture, one a pixel."""
    return Fan(
        eye=viewpoint.eye,
        axes=viewpoint.axes,
        rays=camera_rays(width, height, viewpoint.fov_deg, 1).copy(),
        spacing=2.0 * math.tan(math.radians(viewpoint.fov_deg) / 2.0) / height,
        centre=(width / 2.0, height / 2.0),
    )


def _fan(model: mujoco.MjModel, data: mujoco.MjData, exposure: Exposure, blocks: Blocks) -> Fan:
    """The rays of those blocks of a camera's image that are drawn."""
    camera_id, stride = exposure.camera_id, exposure.stride
    width, height = exposure.width, exposure.height
    rows, columns = blocks
    fovy_deg = float(model.cam_fovy[camera_id])
    return Fan(
        eye=data.cam_xpos[camera_id].copy(),
        axes=data.cam_xmat[camera_id].reshape(3, 3).copy(),
        rays=_rays_of(
            (width, height, fovy_deg, stride), rows.start, rows.stop, columns.start, columns.stop
        ),
        spacing=stride * 2.0 * math.tan(math.radians(fovy_deg) / 2.0) / height,
        centre=(width / 2.0 / stride - columns.start, height / 2.0 / stride - rows.start),
    )


@lru_cache(maxsize=16)
def _rays_of(
    grid: tuple[int, int, float, int], top: int, bottom: int, left: int, right: int
) -> npt.NDArray[np.float64]:
    """Some of the rays of a camera: a target that rests is asked for in the same part again."""
    return camera_rays(*grid)[:, top:bottom, left:right].copy()


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
