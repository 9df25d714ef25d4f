"""Solids in their own frame: extent, distances, and what a ray through them meets."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt
import scipy

from bt_dualarm.core.pose import Matrix, Vector
from bt_dualarm.grasping.kernel_forms import BOX, CAPSULE, CONVEX, CYLINDER, TRIANGLES, Form

# Solids in their own frame, centerd: how far they reach, and how far points are from them.


class Solid:
    """What grasps are looked for on."""

    @property
    def form(self) -> Form:
        """The solid in numbers."""
        raise NotImplementedError

    def reach(self, direction: Vector) -> float:
        """Largest coordinate in m along a unit direction of shape (3,): the support function."""
        from bt_dualarm.grasping.grasp_kernels import reach

        return reach(*self.form, np.ascontiguousarray(direction, dtype=float))

    def distance(self, points: Matrix) -> Vector:
        """Signed distances in m of points of shape (n, 3), negative inside; of shape (n,).

        Exact, but for a convex mesh: there, outside, it is that of the farthest plane.
        """
        from bt_dualarm.grasping.grasp_kernels import distances

        return distances(*self.form, np.ascontiguousarray(points, dtype=float))


@dataclass(frozen=True, eq=False)
class Box(Solid):
    """A box around the origin.

    Attributes:
        half: Half of its edges, of shape (3,), m.
    """

    half: Vector

    @cached_property
    def form(self) -> Form:
        """As `Solid.form`."""
        return Form(BOX, np.array([self.half], dtype=float))


@dataclass(frozen=True, eq=False)
class Cylinder(Solid):
    """A cylinder around the z axis.

    Attributes:
        radius: Radius in m.
        half_length: Half of its length in m.
    """

    radius: float
    half_length: float

    @cached_property
    def form(self) -> Form:
        """As `Solid.form`."""
        return Form(CYLINDER, np.array([[self.radius, self.half_length]], dtype=float))


@dataclass(frozen=True, eq=False)
class Capsule(Solid):
    """A ball moved along the z axis; a sphere where it is not moved.

    Attributes:
        radius: Radius in m.
        half_length: Half of the straight part in m, 0 of a sphere.
    """

    radius: float
    half_length: float = 0.0

    @cached_property
    def form(self) -> Form:
        """As `Solid.form`."""
        return Form(CAPSULE, np.array([[self.radius, self.half_length]], dtype=float))


def solid_of(shape: str, size: Sequence[float]) -> Solid:
    """The solid that a tree file declares.

    Args:
        shape: Name of the form: ``box``, ``cylinder``, ``capsule`` or ``sphere``.
        size: Edges of a box; radius and length of a cylinder, radius and length of the straight
            part of a capsule; radius of a sphere; m.

    Raises:
        ValueError: The form is none of these.
    """
    if shape == "box":
        return Box(0.5 * np.asarray(size, dtype=float))
    if shape == "cylinder":
        return Cylinder(float(size[0]), 0.5 * float(size[1]))
    if shape == "capsule":
        return Capsule(float(size[0]), 0.5 * float(size[1]))
    if shape == "sphere":
        return Capsule(float(size[0]))
    raise ValueError(f"no grasps are known of a {shape!r}: box, cylinder, capsule, sphere are")


# A closed surface of triangles as a solid: its distances, and what a ray through it meets.


_GRAZING = 1e-12
_SAME = 1e-9


@dataclass(frozen=True, eq=False)
class MeshSolid(Solid):
    """Triangles that bound a volume; their corners run anticlockwise seen from outside.

    Attributes:
        corners: Corners of the triangles, of shape (n, 3, 3): triangle, corner, coordinate; m.
    """

    corners: npt.NDArray[np.float64]

    @classmethod
    def hull_of(cls, points: Matrix) -> MeshSolid:
        """The convex hull of points of shape (n, 3), m."""
        hull = scipy.spatial.ConvexHull(points)
        corners = points[hull.simplices]
        normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
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
        """As `Solid.form`; from outside a convex one distances are those of the farthest plane."""
        kind = CONVEX if self.is_convex else TRIANGLES
        rows = (self.corners.reshape(-1, 9), self.normals, self._planes[:, None])
        return Form(kind, np.hstack(rows))

    def sample(self, number: int, rng: np.random.Generator) -> tuple[Matrix, Matrix]:
        """Points spread evenly over the surface, and their normals, each of shape (number, 3)."""
        a, b, c = self.corners.transpose(1, 0, 2)
        area = np.linalg.norm(np.cross(b - a, c - a), axis=1)
        chosen = rng.choice(len(area), number, p=area / area.sum())
        s = np.sqrt(rng.uniform(size=number))[:, None]
        t = rng.uniform(size=number)[:, None]
        points = (1 - s) * a[chosen] + s * (1 - t) * b[chosen] + s * t * c[chosen]
        return points, self.normals[chosen]

    def farthest_hit(self, origin: Vector, direction: Vector) -> tuple[Vector, Vector] | None:
        """Where a ray leaves the solid for good, and the normal there, each of shape (3,).

        Args:
            origin: Beginning of the ray, of shape (3,), m.
            direction: Direction of it, of unit length.

        Returns:
            None where it meets nothing.
        """
        along = self._hits(origin, direction)
        met = np.flatnonzero(along > _SAME)
        if not len(met):
            return None
        last = met[int(along[met].argmax())]
        return origin + along[last] * direction, self.normals[last]

    def _hits(self, origin: Vector, direction: Vector) -> Vector:
        """Meters after which a ray meets each triangle, of shape (n,); where not, minus infinity.

        By Möller and Trumbore, J. Graphics Tools 1997.
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
        hits: Vector = np.where(within, along, -np.inf)
        return hits
