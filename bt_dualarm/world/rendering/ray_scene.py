"""What rays meet in a model: closed forms where there are any, ``mj_multiRay`` for the rest.

One call of ``mj_multiRay`` for a whole image costs 0.3 to 3 microseconds a ray. Most geoms cover
few pixels; for planes, spheres, cylinders, capsules, boxes and convex meshes compiled kernels ask
those alone. Other shapes are left to ``mj_multiRay``.
"""

from __future__ import annotations

import copy
from collections.abc import Sequence

import mujoco
import numpy as np

from bt_dualarm.world.rendering.kernel_arrays import Fan, Hits
from bt_dualarm.world.rendering.ray_shading import Shading
from bt_dualarm.world.rendering.ray_shapes import shapes_of
from bt_dualarm.world.rendering.renderer import Image

_NO_LIMIT_M = 1e10


class RayScene:
    """The visible geoms of a model.

    Args:
        model: Geometry is read once; poses come with the state.
        groups: Geom groups that are visible.
    """

    def __init__(self, model: mujoco.MjModel, groups: Sequence[int]) -> None:
        self.model = model
        visible = [g for g in range(model.ngeom) if _is_visible(model, g, groups)]
        self._shapes, others = shapes_of(model, visible)
        self._others = _only(model, others) if others else None

    def trace(self, data: mujoco.MjData, fan: Fan) -> Hits:
        """Follow the rays to the nearest surfaces."""
        from bt_dualarm.world.rendering.trace_kernels import describe, trace

        axes = data.geom_xmat
        hits = describe(self._shapes, axes, fan, trace(self._shapes, data.geom_xpos, axes, fan))
        if self._others is not None:
            _cast(self._others, data, fan, hits)
        return hits

    def colors(self, shading: Shading, data: mujoco.MjData, fan: Fan) -> Image:
        """Colours of what the rays meet, of shape (rows, columns, 3).

        Args:
            shading: Colours and lights of the model.
            data: State with places of geoms and lights that are up to date.
            fan: The rays.
        """
        if self._others is not None:
            return shading.colors(data, fan, self.trace(data, fan))
        from bt_dualarm.world.rendering.shading_kernels import draw

        pixels = np.empty((*fan.rays.shape[1:], 3), np.uint8)
        draw(
            self._shapes, data.geom_xpos, data.geom_xmat, fan, shading.lights,
            data.light_xpos, data.light_xdir, pixels,
        )  # fmt: skip
        return pixels


def _is_visible(model: mujoco.MjModel, geom: int, groups: Sequence[int]) -> bool:
    """Whether a geom is in a visible group and not wholly transparent: ``mj_multiRay``'s rule."""
    material = model.geom_matid[geom]
    opaque = model.geom_rgba[geom, 3] > 0.0 or (material >= 0 and model.mat_rgba[material, 3] > 0.0)
    return bool(opaque and model.geom_group[geom] in groups)


def _only(model: mujoco.MjModel, geoms: Sequence[int]) -> mujoco.MjModel:
    """A copy of the model in which these geoms alone are in group 0."""
    alone = copy.copy(model)
    alone.geom_group[:] = 1
    alone.geom_group[list(geoms)] = 0
    return alone


def _cast(model: mujoco.MjModel, data: mujoco.MjData, fan: Fan, hits: Hits) -> None:
    """Enter the geoms in group 0 of ``model`` into the hits by ``mj_multiRay``."""
    rays = fan.axes @ fan.rays.reshape(3, -1)
    count = rays.shape[1]
    first_group = np.array([1, 0, 0, 0, 0, 0], dtype=np.uint8)
    geoms, distances = np.empty(count, dtype=np.int32), np.empty(count)
    normals = np.empty(3 * count)
    mujoco.mj_multiRay(
        model, data, fan.eye, np.ascontiguousarray(rays.T).ravel(), first_group, True, -1,
        geoms, distances, normals, count, _NO_LIMIT_M,
    )  # fmt: skip
    nearer = (geoms >= 0) & (distances < hits.distances.ravel())
    rows, columns = np.unravel_index(np.flatnonzero(nearer), hits.geoms.shape)
    hits.geoms[rows, columns] = geoms[nearer]
    hits.distances[rows, columns] = distances[nearer]
    hits.normals[:, rows, columns] = normals.reshape(-1, 3)[nearer].T
