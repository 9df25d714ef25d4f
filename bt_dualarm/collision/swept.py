"""How far an arm may move in joint space before it comes too near to something: compiled."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Final

import mujoco
import numpy as np

from bt_dualarm.collision.checker import CollisionChecker, last_joint
from bt_dualarm.collision.kernel_arrays import ConvexShapes, Joints, Numbers, Pairs, SweptArm
from bt_dualarm.core.pose import Matrix, Vector

# An arm in its world as the kernels of the search read it.


SPARE: Final = 2.5e-3
"""Meters that shapes keep between them besides what they are to keep: to squeeze along something
closer would take many looks."""

_SIDES: Final = 24
"""Sides of the prism that stands for a cylinder; it is 0.9 % wider than the cylinder is."""

_GEOM: Final = mujoco.mjtGeom

_SIGNS: Final = np.array(np.meshgrid((-1.0, 1.0), (-1.0, 1.0), (-1.0, 1.0))).T.reshape(-1, 3)
"""Corners of a cube."""

_POINT: Final = np.zeros((1, 3))

_TURN: Final = 2.0 * np.pi * np.arange(_SIDES) / _SIDES
_RING: Final = np.stack((np.cos(_TURN), np.sin(_TURN)), axis=1) / np.cos(np.pi / _SIDES)


class UnknownShapeError(ValueError):
    """A shape that the kernels do not know."""


def swept(checker: CollisionChecker, ends: Iterable[Vector] = ()) -> SweptArm:
    """An arm in its world, as a test of configurations has them.

    Args:
        checker: Test of configurations.
        ends: Configurations of shape (dof,), rad, in which the arm stands: what touches there may
            be as deep as the checker lets it, all else may not touch at all.

    Raises:
        UnknownShapeError: It has shapes of other kinds than planes that stand still, spheres,
            capsules, cylinders, boxes and convex meshes, or joints that do not turn.
    """
    touching = _touching(checker, ends)
    checker.place(checker.present)
    first, second = _pairs(checker)
    used = np.unique(np.concatenate((first, second)))
    joints = _joints(checker)
    shapes = _shapes(checker, used, joints)
    least = np.maximum(checker.least[first, second], 0.0)
    one = np.searchsorted(used, first)
    other = np.searchsorted(used, second)
    moved = shapes.heaps[:, 2]
    flat = np.isinf(shapes.bounds)
    swapped = (moved[one] < moved[other]) | flat[one]
    one, other = np.where(swapped, other, one), np.where(swapped, one, other)
    if flat[one].any() or moved[flat].any():
        raise UnknownShapeError("a plane that an arm carries")
    apart = shapes.centers[one] - shapes.centers[other] + 1e-6
    for (low, high), normal in touching.items():
        for p in np.flatnonzero((first == low) & (second == high)):
            least[p] = checker.least[low, high]
            apart[p] = normal if swapped[p] else -normal
    together = moved[one] != moved[other]
    pairs = Pairs(*(column[together].copy() for column in (one, other, least, apart)))
    return SweptArm(joints, shapes, pairs, SPARE)


def _touching(checker: CollisionChecker, ends: Iterable[Vector]) -> dict[tuple[int, int], Vector]:
    """Shapes that touch at the ends, the lower number first, with the normal from it, (3,)."""
    touching = {}
    for q in ends:
        checker.place(q)
        found = checker.data.contact
        for (one, other), frame in zip(found.geom.tolist(), found.frame.tolist(), strict=True):
            normal = np.array(frame[:3])
            touching[min(one, other), max(one, other)] = normal if one < other else -normal
    return touching


def _joints(checker: CollisionChecker) -> Joints:
    model = checker.model
    data = checker.data
    ids = checker.joint_ids
    if (model.jnt_type[ids] != mujoco.mjtJoint.mjJNT_HINGE).any():
        raise UnknownShapeError("a joint that does not turn")
    return Joints(checker.present.copy(), data.xanchor[ids].copy(), data.xaxis[ids].copy())


def _pairs(checker: CollisionChecker) -> tuple[Numbers, Numbers]:
    """Shapes that may not meet, the lower number first, each of shape (p,).

    Those that MuJoCo compares: not of one rigid body, not of a body and the one it hangs on.
    """
    model = checker.model
    asked = np.flatnonzero((model.geom_conaffinity != 0) | (model.geom_contype != 0))
    types = model.geom_contype[asked]
    affinities = model.geom_conaffinity[asked]
    bodies = model.geom_bodyid[asked]
    welds = model.body_weldid[bodies]
    above = model.body_weldid[model.body_parentid[welds]]
    kept = (types[:, None] & affinities) != 0
    kept |= kept.T
    kept &= welds[:, None] != welds
    related = (welds[:, None] == above) & (welds[:, None] != 0) & (welds != 0)
    kept &= ~(related | related.T)
    signatures = (bodies[:, None].astype(np.int64) << 16) + bodies
    excluded = np.isin(signatures, model.exclude_signature)
    kept &= ~(excluded | excluded.T)
    kept &= np.isfinite(checker.least[np.ix_(asked, asked)])
    first, second = np.nonzero(np.triu(kept, 1))
    return asked[first], asked[second]


def _shapes(checker: CollisionChecker, geoms: Numbers, joints: Joints) -> ConvexShapes:
    """These geoms, where they are now."""
    model = checker.model
    data = checker.data
    solids, radii = zip(*(_solid(model, geom) for geom in geoms.tolist()), strict=True)
    counts = np.array([len(solid) for solid in solids])
    rounding = np.array(radii)
    ends = np.cumsum(counts)
    begins = ends - counts
    owner = np.repeat(np.arange(len(geoms)), counts)
    local: Matrix = np.concatenate(solids)
    low = np.minimum.reduceat(local, begins)
    high = np.maximum.reduceat(local, begins)
    middles = 0.5 * (low + high)
    far = np.maximum.reduceat(((local - middles[owner]) ** 2).sum(axis=1), begins)
    turns = data.geom_xmat[geoms].reshape(-1, 3, 3)
    places = data.geom_xpos[geoms]
    corners = np.einsum("nij,nj->ni", turns[owner], local) + places[owner]
    flat = model.geom_type[geoms] == _GEOM.mjGEOM_PLANE
    moved = _moved(checker, geoms)
    return ConvexShapes(
        corners=corners,
        heaps=np.stack((begins, ends, moved), axis=1),
        radii=rounding,
        centers=places + np.einsum("nij,nj->ni", turns, middles),
        bounds=np.where(flat, np.inf, np.sqrt(far) + rounding),
        turns=turns.copy(),
        halves=0.5 * (high - low) + rounding[:, None],
        normals=np.where(flat[:, None], turns[:, :, 2], 0.0),
        reaches=_reaches(joints, moved, corners, owner, begins, rounding),
    )


def _moved(checker: CollisionChecker, geoms: Numbers) -> Numbers:
    """How many joints move each geom, of shape (n,)."""
    model = checker.model
    moved = np.zeros(len(geoms), np.int64)
    links = model.jnt_bodyid[checker.joint_ids].tolist()
    for i in np.flatnonzero(checker.moving[geoms]).tolist():
        last = last_joint(model, links, int(model.geom_bodyid[geoms[i]]))
        moved[i] = 0 if last is None else last + 1
    return moved


def _reaches(
    joints: Joints,
    moved: Numbers,
    corners: Matrix,
    owner: Numbers,
    begins: Numbers,
    rounding: Vector,
) -> Matrix:
    """Meters that any point is moved at most by a radian of each joint, of shape (n, dof).

    The distance from the axis of the last joint that moves it, then from joint to joint, stretched
    out: it holds in every configuration.
    """
    anchors = joints.anchors
    last = np.maximum(moved - 1, 0)
    arms = corners - anchors[last][owner]
    squares = (arms**2).sum(axis=1)
    across = squares - (arms * joints.axes[last][owner]).sum(axis=1) ** 2
    nearest = np.sqrt(np.maximum(np.maximum.reduceat(across, begins), 0.0)) + rounding
    farthest = np.sqrt(np.maximum.reduceat(squares, begins)) + rounding
    steps = np.linalg.norm(np.diff(anchors, axis=0), axis=1)
    along = np.concatenate(((0.0,), np.cumsum(steps)))
    joint = np.arange(len(anchors))
    reaches: Matrix = farthest[:, None] + along[last][:, None] - along
    reaches[np.arange(len(moved)), last] = nearest
    reaches[joint >= moved[:, None]] = 0.0
    return reaches


def _solid(model: mujoco.MjModel, geom: int) -> tuple[Matrix, float]:
    """Corners in the geom's own frame, of shape (n, 3), and the radius that rounds them, in m."""
    kind = int(model.geom_type[geom])
    size = model.geom_size[geom]
    if kind == _GEOM.mjGEOM_BOX:
        return _SIGNS * size, 0.0
    if kind == _GEOM.mjGEOM_MESH:
        mesh = int(model.geom_dataid[geom])
        start = int(model.mesh_vertadr[mesh])
        graph = int(model.mesh_graphadr[mesh])
        vertices = model.mesh_vert[start : start + model.mesh_vertnum[mesh]].astype(float)
        if graph < 0:
            return vertices, 0.0
        count = int(model.mesh_graph[graph])
        chosen = model.mesh_graph[graph + 2 + count : graph + 2 + 2 * count]
        return vertices[chosen], 0.0
    if kind == _GEOM.mjGEOM_CYLINDER:
        ring = np.hstack((size[0] * _RING, np.full((_SIDES, 1), size[1])))
        return np.vstack((ring, ring * (1.0, 1.0, -1.0))), 0.0
    if kind == _GEOM.mjGEOM_CAPSULE:
        return np.array(((0.0, 0.0, size[1]), (0.0, 0.0, -size[1]))), float(size[0])
    if kind == _GEOM.mjGEOM_SPHERE:
        return _POINT, float(size[0])
    if kind == _GEOM.mjGEOM_PLANE:
        return _POINT, 0.0
    raise UnknownShapeError(f"a shape of kind {kind}")


# Whether a long way is clear, by machine code: MuJoCo need not look at all of it then.


_LONG_M: Final = 2.0
"""Meters that the arm moves from which it pays: to gather its shapes takes as long as MuJoCo's
looks at 0.7 m, and to load the code 30 ms in each process."""

_SAMPLES: Final = 12
"""Configurations at which MuJoCo confirms it, the ends among them."""


def is_clear(checker: CollisionChecker, rows: Matrix) -> bool | None:
    """Whether nothing is touched on a way; None where that is not certain, or the way is short.

    What touches at neither end touches nowhere in between, not by a hair; where it is clear, each
    look of MuJoCo's at the way would find nothing, either.

    Args:
        checker: Test of configurations that holds for the way.
        rows: Configurations, of shape (n, dof), rad, straight from one to the next.
    """
    if float((np.abs(np.diff(rows, axis=0)) @ checker.radii).sum()) < _LONG_M:
        return None
    picked = np.linspace(0.0, len(rows) - 1.0, _SAMPLES)
    low = np.minimum(picked.astype(int), len(rows) - 2)
    between = rows[low] + (picked - low)[:, None] * (rows[low + 1] - rows[low])
    if not all(checker.free(q) for q in between):
        return False
    return True if _keeps_off(checker, rows) else None


def _keeps_off(checker: CollisionChecker, rows: Matrix) -> bool:
    from bt_dualarm.collision.swept_kernels import first_too_near

    try:
        arm = swept(checker, (rows[0], rows[-1]))
    except UnknownShapeError:
        return False
    hints = arm.pairs.apart.copy()
    spent = np.zeros(1, np.int64)
    rows = np.ascontiguousarray(rows)
    return first_too_near(arm, rows, checker.radii, hints, spent) == len(rows)
