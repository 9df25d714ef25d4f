"""What stands for a mesh in contacts and in cameras, kept once computed."""

from __future__ import annotations

import hashlib
import inspect
import tempfile
import zipfile
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np

from bt_dualarm.share import cache_dir
from bt_dualarm.world.robots import convex_hulls, convex_parts
from bt_dualarm.world.robots.convex_hulls import Hull, low_poly_hull
from bt_dualarm.world.robots.meshes import as_stl, stl_triangles


@dataclass(frozen=True, eq=False)
class MeshShapes:
    """Convex stand-ins of a mesh.

    Attributes:
        outline: One hull around all of it: a camera's rays ask for few shapes.
        parts: Hulls of its parts: what touches things; the outline itself where it has one part.
    """

    outline: Hull
    parts: tuple[Hull, ...]


@lru_cache(maxsize=256)
def mesh_shapes(path: Path, scale: tuple[float, ...]) -> MeshShapes:
    """The stand-ins of a mesh whose corners are scaled along x, y and z.

    They take up to a second a mesh and SciPy, 0.3 s to import: the user's cache directory keeps
    them.
    """
    mesh = as_stl(path)
    digest = hashlib.sha256(mesh.read_bytes() + repr(scale).encode() + _recipe()).hexdigest()[:16]
    place = cache_dir() / "hulls" / f"{path.stem}-{digest}.npz"
    hulls = _read(place)
    if hulls is None:
        hulls = _computed(mesh, scale)
        _keep(place, hulls)
    return MeshShapes(hulls[0], tuple(hulls[1:]) or (hulls[0],))


@lru_cache(maxsize=1)
def _recipe() -> bytes:
    """The source of what computes them: a change of it is another place in the cache."""
    return "".join(map(inspect.getsource, (convex_hulls, convex_parts))).encode()


def _computed(mesh: Path, scale: tuple[float, ...]) -> list[Hull]:
    """The outline, then the parts where there are several."""
    triangles = stl_triangles(mesh) * np.asarray(scale)
    outline = low_poly_hull(triangles.reshape(-1, 3))
    parts = convex_parts.convex_parts(triangles)
    return [outline, *(map(low_poly_hull, parts) if len(parts) > 1 else ())]


def _read(place: Path) -> list[Hull] | None:
    """What is kept there; None where nothing is, or nothing of use."""
    try:
        with place.open("rb") as raw, np.load(raw) as file:
            arrays = [file[f"arr_{number}"] for number in range(len(file.files))]
            return [Hull(*pair) for pair in zip(arrays[::2], arrays[1::2], strict=True)]
    except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile):
        return None


def _keep(place: Path, hulls: Sequence[Hull]) -> None:
    """Write them whole or not at all; what cannot be written is computed again next time."""
    arrays = [array for hull in hulls for array in (hull.vertices, hull.triangles)]
    try:
        place.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(dir=place.parent) as folder:
            raw = Path(folder) / place.name
            np.savez(raw, *arrays)
            raw.replace(place)
    except OSError:
        return
