"""The shapes of a model that have a closed form, as arrays that the kernels read."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final, NamedTuple

import mujoco
import numpy as np

from bt_dualarm.pose import Matrix, Vector
from bt_dualarm.world.rendering.kernel_arrays import (
    CAPSULE,
    CYLINDER,
    HULL,
    PLANE,
    SPHERE,
    Numbers,
    Shapes,
)

_CONVEX_TOLERANCE = 1e-4
_Type = mujoco.mjtGeom

_ROUND: Final = {
    _Type.mjGEOM_SPHERE: SPHERE,
    _Type.mjGEOM_CYLINDER: CYLINDER,
    _Type.mjGEOM_CAPSULE: CAPSULE,
}


class Hull(NamedTuple):
    """A convex body.

    Attributes:
        corners: Places of the corners, of shape (c, 3), in m.
        triangles: Numbers of the corners of each triangle, anticlockwise seen from outside, (f, 3).
        normals: Outward unit normals of the triangles, of shape (f, 3).
        offsets: Distances of their planes from the origin along the normals, of shape (f,).
    """

    corners: Matrix
    triangles: Numbers
    normals: Matrix
    offsets: Vector


def shapes_of(model: mujoco.MjModel, geoms: Sequence[int]) -> tuple[Shapes, list[int]]:
    """The geoms that have a closed form, and the numbers of those that have none."""
    hulls = {geom: _hull(model, geom) for geom in geoms}
    known = [geom for geom in geoms if hulls[geom] is not None or _kind(model, geom) != HULL]
    bodies = [hulls[geom] or _NOTHING for geom in known]
    ends = np.cumsum([(0, 0), *((len(body.corners), len(body.triangles)) for body in bodies)], 0)
    shifted = [body.triangles + first for body, first in zip(bodies, ends[:-1, 0], strict=True)]
    sizes = model.geom_size[known].reshape(-1, 3).astype(float)
    kinds = np.array([_kind(model, geom) for geom in known], dtype=np.int64)
    endless = (kinds == PLANE)[:, None] & (sizes <= 0.0)
    # A plane has no bounding sphere; MuJoCo gives it the radius 0.
    bounds = model.geom_rbound[known].astype(float)
    shapes = Shapes(
        geoms=np.array(known, dtype=np.int64),
        kinds=kinds,
        sizes=np.where(endless, math.inf, sizes),
        radii=np.where(bounds > 0.0, bounds, math.inf),
        corners=np.vstack([_NOTHING.corners, *(body.corners for body in bodies)]),
        triangles=np.vstack([_NOTHING.triangles, *shifted]),
        normals=np.vstack([_NOTHING.normals, *(body.normals for body in bodies)]),
        offsets=np.concatenate([_NOTHING.offsets, *(body.offsets for body in bodies)]),
        heaps=np.column_stack((ends[:-1, 0], ends[1:, 0], ends[:-1, 1], ends[1:, 1])),
        owners=np.concatenate([np.repeat(known, np.diff(ends[:, 1])), known]).astype(np.int64),
    )
    return shapes, sorted(set(geoms) - set(known))


_NOTHING: Final = Hull(
    np.zeros((0, 3)), np.zeros((0, 3), dtype=np.int64), np.zeros((0, 3)), np.zeros(0)
)


def _kind(model: mujoco.MjModel, geom: int) -> int:
    """What the geom is; a hull is what is made of triangles, and what has no closed form."""
    kind = int(model.geom_type[geom])
    return PLANE if kind == _Type.mjGEOM_PLANE else _ROUND.get(_Type(kind), HULL)


def _hull(model: mujoco.MjModel, geom: int) -> Hull | None:
    """The geom as a convex body of triangles, ``None`` if it is none."""
    kind = model.geom_type[geom]
    if kind == _Type.mjGEOM_BOX:
        return box(model.geom_size[geom].astype(float))
    if kind == _Type.mjGEOM_MESH:
        return _convex_mesh(model, int(model.geom_dataid[geom]))
    return None


def box(half: Vector) -> Hull:
    """A box about the origin, two triangles a side.

    Args:
        half: Half lengths along x, y and z, of shape (3,), in m.
    """
    signs = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], dtype=float)
    # Sides +x, +y, +z, -x, -y, -z: corners anticlockwise seen from outside.
    sides = ((4, 6, 7, 5), (2, 3, 7, 6), (1, 5, 7, 3), (0, 1, 3, 2), (0, 4, 5, 1), (0, 2, 6, 4))
    triangles = [half_side for a, b, c, d in sides for half_side in ((a, b, c), (a, c, d))]
    normals = np.vstack([np.eye(3), -np.eye(3)]).repeat(2, axis=0)
    offsets = np.concatenate([half, half]).repeat(2)
    return Hull(signs * half, np.array(triangles, dtype=np.int64), normals, offsets)


def _convex_mesh(model: mujoco.MjModel, mesh: int) -> Hull | None:
    """A mesh as a convex body, or ``None`` if it has a dent."""
    start, count = model.mesh_vertadr[mesh], model.mesh_vertnum[mesh]
    vertices = model.mesh_vert[start : start + count].astype(float)
    first, faces = model.mesh_faceadr[mesh], model.mesh_facenum[mesh]
    triangles = model.mesh_face[first : first + faces].astype(np.int64)
    corners = vertices[triangles]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    areas = np.linalg.norm(normals, axis=1)
    sound = areas > areas.max() * _CONVEX_TOLERANCE**2
    normals = normals[sound] / areas[sound, None]
    offsets = np.einsum("ij,ij->i", normals, corners[sound].mean(axis=1))
    size = float(np.ptp(vertices, axis=0).max())
    if (normals @ vertices.T - offsets[:, None]).max() > _CONVEX_TOLERANCE * size:
        return None
    return Hull(vertices, triangles[sound], normals, offsets)
