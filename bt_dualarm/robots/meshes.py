"""Robot meshes: reading, checking, measuring, and the shapes that stand for them in contacts."""

from __future__ import annotations

import contextlib
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
from contextlib import suppress
from dataclasses import dataclass
from functools import cache, lru_cache
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np
import scipy

from bt_dualarm.core.errors import CatalogError
from bt_dualarm.core.pose import Matrix
from bt_dualarm.core.share import cache_dir
from bt_dualarm.robots.urdf import Shape
from bt_dualarm.robots.urdf_arm import Urdf
from bt_dualarm.spec.problems import Problem

# Conversion of meshes to binary STL.
#
# MuJoCo reads neither COLLADA nor ASCII STL. Other formats than binary STL are converted once with
# the ``assimp`` program (of the package cmeel-assimp) and kept in the user's cache directory, or
# for the life of the process if that is not writable.


_STL_FACET = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attributes", "<u2")])
_STL_HEADER = 84

ASSIMP_SECONDS = 4.0
"""How long the conversion of one mesh may take; 29 MB of COLLADA take 0.4 s."""

_ASSIMP_MEMORY = 4 * 1024**3  # bytes
_ASSIMP_OUTPUT = 256 * 1024**2  # bytes
_UP_AXIS = re.compile(rb"<up_axis>\s*\w+\s*</up_axis>")


class MeshError(CatalogError):
    """A mesh cannot be used.

    Args:
        path: File of the mesh.
        message: What is wrong with it.
        hint: What may be done.
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
    name = f"{path.stem}-{digest}.stl"
    converted = cache_dir() / "meshes" / name
    try:
        _convert_once(path, converted)
    except OSError:  # nothing can be written there
        converted = Path(_scratch().name) / name
        _convert_once(path, converted)
    return converted


@cache
def _scratch() -> tempfile.TemporaryDirectory[str]:
    """Where meshes are converted that cannot be kept; gone with the process."""
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
    """Run assimp; the result appears under its name only when it is whole."""
    target.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=target.parent) as folder:
        upright = Path(folder) / source.name
        # A URDF takes vertices as they are; assimp turns models that declare z to be up.
        upright.write_bytes(_UP_AXIS.sub(rb"<up_axis>Y_UP</up_axis>", source.read_bytes()))
        raw = Path(folder) / target.name
        complaint = _run_assimp("export", str(upright), str(raw), "-fstlb", "-ptv")
        if complaint or not raw.is_file():
            raise MeshError(source, complaint or "was converted to nothing by assimp")
        _write_true_count(raw)
        raw.replace(target)


def _write_true_count(path: Path) -> None:
    """Mend the header: assimp counts lines and points that it then leaves out."""
    count = (path.stat().st_size - _STL_HEADER) // _STL_FACET.itemsize
    with path.open("r+b") as file:
        file.seek(80)
        file.write(count.to_bytes(4, "little"))


def _run_assimp(*arguments: str) -> str:
    """Run it to its end, or to that of its time; returns what it complains of."""
    program = _assimp()
    # The program does not say where its own library lies: in the folder beside its own.
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
            said, _ = process.communicate(timeout=ASSIMP_SECONDS)
        except subprocess.TimeoutExpired:
            return f"takes assimp longer than {ASSIMP_SECONDS:g} s"
        finally:
            process.kill()  # it has ended, or there is no use in waiting for its end
    if process.returncode == 0:
        return ""
    words = " ".join(said.decode(errors="replace").split()).rpartition("ERROR: ")[2]
    return f"cannot be read by assimp: {words[-200:]} (code {process.returncode})"


def _confine(pid: int) -> None:
    """Let a process take no more memory and write no larger a file than any sound mesh needs."""
    for limit, most in (
        (resource.RLIMIT_AS, _ASSIMP_MEMORY),
        (resource.RLIMIT_FSIZE, _ASSIMP_OUTPUT),
        (resource.RLIMIT_CORE, 0),
    ):
        with contextlib.suppress(ProcessLookupError):  # it has ended already
            resource.prlimit(pid, limit, (most, most))


def _assimp() -> Path:
    program = Path(sysconfig.get_paths()["purelib"]) / "cmeel.prefix" / "bin" / "assimp"
    if not program.is_file():
        raise CatalogError(f"the program assimp is missing ({program}); reinstall cmeel-assimp")
    return program


# Extent and least thickness of a mesh, cached.
#
# Reading and measuring the meshes of two arms takes 70 ms, up to a tenth of the start of a run.


MAX_TRIANGLES: Final = 200_000
"""What MuJoCo takes of one mesh."""

MAX_EXTENT: Final = 100.0
"""m; no link is larger."""

MILLIMETERS: Final = 'a mesh in millimeters needs scale="0.001 0.001 0.001"'

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
    key = repr((str(mesh.resolve()), scale, changed, size)).encode() + _extents_recipe()
    place = cache_dir() / "extents" / f"{mesh.stem}-{hashlib.sha256(key).hexdigest()[:16]}.json"
    try:
        return Extents(*map(float, json.loads(place.read_bytes())))
    except (OSError, ValueError, TypeError):
        found = _measured(mesh, scale)
        _keep_extents(place, found)
        return found


@lru_cache(maxsize=1)
def _extents_recipe() -> bytes:
    """The source of what measures: a change of it is another place in the cache."""
    return Path(__file__).read_bytes()


def _keep_extents(place: Path, found: Extents) -> None:
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
        raise MeshError(mesh, f"reaches {away:.3g} m away from its link", MILLIMETERS)
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


# Validation of meshes: empty, flat or infinite ones are refused before MuJoCo and Qhull fail


LEAST_THICKNESS: Final = 1e-4
"""m; what touches objects is thicker: MuJoCo takes no body of less than 1e-15 m³."""


def mesh_problems(arm: Urdf) -> Iterator[Problem]:
    """Meshes of an arm that are no shapes, each at the place where the URDF names it."""
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
        message = f"is {extent:.3g} m long; {MAX_EXTENT:g} m are the most"
        raise MeshError(mesh, message, MILLIMETERS)
    if not extent >= LEAST_THICKNESS:
        raise MeshError(mesh, f"is {extent:.3g} m long, which is nothing", "look at its scale")
    if solid and not thickness >= LEAST_THICKNESS:
        hint = "what touches things has a thickness; a <box> may stand for it"
        raise MeshError(mesh, f"is flat: {thickness:.3g} m thick", hint)


# Convex hulls with few vertices


LOSS_M = 0.002
"""Distance in meters by which a point may stand out of its hull; 1 mm takes 1.5 times the
vertices."""

_DIRECTIONS = 24
"""Number of directions whose extreme points a hull begins with."""


@dataclass(frozen=True, eq=False)
class Hull:
    """A convex polyhedron.

    Attributes:
        vertices: Corners, of shape (n, 3), m.
        triangles: Indices of the corners of its faces, anticlockwise seen from outside, (m, 3).
    """

    vertices: Matrix
    triangles: Matrix


def low_poly_hull(points: Matrix) -> Hull:
    """Convex hull of points, of shape (n, 3), m, with few vertices, all of them among the points.

    It begins with the extreme points in evenly spread directions and takes in the point that
    stands out farthest of each of its sides, until none stands out by more than `LOSS_M`.
    """
    corners = points[scipy.spatial.ConvexHull(points).vertices]
    chosen = np.unique(np.argmax(corners @ _fibonacci_sphere(_DIRECTIONS).T, axis=0))
    while True:
        hull = scipy.spatial.ConvexHull(corners[chosen])
        outside = corners @ hull.equations[:, :3].T + hull.equations[:, 3]
        farthest = np.argmax(outside, axis=0)[outside.max(axis=0) > LOSS_M]
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
    """Triangles of a hull, each with its corners anticlockwise seen from outside."""
    triangles: Matrix = hull.simplices.copy()
    corners = points[triangles]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    inward = np.einsum("ij,ij->i", normal, hull.equations[:, :3]) < 0
    triangles[inward] = triangles[inward][:, ::-1]
    return triangles


# Decomposition of a mesh into nearly convex parts.
#
# A link that is bent, or thick at its joints and thin between them, is far smaller than its convex
# hull. It is cut by planes normal to the axes of its mesh, along which links are modeled, where the
# hulls of the parts have the least total volume. The mesh need not be closed, since a part's hull
# needs no cap.


_STEPS = 12
"""Number of equal slices along each axis, between which a part may be cut."""

_WORTH = 0.03
"""Share of the whole hull's volume that a cut must save: with less, the hollow inside of a shell
would be cut free."""

_MOST = 8
"""Number of parts at most."""

_ROUNDING = 1e-6
"""Share by which sums of volumes may be off."""


@dataclass(frozen=True, eq=False)
class _Part:
    """A part of a mesh, and the best that one more cut could do.

    Attributes:
        triangles: Corners of its triangles, of shape (n, 3, 3), m.
        volume: Volume of its convex hull in m³.
        saved: Volume in m³ that is saved by the best cut.
        axis: Axis across which that cut goes: 0, 1 or 2.
        offset: Position of that cut along the axis, m.
    """

    triangles: Matrix
    volume: float
    saved: float
    axis: int
    offset: float


def convex_parts(triangles: Matrix) -> tuple[Matrix, ...]:
    """Points of the parts, each of shape (m, 3), m, whose convex hulls hold the whole mesh.

    Args:
        triangles: Corners of the mesh's triangles, of shape (n, 3, 3), m.
    """
    whole = _best_cut(triangles, 0.0)
    parts = [whole]
    worth = _WORTH * whole.volume
    while len(parts) < _MOST:
        part = max(parts, key=lambda one: one.saved)
        if part.saved < worth:
            break
        parts.remove(part)
        halves = _halves(part.triangles, part.axis, part.offset)
        parts += [_best_cut(half, worth) for half in halves]
    joined = _joined([_Piece.of(part.triangles) for part in parts], worth)
    return tuple(one.triangles.reshape(-1, 3) for one in joined)


@dataclass(frozen=True, eq=False)
class _Piece:
    """One part or several together.

    Attributes:
        triangles: Corners of its triangles, of shape (n, 3, 3), m.
        corners: Points that have the same convex hull, of shape (m, 3), m.
        volume: Volume of that in m³.
    """

    triangles: Matrix
    corners: Matrix
    volume: float

    @classmethod
    def of(cls, triangles: Matrix) -> _Piece:
        """The piece of these triangles."""
        return cls(triangles, *_hull(triangles))

    def added_by(self, other: _Piece) -> float:
        """Volume in m³ by which the hull of both is larger than their own."""
        both = np.concatenate((self.corners, other.corners))
        return _hull(both)[1] - self.volume - other.volume


def _joined(pieces: list[_Piece], worth: float) -> list[_Piece]:
    """The pieces with those together again whose hull adds less than a volume in m³.

    A first cut goes through the middle of a thin piece between two thick ends.
    """
    while len(pieces) > 1:
        pairs = itertools.combinations(range(len(pieces)), 2)
        added, i, j = min((pieces[i].added_by(pieces[j]), i, j) for i, j in pairs)
        if added >= worth:
            break
        both = _Piece.of(np.concatenate((pieces[i].triangles, pieces[j].triangles)))
        pieces = [*(one for k, one in enumerate(pieces) if k not in (i, j)), both]
    return pieces


def _best_cut(triangles: Matrix, worth: float) -> _Part:
    """A part, and its best cut if that saves as much as a volume in m³."""
    volume = _hull(triangles)[1]
    best = _Part(triangles, volume, 0.0, 0, 0.0)
    low = triangles.min(axis=(0, 1))
    high = triangles.max(axis=(0, 1))
    for axis in range(3):
        offsets = [
            float(low[axis] + (high[axis] - low[axis]) * step / _STEPS) for step in range(1, _STEPS)
        ]
        slices = _slices(triangles, axis, offsets)
        saved, number = _most_saved(slices, volume, max(best.saved, worth))
        if saved > best.saved:
            best = _Part(triangles, volume, saved, axis, offsets[number])
    return best


def _slices(triangles: Matrix, axis: int, offsets: Sequence[float]) -> list[tuple[Matrix, float]]:
    """What lies between planes across an axis, at rising offsets: as `_hull` has it.

    The corners of a slice's own hull do: all else is inside whatever hull holds the slice.
    """
    slices = []
    rest = triangles
    for offset in offsets:
        below, rest = _halves(rest, axis, offset)
        slices.append(_hull(below))
    return [*slices, _hull(rest)]


def _most_saved(
    slices: Sequence[tuple[Matrix, float]], volume: float, least: float
) -> tuple[float, int]:
    """What the best cut between two slices saves, in m³, and its number; 0 if it is too little.

    The hull of several slices is no smaller than theirs together: most cuts are known by that to
    save too little before their hulls are made.

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
        if min(lower[number], upper) > 0.0:  # of a mesh with holes a half may be flat
            best = max(best, (saved, number), key=lambda one: (one[0], -one[1]))
    return best


def _halves(triangles: Matrix, axis: int, offset: float) -> tuple[Matrix, Matrix]:
    """The triangles below a plane across an axis, and those above it, of shape (m, 3, 3) each."""
    below = triangles[:, :, axis] <= offset
    count = below.sum(axis=1)
    crossing = (count == 1) | (count == 2)
    # Of a triangle that crosses the plane one corner is alone on its side: it comes first.
    lower = count[crossing] == 1
    alone = np.argmax(below[crossing] == lower[:, None], axis=1)
    order = (alone[:, None] + np.arange(3)) % 3
    first, second, third = np.take_along_axis(
        triangles[crossing], order[:, :, None], axis=1
    ).transpose(1, 0, 2)
    ends = [_meeting(first, other, axis, offset) for other in (second, third)]
    tips = np.stack((first, *ends), axis=1)
    stumps = np.stack((ends[0], second, third), axis=1), np.stack((*ends, third), axis=1)
    return (
        np.concatenate((triangles[count == 3], tips[lower], *(one[~lower] for one in stumps))),
        np.concatenate((triangles[count == 0], tips[~lower], *(one[lower] for one in stumps))),
    )


def _meeting(start: Matrix, end: Matrix, axis: int, offset: float) -> Matrix:
    """Where lines from points to points, of shape (n, 3) each, meet a plane across an axis."""
    share = (offset - start[:, axis]) / (end[:, axis] - start[:, axis])
    points: Matrix = start + share[:, None] * (end - start)
    return points


def _hull(points: Matrix) -> tuple[Matrix, float]:
    """Corners, of shape (m, 3), of the hull of points, of shape (…, 3), and its volume in m³.

    Of what is flat all points, and a volume of 0.
    """
    points = points.reshape(-1, 3)
    try:
        hull = scipy.spatial.ConvexHull(points)
    except (scipy.spatial.QhullError, ValueError):
        return np.unique(points, axis=0), 0.0
    return points[hull.vertices], float(hull.volume)


# Shapes that replace a mesh in contacts and camera images, cached


@dataclass(frozen=True, eq=False)
class MeshShapes:
    """Convex stand-ins of a mesh.

    Attributes:
        outline: One hull around all of it: a camera's rays ask for few shapes.
        parts: Hulls of its parts: what touches objects; the outline itself where it has one part.
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
    digest = hashlib.sha256(
        mesh.read_bytes() + repr(scale).encode() + _shapes_recipe()
    ).hexdigest()[:16]
    place = cache_dir() / "hulls" / f"{path.stem}-{digest}.npz"
    hulls = _read(place)
    if hulls is None:
        hulls = _computed(mesh, scale)
        _keep_shapes(place, hulls)
    return MeshShapes(hulls[0], tuple(hulls[1:]) or (hulls[0],))


@lru_cache(maxsize=1)
def _shapes_recipe() -> bytes:
    """The source of what computes them: a change of it is another place in the cache."""
    return Path(__file__).read_bytes()


def _computed(mesh: Path, scale: tuple[float, ...]) -> list[Hull]:
    """The outline, then the parts where there are several."""
    triangles = stl_triangles(mesh) * np.asarray(scale)
    outline = low_poly_hull(triangles.reshape(-1, 3))
    parts = convex_parts(triangles)
    return [outline, *(map(low_poly_hull, parts) if len(parts) > 1 else ())]


def _read(place: Path) -> list[Hull] | None:
    """What is kept there; None where nothing is, or nothing of use."""
    try:
        with place.open("rb") as raw, np.load(raw) as file:
            arrays = [file[f"arr_{number}"] for number in range(len(file.files))]
            return [Hull(*pair) for pair in zip(arrays[::2], arrays[1::2], strict=True)]
    except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile):
        return None


def _keep_shapes(place: Path, hulls: Sequence[Hull]) -> None:
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
