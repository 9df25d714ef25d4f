"""Low-polygon convex hulls that stand for meshes in contacts and cameras, kept once computed."""

from __future__ import annotations

import hashlib
import tempfile
import zipfile
from functools import lru_cache
from pathlib import Path

import numpy as np
import scipy

from bt_dualarm.pose import Matrix
from bt_dualarm.world.meshes import as_stl, cache_dir, stl_triangles

_DIRECTIONS = 24  # in which a hull begins
_LOSS = 0.002  # m by which a mesh may stand out of its hull; 1 mm takes 1.5 times the vertices


@lru_cache(maxsize=256)
def low_poly_hull(path: Path, scale: tuple[float, ...]) -> tuple[Matrix, Matrix]:
    """Convex hull of a mesh with few vertices, all of them the mesh's own.

    It begins with the extreme points in evenly spread directions and takes in the point that
    stands out farthest of each of its sides, until none stands out by more than 2 mm. That takes
    10 ms a mesh and SciPy, 0.3 s to import: the user's cache directory keeps it.

    Returns:
        Vertices of shape (n, 3) in metres and triangles of shape (m, 3).
    """
    mesh = as_stl(path)
    recipe = repr((scale, _DIRECTIONS, _LOSS)).encode()
    digest = hashlib.sha256(mesh.read_bytes() + recipe).hexdigest()[:16]
    place = cache_dir() / "hulls" / f"{path.stem}-{digest}.npz"
    kept = _read(place)
    if kept is None:
        kept = _hull(stl_triangles(mesh).reshape(-1, 3) * np.asarray(scale))
        _keep(place, *kept)
    return kept


def _read(place: Path) -> tuple[Matrix, Matrix] | None:
    """What is kept there; None where nothing is, or nothing of use."""
    try:
        with place.open("rb") as raw, np.load(raw) as file:
            return file["vertices"], file["triangles"]
    except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile):
        return None


def _keep(place: Path, vertices: Matrix, triangles: Matrix) -> None:
    """Write it whole or not at all; what cannot be written is computed again next time."""
    try:
        place.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(dir=place.parent) as folder:
            raw = Path(folder) / place.name
            np.savez(raw, vertices=vertices, triangles=triangles)
            raw.replace(place)
    except OSError:
        return


def _hull(points: Matrix) -> tuple[Matrix, Matrix]:
    corners = points[scipy.spatial.ConvexHull(points).vertices]
    chosen = np.unique(np.argmax(corners @ _fibonacci_sphere(_DIRECTIONS).T, axis=0))
    while True:
        hull = scipy.spatial.ConvexHull(corners[chosen])
        outside = corners @ hull.equations[:, :3].T + hull.equations[:, 3]
        farthest = np.argmax(outside, axis=0)[outside.max(axis=0) > _LOSS]
        if len(farthest) == 0:
            return corners[chosen], _outward(corners[chosen], hull)
        chosen = np.union1d(chosen, farthest)


def _fibonacci_sphere(count: int) -> Matrix:
    """Evenly spread unit vectors, of shape (count, 3) (golden-angle spiral)."""
    k = np.arange(count) + 0.5
    z = 1 - 2 * k / count
    angle = np.pi * (1 + 5**0.5) * k
    radius = np.sqrt(1 - z**2)
    return np.column_stack((radius * np.cos(angle), radius * np.sin(angle), z))


def _outward(points: Matrix, hull: scipy.spatial.ConvexHull) -> Matrix:
    """Triangles of a hull, each with its corners anticlockwise seen from outside."""
    triangles: Matrix = hull.simplices.copy()
    corners = points[triangles]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    inward = np.einsum("ij,ij->i", normal, hull.equations[:, :3]) < 0
    triangles[inward] = triangles[inward][:, ::-1]
    return triangles
