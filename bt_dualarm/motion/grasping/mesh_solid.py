"""A closed surface of triangles as a solid: its distances, and what a ray through it meets."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt
import scipy

from bt_dualarm.motion.grasping.solids import Solid
from bt_dualarm.motion.pinching.kernel_forms import CONVEX, TRIANGLES, Form
from bt_dualarm.pose import Matrix, Vector

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
        s, t = np.sqrt(rng.uniform(size=number))[:, None], rng.uniform(size=number)[:, None]
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
        """Metres after which a ray meets each triangle, of shape (n,); where not, minus infinity.

        By Möller and Trumbore, J. Graphics Tools 1997.
        """
        first = self.corners[:, 0]
        one, two = self.corners[:, 1] - first, self.corners[:, 2] - first
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
