"""Meshes of a robot, read before MuJoCo and Qhull do: what is empty, flat or endless is refused."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Final

from bt_dualarm.spec.problems import Problem
from bt_dualarm.world.robots.mesh_extents import MAX_EXTENT, MILLIMETRES, extents
from bt_dualarm.world.robots.meshes import MeshError
from bt_dualarm.world.robots.urdf import Urdf
from bt_dualarm.world.urdf.link import Shape

LEAST_THICKNESS: Final = 1e-4
"""m; what touches things is thicker: MuJoCo takes no body of less than 1e-15 m³."""


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
        raise MeshError(mesh, message, MILLIMETRES)
    if not extent >= LEAST_THICKNESS:
        raise MeshError(mesh, f"is {extent:.3g} m long, which is nothing", "look at its scale")
    if solid and not thickness >= LEAST_THICKNESS:
        hint = "what touches things has a thickness; a <box> may stand for it"
        raise MeshError(mesh, f"is flat: {thickness:.3g} m thick", hint)
