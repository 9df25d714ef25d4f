"""Shapes and meshes of a world for a page: the robots' real meshes, where their files are there."""

from __future__ import annotations

import hashlib
import struct
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Final, TypeAlias

import mujoco
import numpy as np

from bt_dualarm.errors import DualArmError
from bt_dualarm.spec.source import Json
from bt_dualarm.world.grippers.gripper import Gripper
from bt_dualarm.world.grippers.mjspec import add_gripper
from bt_dualarm.world.grippers.mounting import with_gripper
from bt_dualarm.world.grippers.named import load_gripper
from bt_dualarm.world.robots.catalogue import load_robot
from bt_dualarm.world.robots.geom_groups import COLLISION_GROUP, LOOP_GROUPS, VISUAL_GROUP
from bt_dualarm.world.robots.mjspec import TOOL_GEOM, robot_spec
from bt_dualarm.world.robots.robot import Robot

Mounted: TypeAlias = tuple[Robot, Gripper | None]
"""A robot with its gripper mounted, and that gripper if it has one."""

_HEAD: Final = struct.Struct("<II6f")
_STEPS: Final = 65535
_SMALL: Final = 1 << 16
_FLOOR_M: Final = 4.0
_FLOOR_COLOR: Final = [0.72, 0.75, 0.78, 1.0]

_Geom = mujoco.mjtGeom


@dataclass(frozen=True)
class Looks:
    """What a page draws of one compiled world.

    Attributes:
        shapes: Each with name, body, place on it, scale and colour, ready for JSON.
        meshes: Content of each mesh among them, by name: see `packed`. The name is a digest of the
            content, so that a mesh is sent once, whoever has it.
    """

    shapes: tuple[Json, ...]
    meshes: Mapping[str, bytes]


def packed(model: mujoco.MjModel, mesh: int) -> bytes:
    """A mesh as a page reads it, in a fifth of its bytes in memory.

    How many vertices and triangles it has, two 32-bit numbers; lowest corner and size of the box
    around it in m, six floats; of each vertex three 16-bit numbers, shares of that box, so that a
    link of 1 m is off by 8 µm at most; of each triangle the numbers of its vertices, with 16 bits
    each where that is enough, else with 32; of each vertex the normal, three 8-bit numbers.
    """
    first, count = int(model.mesh_vertadr[mesh]), int(model.mesh_vertnum[mesh])
    normal, normals = int(model.mesh_normaladr[mesh]), int(model.mesh_normalnum[mesh])
    face, faces = int(model.mesh_faceadr[mesh]), int(model.mesh_facenum[mesh])
    corners = model.mesh_face[face : face + faces].astype(np.int64).ravel()
    facing = model.mesh_facenormal[face : face + faces].astype(np.int64).ravel()
    # A vertex of a page has one normal: one of MuJoCo's with several becomes several.
    pairs, numbers = np.unique(corners * max(normals, 1) + facing, return_inverse=True)
    points = model.mesh_vert[first : first + count][pairs // max(normals, 1)].astype(float)
    directions = model.mesh_normal[normal : normal + normals][pairs % max(normals, 1)]
    low = points.min(axis=0)
    size = np.maximum(points.max(axis=0) - low, 1e-9)
    parts = (
        (_STEPS * (points - low) / size).round().astype("<u2"),
        numbers.astype("<u2" if len(points) <= _SMALL else "<u4"),
        (127 * directions).round().astype("i1"),
    )
    head = _HEAD.pack(len(points), faces, *low.tolist(), *size.tolist())
    return head + b"".join(part.tobytes() for part in parts)


def looks_of(model: mujoco.MjModel, arms: Mapping[str, Mounted]) -> Looks:
    """What is drawn of a world.

    Args:
        model: The compiled world.
        arms: Arms whose real meshes are to be seen, by name; of the others the hulls are, that
            cameras see.
    """
    visuals: list[Json] = []
    meshes: dict[str, bytes] = {}
    for arm, (robot, gripper) in arms.items():
        looks = _looks_of_arm(robot, gripper)
        for shape in looks.shapes:
            body = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, f"{arm}/{shape['body']}")
            if body >= 0:
                visuals.append({**shape, "body": body})
        meshes |= looks.meshes
    clothed = {int(shape["body"]) for shape in visuals}
    seen = [
        geom
        for geom in range(model.ngeom)
        if model.geom_group[geom] in LOOP_GROUPS and not _is_hull(model, geom, clothed)
    ]
    shapes, hulls = _drawn(model, seen)
    kept = (*shapes, *visuals)
    used = {str(shape["name"]) for shape in kept}
    meshes |= hulls
    return Looks(kept, {name: mesh for name, mesh in meshes.items() if name in used})


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


def _is_hull(model: mujoco.MjModel, geom: int, clothed: Collection[int]) -> bool:
    """Whether a shape belongs to a link whose real meshes are drawn, and is not its tool."""
    return (
        int(model.geom_group[geom]) == COLLISION_GROUP
        and int(model.geom_bodyid[geom]) in clothed
        and not model.geom(geom).name.endswith(f"/{TOOL_GEOM}")
    )


@lru_cache(maxsize=16)
def _looks_of_arm(robot: Robot, gripper: Gripper | None) -> Looks:
    """What is seen of an arm, each shape with the name of its link for a body."""
    try:
        spec = robot_spec(robot, visuals=True)
        if gripper is not None:
            add_gripper(spec, robot, gripper, visuals=True)
        spec.compiler.discardvisual = False
        model = spec.compile()
    except (DualArmError, ValueError, OSError):
        return Looks((), {})
    seen = [geom for geom in range(model.ngeom) if model.geom_group[geom] == VISUAL_GROUP]
    shapes, meshes = _drawn(model, seen)
    named = [{**shape, "body": model.body(int(shape["body"])).name} for shape in shapes]
    return Looks(tuple(named), meshes)


def _drawn(
    model: mujoco.MjModel, geoms: Collection[int]
) -> tuple[tuple[Json, ...], Mapping[str, bytes]]:
    """Some geoms as shapes that a page can draw, and the meshes among them by name."""
    meshes: dict[str, bytes] = {}
    names: dict[int, str] = {}
    shapes = []
    for geom in geoms:
        if model.geom_type[geom] == _Geom.mjGEOM_MESH:
            mesh = int(model.geom_dataid[geom])
            if mesh not in names:
                content = packed(model, mesh)
                names[mesh] = hashlib.sha256(content).hexdigest()[:20]
                meshes[names[mesh]] = content
            parts = [(names[mesh], [1.0, 1.0, 1.0], 0.0)]
        else:
            parts = [*_parts(int(model.geom_type[geom]), model.geom_size[geom].tolist())]
        for name, scale, lift in parts:
            turned = np.zeros(3)
            mujoco.mju_rotVecQuat(turned, np.array((0.0, 0.0, lift)), model.geom_quat[geom])
            shapes.append(
                {
                    "name": name,
                    "body": int(model.geom_bodyid[geom]),
                    "position": (model.geom_pos[geom] + turned).round(6).tolist(),
                    "quaternion": model.geom_quat[geom].round(6).tolist(),
                    "scale": scale,
                    "color": _color(model, geom),
                }
            )
    return tuple(shapes), meshes


def _parts(kind: int, size: list[float]) -> Iterator[tuple[str, list[float], float]]:
    """Name of a shape, its scale and how far along z it lies, in m, for each part of a geom."""
    if kind == _Geom.mjGEOM_BOX:
        yield "box", size, 0.0
    elif kind == _Geom.mjGEOM_SPHERE:
        yield "sphere", [size[0]] * 3, 0.0
    elif kind == _Geom.mjGEOM_ELLIPSOID:
        yield "sphere", size, 0.0
    elif kind == _Geom.mjGEOM_CYLINDER:
        yield "cylinder", [size[0], size[0], size[1]], 0.0
    elif kind == _Geom.mjGEOM_CAPSULE:
        yield "tube", [size[0], size[0], size[1]], 0.0
        yield "sphere", [size[0]] * 3, size[1]
        yield "sphere", [size[0]] * 3, -size[1]
    elif kind == _Geom.mjGEOM_PLANE:
        yield "plane", [size[0] or _FLOOR_M, size[1] or _FLOOR_M, 1.0], 0.0


def _color(model: mujoco.MjModel, geom: int) -> list[float]:
    if model.geom_type[geom] == _Geom.mjGEOM_PLANE:
        return _FLOOR_COLOR
    material = int(model.geom_matid[geom])
    rgba = model.geom_rgba[geom] if material < 0 else model.mat_rgba[material]
    color: list[float] = rgba.round(3).tolist()
    return color
