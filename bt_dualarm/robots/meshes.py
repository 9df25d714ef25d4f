"""Robot meshes: conversion to STL, validation, and convex shapes for contacts and cameras.

MuJoCo reads neither COLLADA nor ASCII STL, and collides meshes only as convex hulls. `as_stl`
converts a mesh, `mesh_problems` refuses unusable ones before MuJoCo or Qhull fail, and
`mesh_shapes` approximates a mesh by hulls with few vertices. Results are cached by content.
"""

from __future__ import annotations

import hashlib
import itertools
import json
import os
import re
import resource
import subprocess
import sysconfig
import tempfile
import zipfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import cache, lru_cache
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np
import scipy

from bt_dualarm.core.errors import CatalogError
from bt_dualarm.core.pose import Matrix
from bt_dualarm.core.share import cache_dir, start_of_name
from bt_dualarm.core.triangles import cut_at
from bt_dualarm.robots.urdf import Shape
from bt_dualarm.robots.urdf_arm import Urdf
from bt_dualarm.spec.problems import Problem

# Conversion
#
# Formats other than binary STL are converted once by the ``assimp`` program (of the package
# cmeel-assimp) and kept in the user's cache directory, or until the end of the process if that is
# not writable.


_STL_FACET = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attributes", "<u2")])
_STL_HEADER = 84

ASSIMP_SECONDS = 4.0
"""Timeout of the conversion of one mesh in s; 29 MB of COLLADA take 0.4 s."""

_ASSIMP_MEMORY = 4 * 1024**3  # bytes
_ASSIMP_OUTPUT = 256 * 1024**2  # bytes
_UP_AXIS = re.compile(rb"<up_axis>\s*\w+\s*</up_axis>")


class MeshError(CatalogError):
    """A mesh cannot be used.

    Args:
        path: File of the mesh.
        message: The problem, as a predicate of the mesh.
        hint: How to solve it.
    """

    def __init__(self, path: Path, message: str, hint: str = "") -> None:
        super().__init__(f"mesh {path} {message}; {hint}" if hint else f"mesh {path} {message}")
        self.message = message
        self.hint = hint


def stl_triangles(path: Path) -> Matrix:
    """Corners of the triangles of a binary STL, of shape (n, 3, 3)."""
    facets = np.frombuffer(path.read_bytes(), _STL_FACET, offset=_STL_HEADER)
    return facets["corners"].astype(float)


def as_stl(path: Path) -> Path:
    """The mesh as binary STL: the file itself, or its conversion in the cache.

    Raises:
        MeshError: The file is missing or cannot be converted.
    """
    if not path.is_file():
        raise MeshError(path, "does not exist")
    if path.suffix.lower() == ".stl" and _is_binary_stl(path):
        return path
    digest = hashlib.sha256(path.read_bytes()).hexdigest()[:16]
    name = f"{start_of_name(path.stem)}-{digest}.stl"
    converted = cache_dir() / "meshes" / name
    try:
        _convert_once(path, converted)
    except OSError:  # the cache directory is not writable
        converted = Path(_scratch().name) / name
        _convert_once(path, converted)
    return converted


@cache
def _scratch() -> tempfile.TemporaryDirectory[str]:
    """Directory for conversions that cannot be cached; removed when the process ends."""
    return tempfile.TemporaryDirectory(prefix="bt_dualarm-")


def _convert_once(source: Path, target: Path) -> None:
    if not (target.is_file() and _is_binary_stl(target)):
        _convert(source, target)


def _is_binary_stl(path: Path) -> bool:
    with path.open("rb") as file:
        header = file.read(_STL_HEADER)
    if len(header) < _STL_HEADER:
        return False
    count = int.from_bytes(header[80:], "little")
    return path.stat().st_size == _STL_HEADER + count * _STL_FACET.itemsize


def _convert(source: Path, target: Path) -> None:
    """Run assimp; the target file appears only when it is complete."""
    target.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=target.parent) as folder:
        upright = Path(folder) / source.name
        # URDF ignores a COLLADA file's up axis; assimp would rotate models with z up.
        upright.write_bytes(_UP_AXIS.sub(rb"<up_axis>Y_UP</up_axis>", source.read_bytes()))
        raw = Path(folder) / target.name
        error = _run_assimp("export", str(upright), str(raw), "-fstlb", "-ptv")
        if error or not raw.is_file():
            raise MeshError(source, error or "cannot be converted: assimp wrote no file")
        _write_true_count(raw)
        raw.replace(target)


def _write_true_count(path: Path) -> None:
    """Correct the triangle count: assimp counts lines and points, which it does not write."""
    count = (path.stat().st_size - _STL_HEADER) // _STL_FACET.itemsize
    with path.open("r+b") as file:
        file.seek(80)
        file.write(count.to_bytes(4, "little"))


def _run_assimp(*arguments: str) -> str:
    """Run assimp with a timeout; returns its error message, empty on success."""
    program = _assimp()
    # The program has no RPATH to its library, which is in the folder next to its own.
    environment = os.environ | {"LD_LIBRARY_PATH": str(program.parents[1] / "lib")}
    with subprocess.Popen(  # noqa: S603  # our own program and paths
        [program, *arguments],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        stdin=subprocess.DEVNULL,
        env=environment,
    ) as process:
        _confine(process.pid)
        try:
            output, _ = process.communicate(timeout=ASSIMP_SECONDS)
        except subprocess.TimeoutExpired:
            return f"takes assimp longer than {ASSIMP_SECONDS:g} s"
        finally:
            process.kill()  # no effect if it has ended
    if process.returncode == 0:
        return ""
    text = " ".join(output.decode(errors="replace").split()).rpartition("ERROR: ")[2]
    return f"cannot be read by assimp: {text[-200:]} (code {process.returncode})"


def _confine(pid: int) -> None:
    """Limit the memory and file size of a process to what any valid mesh needs."""
    for limit, most in (
        (resource.RLIMIT_AS, _ASSIMP_MEMORY),
        (resource.RLIMIT_FSIZE, _ASSIMP_OUTPUT),
        (resource.RLIMIT_CORE, 0),
    ):
        with suppress(ProcessLookupError):  # it has ended already
            resource.prlimit(pid, limit, (most, most))


def _assimp() -> Path:
    program = Path(sysconfig.get_paths()["purelib"]) / "cmeel.prefix" / "bin" / "assimp"
    if not program.is_file():
        raise CatalogError(f"the program assimp is missing ({program}); reinstall cmeel-assimp")
    return program


# Extents
#
# They are cached, since measuring the meshes of two arms takes 70 ms, up to a tenth of the start of
# a run.

MAX_TRIANGLES: Final = 200_000
"""Largest number of triangles that MuJoCo accepts in one mesh."""

MAX_EXTENT: Final = 10.0
"""Largest extent in m of a plausible link."""

MILLIMETERS: Final = 'a mesh in millimeters needs scale="0.001 0.001 0.001"'

_MIN_CORNERS: Final = 4
_MIN_AREA: Final = 1e-10  # m²
_FEW: Final = 200  # triangles or corners, for which exact tests are cheap
_SAMPLE: Final = 2000  # corners from which the flattest direction is computed
_MIN_CACHED_BYTES: Final = 10_000  # smaller meshes are measured as fast as a cache file is read


class Extents(NamedTuple):
    """Largest extent along an axis, and extent in the flattest direction (thickness), m."""

    largest: float
    thickness: float


def extents(mesh: Path, scale: tuple[float, ...]) -> Extents:
    """Extents of a mesh whose corners are scaled along x, y and z.

    They are cached in the user's cache directory while the file keeps its size and time.

    Raises:
        OSError: The file cannot be read.
        MeshError: The mesh is unusable.
    """
    state = mesh.stat()
    return _extents(mesh, scale, state.st_mtime_ns, state.st_size)


@lru_cache(maxsize=1024)
def _extents(mesh: Path, scale: tuple[float, ...], changed: int, size: int) -> Extents:
    if size < _MIN_CACHED_BYTES:
        return _measured(mesh, scale)
    key = repr((str(mesh.resolve()), scale, changed, size)).encode() + _source()
    digest = hashlib.sha256(key).hexdigest()[:16]
    cached = cache_dir() / "extents" / f"{start_of_name(mesh.stem)}-{digest}.json"
    try:
        return Extents(*map(float, json.loads(cached.read_bytes())))
    except (OSError, ValueError, TypeError):
        found = _measured(mesh, scale)
    with suppress(OSError), _atomic_file(cached) as raw:
        raw.write_text(json.dumps(found))
    return found


@lru_cache(maxsize=1)
def _source() -> bytes:
    """Source of what computes, part of all cache keys: a change of it invalidates the caches."""
    cuts = Path(__file__).parents[1] / "core" / "triangles.py"
    return Path(__file__).read_bytes() + cuts.read_bytes()


@contextmanager
def _atomic_file(path: Path) -> Iterator[Path]:
    """A temporary file that becomes ``path`` when the block ends, so readers see it complete."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=path.parent) as folder:
        raw = Path(folder) / path.name
        yield raw
        raw.replace(path)


def _measured(mesh: Path, scale: tuple[float, ...]) -> Extents:
    triangles = stl_triangles(as_stl(mesh))
    if len(triangles) == 0:
        raise MeshError(mesh, "is empty: it has no triangles")
    if len(triangles) > MAX_TRIANGLES:
        hint = "thin it out, or choose a base_link that leaves this link out"
        raise MeshError(mesh, f"has {len(triangles)} triangles, more than {MAX_TRIANGLES}", hint)
    with np.errstate(all="ignore"):  # infinite corners are refused below
        scaled = triangles * np.asarray(scale)
    points = scaled.reshape(-1, 3)
    ends = np.array((points.min(axis=0), points.max(axis=0)))
    if not np.isfinite(ends).all():
        raise MeshError(mesh, "has a corner with a NaN or infinite coordinate")
    away = float(np.abs(ends).max())
    if away > 10 * MAX_EXTENT:
        raise MeshError(mesh, f"extends {away:.3g} m from its link", MILLIMETERS)
    if _area(scaled[:_FEW]) < _MIN_AREA and _area(scaled) < _MIN_AREA:
        raise MeshError(mesh, "has no surface: its triangles are points or lines")
    if len(points) < _FEW and len(np.unique(points, axis=0)) < _MIN_CORNERS:
        raise MeshError(mesh, f"is not a solid: it has fewer than {_MIN_CORNERS} different corners")
    return Extents(float(np.abs(ends[1] - ends[0]).max()), _thickness(points))


def _area(triangles: Matrix) -> float:
    """Total area of triangles, of shape (n, 3, 3), m²."""
    sides = triangles[:, 1:] - triangles[:, :1]
    return float(np.linalg.norm(np.cross(sides[:, 0], sides[:, 1]), axis=1).sum()) / 2


def _thickness(points: Matrix) -> float:
    """Extent of points, of shape (n, 3), along the smallest principal axis of a sample of them."""
    sample = points[:: 1 + len(points) // _SAMPLE]
    sample = sample - sample.mean(axis=0)
    _, axes = np.linalg.eigh(sample.T @ sample)
    return float(np.ptp(points @ axes[:, 0]))


# Validation

MIN_THICKNESS: Final = 1e-4
"""Minimum thickness of a collision mesh, m; MuJoCo refuses bodies of less than 1e-15 m³."""


def mesh_problems(arm: Urdf) -> Iterator[Problem]:
    """Yield a problem for each unusable mesh of an arm, at the URDF element that names it."""
    for part in arm.parts.values():
        for shapes, solid in ((part.collision, True), (part.visual, False)):
            for shape in shapes:
                if shape.mesh is not None:
                    yield from _problem(shape, shape.mesh, solid=solid)


def _problem(shape: Shape, mesh: Path, *, solid: bool) -> Iterator[Problem]:
    try:
        _refuse_size(mesh, *extents(mesh, shape.size), solid=solid)
    except OSError as error:
        message = f"mesh {mesh.name} cannot be read: {error.strerror or error}"
        yield shape.element.problem(message, "", "filename")
    except MeshError as error:
        yield shape.element.problem(f"mesh {mesh.name} {error.message}", error.hint, "filename")


def _refuse_size(mesh: Path, extent: float, thickness: float, *, solid: bool) -> None:
    if not extent <= MAX_EXTENT:
        message = f"is {extent:.3g} m long; the maximum is {MAX_EXTENT:g} m"
        raise MeshError(mesh, message, MILLIMETERS)
    if not extent >= MIN_THICKNESS:
        raise MeshError(mesh, f"is only {extent:.3g} m long", "check its scale")
    if solid and not thickness >= MIN_THICKNESS:
        hint = "collision shapes need a thickness; use a <box> instead"
        raise MeshError(mesh, f"is flat: {thickness:.3g} m thick", hint)


# Low-polygon convex hulls

LOSS_M = 0.002
"""Distance in m by which a point may lie outside the simplified hull; with 1 mm there are 1.5 times
as many vertices."""

_DIRECTIONS = 24
"""Number of directions whose extreme points are the first vertices."""


@dataclass(frozen=True, eq=False)
class Hull:
    """A convex polyhedron.

    Attributes:
        vertices: Corners, of shape (n, 3), m.
        triangles: Corner indices of its faces, counterclockwise from outside, of shape (m, 3).
    """

    vertices: Matrix
    triangles: Matrix


def low_poly_hull(points: Matrix, loss: float = LOSS_M) -> Hull:
    """Simplified convex hull of points, of shape (n, 3), m; its vertices are some of the points.

    The hull of the extreme points in evenly spread directions is refined by the farthest point
    outside each face, until no point is farther outside than ``loss``, m.
    """
    corners = points[scipy.spatial.ConvexHull(points).vertices]
    chosen = np.unique(np.argmax(corners @ _fibonacci_sphere(_DIRECTIONS).T, axis=0))
    while True:
        hull = scipy.spatial.ConvexHull(corners[chosen])
        outside = corners @ hull.equations[:, :3].T + hull.equations[:, 3]
        farthest = np.argmax(outside, axis=0)[outside.max(axis=0) > loss]
        if len(farthest) == 0:
            return Hull(corners[chosen], _outward(corners[chosen], hull))
        chosen = np.union1d(chosen, farthest)


def _fibonacci_sphere(count: int) -> Matrix:
    """Evenly spread unit vectors, of shape (count, 3) (golden-angle spiral)."""
    k = np.arange(count) + 0.5
    z = 1 - 2 * k / count
    angle = np.pi * (1 + 5**0.5) * k
    radius = np.sqrt(1 - z**2)
    return np.column_stack((radius * np.cos(angle), radius * np.sin(angle), z))


def _outward(points: Matrix, hull: scipy.spatial.ConvexHull) -> Matrix:
    """Triangles of a hull, each with its corners counterclockwise from outside."""
    triangles: Matrix = hull.simplices.copy()
    corners = points[triangles]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    inward = np.einsum("ij,ij->i", normal, hull.equations[:, :3]) < 0
    triangles[inward] = triangles[inward][:, ::-1]
    return triangles


# Convex decomposition
#
# A link that is bent, or thick at its joints and thin between them, is much smaller than its convex
# hull. It is cut by planes normal to the axes of its mesh, along which links are modeled, at the
# positions where the hulls of the parts have the smallest total volume. The mesh need not be
# closed, because the hull of a part needs no cap.


_STEPS = 12
"""Number of equal slices along each axis; a part may be cut between two of them."""

_MIN_SAVING = 0.03
"""Fraction of the whole hull's volume that a cut must save: with less, the cavities of shells would
be cut out."""

_MAX_PARTS = 8

_MANY = 15_000
"""Number of triangles above which cuts are chosen on a coarse copy of the mesh: with the details of
a CAD model, its hulls would take ten times as long as the choice needs."""

_CELLS = 100
"""Number of cells along the longest side of a mesh, to whose corners those of its copy are moved:
the volumes of its hulls are right to 1 %."""

_ROUNDING = 1e-6
"""Relative rounding error of sums of volumes."""


@dataclass(frozen=True, eq=False)
class _Part:
    """A part of a mesh, and its best cut.

    Attributes:
        triangles: Corners of its triangles, of shape (n, 3, 3), m.
        fine: Those of the mesh itself where they are of its coarse copy; else None.
        volume: Volume of its convex hull, m³.
        saved: Volume that the best cut saves, m³; 0 if none is worth it.
        axis: Axis that is normal to the cut: 0, 1 or 2.
        offset: Position of the cut along the axis, m.
    """

    triangles: Matrix
    fine: Matrix | None
    volume: float
    saved: float
    axis: int
    offset: float


def convex_parts(triangles: Matrix) -> tuple[Matrix, ...]:
    """Decompose a mesh into parts whose convex hulls together contain it.

    Args:
        triangles: Corners of the mesh's triangles, of shape (n, 3, 3), m.

    Returns:
        Corner points of each part, of shape (m, 3), m.
    """
    many = len(triangles) > _MANY
    coarse = _coarse(triangles) if many else triangles
    whole = _best_cut(coarse, triangles if many else None, 0.0)
    parts = [whole]
    threshold = _MIN_SAVING * whole.volume
    while len(parts) < _MAX_PARTS:
        part = max(parts, key=lambda one: one.saved)
        if part.saved < threshold:
            break
        parts.remove(part)
        halves = cut_at(part.triangles, part.axis, part.offset)
        fine = (None, None) if part.fine is None else cut_at(part.fine, part.axis, part.offset)
        parts += [_best_cut(*both, threshold) for both in zip(halves, fine, strict=True)]
    joined = _joined([_Piece.of(part.triangles, part.fine) for part in parts], threshold)
    found = [one.triangles if one.fine is None else one.fine for one in joined]
    if many and min(_hull(one)[1] for one in found) == 0.0:  # there is hardly anything in a part
        found = [triangles]
    return tuple(one.reshape(-1, 3) for one in found)


def _coarse(triangles: Matrix) -> Matrix:
    """Copy of triangles, of shape (n, 3, 3), with corners on a grid, without those that vanish."""
    cell = float(np.ptp(triangles, axis=(0, 1)).max()) / _CELLS
    moved = np.unique(np.rint(triangles / cell).reshape(-1, 9), axis=0).reshape(-1, 3, 3)
    sides = moved - np.roll(moved, 1, axis=1)
    coarse: Matrix = moved[np.any(sides != 0.0, axis=2).all(axis=1)] * cell
    return coarse


@dataclass(frozen=True, eq=False)
class _Piece:
    """One part, or several joined.

    Attributes:
        triangles: Corners of its triangles, of shape (n, 3, 3), m.
        fine: As of a part.
        corners: Vertices of its convex hull, of shape (m, 3), m.
        volume: Volume of the hull, m³.
    """

    triangles: Matrix
    fine: Matrix | None
    corners: Matrix
    volume: float

    @classmethod
    def of(cls, triangles: Matrix, fine: Matrix | None) -> _Piece:
        """The piece of these triangles."""
        return cls(triangles, fine, *_hull(triangles))

    def added_by(self, other: _Piece) -> float:
        """Volume that the common hull of both adds to their own hulls, m³."""
        both = np.concatenate((self.corners, other.corners))
        return _hull(both)[1] - self.volume - other.volume


def _joined(pieces: list[_Piece], threshold: float) -> list[_Piece]:
    """Join pairs of pieces again whose common hull adds less than a threshold in m³.

    This undoes unfortunate cuts: the first cut of a dumbbell goes through the middle of its bar.
    """
    while len(pieces) > 1:
        pairs = itertools.combinations(range(len(pieces)), 2)
        added, i, j = min((pieces[i].added_by(pieces[j]), i, j) for i, j in pairs)
        if added >= threshold:
            break
        one, other = pieces[i], pieces[j]
        fine = None
        if one.fine is not None and other.fine is not None:
            fine = np.concatenate((one.fine, other.fine))
        both = _Piece.of(np.concatenate((one.triangles, other.triangles)), fine)
        pieces = [*(one for k, one in enumerate(pieces) if k not in (i, j)), both]
    return pieces


def _best_cut(triangles: Matrix, fine: Matrix | None, threshold: float) -> _Part:
    """A part with its best cut, if that saves at least a threshold in m³."""
    volume = _hull(triangles)[1]
    best = _Part(triangles, fine, volume, 0.0, 0, 0.0)
    low = triangles.min(axis=(0, 1))
    high = triangles.max(axis=(0, 1))
    for axis in range(3):
        offsets = [
            float(low[axis] + (high[axis] - low[axis]) * step / _STEPS) for step in range(1, _STEPS)
        ]
        slices = _slices(triangles, axis, offsets)
        saved, number = _most_saved(slices, volume, max(best.saved, threshold))
        if saved > best.saved:
            best = _Part(triangles, fine, volume, saved, axis, offsets[number])
    return best


def _slices(triangles: Matrix, axis: int, offsets: Sequence[float]) -> list[tuple[Matrix, float]]:
    """Hull corners and volume of the slices between planes normal to an axis, at rising offsets.

    The corners of a slice's hull suffice to compute the hull of several slices.
    """
    slices = []
    rest = triangles
    for offset in offsets:
        below, rest = cut_at(rest, axis, offset)
        slices.append(_hull(below))
    return [*slices, _hull(rest)]


def _most_saved(
    slices: Sequence[tuple[Matrix, float]], volume: float, least: float
) -> tuple[float, int]:
    """Volume that the best cut between two slices saves, m³, and its number; 0 if too little.

    The hull of several slices is at least as large as the sum of their hulls. This bound rules out
    most cuts before their hulls are computed.

    Args:
        slices: Corners and volume of each slice.
        volume: Volume of the hull of all of them, m³.
        least: Volume in m³ that it must save.
    """
    least *= 1.0 - _ROUNDING
    above = np.cumsum([size for _, size in slices[::-1]])[::-1]
    if volume - above[0] < least:
        return 0.0, 0
    corners = slices[0][0]
    lower = [slices[0][1]]
    for one, _ in slices[1:-1]:
        corners, size = _hull(np.concatenate((corners, one)))
        lower.append(size)
    best = 0.0, 0
    for number in np.argsort(np.add(lower, above[1:]), kind="stable").tolist():
        if volume - lower[number] - above[number + 1] < max(least, best[0] * (1.0 - _ROUNDING)):
            break
        upper = _hull(np.concatenate([one for one, _ in slices[number + 1 :]]))[1]
        saved = volume - lower[number] - upper
        if min(lower[number], upper) > 0.0:  # half of a mesh with holes may be flat
            best = max(best, (saved, number), key=lambda one: (one[0], -one[1]))
    return best


def _hull(points: Matrix) -> tuple[Matrix, float]:
    """Hull corners, of shape (m, 3), of points of shape (…, 3), and the hull's volume in m³.

    For flat sets all points, and a volume of 0.
    """
    points = points.reshape(-1, 3)
    try:
        hull = scipy.spatial.ConvexHull(points)
    except (scipy.spatial.QhullError, ValueError):
        return np.unique(points, axis=0), 0.0
    return points[hull.vertices], float(hull.volume)


# Shapes for contacts and cameras


@dataclass(frozen=True, eq=False)
class MeshShapes:
    """Convex approximations of a mesh.

    Attributes:
        outline: One hull around the whole mesh, for cameras: few shapes mean few ray tests.
        parts: Hulls of its convex parts, for contacts; the outline itself if there is one part.
    """

    outline: Hull
    parts: tuple[Hull, ...]


@lru_cache(maxsize=256)
def mesh_shapes(path: Path, scale: tuple[float, ...]) -> MeshShapes:
    """Convex approximations of a mesh whose corners are scaled along x, y and z.

    They are kept in the user's cache directory: computing them takes up to two seconds per mesh.
    """
    mesh = as_stl(path)
    digest = hashlib.sha256(mesh.read_bytes() + repr(scale).encode() + _source()).hexdigest()[:16]
    cached = cache_dir() / "hulls" / f"{start_of_name(path.stem)}-{digest}.npz"
    hulls = _read_hulls(cached)
    if hulls is None:
        hulls = _computed_hulls(mesh, scale)
        with suppress(OSError), _atomic_file(cached) as raw:
            np.savez(raw, *(array for hull in hulls for array in (hull.vertices, hull.triangles)))
    return MeshShapes(hulls[0], tuple(hulls[1:]) or (hulls[0],))


def _computed_hulls(mesh: Path, scale: tuple[float, ...]) -> list[Hull]:
    """The outline, followed by the parts if there are several."""
    triangles = stl_triangles(mesh) * np.asarray(scale)
    outline = low_poly_hull(triangles.reshape(-1, 3))
    parts = convex_parts(triangles)
    return [outline, *(map(low_poly_hull, parts) if len(parts) > 1 else ())]


def _read_hulls(cached: Path) -> list[Hull] | None:
    """Hulls from a cache file; None if it does not exist or is unreadable."""
    try:
        with cached.open("rb") as raw, np.load(raw) as file:
            arrays = [file[f"arr_{number}"] for number in range(len(file.files))]
            return [Hull(*pair) for pair in zip(arrays[::2], arrays[1::2], strict=True)]
    except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile):
        return None


# Meshes of objects


MAX_OBJECT_BYTES: Final = 20_000_000
"""Largest file of an object's mesh."""

MAX_OBJECT_EXTENT: Final = 10.0
"""Largest extent of an object, m, as that of one that is given by a size."""

OBJECT_LOSS: Final = 0.005
"""Fraction of an object's extent by which a point may lie outside of its simplified hulls."""


def refuse_object_mesh(path: Path, folder: Path, scale: float) -> None:
    """Check the mesh of an object before any use of it.

    Args:
        path: Its file.
        folder: Folder that the file must be in, or below.
        scale: Factor of its coordinates.

    Raises:
        MeshError: It is missing, outside of the folder, too large, too small or broken.
    """
    if not path.is_file():
        raise MeshError(path, "does not exist")
    if not path.resolve().is_relative_to(folder.resolve()):
        raise MeshError(path, f"is a link to a place outside of {folder}")
    size = path.stat().st_size
    if size > MAX_OBJECT_BYTES:
        most = MAX_OBJECT_BYTES // 1_000_000
        raise MeshError(path, f"has {size / 1e6:.0f} MB; the maximum is {most} MB", "simplify it")
    try:
        largest, thickness = extents(path, (scale,) * 3)
    except OSError as error:
        raise MeshError(path, f"cannot be read: {error}") from error
    if largest > MAX_OBJECT_EXTENT:
        hint = "it needs a smaller scale"
        if scale == 1.0:  # the default
            hint = "a mesh in millimeters needs scale: 0.001"
        raise MeshError(
            path, f"extends over {largest:.3g} m; at most {MAX_OBJECT_EXTENT:g} m is allowed", hint
        )
    if thickness < MIN_THICKNESS:
        hint = "it is not a solid, or needs a larger scale"
        raise MeshError(path, f"is {1e3 * thickness:.2g} mm thick; the minimum is 0.1 mm", hint)


def object_hulls(path: Path, scale: float) -> tuple[Matrix, ...]:
    """Corners of the convex parts of an object's mesh, each of shape (n, 3), m; cached.

    At most eight parts, cut by planes across the axes of the mesh, so that bent objects and those
    with handles are decomposed well, and cavities are not.
    """
    mesh = as_stl(path)
    key = mesh.read_bytes() + f"object {scale!r}".encode() + _source()
    digest = hashlib.sha256(key).hexdigest()[:16]
    cached = cache_dir() / "hulls" / f"{start_of_name(path.stem)}-{digest}.npz"
    hulls = _read_hulls(cached)
    if hulls is None:
        triangles = stl_triangles(mesh) * scale
        loss = min(LOSS_M, OBJECT_LOSS * float(np.ptp(triangles.reshape(-1, 3), axis=0).max()))
        hulls = [low_poly_hull(part, loss) for part in convex_parts(triangles)]
        with suppress(OSError), _atomic_file(cached) as raw:
            np.savez(raw, *(array for hull in hulls for array in (hull.vertices, hull.triangles)))
    return tuple(hull.vertices for hull in hulls)
