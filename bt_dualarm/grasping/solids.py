"""Solids to grasp, in frames of their own: extents, signed distances, rays.

`Box`, `Cylinder` and `Capsule` are centered at the origin of their frame; `MeshSolid` is a closed
surface of triangles.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt
import scipy

from bt_dualarm.core.pose import Matrix, Vector
from bt_dualarm.grasping.kernel_forms import BOX, CAPSULE, CONVEX, CYLINDER, TRIANGLES, Form

_GRAZING = 1e-12
"""Volume below which a ray counts as parallel to a triangle, m³."""

_SAME = 1e-9
"""Tolerance for rounding, in m and in barycentric coordinates."""


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
    raise ValueError(f"{shape!r} is no shape to grasp: box, cylinder, capsule and sphere are")
