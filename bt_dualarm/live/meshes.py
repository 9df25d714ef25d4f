"""Shapes and meshes of a world for a page: the robots' real meshes, where their files are there."""

from __future__ import annotations

import struct
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Final

import mujoco
import numpy as np

from bt_dualarm.errors import DualArmError
from bt_dualarm.replay.page_scene import shapes_of
from bt_dualarm.spec.source import Json
from bt_dualarm.world.robots.catalogue import load_robot
from bt_dualarm.world.robots.geom_groups import COLLISION_GROUP, VISUAL_GROUP
from bt_dualarm.world.robots.mjspec import TOOL_GEOM, robot_spec
from bt_dualarm.world.robots.robot import Robot

_COUNTS: Final = struct.Struct("<III")


@dataclass(frozen=True)
class Looks:
    """What a page draws of one compiled world.

    Attributes:
        shapes: Each with name, body, place on it, scale and colour, ready for JSON.
        meshes: Content of each mesh among them, by name: see `packed`.
    """

    shapes: tuple[Json, ...]
    meshes: Mapping[str, bytes]


def packed(model: mujoco.MjModel, mesh: int) -> bytes:
    """A mesh as a page reads it: how many vertices, normals and triangles it has, then these.

    Vertices in m and normals with three 32-bit numbers each; for each triangle the numbers of
    three vertices, then, for each again, those of three normals.
    """
    first, count = int(model.mesh_vertadr[mesh]), int(model.mesh_vertnum[mesh])
    normal, normals = int(model.mesh_normaladr[mesh]), int(model.mesh_normalnum[mesh])
    face, faces = int(model.mesh_faceadr[mesh]), int(model.mesh_facenum[mesh])
    parts = (
        model.mesh_vert[first : first + count].astype(np.float32),
        model.mesh_normal[normal : normal + normals].astype(np.float32),
        model.mesh_face[face : face + faces].astype(np.uint32),
        model.mesh_facenormal[face : face + faces].astype(np.uint32),
    )
    return _COUNTS.pack(count, normals, faces) + b"".join(part.tobytes() for part in parts)


def looks_of(model: mujoco.MjModel, robots: Mapping[str, Robot]) -> Looks:
    """What is drawn of a world.

    Args:
        model: The compiled world.
        robots: Robots whose real meshes are to be seen, by the arm's name; of the others the
            hulls are, that cameras see.
    """
    shapes, hulls = shapes_of(model)
    real = {name: _real(robot) for name, robot in robots.items()}
    clothed = {f"{arm}/" for arm, looks in real.items() if looks.shapes}
    kept = [shape for shape in shapes if not _is_hull(model, shape, clothed)]
    meshes = {name: packed(model, model.mesh(name).id) for name in hulls}
    for arm, looks in real.items():
        for shape in looks.shapes:
            body = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, f"{arm}/{shape['body']}")
            if body >= 0:
                kept.append({**shape, "body": body})
        meshes |= looks.meshes
    used = {str(shape["name"]) for shape in kept}
    return Looks(tuple(kept), {name: mesh for name, mesh in meshes.items() if name in used})


def robot_of(name: str, root: Path) -> Robot | None:
    """A robot by its name or page; None where that is no longer to be had."""
    try:
        return load_robot(name, root)
    except (DualArmError, OSError):
        return None


def _is_hull(model: mujoco.MjModel, shape: Json, clothed: set[str]) -> bool:
    """Whether a shape is a link of an arm whose real meshes are drawn."""
    geom = int(shape["geom"])
    name = model.geom(geom).name
    is_tool = name.endswith(f"/{TOOL_GEOM}")
    return (
        int(model.geom_group[geom]) == COLLISION_GROUP
        and any(name.startswith(arm) for arm in clothed)
        and not is_tool
    )


def _real(robot: Robot) -> Looks:
    return _looks_of_robot(robot.name, robot)


@lru_cache(maxsize=16)
def _looks_of_robot(name: str, robot: Robot) -> Looks:
    """What is seen of a robot, each shape with the name of its link for a body."""
    try:
        spec = robot_spec(robot, visuals=True)
        spec.compiler.discardvisual = False
        model = spec.compile()
    except (DualArmError, ValueError, OSError):
        return Looks((), {})
    shapes = tuple(_visuals(model, name))
    meshes = {
        f"{name}:{model.mesh(mesh).name}": packed(model, mesh)
        for mesh in {int(model.geom_dataid[geom]) for geom in _seen(model)} - {-1}
    }
    return Looks(shapes, meshes)


def _seen(model: mujoco.MjModel) -> list[int]:
    return [geom for geom in range(model.ngeom) if model.geom_group[geom] == VISUAL_GROUP]


def _visuals(model: mujoco.MjModel, robot: str) -> Iterator[Json]:
    drawn, _ = shapes_of(model, (VISUAL_GROUP,))
    for shape in drawn:
        own = int(model.geom_dataid[shape["geom"]]) >= 0
        called = f"{robot}:{shape['name']}" if own else shape["name"]
        yield {**shape, "name": called, "body": model.body(int(shape["body"])).name}
