"""Where rays enter planes, spheres, cylinders and convex polyhedra: all rays of a shape at once.

Everything is in the shape's own frame: ``eye`` of shape (3,) lies outside it (seen from inside, a
shape is invisible, as in OpenGL), ``rays`` are unit vectors of shape (3, n). ``enter`` gives the
distance of each entry, of shape (n,), inf for a miss; ``normals`` the outward unit normals, of
shape (3, n), for rays that do enter at ``distances``.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from bt_dualarm.pose import Matrix, Vector

_TINY = 1e-12
_ON_THE_CAP_M = 1e-9
_SERIAL_PRODUCT = 200_000
"""Multiplications in one product; OpenBLAS starts threads above 262,144 (interface/gemm.c)."""


def multiply(matrix: Matrix, rays: Matrix) -> Matrix:
    """The product of shapes (f, 3) and (3, n) on one thread, whatever the BLAS would do."""
    product = np.empty((len(matrix), rays.shape[1]))
    for some in _portions(len(matrix), rays.shape[1]):
        np.matmul(matrix, rays[:, some], out=product[:, some])
    return product


def dots(vector: Vector, rays: Matrix) -> Vector:
    """The products of shape (n,) of a vector with rays of shape (3, n), on one thread."""
    products: Vector = np.einsum("i,ij->j", vector, rays)
    return products


def _portions(faces: int, rays: int) -> Iterator[slice]:
    """Slices of the rays that OpenBLAS multiplies on the calling thread.

    With more it wakes a thread a core and spins; on a busy machine that costs ten times more
    than it gains.
    """
    size = max(_SERIAL_PRODUCT // (3 * faces), 1)
    return (slice(start, start + size) for start in range(0, rays, size))


class Surface(Protocol):
    """A surface that rays can meet."""

    def contains(self, eye: Vector) -> bool:
        """Whether ``eye`` is inside, or where the surface is not to be seen from."""

    def enter(self, eye: Vector, rays: Matrix) -> Vector:
        """Distances to the surface."""

    def normals(self, eye: Vector, rays: Matrix, distances: Vector) -> Matrix:
        """Outward unit normals at the entries."""


@dataclass(frozen=True)
class FlatSurface:
    """z = 0, seen from above, as far as half the lengths ``reach`` in x and y (inf: no end)."""

    reach: tuple[float, float] = (math.inf, math.inf)

    def contains(self, eye: Vector) -> bool:
        """Whether the eye is below the plane, from where it is not seen."""
        return bool(eye[2] <= 0.0)

    def enter(self, eye: Vector, rays: Matrix) -> Vector:
        """Distances of the entries, of shape (n,), inf for a miss."""
        down = np.minimum(rays[2], -_TINY)
        distances = np.where(rays[2] < -_TINY, -eye[2] / down, np.inf)
        if math.isfinite(self.reach[0]) or math.isfinite(self.reach[1]):
            with np.errstate(invalid="ignore"):
                x, y = np.abs(eye[:2, None] + distances * rays[:2])
                distances[~((x <= self.reach[0]) & (y <= self.reach[1]))] = np.inf
        return distances

    def normals(self, eye: Vector, rays: Matrix, distances: Vector) -> Matrix:  # noqa: ARG002
        """Normals that all point up, of shape (3, n)."""
        return np.broadcast_to(np.array([[0.0], [0.0], [1.0]]), rays.shape)


@dataclass(frozen=True)
class Sphere:
    """About the origin."""

    radius: float

    def contains(self, eye: Vector) -> bool:
        """Whether the eye is within the radius."""
        return bool(eye @ eye <= self.radius**2)

    def enter(self, eye: Vector, rays: Matrix) -> Vector:
        """Distances of the entries, of shape (n,), inf for a miss."""
        along = dots(eye, rays)
        squared = along**2 - (eye @ eye - self.radius**2)
        hit = (squared >= 0.0) & (along < 0.0)
        return np.where(hit, -along - np.sqrt(np.maximum(squared, 0.0)), np.inf)

    def normals(self, eye: Vector, rays: Matrix, distances: Vector) -> Matrix:
        """Normals away from the centre, of shape (3, n)."""
        return (eye[:, None] + distances * rays) / self.radius


@dataclass(frozen=True)
class Cylinder:
    """About the z axis, from ``-half_length`` to ``half_length``, closed."""

    radius: float
    half_length: float

    def contains(self, eye: Vector) -> bool:
        """Whether the eye is within radius and length."""
        return bool(np.hypot(eye[0], eye[1]) <= self.radius and abs(eye[2]) <= self.half_length)

    def enter(self, eye: Vector, rays: Matrix) -> Vector:
        """Distances to the common part of the inside of the wall and what is between the caps."""
        a = np.maximum(rays[0] ** 2 + rays[1] ** 2, _TINY)
        b = eye[0] * rays[0] + eye[1] * rays[1]
        squared = b**2 - a * (eye[0] ** 2 + eye[1] ** 2 - self.radius**2)
        root = np.sqrt(np.maximum(squared, 0.0))
        climb = np.where(np.abs(rays[2]) < _TINY, _TINY, rays[2])
        middle, half = -eye[2] / climb, np.abs(self.half_length / climb)
        entry = np.maximum((-b - root) / a, middle - half)
        leave = np.minimum((-b + root) / a, middle + half)
        return np.where((squared >= 0.0) & (entry <= leave) & (entry > 0.0), entry, np.inf)

    def normals(self, eye: Vector, rays: Matrix, distances: Vector) -> Matrix:
        """Normals away from the axis on the wall, along it on the caps, of shape (3, n)."""
        points = eye[:, None] + distances * rays
        capped = np.abs(points[2]) >= self.half_length - _ON_THE_CAP_M
        normals = points / self.radius
        normals[2] = 0.0
        normals[:, capped] = 0.0
        normals[2, capped] = np.sign(points[2, capped])
        return normals


@dataclass(frozen=True, eq=False)
class Polyhedron:
    """A convex body.

    From an eye outside, let h be the distance of a face's plane along its outward normal n:
    negative for the faces that look at the eye. A ray d meets the plane at the inverse distance
    u = (n / h) · d. It enters the body at the smallest u of the faces that look at the eye and
    leaves it at the largest of the others; it hits if it enters before it leaves (Cyrus and
    Beck, "Generalized two- and three-dimensional clipping", 1978, in inverse distances). Every
    face with every ray is then one product of two matrices.

    Attributes:
        face_normals: Outward unit normals, of shape (f, 3).
        offsets: Distances of the planes from the origin along the normals, of shape (f,).
        vertices: Corners, of shape (v, 3).
    """

    face_normals: Matrix
    offsets: Vector
    vertices: Matrix

    @classmethod
    def box(cls, half: Vector) -> Polyhedron:
        """A box about the origin.

        Args:
            half: Half lengths along x, y and z, of shape (3,), in m.
        """
        signs = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
        return cls(np.vstack([np.eye(3), -np.eye(3)]), np.concatenate([half, half]), signs * half)

    def contains(self, eye: Vector) -> bool:
        """Whether the eye is below every face."""
        return bool((self.offsets - self.face_normals @ eye).min() > -_TINY)

    def enter(self, eye: Vector, rays: Matrix) -> Vector:
        """Distances of the entries by the class's formula, of shape (n,), inf for a miss."""
        heights = self._heights(eye)
        toward = heights < 0.0
        scaled = self.face_normals / heights[:, None]
        front, back = scaled[toward], scaled[~toward]
        entry, leave = np.empty(rays.shape[1]), np.zeros(rays.shape[1])
        for some in _portions(max(len(front), len(back)), rays.shape[1]):
            (front @ rays[:, some]).min(axis=0, out=entry[some])
            (back @ rays[:, some]).max(axis=0, initial=0.0, out=leave[some])
        hit = (entry >= leave) & (entry > _TINY)
        return np.where(hit, 1.0 / np.maximum(entry, _TINY), np.inf)

    def normals(self, eye: Vector, rays: Matrix, distances: Vector) -> Matrix:  # noqa: ARG002
        """Normals of the faces through which the rays enter, of shape (3, n)."""
        heights = self._heights(eye)
        toward = np.flatnonzero(heights < 0.0)
        scaled = self.face_normals[toward] / heights[toward, None]
        first = np.empty(rays.shape[1], dtype=int)
        for some in _portions(len(scaled), rays.shape[1]):
            (scaled @ rays[:, some]).argmin(axis=0, out=first[some])
        normals: Matrix = self.face_normals[toward[first]].T
        return normals

    def _heights(self, eye: Vector) -> Vector:
        """Signed distances of the planes, of shape (f,); never zero."""
        heights = self.offsets - self.face_normals @ eye
        return np.where(np.abs(heights) < _TINY, _TINY, heights)
