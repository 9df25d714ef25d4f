"""Colours for ray-cast surfaces: the diffuse part of MuJoCo's own lighting, without shadows.

Base colour, head light and lights follow the rules of the OpenGL renderer, so that one colour
range serves both. Textures are reduced to their mean colour; highlights are left out.
"""

from __future__ import annotations

import mujoco
import numpy as np

from bt_dualarm.pose import Matrix, Vector
from bt_dualarm.world.rendering.ray_fan import Fan
from bt_dualarm.world.rendering.ray_scene import Hits
from bt_dualarm.world.rendering.ray_shapes import multiply
from bt_dualarm.world.rendering.renderer import Image

_DEFAULT_RGBA = (0.5, 0.5, 0.5, 1.0)


class Shading:
    """Colours and lights of one model."""

    def __init__(self, model: mujoco.MjModel) -> None:
        self.model = model
        # The last row serves geom -1: a ray that hit nothing sees the sky.
        self._base = np.vstack([_geom_colors(model), _sky_color(model)])
        self._lights = np.flatnonzero(model.light_active)
        head = model.vis.headlight
        self._head_diffuse = np.array(head.diffuse, dtype=float) * bool(head.active)
        self._ambient = np.array(head.ambient, dtype=float) * bool(head.active)
        self._ambient += model.light_ambient[self._lights].sum(axis=0)

    def colors(self, data: mujoco.MjData, fan: Fan, hits: Hits) -> Image:
        """Colours of what the rays of ``fan`` met, of shape (rows, columns, 3).

        Light positions of ``data`` must be up to date.
        """
        grid = hits.geoms.shape
        geoms = hits.geoms.ravel()
        normals = hits.normals.reshape(3, -1)
        directions = multiply(fan.axes, fan.rays.reshape(3, -1))
        facing = -np.einsum("ij,ij->j", normals, directions)
        light = self._ambient[:, None] + facing * self._head_diffuse[:, None]
        for index in self._lights:
            toward = self._toward_light(data, index, fan.eye, directions, hits.distances.ravel())
            lambert = np.maximum(np.einsum("ij,ij->j", normals, toward), 0.0)
            light += lambert * self.model.light_diffuse[index][:, None]
        light[:, geoms < 0] = 1.0
        shaded = self._base.take(geoms, axis=0)
        shaded *= light.T
        np.minimum(shaded, 1.0, out=shaded)
        shaded *= 255.0
        shaded += 0.5
        pixels: Image = shaded.astype(np.uint8).reshape(*grid, 3)
        return pixels

    def _toward_light(
        self, data: mujoco.MjData, index: int, eye: Vector, directions: Matrix, distances: Vector
    ) -> Matrix:
        """Unit vectors from each hit towards a light, of shape (3, n) or (3, 1)."""
        if self.model.light_type[index] == mujoco.mjtLightType.mjLIGHT_DIRECTIONAL:
            away: Matrix = -data.light_xdir[index][:, None]
            return away
        reach = np.where(np.isfinite(distances), distances, 0.0)
        toward: Matrix = (data.light_xpos[index] - eye)[:, None] - directions * reach
        toward /= np.sqrt(np.einsum("ij,ij->j", toward, toward))
        return toward


def _geom_colors(model: mujoco.MjModel) -> Matrix:
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
