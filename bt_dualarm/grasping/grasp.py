"""Solids, grasps on them, and the minimum force with which a grip holds a load.

- A `Solid` has extents, signed distances and rays in its own frame. `Box`, `Cylinder` and `Capsule`
  are centered at its origin; `MeshSolid` is a closed surface of triangles; `CompoundSolid` consists
  of several others.
- `Grasp` is a pose of the tool on an object, with its force and margin.
- `JawMeasures` and `CupMeasures` are what counts of a gripper; their tool frame has its z axis out
  of the tool. A parallel gripper closes along y, with the tool frame in the middle of its pads.
- `pinching_force` models the pads as soft fingers, `suction_force` the rim of a cup as a ring.
- `pad_contact` and `held` find where flat pads touch a solid.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
import scipy

from bt_dualarm.core.pose import Matrix, Pose, Vector

_GRAZING = 1e-12
"""Volume below which a ray counts as parallel to a triangle, m³."""

_SHARP = math.cos(math.radians(20.0))
"""Cosine of the smallest angle between the normals of two faces at an edge that counts as sharp."""

_SAME = 1e-9
"""Tolerance for rounding, in m and in barycentric coordinates."""


class Form(NamedTuple):
    """Solid in its own frame.

    Attributes:
        kind: `BOX`, `CYLINDER`, `CAPSULE`, `CONVEX` or `TRIANGLES`.
        numbers: Half edges of a box, or radius and half length of a cylinder or capsule, in one
            row, m. Of the last two kinds, one row per triangle, of shape (n, 13): its three
            corners, its outward unit normal, and the distance of its plane from the origin.
    """

    kind: int
    numbers: Matrix


class Solid:
    """Base of all solids: `form` is all that a subclass has to provide."""

    @property
    def form(self) -> Form:
        """Solid as an array for the kernels."""
        raise NotImplementedError

    def reach(self, direction: Vector) -> float:
        """Support function: largest coordinate along a unit vector of shape (3,), m."""
        from bt_dualarm.grasping.grasp_kernels import reach

        return reach(*self.form, np.ascontiguousarray(direction, dtype=float))

    def distance(self, points: Matrix) -> Vector:
        """Signed distances of points of shape (n, 3), negative inside; of shape (n,), m.

        Exact except outside a convex mesh: there, the distance of the farthest plane, a lower
        bound.
        """
        from bt_dualarm.grasping.grasp_kernels import distances

        return distances(*self.form, np.ascontiguousarray(points, dtype=float))


@dataclass(frozen=True, eq=False)
class Box(Solid):
    """Box around the origin.

    Attributes:
        half: Half of its edges, of shape (3,), m.
    """

    half: Vector

    @cached_property
    def form(self) -> Form:
        """See `Solid.form`."""
        from bt_dualarm.grasping.grasp_kernels import BOX

        return Form(BOX, np.array([self.half], dtype=float))


@dataclass(frozen=True, eq=False)
class Cylinder(Solid):
    """Cylinder around the z axis.

    Attributes:
        radius: Radius, m.
        half_length: Half of its length, m.
    """

    radius: float
    half_length: float

    @cached_property
    def form(self) -> Form:
        """See `Solid.form`."""
        from bt_dualarm.grasping.grasp_kernels import CYLINDER

        return Form(CYLINDER, np.array([[self.radius, self.half_length]], dtype=float))


@dataclass(frozen=True, eq=False)
class Capsule(Solid):
    """Capsule around the z axis, or a sphere.

    Attributes:
        radius: Radius, m.
        half_length: Half of the straight part, m; 0 for a sphere.
    """

    radius: float
    half_length: float = 0.0

    @cached_property
    def form(self) -> Form:
        """See `Solid.form`."""
        from bt_dualarm.grasping.grasp_kernels import CAPSULE

        return Form(CAPSULE, np.array([[self.radius, self.half_length]], dtype=float))


@dataclass(frozen=True, eq=False)
class MeshSolid(Solid):
    """Volume bounded by triangles, whose corners run counterclockwise seen from outside.

    Attributes:
        corners: Corners of the triangles, of shape (n, 3, 3): triangle, corner, coordinate, m.
    """

    corners: npt.NDArray[np.float64]

    @classmethod
    def hull_of(cls, points: Matrix) -> MeshSolid:
        """Convex hull of points of shape (n, 3), m."""
        hull = scipy.spatial.ConvexHull(points)
        corners = points[hull.simplices]
        normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        # Qhull orients its equations outward, but not its triangles.
        inward = np.einsum("ij,ij->i", normal, hull.equations[:, :3]) < 0.0
        corners[inward] = corners[inward][:, ::-1]
        return cls(corners)

    @cached_property
    def normals(self) -> Matrix:
        """Unit normals of the triangles, outward, of shape (n, 3)."""
        across = np.cross(
            self.corners[:, 1] - self.corners[:, 0], self.corners[:, 2] - self.corners[:, 0]
        )
        unit: Matrix = across / np.linalg.norm(across, axis=1)[:, None]
        return unit

    @cached_property
    def is_convex(self) -> bool:
        """Whether no corner lies outside the plane of any triangle."""
        return bool((self.corners.reshape(-1, 3) @ self.normals.T - self._planes).max() < _SAME)

    @cached_property
    def _planes(self) -> Vector:
        """Distances of the triangles' planes from the origin, of shape (n,), m."""
        planes: Vector = np.einsum("ij,ij->i", self.corners[:, 0], self.normals)
        return planes

    @cached_property
    def form(self) -> Form:
        """See `Solid.form`; a convex mesh has a faster, approximate distance outside."""
        from bt_dualarm.grasping.grasp_kernels import CONVEX, TRIANGLES

        kind = CONVEX if self.is_convex else TRIANGLES
        rows = (self.corners.reshape(-1, 9), self.normals, self._planes[:, None])
        return Form(kind, np.hstack(rows))

    def sample(self, number: int, rng: np.random.Generator) -> tuple[Matrix, Matrix]:
        """Points uniform over the surface, and their normals, each of shape (number, 3)."""
        a, b, c = self.corners.transpose(1, 0, 2)
        area = np.linalg.norm(np.cross(b - a, c - a), axis=1)
        chosen = rng.choice(len(area), number, p=area / area.sum())
        # The square root makes points uniform over a triangle (R. Osada et al., Shape
        # distributions, ACM Transactions on Graphics 21(4), 2002).
        s = np.sqrt(rng.uniform(size=number))[:, None]
        t = rng.uniform(size=number)[:, None]
        points = (1 - s) * a[chosen] + s * (1 - t) * b[chosen] + s * t * c[chosen]
        return points, self.normals[chosen]

    @cached_property
    def edges(self) -> tuple[Matrix, Matrix]:
        """Middles of the sharp, convex edges, m, and unit vectors halfway between their faces.

        Both of shape (n, 3), the longest edge first. Edges between triangles of one face, or of a
        smoothly curved surface, do not count, nor do those less than half as long as the longest.
        """
        triangles: dict[tuple[tuple[float, ...], ...], list[tuple[int, int]]] = {}
        for index, corners in enumerate(self.corners):
            for k in range(3):
                ends = sorted(tuple(np.round(corners[i], 6).tolist()) for i in (k, (k + 1) % 3))
                triangles.setdefault(tuple(ends), []).append((index, k))
        found = []
        for beside in triangles.values():
            if len(beside) != 2:
                continue
            (first, k), (second, _) = beside
            start, end = self.corners[first][[k, (k + 1) % 3]]
            one, other = self.normals[[first, second]]
            middle = 0.5 * (start + end)
            apart = self.corners[second].mean(axis=0) - middle
            if float(one @ other) < _SHARP and float(one @ apart) < 0.0:
                outward = one + other
                length = np.linalg.norm(outward)
                if length > _SAME:
                    found.append((float(np.linalg.norm(end - start)), middle, outward / length))
        longest = max((length for length, _, _ in found), default=0.0)
        found = [edge for edge in found if edge[0] >= 0.5 * longest]
        found.sort(key=lambda edge: -edge[0])
        middles = np.array([edge[1] for edge in found]).reshape(-1, 3)
        return middles, np.array([edge[2] for edge in found]).reshape(-1, 3)

    @cached_property
    def faces(self) -> tuple[Matrix, Matrix]:
        """Centers of the flat faces, m, and their unit normals, both of shape (n, 3), by area."""
        a, b, c = self.corners.transpose(1, 0, 2)
        areas = 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1)
        planes = np.round(np.column_stack((self.normals, self._planes)), 6) + 0.0  # no -0
        order = np.lexsort(planes.T)
        starts = np.flatnonzero((np.diff(planes[order], axis=0) != 0.0).any(axis=1)) + 1
        groups = sorted(np.split(order, starts), key=lambda group: -float(areas[group].sum()))
        middles = self.corners.mean(axis=1)
        centers = [areas[group] @ middles[group] / areas[group].sum() for group in groups]
        return np.array(centers), self.normals[[group[0] for group in groups]]

    def farthest_hit(self, origin: Vector, direction: Vector) -> tuple[Vector, Vector] | None:
        """Last intersection of a ray with the surface, and the normal there, each of shape (3,).

        Args:
            origin: Origin of the ray, of shape (3,), m.
            direction: Unit vector of its direction, of shape (3,).

        Returns:
            None if there is no intersection.
        """
        along = self._intersections(origin, direction)
        ahead = np.flatnonzero(along > _SAME)  # not the triangle on which the ray begins
        if not len(ahead):
            return None
        last = ahead[int(along[ahead].argmax())]
        return origin + along[last] * direction, self.normals[last]

    def _intersections(self, origin: Vector, direction: Vector) -> Vector:
        """Distance along a ray to each triangle, of shape (n,), m; minus infinity if it misses.

        T. Möller, B. Trumbore, Fast, minimum storage ray-triangle intersection, Journal of Graphics
        Tools 2(1), 1997.
        """
        first = self.corners[:, 0]
        one = self.corners[:, 1] - first
        two = self.corners[:, 2] - first
        across = np.cross(direction, two)
        volume = np.einsum("ij,ij->i", one, across)
        safe = np.where(np.abs(volume) < _GRAZING, np.inf, volume)
        to = origin - first
        u = np.einsum("ij,ij->i", to, across) / safe
        turned = np.cross(to, one)
        v = turned @ direction / safe
        along = np.einsum("ij,ij->i", two, turned) / safe
        within = (u >= -_SAME) & (v >= -_SAME) & (u + v <= 1 + _SAME) & np.isfinite(safe)
        distances: Vector = np.where(within, along, -np.inf)
        return distances


@dataclass(frozen=True, eq=False)
class CompoundSolid(Solid):
    """Union of convex solids.

    Attributes:
        parts: Each solid with its pose in the frame of the union.
        envelopes: Solids whose surface the union has in common with its convex hull, with their
            poses: the outside of a cup, around which fingers close as around a can.
        graspable: Indices of the parts on which grasps are searched.
        surfaces: Points on the surface of each part in the frame of the union, close enough that
            none of it passes between a gripper's parts unseen, each of shape (n, 3), m.
    """

    parts: tuple[tuple[Solid, Pose], ...]
    envelopes: tuple[tuple[Solid, Pose], ...] = ()
    graspable: tuple[int, ...] = ()
    surfaces: tuple[Matrix, ...] = ()

    @property
    def form(self) -> Form:
        """Not available: kernels take one solid at a time."""
        raise TypeError("a compound has no single form; only its parts do")

    def reach(self, direction: Vector) -> float:
        """See `Solid.reach`."""
        return max(
            float(pose.position @ direction) + solid.reach(direction @ pose.rotation_matrix)
            for solid, pose in self.parts
        )

    def distance(self, points: Matrix) -> Vector:
        """Signed distances to the nearest part; see `Solid.distance`."""
        each = [solid.distance(pose.inverse.apply(points)) for solid, pose in self.parts]
        nearest: Vector = np.min(each, axis=0)
        return nearest


def solid_of(shape: str, size: Sequence[float]) -> Solid:
    """Solid of a shape as declared in a tree file.

    Args:
        shape: ``box``, ``cylinder``, ``capsule`` or ``sphere``.
        size: Edges of a box; radius and length of a cylinder; radius and length of the straight
            part of a capsule; radius of a sphere; m.

    Raises:
        ValueError: Another shape.
    """
    if shape == "box":
        return Box(0.5 * np.asarray(size, dtype=float))
    if shape == "cylinder":
        return Cylinder(float(size[0]), 0.5 * float(size[1]))
    if shape == "capsule":
        return Capsule(float(size[0]), 0.5 * float(size[1]))
    if shape == "sphere":
        return Capsule(float(size[0]))
    raise ValueError(f"{shape!r} cannot be grasped; box, cylinder, capsule and sphere can")


_DIRECTIONS = np.array([d for d in itertools.product((-1.0, 0.0, 1.0), repeat=3) if any(d)])

SHAKE_DIRECTIONS: Matrix = _DIRECTIONS / np.linalg.norm(_DIRECTIONS, axis=1)[:, None]
"""Directions of the tool's acceleration under which a grip must hold: the faces, edges and corners
of a cube, of unit length, of shape (26, 3)."""


@dataclass(frozen=True, eq=False)
class Grasp:
    """Grasp of an object.

    Attributes:
        tool: Pose of the tool frame in the object's frame.
        width: Distance of the pads on contact, m; 0 for suction.
        force: Minimum force that holds the load, of each pad or of the suction, N.
        margin: Largest force of the gripper divided by that force.
        ahead: Distance of the fingertips from other parts of the object before them, m.
    """

    tool: Pose
    width: float
    force: float
    margin: float
    ahead: float = math.inf


@dataclass(frozen=True, eq=False)
class JawMeasures:
    """Dimensions of a parallel gripper with two fingers.

    Attributes:
        least_opening: Distance of the pads when closed, m.
        widest_opening: Distance of the pads when open, m.
        pad_length: Length of a pad along the tool's z axis, m.
        pad_width: Width of a pad along the tool's x axis, m.
        palm: Distance from the tool frame back to the palm, m.
        tip: Distance from the tool frame forward to the fingertips, m.
        thickness: Thickness of a finger along the tool's y axis, m.
        least_force: Minimum force of each pad on a grasped object, N.
        most_force: Largest force of each pad on a grasped object, N.
        friction: Coefficient of sliding friction of the pads.
        pad_center: Distance from the tool frame to the center of the pads, along z, m.
        palm_radius: Radius of the palm about the tool's z axis, m.
    """

    least_opening: float
    widest_opening: float
    pad_length: float
    pad_width: float
    palm: float
    tip: float
    thickness: float
    least_force: float
    most_force: float
    friction: float
    pad_center: float = 0.0
    palm_radius: float = 0.04


@dataclass(frozen=True, eq=False)
class CupMeasures:
    """Dimensions of a suction cup with its rim at the tool frame.

    Attributes:
        radius: Radius of the rim, m.
        bends: Depth by which the rim adapts to a curved surface, m.
        most_force: Largest suction force, N.
        friction: Coefficient of sliding friction of the rim.
        length: Distance from the rim back to the arm's flange, m; 0 for three radii.
    """

    radius: float
    bends: float
    most_force: float
    friction: float
    length: float = 0.0


@dataclass(frozen=True, eq=False)
class Load:
    """Load on a grip.

    Attributes:
        mass: Mass, kg.
        gravity: Acceleration of gravity in the object's frame, of shape (3,), m/s².
        shake: Largest acceleration of the tool in any direction, m/s².
        center: Center of mass in the object's frame, of shape (3,), m.
    """

    mass: float
    gravity: Vector
    shake: float
    center: Vector


def pinching_force(
    load: Load, center: Vector, axis: Vector, width: float, levers: float, friction: float
) -> float:
    """Minimum force of each of two pads that holds a load under any acceleration of the tool, N.

    A pad is a soft finger (R. M. Murray, Z. Li, S. S. Sastry, A Mathematical Introduction to
    Robotic Manipulation, 1994, chapter 5): a normal force, friction in its plane, and a frictional
    moment about the normal. The limit of both together is an ellipsoid, the limit surface (R. D.
    Howe, M. R. Cutkosky, Practical force-motion models for sliding manipulation, IJRR 1996). A
    moment across the grasp axis is balanced by opposite forces in the planes of the pads; a shift
    of pressure within a pad is neglected. A force along the axis loads one pad and relieves the
    other.

    Args:
        load: Mass, gravity, shake and center of mass, in the object's frame.
        center: Center between the pads, of shape (3,), m.
        axis: Unit vector along which the pads close, of shape (3,).
        width: Distance of the pads, m.
        levers: Lever of the frictional moment about the normal: the smaller one of both pads, m.
        friction: Coefficient of friction, reduced by the slope of the surface.

    Returns:
        Force in N; infinite if friction or its moment cannot hold the load.
    """
    needed = pinching_forces(shaken(load), load.center - center, axis, width, levers, friction)
    return float(needed.max())


def pinching_forces(
    forces: Matrix,
    offset: Vector,
    axis: Vector,
    width: float,
    lever: float,
    friction: float,
    moments: Matrix | None = None,
) -> Vector:
    """Minimum force of each of two pads under each of several loads, of shape (n,), N.

    Args:
        forces: Forces on the object at its center of mass, of shape (n, 3), N.
        offset: Vector from the center between the pads to the center of mass, of shape (3,), m.
        axis: Unit vector along which the pads close, of shape (3,).
        width: Distance of the pads, m.
        lever: Lever of the frictional moment about the normal: the smaller one of both pads, m.
        friction: Coefficient of friction, reduced by the slope of the surface.
        moments: Moments on the object besides, of shape (n, 3), N m; none by default.

    Returns:
        Forces; infinite if friction or its moment cannot hold a load.
    """
    from bt_dualarm.grasping.grasp_kernels import pinch

    # The kernel is compiled for contiguous arrays of floats alone.
    if moments is None:
        moments = np.zeros_like(forces)
    forces, moments, offset, axis = (
        np.ascontiguousarray(array, dtype=float) for array in (forces, moments, offset, axis)
    )
    return pinch(forces, moments, offset, axis, float(width), float(lever), float(friction))


def suction_force(load: Load, place: Vector, normal: Vector, cup: CupMeasures) -> float:
    """Minimum suction force of a cup that holds a load under any acceleration of the tool, N.

    The rim is a ring that can be pulled off, slide, turn and tip: J. Mahler, M. Matl, X. Liu, A.
    Li, D. Gealy, K. Goldberg, Dex-Net 3.0, ICRA 2018.

    Args:
        load: Mass, gravity, shake and center of mass, in the object's frame.
        place: Center of the rim on the object, of shape (3,), m.
        normal: Unit vector from the object to the cup, of shape (3,).
        cup: Measures of the cup.
    """
    return float(suction_forces(shaken(load), load.center - place, normal, cup).max())


def suction_forces(
    forces: Matrix,
    offset: Vector,
    normal: Vector,
    cup: CupMeasures,
    moments: Matrix | None = None,
) -> Vector:
    """Minimum suction force of a cup under each of several loads, of shape (n,), N.

    Args:
        forces: Forces on the object at its center of mass, of shape (n, 3), N.
        offset: Vector from the center of the rim to the center of mass, of shape (3,), m.
        normal: Unit vector from the object to the cup, of shape (3,).
        cup: Measures of the cup.
        moments: Moments on the object besides, of shape (n, 3), N m; none by default.
    """
    if cup.friction <= 0.0:
        return np.full(len(forces), math.inf)
    levered = np.asarray(np.cross(offset, forces), dtype=float)
    moments = levered if moments is None else levered + moments
    # Suction minus the pull on the object presses the rim on. That must be enough for friction to
    # hold against sliding and turning about the normal, and to keep the rim from tipping off.
    pulling = np.maximum(-(forces @ normal), 0.0)
    sliding = np.hypot(_across(forces, normal), np.abs(moments @ normal) / cup.radius)
    tipping = _across(moments, normal) / cup.radius
    needed: Vector = pulling + np.maximum(sliding / cup.friction, tipping)
    return needed


def shaken(load: Load) -> Matrix:
    """Forces on a load at its center of mass, one per direction of shake, of shape (26, 3), N."""
    forces: Matrix = load.mass * (load.gravity + load.shake * SHAKE_DIRECTIONS)
    return forces


def _across(vectors: Matrix, axis: Vector) -> Vector:
    """Lengths of the components of vectors, of shape (n, 3), across a unit axis; of shape (n,)."""
    lengths: Vector = np.linalg.norm(vectors - (vectors @ axis)[:, None] * axis, axis=1)
    return lengths


@dataclass(frozen=True, eq=False)
class PadContact:
    """Contact patch of a pad.

    Attributes:
        middle: Center of the patch, of shape (3,), m.
        share: Fraction of the pad in contact, in [0, 1].
        lever: Mean distance of the patch from its center, m: times the friction force, the largest
            frictional moment about the normal under even pressure.
        slope: Smallest angle between the normals of pad and surface in the patch, rad.
    """

    middle: Vector
    share: float
    lever: float
    slope: float


@dataclass(frozen=True, eq=False)
class PadHold:
    """Solid between two pads.

    Attributes:
        center: Center between both contact patches, of shape (3,), m.
        width: Distance of the pads, m.
        lever: Smaller one of both pads' levers, m.
        tilt: Largest of the angles between the pads' normal and the surface on either side, or the
            line between the patches, rad.
    """

    center: Vector
    width: float
    lever: float
    tilt: float


def pad_contact(
    solid: Solid, center: Vector, normal: Vector, along: Vector, size: Vector
) -> PadContact | None:
    """Contact patch of one pad that approaches a solid from outside; None if it misses the solid.

    Args:
        solid: Solid against which it is pressed.
        center: Any point on the line along which the pad's center approaches, of shape (3,), m.
        normal: Unit vector from the solid to the pad, of shape (3,).
        along: Unit vector along the pad's length, perpendicular to the normal, of shape (3,).
        size: Length and width of the pad, of shape (2,), m.
    """
    from bt_dualarm.grasping.grasp_kernels import press

    met = np.empty(6)
    if not press(*solid.form, center, normal, along, size, met):
        return None
    return PadContact(met[:3], float(met[3]), float(met[4]), float(met[5]))


def held(solid: Solid, center: Vector, axis: Vector, along: Vector, size: Vector) -> PadHold | None:
    """Contact of two pads that close along an axis; None if one of them misses the solid.

    Args:
        solid: Solid between them.
        center: Point on the line between the pads' centers, of shape (3,), m.
        axis: Unit vector along which they close, of shape (3,).
        along: Unit vector along the pads' length, perpendicular to the axis, of shape (3,).
        size: Length and width of a pad, of shape (2,), m.
    """
    from bt_dualarm.grasping.grasp_kernels import hold

    between = np.empty(6)
    if not hold(*solid.form, center, axis, along, size, between):
        return None
    return PadHold(between[:3], float(between[3]), float(between[4]), float(between[5]))
