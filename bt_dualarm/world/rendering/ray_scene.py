"""What rays meet in a model: closed forms where there are any, ``mj_multiRay`` for the rest.

One call of ``mj_multiRay`` for a whole image costs 0.3 to 3 microseconds a ray. Most geoms cover
few pixels, and for planes, spheres, cylinders, boxes and convex meshes there are formulas for
all rays at once; other shapes are left to ``mj_multiRay``.
"""

from __future__ import annotations

import copy
import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import mujoco
import numpy as np
import numpy.typing as npt

from bt_dualarm.pose import Matrix
from bt_dualarm.world.rendering.ray_fan import Fan
from bt_dualarm.world.rendering.ray_shapes import (
    Cylinder,
    FlatSurface,
    Polyhedron,
    Sphere,
    Surface,
    dots,
    multiply,
)

_NO_LIMIT_M = 1e10
_NEAR_M = 1e-3
_CONVEX_TOLERANCE = 1e-4
_Type = mujoco.mjtGeom


@dataclass(frozen=True, eq=False)
class Hits:
    """What the rays of a fan meet.

    Attributes:
        geoms: Number of each geom, -1 for nothing, of shape (rows, columns).
        distances: Distance from the eye in m, inf for nothing, of shape (rows, columns).
        normals: Outward unit normals in the world, zero for nothing, of shape (3, rows, columns).
    """

    geoms: npt.NDArray[np.int32]
    distances: npt.NDArray[np.float64]
    normals: npt.NDArray[np.float64]

    @cached_property
    def numbers(self) -> npt.NDArray[np.int64]:
        """Numbers of the rays, row by row, of shape (rows, columns)."""
        return np.arange(self.geoms.size).reshape(self.geoms.shape)


class RayScene:
    """The visible geoms of a model.

    Args:
        model: Geometry is read once; poses come with the state.
        groups: Geom groups that are visible.
    """

    def __init__(self, model: mujoco.MjModel, groups: Sequence[int]) -> None:
        self.model = model
        visible = [g for g in range(model.ngeom) if _is_visible(model, g, groups)]
        shapes = {geom: _surface(model, geom) for geom in visible}
        self._shapes = {geom: shape for geom, shape in shapes.items() if shape is not None}
        others = [geom for geom, shape in shapes.items() if shape is None]
        self._corners = {geom: _corners(shape) for geom, shape in self._shapes.items()}
        self._others = _only(model, others) if others else None
        self._ids = np.array(list(self._shapes), dtype=int)
        bounds = model.geom_rbound[self._ids]
        # A plane has no bounding sphere; MuJoCo gives it the radius 0.
        self._radii = np.where(bounds > 0.0, bounds, np.inf)

    def trace(self, data: mujoco.MjData, fan: Fan) -> Hits:
        """Follow the rays to the nearest surfaces."""
        grid = fan.rays.shape[1:]
        hits = Hits(np.full(grid, -1, np.int32), np.full(grid, np.inf), np.zeros((3, *grid)))
        for geom, closest in self._ahead(data, fan):
            self._meet(data, fan, geom, closest, hits)
        if self._others is not None:
            _cast(self._others, data, fan, hits)
        return hits

    def _ahead(self, data: mujoco.MjData, fan: Fan) -> list[tuple[int, float]]:
        """Geoms whose bounding sphere reaches into the cone of the fan, and its distance.

        In the order of distance, planes last: what is hidden by others then costs least.
        """
        middle = fan.rays.reshape(3, -1).mean(axis=1)
        middle /= np.linalg.norm(middle)
        reach = math.acos(min(1.0, float(dots(middle, fan.rays.reshape(3, -1)).min())))
        offsets = data.geom_xpos[self._ids] - fan.eye
        distances = np.maximum(np.linalg.norm(offsets, axis=1), _NEAR_M)
        away = np.arccos(np.clip(offsets @ (fan.axes @ middle) / distances, -1.0, 1.0))
        half = np.arcsin(np.minimum(self._radii / distances, 1.0))
        met = (distances <= self._radii) | (away - half <= reach)
        closest = np.maximum(distances - self._radii, 0.0)
        order = np.argsort(np.where(np.isinf(self._radii), np.inf, closest), kind="stable")
        return [(int(self._ids[i]), float(closest[i])) for i in order if met[i]]

    def _meet(self, data: mujoco.MjData, fan: Fan, geom: int, closest: float, hits: Hits) -> None:
        """Enter one geom into the hits, where it is nearer than what is there."""
        shape = self._shapes[geom]
        place, axes = data.geom_xpos[geom], data.geom_xmat[geom].reshape(3, 3)
        eye, turn = (fan.eye - place) @ axes, axes.T @ fan.axes
        part: tuple[slice, slice] | None = fan.whole
        if isinstance(shape, FlatSurface):
            closest = float(eye[2])
        else:
            part = fan.part((self._corners[geom] - eye) @ turn)
        if part is None or shape.contains(eye):
            return
        # Rays by their number on the grid: one index each is taken faster than two.
        numbers = hits.numbers[part].ravel()
        numbers = numbers.take(np.flatnonzero(hits.distances[part] > closest))
        if not len(numbers):
            return
        rays = multiply(turn, fan.rays.reshape(3, -1).take(numbers, axis=1))
        entries, met = shape.enter(eye, rays), hits.distances.reshape(-1)
        nearer = np.flatnonzero(entries < met.take(numbers))
        if not len(nearer):
            return
        numbers, entries = numbers.take(nearer), entries.take(nearer)
        met[numbers] = entries
        hits.geoms.reshape(-1)[numbers] = geom
        normals = multiply(axes, shape.normals(eye, rays.take(nearer, axis=1), entries))
        for component, found in zip(hits.normals.reshape(3, -1), normals, strict=True):
            component[numbers] = found


def _corners(shape: Surface) -> Matrix:
    """Points that span a bounded shape, or more than it, of shape (n, 3)."""
    if isinstance(shape, Polyhedron):
        return shape.vertices
    if isinstance(shape, Cylinder):
        half = np.array((shape.radius, shape.radius, shape.half_length))
        return Polyhedron.box(half).vertices
    if isinstance(shape, Sphere):
        return Polyhedron.box(np.full(3, shape.radius)).vertices
    return np.zeros((0, 3))


def _is_visible(model: mujoco.MjModel, geom: int, groups: Sequence[int]) -> bool:
    """Whether a geom is in a visible group and not wholly transparent: ``mj_multiRay``'s rule."""
    material = model.geom_matid[geom]
    opaque = model.geom_rgba[geom, 3] > 0.0 or (material >= 0 and model.mat_rgba[material, 3] > 0.0)
    return bool(opaque and model.geom_group[geom] in groups)


def _surface(model: mujoco.MjModel, geom: int) -> Surface | None:
    """The geom as a shape with a closed form; ``None`` if there is none for it."""
    kind, size = model.geom_type[geom], model.geom_size[geom]
    if kind == _Type.mjGEOM_PLANE:
        x, y = (float(length) if length > 0.0 else math.inf for length in size[:2])
        return FlatSurface((x, y))
    if kind == _Type.mjGEOM_SPHERE:
        return Sphere(float(size[0]))
    if kind == _Type.mjGEOM_CYLINDER:
        return Cylinder(float(size[0]), float(size[1]))
    if kind == _Type.mjGEOM_BOX:
        return Polyhedron.box(size.copy())
    if kind == _Type.mjGEOM_MESH:
        return _convex_mesh(model, int(model.geom_dataid[geom]))
    return None


def _convex_mesh(model: mujoco.MjModel, mesh: int) -> Polyhedron | None:
    """A mesh as a polyhedron, or ``None`` if it has a dent."""
    start, count = model.mesh_vertadr[mesh], model.mesh_vertnum[mesh]
    vertices = model.mesh_vert[start : start + count].astype(float)
    first, faces = model.mesh_faceadr[mesh], model.mesh_facenum[mesh]
    corners = vertices[model.mesh_face[first : first + faces]]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    areas = np.linalg.norm(normals, axis=1)
    sound = areas > areas.max() * _CONVEX_TOLERANCE**2
    normals = normals[sound] / areas[sound, None]
    offsets = np.einsum("ij,ij->i", normals, corners[sound].mean(axis=1))
    size = float(np.ptp(vertices, axis=0).max())
    if (normals @ vertices.T - offsets[:, None]).max() > _CONVEX_TOLERANCE * size:
        return None
    return Polyhedron(normals, offsets, vertices)


def _only(model: mujoco.MjModel, geoms: Sequence[int]) -> mujoco.MjModel:
    """A copy of the model in which these geoms alone are in group 0."""
    alone = copy.copy(model)
    alone.geom_group[:] = 1
    alone.geom_group[list(geoms)] = 0
    return alone


def _cast(model: mujoco.MjModel, data: mujoco.MjData, fan: Fan, hits: Hits) -> None:
    """Enter the geoms in group 0 of ``model`` into the hits by ``mj_multiRay``."""
    rays = multiply(fan.axes, fan.rays.reshape(3, -1))
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
