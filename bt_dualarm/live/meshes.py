"""Shapes and meshes of a world for a page: the robots' real meshes, where their files are there."""

from __future__ import annotations

import struct
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Final, TypeAlias

import mujoco
import numpy as np

from bt_dualarm.errors import DualArmError
from bt_dualarm.replay.page_scene import shapes_of
from bt_dualarm.spec.source import Json
from bt_dualarm.world.grippers.gripper import Gripper
from bt_dualarm.world.grippers.mjspec import add_gripper
from bt_dualarm.world.grippers.mounting import with_gripper
from bt_dualarm.world.grippers.named import load_gripper
from bt_dualarm.world.robots.catalogue import load_robot
from bt_dualarm.world.robots.geom_groups import COLLISION_GROUP, VISUAL_GROUP
from bt_dualarm.world.robots.mjspec import TOOL_GEOM, robot_spec
from bt_dualarm.world.robots.robot import Robot

Mounted: TypeAlias = tuple[Robot, Gripper | None]
"""A robot with its gripper mounted, and that gripper if it has one."""

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


def looks_of(model: mujoco.MjModel, arms: Mapping[str, Mounted]) -> Looks:
    """What is drawn of a world.

    Args:
        model: The compiled world.
        arms: Arms whose real meshes are to be seen, by name; of the others the hulls are, that
            cameras see.
    """
    shapes, hulls = shapes_of(model)
    meshes = {name: packed(model, model.mesh(name).id) for name in hulls}
    visuals: list[Json] = []
    for arm, (robot, gripper) in arms.items():
        looks = _looks_of_arm(robot, gripper)
        for shape in looks.shapes:
            body = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, f"{arm}/{shape['body']}")
            if body >= 0:
                visuals.append({**shape, "body": body})
        meshes |= looks.meshes
    clothed = {int(shape["body"]) for shape in visuals}
    kept = [shape for shape in shapes if not _is_hull(model, shape, clothed)] + visuals
    used = {str(shape["name"]) for shape in kept}
    return Looks(tuple(kept), {name: mesh for name, mesh in meshes.items() if name in used})


def arm_of(facts: Json, root: Path) -> Mounted | None:
    """The robot and gripper of an arm by their names or descriptions, as a record has them.

    None where one is no longer to be had, or does not fit any more.
    """
    try:
        robot = load_robot(str(facts["robot"]), root)
        if facts.get("gripper") is None:
            return robot, None
        gripper = load_gripper(str(facts["gripper"]), root)
        return with_gripper(robot, gripper), gripper
    except (DualArmError, OSError, KeyError):
        return None


def _is_hull(model: mujoco.MjModel, shape: Json, clothed: set[int]) -> bool:
    """Whether a shape belongs to a link whose real meshes are drawn, and is not its tool."""
    geom = int(shape["geom"])
    return (
        int(model.geom_group[geom]) == COLLISION_GROUP
        and int(shape["body"]) in clothed
        and not model.geom(geom).name.endswith(f"/{TOOL_GEOM}")
    )


@lru_cache(maxsize=16)
def _looks_of_arm(robot: Robot, gripper: Gripper | None) -> Looks:
    """What is seen of an arm, each shape with the name of its link for a body."""
    name = robot.name if gripper is None else f"{robot.name}+{gripper.name}"
    try:
        spec = robot_spec(robot, visuals=True)
        if gripper is not None:
            add_gripper(spec, robot, gripper, visuals=True)
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


def _visuals(model: mujoco.MjModel, arm: str) -> Iterator[Json]:
    drawn, _ = shapes_of(model, (VISUAL_GROUP,))
    for shape in drawn:
        own = int(model.geom_dataid[shape["geom"]]) >= 0
        called = f"{arm}:{shape['name']}" if own else shape["name"]
        yield {**shape, "name": called, "body": model.body(int(shape["body"])).name}
