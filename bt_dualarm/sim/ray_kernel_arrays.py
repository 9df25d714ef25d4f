"""Rays, shapes, lights and hits as arrays for the kernels of the ray caster."""

from __future__ import annotations

from typing import Final, NamedTuple, TypeAlias

import numpy as np
import numpy.typing as npt

from bt_dualarm.core.pose import Matrix, Vector

Numbers: TypeAlias = npt.NDArray[np.int64]

HULL: Final = 0
PLANE: Final = 1
SPHERE: Final = 2
CYLINDER: Final = 3
CAPSULE: Final = 4

NOTHING: Final = -1
"""Mark of a ray that meets nothing."""


class Fan(NamedTuple):
    """Rays from one eye, on a grid.

    Attributes:
        eye: Position of the eye in the world, of shape (3,), in m.
        axes: Camera's x (right), y (up) and z (backward) as columns in the world.
        rays: Unit vectors in these axes, of shape (3, rows, columns); each passes through its own
            cell of the grid.
        spacing: Distance of neighboring rays one meter ahead.
        center: Column and row on the grid of the camera's axis.
    """

    eye: Vector
    axes: Matrix
    rays: npt.NDArray[np.float64]
    spacing: float
    center: tuple[float, float]


class Hits(NamedTuple):
    """What the rays of a fan meet.

    Attributes:
        geoms: Number of each geom, -1 for nothing, of shape (rows, columns).
        distances: Distance from the eye in m, inf for nothing, of shape (rows, columns).
        normals: Outward unit normals in the world, zero for nothing, of shape (3, rows, columns).
    """

    geoms: npt.NDArray[np.int32]
    distances: npt.NDArray[np.float64]
    normals: npt.NDArray[np.float64]

    @classmethod
    def none(cls, fan: Fan) -> Hits:
        """Of rays that have met nothing yet."""
        grid = fan.rays.shape[1:]
        return cls(np.full(grid, -1, np.int32), np.full(grid, np.inf), np.zeros((3, *grid)))


class Marks(NamedTuple):
    """What the rays of a fan meet, as numbers from which `Hits` can be worked out.

    Attributes:
        faces: Number of a face among all of the shapes; of what is curved, -2 less its number among
            them; -1 for nothing. Of shape (rows, columns).
        distances: Distance from the eye in m, inf for nothing, of shape (rows, columns).
        normals: Outward unit normals in the world of the faces that were asked, (f + n, 3).
        eyes: Place of the eye in the axes of each shape that was asked, of shape (n, 3), in m.
        turns: The camera's axes as columns in those axes, of shape (n, 3, 3).
    """

    faces: npt.NDArray[np.int32]
    distances: npt.NDArray[np.float64]
    normals: Matrix
    eyes: Matrix
    turns: npt.NDArray[np.float64]


class Shapes(NamedTuple):
    """Shapes of n geoms, all hulls in one heap.

    Attributes:
        geoms: Numbers of the geoms in the model, of shape (n,).
        kinds: `HULL`, `PLANE`, `SPHERE`, `CYLINDER` or `CAPSULE`, of shape (n,).
        sizes: Half lengths of a plane along x and y (inf: no end), radius and half length of the
            others, of shape (n, 3), in m.
        radii: Radii of the spheres about the geoms' centers that hold them, inf for planes, of
            shape (n,), in m.
        corners: Corners of all hulls, of shape (c, 3), in m.
        triangles: Numbers of corners in this heap, of shape (f, 3).
        normals: Outward unit normals of the triangles, of shape (f, 3).
        offsets: Distances of the planes from the origin of the geom, of shape (f,), in m.
        heaps: First corner, last corner, first triangle, last triangle of each geom, the last
            ones not counted, of shape (n, 4).
        owners: Number of the geom of each face, of shape (f + n,): of each triangle, then of each
            shape as a whole, which a plane's one face is.
    """

    geoms: Numbers
    kinds: Numbers
    sizes: Matrix
    radii: Vector
    corners: Matrix
    triangles: Numbers
    normals: Matrix
    offsets: Vector
    heaps: Numbers
    owners: Numbers


class Lights(NamedTuple):
    """Colors and lights of a model.

    Attributes:
        base: Red, green, blue of each geom, the sky's in the last row, of shape (ngeom + 1, 3).
        ambient: What comes from all sides, of shape (3,).
        head: What comes from the eye, of shape (3,).
        active: Numbers of the lights that are on, of shape (n,).
        distant: Whether they are of infinite distance, of shape (n,).
        diffuse: Their colors, of shape (n, 3).
    """

    base: Matrix
    ambient: Vector
    head: Vector
    active: Numbers
    distant: npt.NDArray[np.bool_]
    diffuse: Matrix
