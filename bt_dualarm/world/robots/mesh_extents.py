"""How large a mesh is, and how thin where it is thinnest: measured once, then kept.

The meshes of two arms take 70 ms to read and measure, as much as a tenth of a run's start.
"""

from __future__ import annotations

import hashlib
import json
import tempfile
from contextlib import suppress
from functools import lru_cache
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np

from bt_dualarm.pose import Matrix
from bt_dualarm.share import cache_dir
from bt_dualarm.world.robots.meshes import MeshError, as_stl, stl_triangles

MAX_TRIANGLES: Final = 200_000
"""What MuJoCo takes of one mesh."""

MAX_EXTENT: Final = 100.0
"""m; no link is larger."""

MILLIMETRES: Final = 'a mesh in millimetres needs scale="0.001 0.001 0.001"'

_LEAST_CORNERS: Final = 4
_LEAST_AREA: Final = 1e-10  # m²
_FEW: Final = 200
_SAMPLE: Final = 2000  # corners that say where a mesh is flattest
_WORTH_KEEPING: Final = 10_000  # bytes of a file; what is smaller is read as fast as what is kept


class Extents(NamedTuple):
    """Largest extent along an axis, and extent in the direction in which it is flattest, m."""

    largest: float
    thickness: float


def extents(mesh: Path, scale: tuple[float, ...]) -> Extents:
    """The extents of a mesh whose corners are scaled along x, y and z.

    They are kept in the user's cache directory, for as long as the file has the same size and time.

    Raises:
        OSError: It cannot be read.
        MeshError: It is no mesh that anybody can use.
    """
    state = mesh.stat()
    return _extents(mesh, scale, state.st_mtime_ns, state.st_size)


@lru_cache(maxsize=1024)
def _extents(mesh: Path, scale: tuple[float, ...], changed: int, size: int) -> Extents:
    if size < _WORTH_KEEPING:
        return _measured(mesh, scale)
    key = repr((str(mesh.resolve()), scale, changed, size)).encode() + _recipe()
    place = cache_dir() / "extents" / f"{mesh.stem}-{hashlib.sha256(key).hexdigest()[:16]}.json"
    try:
        return Extents(*map(float, json.loads(place.read_bytes())))
    except (OSError, ValueError, TypeError):
        found = _measured(mesh, scale)
        _keep(place, found)
        return found


@lru_cache(maxsize=1)
def _recipe() -> bytes:
    """The source of what measures: a change of it is another place in the cache."""
    return Path(__file__).read_bytes()


def _keep(place: Path, found: Extents) -> None:
    """Write it whole or not at all; what cannot be written is measured again next time."""
    with suppress(OSError):
        place.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(dir=place.parent) as folder:
            raw = Path(folder) / place.name
            raw.write_text(json.dumps(found))
            raw.replace(place)


def _measured(mesh: Path, scale: tuple[float, ...]) -> Extents:
    triangles = stl_triangles(as_stl(mesh))
    if len(triangles) == 0:
        raise MeshError(mesh, "is empty: it has no triangles")
    if len(triangles) > MAX_TRIANGLES:
        hint = "thin it out, or choose a base_link that leaves this link out"
        raise MeshError(mesh, f"has {len(triangles)} triangles; {MAX_TRIANGLES} are the most", hint)
    with np.errstate(all="ignore"):  # what is infinite is refused below
        scaled = triangles * np.asarray(scale)
    points = scaled.reshape(-1, 3)
    ends = np.array((points.min(axis=0), points.max(axis=0)))
    if not np.isfinite(ends).all():
        raise MeshError(mesh, "has a corner that is nowhere: NaN or infinite")
    away = float(np.abs(ends).max())
    if away > 10 * MAX_EXTENT:
        raise MeshError(mesh, f"reaches {away:.3g} m away from its link", MILLIMETRES)
    if _area(scaled[:_FEW]) < _LEAST_AREA and _area(scaled) < _LEAST_AREA:
        raise MeshError(mesh, "has no surface: its triangles are points or lines")
    if len(points) < _FEW and len(np.unique(points, axis=0)) < _LEAST_CORNERS:
        raise MeshError(mesh, f"is no shape: it has fewer than {_LEAST_CORNERS} different corners")
    return Extents(float(np.abs(ends[1] - ends[0]).max()), _thickness(points))


def _area(triangles: Matrix) -> float:
    """Area of triangles, of shape (n, 3, 3), m²."""
    sides = triangles[:, 1:] - triangles[:, :1]
    return float(np.linalg.norm(np.cross(sides[:, 0], sides[:, 1]), axis=1).sum()) / 2


def _thickness(points: Matrix) -> float:
    """How far points, of shape (n, 3), lie apart in the direction in which a sample is flattest."""
    sample = points[:: 1 + len(points) // _SAMPLE]
    sample = sample - sample.mean(axis=0)
    _, axes = np.linalg.eigh(sample.T @ sample)
    return float(np.ptp(points @ axes[:, 0]))
