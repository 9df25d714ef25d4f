"""Colours for ray-cast surfaces: the diffuse part of MuJoCo's own lighting, without shadows.

Base colour, head light and lights follow the rules of the OpenGL renderer, so that one colour
range serves both. Textures are reduced to their mean colour; highlights are left out.
"""

from __future__ import annotations

import mujoco
import numpy as np

from bt_dualarm.pose import Matrix, Vector
from bt_dualarm.world.rendering.kernel_arrays import Fan, Hits, Lights
from bt_dualarm.world.rendering.renderer import Image

_DEFAULT_RGBA = (0.5, 0.5, 0.5, 1.0)


class Shading:
    """Colours and lights of one model.

    Args:
        model: Compiled.

    Attributes:
        lights: What the kernels read of them.
    """

    def __init__(self, model: mujoco.MjModel) -> None:
        active = np.flatnonzero(model.light_active)
        head = model.vis.headlight
        ambient = np.array(head.ambient, dtype=float) * bool(head.active)
        self.lights = Lights(
            # The last row serves geom -1: a ray that hit nothing sees the sky.
            base=np.vstack([geom_colors(model), _sky_color(model)]),
            ambient=ambient + model.light_ambient[active].sum(axis=0),
            head=np.array(head.diffuse, dtype=float) * bool(head.active),
            active=active,
            distant=model.light_type[active] == mujoco.mjtLightType.mjLIGHT_DIRECTIONAL,
            diffuse=model.light_diffuse[active].astype(float),
        )

    def colors(self, data: mujoco.MjData, fan: Fan, hits: Hits) -> Image:
        """Colours of what the rays of ``fan`` met, of shape (rows, columns, 3).

        Light positions of ``data`` must be up to date.
        """
        from bt_dualarm.world.rendering.shading_kernels import shade

        pixels: Image = np.empty((*hits.geoms.shape, 3), dtype=np.uint8)
        shade(self.lights, data.light_xpos, data.light_xdir, fan, hits, pixels)
        return pixels


def geom_colors(model: mujoco.MjModel) -> Matrix:
    """Red, green, blue of each geom, of shape (ngeom, 3): its own colour, else its material's."""
    colors: Matrix = model.geom_rgba[:, :3].astype(float)
    materials = model.geom_matid
    plain = (model.geom_rgba == np.array(_DEFAULT_RGBA, dtype=np.float32)).all(axis=1)
    from_material = (materials >= 0) & plain
    colors[from_material] = model.mat_rgba[materials[from_material], :3]
    role = mujoco.mjtTextureRole.mjTEXROLE_RGB
    for geom in np.flatnonzero(materials >= 0):
        texture = model.mat_texid[materials[geom], role]
        if texture >= 0:
            colors[geom] *= _mean_color(model, texture)
    return colors


def _sky_color(model: mujoco.MjModel) -> Vector:
    """Mean colour of the sky box, of shape (3,); black, as in OpenGL, where there is none."""
    skies = np.flatnonzero(model.tex_type == mujoco.mjtTexture.mjTEXTURE_SKYBOX)
    return _mean_color(model, int(skies[0])) if len(skies) else np.zeros(3)


def _mean_color(model: mujoco.MjModel, texture: int) -> Vector:
    start, channels = int(model.tex_adr[texture]), int(model.tex_nchannel[texture])
    count = int(model.tex_height[texture]) * int(model.tex_width[texture])
    texels = model.tex_data[start : start + count * channels].reshape(count, channels)
    mean: Vector = (
        np.resize(texels.mean(axis=0) / 255.0, 3)
        if channels < 3
        else (texels[:, :3].mean(axis=0) / 255.0)
    )
    return mean
