"""Rays, shapes, lights and hits as arrays, for the kernels of the ray caster."""

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
"""Face index of a ray that hits nothing."""


class Fan(NamedTuple):
    """Rays from one point, on a grid of image cells.

    Attributes:
        eye: Origin of the rays in the world, of shape (3,), m.
        axes: Camera's x (right), y (up) and z (backward) as columns in the world.
        rays: Unit vectors in these axes, of shape (3, rows, columns); each passes through some
            point of its cell.
        spacing: Distance of neighboring cells at a depth of 1 m.
        center: Column and row of the camera's axis on the grid.
    """

    eye: Vector
    axes: Matrix
    rays: npt.NDArray[np.float64]
    spacing: float
    center: tuple[float, float]


class Hits(NamedTuple):
    """First intersections of the rays of a fan.

    Attributes:
        geoms: Id of each geom, -1 for none, of shape (rows, columns).
        distances: Distance from the eye in m, inf for none, of shape (rows, columns).
        normals: Outward unit normals in the world, zero for none, of shape (3, rows, columns).
    """

    geoms: npt.NDArray[np.int32]
    distances: npt.NDArray[np.float64]
    normals: npt.NDArray[np.float64]

    @classmethod
    def none(cls, fan: Fan) -> Hits:
        """Hits of rays that hit nothing."""
        grid = fan.rays.shape[1:]
        return cls(np.full(grid, -1, np.int32), np.full(grid, np.inf), np.zeros((3, *grid)))


class Marks(NamedTuple):
    """First intersections in the compact form that the kernels fill, from which `Hits` follow.

    Attributes:
        faces: Index of a face among all faces of the shapes; for a curved shape -2 less its index;
            -1 for none. Of shape (rows, columns).
        distances: Distance from the eye in m, inf for none, of shape (rows, columns).
        normals: Outward unit normals in the world of the faces that were tested, (f + n, 3).
        eyes: Position of the eye in the frame of each shape that was tested, of shape (n, 3), m.
        turns: The camera's axes as columns in that frame, of shape (n, 3, 3).
    """

    faces: npt.NDArray[np.int32]
    distances: npt.NDArray[np.float64]
    normals: Matrix
    eyes: Matrix
    turns: npt.NDArray[np.float64]


class Shapes(NamedTuple):
    """Shapes of n geoms; the hulls share one array of corners and one of triangles.

    Attributes:
        geoms: Ids of the geoms in the model, of shape (n,).
        kinds: `HULL`, `PLANE`, `SPHERE`, `CYLINDER` or `CAPSULE`, of shape (n,).
        sizes: Half lengths of a plane along x and y (inf: infinite); radius and half length of the
            others, of shape (n, 3), m.
        radii: Radii of bounding spheres about the geoms' centers, inf for planes, (n,), m.
        corners: Corners of all hulls, of shape (c, 3), m.
        triangles: Indices of their corners, of shape (f, 3).
        normals: Outward unit normals of the triangles, of shape (f, 3).
        offsets: Distances of the triangles' planes from the geom's origin, of shape (f,), m.
        heaps: First and end corner, first and end triangle of each geom, of shape (n, 4).
        owners: Id of the geom of each face, of shape (f + n,): of each triangle, then of each shape
            as a whole (the one face of a plane).
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
    """Colors and lights of a model, each color as red, green, blue from 0 to 1.

    Attributes:
        base: Color of each geom, the sky's in the last row, of shape (ngeom + 1, 3).
        ambient: Ambient light, of shape (3,).
        head: Head light, which shines from the eye, of shape (3,).
        active: Ids of the active lights, of shape (n,).
        distant: Whether they are directional, of shape (n,).
        diffuse: Their diffuse colors, of shape (n, 3).
    """

    base: Matrix
    ambient: Vector
    head: Vector
    active: Numbers
    distant: npt.NDArray[np.bool_]
    diffuse: Matrix
