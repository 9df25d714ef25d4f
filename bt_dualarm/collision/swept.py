"""Continuous collision checks of straight motions in joint space, and the model that they read.

`is_clear` determines whether a path is free without sampling it densely; planners check the edges
of their trees with an implementation of `Edges`. `swept_arm` converts the geoms of a
`CollisionChecker` to the arrays of `swept_kernels`.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable
from typing import Final, Protocol

import mujoco
import numpy as np

from bt_dualarm.collision.checker import FINE, CollisionChecker, interpolated, last_joint
from bt_dualarm.collision.kernel_arrays import ConvexShapes, Joints, Numbers, Pairs, SweptArm
from bt_dualarm.core.pose import Matrix, Vector
from bt_dualarm.sim.object_body import BALL_LOSS, unit_ball

CLEARANCE: Final = 2.5e-3
"""Distance that shapes keep on top of their smallest distances, m: to pass anything closer would
take many checks."""

_LONG_M: Final = 2.0
"""Length of a path, as motion of the arm, above which compiled checks pay off, m: to gather the
shapes takes as long as MuJoCo's checks of 0.7 m, and to load the code 30 ms in each process."""

_SAMPLES: Final = 12
"""Configurations at which MuJoCo confirms the result, both ends among them."""

_SIDES: Final = 24
"""Sides of the prism that circumscribes a cylinder: its corners are 0.9 % farther from the axis."""

_GEOM: Final = mujoco.mjtGeom

_SIGNS: Final = np.array(np.meshgrid((-1.0, 1.0), (-1.0, 1.0), (-1.0, 1.0))).T.reshape(-1, 3)
"""Corners of a cube with edges of length 2."""

_POINT: Final = np.zeros((1, 3))

_ANGLES: Final = 2.0 * np.pi * np.arange(_SIDES) / _SIDES
_RING: Final = np.stack((np.cos(_ANGLES), np.sin(_ANGLES)), axis=1) / np.cos(np.pi / _SIDES)


class UnknownShapeError(ValueError):
    """Shape or joint that the kernels do not support."""


def is_clear(checker: CollisionChecker, rows: Matrix) -> bool | None:
    """Whether a path is free of collisions; None if that is uncertain, or the path is short.

    True is stricter than samples: pairs in contact at neither end do not touch in between at all,
    so that MuJoCo's checks of any configuration on the path would find no collision, either.

    Args:
        checker: Collision checker for the path.
        rows: Configurations, of shape (n, dof), rad, joined by straight segments.
    """
    if float((np.abs(np.diff(rows, axis=0)) @ checker.radii).sum()) < _LONG_M:
        return None
    # MuJoCo confirms the compiled checks at a few configurations. It comes first because it can
    # reject: the compiled checks are bounds, which can only accept.
    picked = np.linspace(0.0, len(rows) - 1.0, _SAMPLES)
    low = np.minimum(picked.astype(int), len(rows) - 2)
    between = rows[low] + (picked - low)[:, None] * (rows[low + 1] - rows[low])
    if not all(checker.free(q) for q in between):
        return False
    from bt_dualarm.collision.swept_kernels import first_too_near

    try:
        arm = swept_arm(checker, (rows[0], rows[-1]))
    except UnknownShapeError:
        return None
    hints = arm.pairs.directions.copy()
    checks = np.zeros(1, np.int64)
    rows = np.ascontiguousarray(rows)
    # Too close for the bounds is not yet a collision: return None, and the caller samples the path.
    return True if first_too_near(arm, rows, checker.radii, hints, checks) == len(rows) else None


def swept_arm(checker: CollisionChecker, ends: Iterable[Vector] = ()) -> SweptArm:
    """Model of an arm in its world for the kernels, equivalent to a collision checker.

    Args:
        checker: Collision checker of the arm; the reference configuration is its current one.
        ends: Configurations at the ends of a path, each of shape (dof,), rad: pairs in contact
            there may penetrate as far as the checker allows, all others must not touch.

    Raises:
        UnknownShapeError: A shape is not a fixed plane, sphere, capsule, cylinder, box or convex
            mesh, or a joint is not revolute.
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
    moved = shapes.ranges[:, 2]
    flat = np.isinf(shapes.bounds)
    # The kernels expect the shape on the later link first, and a plane second.
    swapped = (moved[one] < moved[other]) | flat[one]
    one, other = np.where(swapped, other, one), np.where(swapped, one, other)
    if flat[one].any() or moved[flat].any():
        raise UnknownShapeError("a plane that an arm carries")
    # Initial directions for GJK; the offset keeps them from zero for concentric shapes.
    directions = shapes.centers[one] - shapes.centers[other] + 1e-6
    for (low, high), normal in touching.items():
        for p in np.flatnonzero((first == low) & (second == high)):
            least[p] = checker.least[low, high]
            # The normal points from the lower id to the higher, a direction from second to first.
            directions[p] = normal if swapped[p] else -normal
    # Shapes that the same joints move keep their distance whatever the arm does.
    relative = moved[one] != moved[other]
    pairs = Pairs(*(column[relative].copy() for column in (one, other, least, directions)))
    return SweptArm(joints, shapes, pairs, CLEARANCE)


def _touching(checker: CollisionChecker, ends: Iterable[Vector]) -> dict[tuple[int, int], Vector]:
    """Pairs of geoms in contact at the ends, lower id first, with the normal from it, (3,)."""
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
        raise UnknownShapeError("a joint that is not revolute")
    return Joints(checker.present.copy(), data.xanchor[ids].copy(), data.xaxis[ids].copy())


def _pairs(checker: CollisionChecker) -> tuple[Numbers, Numbers]:
    """Ids of the geoms of each pair to check, the lower id first, each of shape (p,).

    These are the pairs that MuJoCo's own filters pass: different rigid bodies that are not parent
    and child, and whose bits match.
    """
    model = checker.model
    checked = np.flatnonzero((model.geom_conaffinity != 0) | (model.geom_contype != 0))
    types = model.geom_contype[checked]
    affinities = model.geom_conaffinity[checked]
    bodies = model.geom_bodyid[checked]
    welds = model.body_weldid[bodies]
    above = model.body_weldid[model.body_parentid[welds]]
    kept = (types[:, None] & affinities) != 0
    kept |= kept.T
    kept &= welds[:, None] != welds
    # The world (weld id 0) is not a parent in this sense: an arm's first link may hit the floor.
    related = (welds[:, None] == above) & (welds[:, None] != 0) & (welds != 0)
    kept &= ~(related | related.T)
    # MuJoCo's encoding of pairs excluded in the model, by the bodies' ids.
    signatures = (bodies[:, None].astype(np.int64) << 16) + bodies
    excluded = np.isin(signatures, model.exclude_signature)
    kept &= ~(excluded | excluded.T)
    kept &= np.isfinite(checker.least[np.ix_(checked, checked)])
    first, second = np.nonzero(np.triu(kept, 1))
    return checked[first], checked[second]


def _shapes(checker: CollisionChecker, geoms: Numbers, joints: Joints) -> ConvexShapes:
    """Shapes of geoms at their current poses."""
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
    # Bounding boxes and spheres share their center: one transform places both.
    middles = 0.5 * (low + high)
    far = np.maximum.reduceat(((local - middles[owner]) ** 2).sum(axis=1), begins)
    rotations = data.geom_xmat[geoms].reshape(-1, 3, 3)
    places = data.geom_xpos[geoms]
    corners = np.einsum("nij,nj->ni", rotations[owner], local) + places[owner]
    flat = model.geom_type[geoms] == _GEOM.mjGEOM_PLANE
    moved = _moved(checker, geoms)
    return ConvexShapes(
        corners=corners,
        ranges=np.stack((begins, ends, moved), axis=1),
        radii=rounding,
        centers=places + np.einsum("nij,nj->ni", rotations, middles),
        bounds=np.where(flat, np.inf, np.sqrt(far) + rounding),
        rotations=rotations.copy(),
        half_extents=0.5 * (high - low) + rounding[:, None],
        normals=np.where(flat[:, None], rotations[:, :, 2], 0.0),
        reaches=_reaches(joints, moved, corners, owner, begins, rounding),
    )


def _moved(checker: CollisionChecker, geoms: Numbers) -> Numbers:
    """Number of joints that move each geom, of shape (n,)."""
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
    """Largest motion of any point of each shape per radian of each joint, of shape (n, dof), m/rad.

    For the last joint that moves a shape, the distance from its axis; for earlier ones, the length
    of the stretched chain of anchors up to the farthest point. Valid in every configuration.
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
    """Corners in the geom's frame, of shape (n, 3), m, and the radius of inflation, m."""
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
        # Only the vertices of the convex hull. Their ids follow two counts and the edge address of
        # each of them.
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
    if kind == _GEOM.mjGEOM_ELLIPSOID:  # a polyhedron around it
        return size * unit_ball() / (1.0 - BALL_LOSS), 0.0
    if kind == _GEOM.mjGEOM_PLANE:
        return _POINT, 0.0
    raise UnknownShapeError(f"a geom of type {kind}")


class Edges(Protocol):
    """Collision check of edges, which counts its work."""

    @property
    def checked(self) -> int:
        """Number of configurations that have been checked so far."""
        ...

    def is_free(self, start: Vector, end: Vector) -> bool:
        """Whether the straight motion between two configurations, each of shape (dof,), is free."""
        ...


def is_path_free(edges: Edges, corners: Matrix) -> bool:
    """Whether straight motions from corner to corner, of shape (n, dof), rad, are free."""
    return all(edges.is_free(start, end) for start, end in itertools.pairwise(corners))


def path_length(corners: Matrix, radii: Vector) -> float:
    """Length of a path, its joints scaled to meters that the arm moves, m.

    Args:
        corners: Corners of the path, of shape (n, dof), rad.
        radii: Largest motion of the arm per radian of each joint, of shape (dof,), m/rad.
    """
    return float(np.linalg.norm(np.diff(corners, axis=0) * radii, axis=1).sum())


class CompiledEdges:
    """Edges checked as a whole by compiled distances between convex shapes.

    Nothing between two configurations is stepped over.

    Args:
        arm: Arm in its world.

    Attributes:
        arm: The same; a search may change its clearance, see `keep_clear`.
        hints: Directions in which each pair was apart when it was checked last, of shape (p, 3).
        spent: Number of configurations that have been checked, of shape (1,); kernels add to it.
    """

    def __init__(self, arm: SweptArm) -> None:
        self.arm = arm
        self.hints = arm.pairs.directions.copy()
        self.spent = np.zeros(1, np.int64)

    @property
    def checked(self) -> int:
        """Number of configurations that have been checked so far."""
        return int(self.spent[0])

    def keep_clear(self, clearance: float) -> None:
        """Set the clearance that shapes keep besides what they must, in m."""
        self.arm = self.arm._replace(clearance=clearance)

    def is_free(self, start: Vector, end: Vector) -> bool:
        """Whether the straight motion between two configurations, each of shape (dof,), is free."""
        from bt_dualarm.collision.swept_kernels import WHOLE, free_share

        return free_share(self.arm, start, end, WHOLE, self.hints, self.spent) == 1.0

    def is_dense_path_free(self, rows: Matrix, radii: Vector) -> bool:
        """Whether a dense path is free.

        Args:
            rows: Configurations, of shape (n, dof), rad.
            radii: Largest motion of the arm per radian of each joint, of shape (dof,), m/rad.
        """
        from bt_dualarm.collision.swept_kernels import first_too_near

        return first_too_near(self.arm, rows, radii, self.hints, self.spent) == len(rows)


class SampledEdges:
    """Edges checked by MuJoCo every `FINE` meters, for shapes that the kernels do not support.

    Args:
        checker: Collision checker of the arm.
    """

    def __init__(self, checker: CollisionChecker) -> None:
        self._checker = checker
        self._checked = 0

    @property
    def checked(self) -> int:
        """Number of configurations that have been checked so far."""
        return self._checked

    def is_free(self, start: Vector, end: Vector) -> bool:
        """Whether the straight motion between two configurations, each of shape (dof,), is free."""
        rows = interpolated(start, end, self._checker.radii, FINE)
        self._checked += len(rows)
        return self._checker.first_contact(rows) is None
