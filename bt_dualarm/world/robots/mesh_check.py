"""Meshes of a robot, read before MuJoCo and Qhull do: what is empty, flat or endless is refused."""

from __future__ import annotations

from collections.abc import Iterator
from functools import lru_cache
from pathlib import Path
from typing import Final

import numpy as np

from bt_dualarm.pose import Matrix
from bt_dualarm.spec.problems import Problem
from bt_dualarm.world.robots.meshes import MeshError, as_stl, stl_triangles
from bt_dualarm.world.robots.urdf import Urdf
from bt_dualarm.world.urdf.link import Shape

MAX_TRIANGLES: Final = 200_000
"""What MuJoCo takes of one mesh."""

LEAST_THICKNESS: Final = 1e-4
"""m; what touches things is thicker: MuJoCo takes no body of less than 1e-15 m³."""

MAX_EXTENT: Final = 100.0
"""m; no link is larger."""

_LEAST_CORNERS: Final = 4
_LEAST_AREA: Final = 1e-10  # m²
_FEW: Final = 200
_SAMPLE: Final = 2000  # corners that say where a mesh is flattest
_MILLIMETRES: Final = 'a mesh in millimetres needs scale="0.001 0.001 0.001"'


def mesh_problems(arm: Urdf) -> Iterator[Problem]:
    """Meshes of an arm that are no shapes, each at the place where the URDF names it."""
    for part in arm.parts.values():
        for shapes, solid in ((part.collision, True), (part.visual, False)):
            for shape in shapes:
                if shape.mesh is not None:
                    yield from _problem(shape, shape.mesh, solid=solid)


def _problem(shape: Shape, mesh: Path, *, solid: bool) -> Iterator[Problem]:
    try:
        state = mesh.stat()
        extent, thickness = _measured(mesh, shape.size, state.st_mtime_ns, state.st_size)
        _refuse_size(mesh, extent, thickness, solid=solid)
    except OSError as error:
        message = f"mesh {mesh.name} cannot be read: {error.strerror or error}"
        yield shape.element.problem(message, "", "filename")
    except MeshError as error:
        yield shape.element.problem(f"mesh {mesh.name} {error.message}", error.hint, "filename")


def _refuse_size(mesh: Path, extent: float, thickness: float, *, solid: bool) -> None:
    if not extent <= MAX_EXTENT:
        message = f"is {extent:.3g} m long; {MAX_EXTENT:g} m are the most"
        raise MeshError(mesh, message, _MILLIMETRES)
    if not extent >= LEAST_THICKNESS:
        raise MeshError(mesh, f"is {extent:.3g} m long, which is nothing", "look at its scale")
    if solid and not thickness >= LEAST_THICKNESS:
        hint = "what touches things has a thickness; a <box> may stand for it"
        raise MeshError(mesh, f"is flat: {thickness:.3g} m thick", hint)


@lru_cache(maxsize=1024)
def _measured(
    mesh: Path, scale: tuple[float, ...], _changed: int, _size: int
) -> tuple[float, float]:
    """Largest and smallest extent of a mesh, m; read again only when the file has changed."""
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
        raise MeshError(mesh, f"reaches {away:.3g} m away from its link", _MILLIMETRES)
    if _area(scaled[:_FEW]) < _LEAST_AREA and _area(scaled) < _LEAST_AREA:
        raise MeshError(mesh, "has no surface: its triangles are points or lines")
    if len(points) < _FEW and len(np.unique(points, axis=0)) < _LEAST_CORNERS:
        raise MeshError(mesh, f"is no shape: it has fewer than {_LEAST_CORNERS} different corners")
    return float(np.abs(ends[1] - ends[0]).max()), _thickness(points)


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
