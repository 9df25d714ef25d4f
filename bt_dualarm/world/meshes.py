"""Meshes of robots: low-polygon hulls for contacts and cameras, full meshes for pictures.

MuJoCo reads neither COLLADA nor ASCII STL. Whatever is not binary STL is converted once with the
``assimp`` program (of the package cmeel-assimp) and kept in the user's cache directory.
"""

from __future__ import annotations

import hashlib
import os
import re
import subprocess
import sysconfig
import tempfile
from functools import lru_cache
from pathlib import Path

import numpy as np
from scipy.spatial import ConvexHull

from bt_dualarm.errors import CatalogueError
from bt_dualarm.pose import Matrix

_STL_FACET = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attributes", "<u2")])
_STL_HEADER = 84
_UP_AXIS = re.compile(rb"<up_axis>\s*\w+\s*</up_axis>")
_DIRECTIONS = 24  # in which a hull begins
_LOSS = 0.002  # m by which a mesh may stand out of its hull; 1 mm takes 1.5 times the vertices


def cache_dir() -> Path:
    """Where converted meshes are kept: ``$XDG_CACHE_HOME/bt_dualarm``, else ``~/.cache``."""
    root = os.environ.get("XDG_CACHE_HOME") or str(Path.home() / ".cache")
    return Path(root) / "bt_dualarm"


@lru_cache(maxsize=256)
def low_poly_hull(path: Path, scale: tuple[float, ...]) -> tuple[Matrix, Matrix]:
    """Convex hull of a mesh with few vertices, all of them the mesh's own.

    It begins with the extreme points in evenly spread directions and takes in the point that
    stands out farthest of each of its sides, until none stands out by more than 2 mm.

    Returns:
        Vertices of shape (n, 3) in metres and triangles of shape (m, 3).
    """
    points = stl_triangles(as_stl(path)).reshape(-1, 3) * np.asarray(scale)
    corners = points[ConvexHull(points).vertices]
    chosen = np.unique(np.argmax(corners @ _fibonacci_sphere(_DIRECTIONS).T, axis=0))
    while True:
        hull = ConvexHull(corners[chosen])
        outside = corners @ hull.equations[:, :3].T + hull.equations[:, 3]
        farthest = np.argmax(outside, axis=0)[outside.max(axis=0) > _LOSS]
        if len(farthest) == 0:
            return corners[chosen], _outward(corners[chosen], hull)
        chosen = np.union1d(chosen, farthest)


def stl_triangles(path: Path) -> Matrix:
    """Corners of the triangles of a binary STL, of shape (n, 3, 3)."""
    facets = np.frombuffer(path.read_bytes(), _STL_FACET, offset=_STL_HEADER)
    return facets["corners"].astype(float)


def as_stl(path: Path) -> Path:
    """The mesh as binary STL: the file itself, or its conversion in the cache.

    Raises:
        CatalogueError: The file is missing or cannot be converted.
    """
    if not path.is_file():
        raise CatalogueError(f"mesh {path} does not exist")
    if path.suffix.lower() == ".stl" and _is_binary_stl(path):
        return path
    digest = hashlib.sha256(path.read_bytes()).hexdigest()[:16]
    converted = cache_dir() / "meshes" / f"{path.stem}-{digest}.stl"
    if not (converted.is_file() and _is_binary_stl(converted)):
        _convert(path, converted)
    return converted


def _is_binary_stl(path: Path) -> bool:
    with path.open("rb") as file:
        header = file.read(_STL_HEADER)
    if len(header) < _STL_HEADER:
        return False
    count = int.from_bytes(header[80:], "little")
    return path.stat().st_size == _STL_HEADER + count * _STL_FACET.itemsize


def _convert(source: Path, target: Path) -> None:
    """Run assimp; the result appears under its name only when it is whole."""
    target.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=target.parent) as folder:
        upright = Path(folder) / source.name
        # A URDF takes vertices as they are; assimp turns models that declare z to be up.
        upright.write_bytes(_UP_AXIS.sub(rb"<up_axis>Y_UP</up_axis>", source.read_bytes()))
        raw = Path(folder) / target.name
        _run_assimp("export", str(upright), str(raw), "-fstlb", "-ptv")
        if not raw.is_file():
            raise CatalogueError(f"assimp converted {source} to nothing")
        _write_true_count(raw)
        raw.replace(target)


def _write_true_count(path: Path) -> None:
    """Mend the header: assimp counts lines and points that it then leaves out."""
    count = (path.stat().st_size - _STL_HEADER) // _STL_FACET.itemsize
    with path.open("r+b") as file:
        file.seek(80)
        file.write(count.to_bytes(4, "little"))


def _run_assimp(*arguments: str) -> None:
    program = _assimp()
    # The program does not say where its own library lies: in the folder beside its own.
    environment = os.environ | {"LD_LIBRARY_PATH": str(program.parents[1] / "lib")}
    result = subprocess.run(  # noqa: S603  # our own program and paths
        [program, *arguments], capture_output=True, text=True, check=False, env=environment
    )
    if result.returncode != 0:
        said = (result.stderr or result.stdout).strip()[-400:]
        raise CatalogueError(f"assimp {' '.join(arguments)}: {said}")


def _assimp() -> Path:
    program = Path(sysconfig.get_paths()["purelib"]) / "cmeel.prefix" / "bin" / "assimp"
    if not program.is_file():
        raise CatalogueError(f"the program assimp is missing ({program}); reinstall cmeel-assimp")
    return program


def _fibonacci_sphere(count: int) -> Matrix:
    """Evenly spread unit vectors, of shape (count, 3) (golden-angle spiral)."""
    k = np.arange(count) + 0.5
    z = 1 - 2 * k / count
    angle = np.pi * (1 + 5**0.5) * k
    radius = np.sqrt(1 - z**2)
    return np.column_stack((radius * np.cos(angle), radius * np.sin(angle), z))


def _outward(points: Matrix, hull: ConvexHull) -> Matrix:
    """Triangles of a hull, each with its corners anticlockwise seen from outside."""
    triangles: Matrix = hull.simplices.copy()
    corners = points[triangles]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    inward = np.einsum("ij,ij->i", normal, hull.equations[:, :3]) < 0
    triangles[inward] = triangles[inward][:, ::-1]
    return triangles
