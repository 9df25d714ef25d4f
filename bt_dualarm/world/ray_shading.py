"""Colours for ray-cast surfaces: the diffuse part of MuJoCo's own lighting, without shadows.

Base colour, head light and lights follow the rules of the OpenGL renderer, so that one colour
range serves both. Textures are reduced to their mean colour; highlights are left out.
"""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np
import numpy.typing as npt

from bt_dualarm.pose import Matrix, Vector
from bt_dualarm.world.rendering import Image

_DEFAULT_RGBA = (0.5, 0.5, 0.5, 1.0)


class Shading:
    """Colours and lights of one model."""

    def __init__(self, model: Any) -> None:
        self.model = model
        # The last row serves geom -1: a ray that hit nothing sees the sky.
        self._base = np.vstack([_geom_colors(model), _sky_color(model)])
        self._lights = np.flatnonzero(model.light_active)
        head = model.vis.headlight
        self._head_diffuse = np.array(head.diffuse, dtype=float) * bool(head.active)
        self._ambient = np.array(head.ambient, dtype=float) * bool(head.active)
        self._ambient += model.light_ambient[self._lights].sum(axis=0)

    def colors(
        self,
        data: Any,
        eye: Vector,
        directions: Matrix,
        geoms: npt.NDArray[np.int32],
        distances: Vector,
        normals: Matrix,
    ) -> Image:
        """Shade hits, all arrays in the world's frame.

        Args:
            data: State with up-to-date light positions.
            eye: Where the rays start, of shape (3,).
            directions: Unit vectors, of shape (n, 3).
            geoms: Geom that each ray hit, of shape (n,); -1 for none.
            distances: Along each ray in metres, of shape (n,).
            normals: Outward surface normals, of shape (n, 3).
        """
        facing = np.einsum("ij,ij->i", normals, directions)
        # A surface seen from behind (a plane from below) is lit like its front.
        outward = np.where(facing > 0.0, -1.0, 1.0)
        light = self._ambient + np.abs(facing)[:, None] * self._head_diffuse
        for index in self._lights:
            toward = self._toward_light(data, index, eye, directions, distances)
            lambert = np.einsum("ij,ij->i", normals, toward) * outward
            light += np.maximum(lambert, 0.0)[:, None] * self.model.light_diffuse[index]
        light[geoms < 0] = 1.0
        shaded = self._base[geoms] * light
        np.clip(shaded, 0.0, 1.0, out=shaded)
        pixels: Image = (shaded * 255.0 + 0.5).astype(np.uint8)
        return pixels

    def _toward_light(
        self, data: Any, index: int, eye: Vector, directions: Matrix, distances: Vector
    ) -> Matrix:
        """Unit vectors from each hit towards a light, of shape (n, 3)."""
        if self.model.light_type[index] == mujoco.mjtLightType.mjLIGHT_DIRECTIONAL:
            return np.broadcast_to(-data.light_xdir[index], directions.shape)
        toward: Matrix = (data.light_xpos[index] - eye) - directions * distances[:, None]
        toward /= np.linalg.norm(toward, axis=1, keepdims=True)
        return toward


def _geom_colors(model: Any) -> Matrix:
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


def _sky_color(model: Any) -> Vector:
    """Mean colour of the sky box, of shape (3,); black, as in OpenGL, where there is none."""
    skies = np.flatnonzero(model.tex_type == mujoco.mjtTexture.mjTEXTURE_SKYBOX)
    return _mean_color(model, int(skies[0])) if len(skies) else np.zeros(3)


def _mean_color(model: Any, texture: int) -> Vector:
    start, channels = int(model.tex_adr[texture]), int(model.tex_nchannel[texture])
    count = int(model.tex_height[texture]) * int(model.tex_width[texture])
    texels = model.tex_data[start : start + count * channels].reshape(count, channels)
    mean: Vector = (
        np.resize(texels.mean(axis=0) / 255.0, 3)
        if channels < 3
        else (texels[:, :3].mean(axis=0) / 255.0)
    )
    return mean
