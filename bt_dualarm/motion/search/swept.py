"""An arm in its world as the kernels of the search read it."""

from __future__ import annotations

import math
from typing import Final

import mujoco
import numpy as np

from bt_dualarm.motion.collision.checker import CollisionChecker
from bt_dualarm.motion.collision.sweep import last_joint
from bt_dualarm.motion.search.kernel_arrays import Joints, Numbers, Pairs, Shapes, Swept
from bt_dualarm.pose import Matrix, Vector

_SIDES: Final = 24
"""Sides of the prism that stands for a cylinder; it is 0.9 % wider than the cylinder is."""

_GEOM: Final = mujoco.mjtGeom

_SIGNS: Final = np.array(np.meshgrid((-1.0, 1.0), (-1.0, 1.0), (-1.0, 1.0))).T.reshape(-1, 3)
"""Corners of a cube."""


class UnknownShapeError(ValueError):
    """A shape that the kernels do not know."""


def swept(checker: CollisionChecker) -> Swept:
    """An arm in its world, as a test of configurations has them.

    Raises:
        UnknownShapeError: It has shapes of other kinds than planes that stand still, spheres,
            capsules, cylinders, boxes and convex meshes, or joints that do not turn.
    """
    checker.place(checker.present)
    first, second, least = _pairs(checker)
    used = np.unique(np.concatenate((first, second)))
    joints = _joints(checker)
    shapes = _shapes(checker, used, joints)
    first, second = np.searchsorted(used, first), np.searchsorted(used, second)
    moved = shapes.heaps[:, 2]
    turned = moved[first] < moved[second]
    turned |= np.isinf(shapes.bounds[first])
    pairs = Pairs(np.where(turned, second, first), np.where(turned, first, second), least)
    together = moved[pairs.first] != moved[pairs.second]
    if np.isinf(shapes.bounds[pairs.first]).any() or moved[np.isinf(shapes.bounds)].any():
        raise UnknownShapeError("a plane that an arm carries")
    return Swept(joints, shapes, Pairs(*(column[together].copy() for column in pairs)))


def _joints(checker: CollisionChecker) -> Joints:
    model, data, ids = checker.model, checker.data, checker.joint_ids
    if (model.jnt_type[ids] != mujoco.mjtJoint.mjJNT_HINGE).any():
        raise UnknownShapeError("a joint that does not turn")
    return Joints(checker.present.copy(), data.xanchor[ids].copy(), data.xaxis[ids].copy())


def _pairs(checker: CollisionChecker) -> tuple[Numbers, Numbers, Vector]:
    """Shapes that may not meet, and how far apart they keep, each of shape (p,).

    Those that MuJoCo compares: not of one rigid body, not of a body and the one it hangs on.
    """
    model = checker.model
    asked = np.flatnonzero((model.geom_conaffinity != 0) | (model.geom_contype != 0))
    first, second = (asked[side] for side in np.triu_indices(len(asked), 1))
    kept = (model.geom_contype[first] & model.geom_conaffinity[second]) != 0
    kept |= (model.geom_contype[second] & model.geom_conaffinity[first]) != 0
    body = model.geom_bodyid[first], model.geom_bodyid[second]
    weld = model.body_weldid[body[0]], model.body_weldid[body[1]]
    kept &= weld[0] != weld[1]
    above = (model.body_weldid[model.body_parentid[one]] for one in weld)
    related = np.logical_or.reduce(
        [one == parent for one, parent in zip(weld[::-1], above, strict=True)]
    )
    kept &= ~(related & (weld[0] != 0) & (weld[1] != 0))
    signature = (
        (body[0].astype(np.int64) << 16) + body[1],
        (body[1].astype(np.int64) << 16) + body[0],
    )
    kept &= ~np.isin(signature[0], model.exclude_signature)
    kept &= ~np.isin(signature[1], model.exclude_signature)
    least = checker.least[first, second]
    kept &= np.isfinite(least)
    return first[kept], second[kept], np.maximum(least[kept], 0.0)


def _shapes(checker: CollisionChecker, geoms: Numbers, joints: Joints) -> Shapes:
    """These geoms, where they are now."""
    model, data = checker.model, checker.data
    links = model.jnt_bodyid[checker.joint_ids].tolist()
    local, radii = zip(*(_solid(model, geom) for geom in geoms.tolist()), strict=True)
    rounding, turns = np.array(radii), data.geom_xmat[geoms].reshape(-1, 3, 3)
    low, high = (np.array([end(solid, axis=0) for solid in local]) for end in (np.min, np.max))
    middles = 0.5 * (low + high)
    far = [((one - mid) ** 2).sum(axis=1).max() for one, mid in zip(local, middles, strict=True)]
    flat = model.geom_type[geoms] == _GEOM.mjGEOM_PLANE
    places = data.geom_xpos[geoms]
    corners = [
        solid @ turn.T + place for solid, turn, place in zip(local, turns, places, strict=True)
    ]
    moved = [_moved(checker, links, geom) for geom in geoms.tolist()]
    ends = np.cumsum([len(solid) for solid in local])
    pieces = zip(moved, corners, rounding, strict=True)
    return Shapes(
        corners=np.vstack(corners),
        heaps=np.stack((np.concatenate(((0,), ends[:-1])), ends, np.array(moved)), axis=1),
        radii=rounding,
        centers=places + np.einsum("nij,nj->ni", turns, middles),
        bounds=np.where(flat, np.inf, np.sqrt(far) + rounding),
        turns=turns.copy(),
        halves=0.5 * (high - low) + rounding[:, None],
        normals=np.where(flat[:, None], turns[:, :, 2], 0.0),
        reaches=np.array([_reaches(joints, *piece) for piece in pieces]),
    )


def _moved(checker: CollisionChecker, links: list[int], geom: int) -> int:
    """How many joints move a geom."""
    if not checker.moving[geom]:
        return 0
    last = last_joint(checker.model, links, int(checker.model.geom_bodyid[geom]))
    return 0 if last is None else last + 1


def _reaches(joints: Joints, moved: int, corners: Matrix, radius: float) -> Vector:
    """Metres that any point is moved at most by a radian of each joint, of shape (dof,).

    The distance from the axis of the last joint that moves it, then from joint to joint, stretched
    out: it holds in every configuration.
    """
    reaches = np.zeros(len(joints.anchors))
    if moved == 0:
        return reaches
    arms = corners - joints.anchors[moved - 1]
    squares = (arms**2).sum(axis=1)
    across = squares - (arms @ joints.axes[moved - 1]) ** 2
    reaches[moved - 1] = math.sqrt(max(across.max(), 0.0)) + radius
    farthest = math.sqrt(squares.max()) + radius
    for k in range(moved - 2, -1, -1):
        farthest += math.dist(joints.anchors[k + 1], joints.anchors[k])
        reaches[k] = farthest
    return reaches


def _solid(model: mujoco.MjModel, geom: int) -> tuple[Matrix, float]:
    """Corners in the geom's own frame, of shape (n, 3), and the radius that rounds them, in m."""
    kind, size = int(model.geom_type[geom]), model.geom_size[geom]
    if kind == _GEOM.mjGEOM_BOX:
        return _SIGNS * size, 0.0
    if kind == _GEOM.mjGEOM_MESH:
        mesh = int(model.geom_dataid[geom])
        start, graph = int(model.mesh_vertadr[mesh]), int(model.mesh_graphadr[mesh])
        vertices = model.mesh_vert[start : start + model.mesh_vertnum[mesh]].astype(float)
        if graph < 0:
            return vertices, 0.0
        count = int(model.mesh_graph[graph])
        chosen = model.mesh_graph[graph + 2 + count : graph + 2 + 2 * count]
        return vertices[chosen], 0.0
    if kind == _GEOM.mjGEOM_CYLINDER:
        turn = 2.0 * np.pi * np.arange(_SIDES) / _SIDES
        wide = size[0] / np.cos(np.pi / _SIDES)
        ring = np.stack(
            (wide * np.cos(turn), wide * np.sin(turn), np.full(_SIDES, size[1])), axis=1
        )
        return np.vstack((ring, ring * (1.0, 1.0, -1.0))), 0.0
    if kind == _GEOM.mjGEOM_CAPSULE:
        return np.array(((0.0, 0.0, size[1]), (0.0, 0.0, -size[1]))), float(size[0])
    if kind == _GEOM.mjGEOM_SPHERE:
        return np.zeros((1, 3)), float(size[0])
    if kind == _GEOM.mjGEOM_PLANE:
        return np.zeros((1, 3)), 0.0
    raise UnknownShapeError(f"a shape of kind {kind}")
