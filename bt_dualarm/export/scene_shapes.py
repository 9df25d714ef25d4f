"""Shapes of a recorded world, with the visual meshes of robots and grippers.

A record has the shapes that cameras see: convex hulls of the links. The visual meshes are read from
the catalog, by the names of robot and gripper. An arm with its own description file keeps its
hulls: a record may be untrusted, and no path that it names is opened.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Final

import mujoco
import numpy as np
import numpy.typing as npt

from bt_dualarm.core.errors import DualArmError
from bt_dualarm.core.pose import Vector
from bt_dualarm.replay.record import Facts
from bt_dualarm.robots.gripper import gripper_names, load_gripper
from bt_dualarm.robots.mjspec import LOOP_GROUPS, TOOL_GEOM, VISUAL_GROUP, add_gripper, robot_spec
from bt_dualarm.robots.mounting import with_gripper
from bt_dualarm.robots.robot_description import load_robot, robot_names
from bt_dualarm.sim.ray_renderer import geom_colors

_KINDS: Final = {
    mujoco.mjtGeom.mjGEOM_PLANE: "plane",
    mujoco.mjtGeom.mjGEOM_SPHERE: "sphere",
    mujoco.mjtGeom.mjGEOM_CAPSULE: "capsule",
    mujoco.mjtGeom.mjGEOM_ELLIPSOID: "ellipsoid",
    mujoco.mjtGeom.mjGEOM_CYLINDER: "cylinder",
    mujoco.mjtGeom.mjGEOM_BOX: "box",
    mujoco.mjtGeom.mjGEOM_MESH: "mesh",
}


@dataclass(frozen=True, eq=False)
class Mesh:
    """A triangle mesh.

    Attributes:
        vertices: Vertices of shape (n, 3), m, 32-bit.
        faces: Indices of three vertices each, counterclockwise from outside, of shape (m, 3).
    """

    vertices: npt.NDArray[np.float32]
    faces: npt.NDArray[np.uint32]


@dataclass(frozen=True, eq=False)
class DrawnShape:
    """One shape of a body.

    Attributes:
        body: Name of the body; ``world`` for static shapes.
        name: Name of the shape, which may be empty.
        kind: ``plane``, ``sphere``, ``capsule``, ``ellipsoid``, ``cylinder``, ``box`` or ``mesh``.
        position: Position in the body, of shape (3,), m.
        quaternion: Orientation in the body (w, x, y, z).
        size: MuJoCo's sizes: half lengths of a box or plane (0: infinite), radius and half length.
        color: Red, green, blue, opacity, from 0 to 1.
        mesh: Triangles of a mesh.
    """

    body: str
    name: str
    kind: str
    position: Vector
    quaternion: Vector
    size: Vector
    color: tuple[float, float, float, float]
    mesh: Mesh | None


def drawn_shapes(model: mujoco.MjModel, arms: dict[str, Facts]) -> list[DrawnShape]:
    """Shapes of everything visible in a compiled world.

    Args:
        model: The compiled world.
        arms: The record's data of each arm, by name.
    """
    drawn = [*_shapes(model, LOOP_GROUPS)]
    for arm, facts in arms.items():
        gripper = facts.get("gripper")
        locked = tuple(sorted(facts.get("locked", {}).items()))
        real = _real_shapes(str(facts["robot"]), None if gripper is None else str(gripper), locked)
        bodies = {f"{arm}/{shape.body}" for shape in real}
        present = {model.body(body).name for body in range(model.nbody)} & bodies
        drawn = [shape for shape in drawn if not _is_covered(shape, present)]
        drawn += [
            DrawnShape(
                f"{arm}/{shape.body}",
                f"{arm}/{shape.name}",
                shape.kind,
                shape.position,
                shape.quaternion,
                shape.size,
                shape.color,
                shape.mesh,
            )
            for shape in real
            if f"{arm}/{shape.body}" in present
        ]
    return drawn


def _is_covered(shape: DrawnShape, bodies: Collection[str]) -> bool:
    """Whether a visual mesh replaces the hull of a link; tool shapes have no visual mesh."""
    return shape.body in bodies and not shape.name.endswith(f"/{TOOL_GEOM}")


@lru_cache(maxsize=32)
def _real_shapes(
    robot: str, gripper: str | None, locked: tuple[tuple[str, float], ...]
) -> Sequence[DrawnShape]:
    """Visual shapes of a robot and its gripper, without the arm's prefix; none if unknown."""
    if robot not in robot_names() or (gripper is not None and gripper not in gripper_names()):
        return ()
    try:
        mounted = load_robot(robot, locked=dict(locked))
        if gripper is not None:
            mounted = with_gripper(mounted, load_gripper(gripper))
        spec = robot_spec(mounted, visuals=True)
        if gripper is not None:
            add_gripper(spec, mounted, load_gripper(gripper), visuals=True)
        spec.compiler.discardvisual = False
        model = spec.compile()
    except (DualArmError, ValueError, OSError):  # no meshes on this machine: hulls are drawn
        return ()
    return tuple(_shapes(model, (VISUAL_GROUP,)))


def _shapes(model: mujoco.MjModel, groups: Collection[int]) -> Iterator[DrawnShape]:
    colors = geom_colors(model)
    for geom in range(model.ngeom):
        kind = _KINDS.get(mujoco.mjtGeom(int(model.geom_type[geom])))
        material = int(model.geom_matid[geom])
        opacity = float(model.geom_rgba[geom, 3] if material < 0 else model.mat_rgba[material, 3])
        if kind is None or opacity <= 0.0 or model.geom_group[geom] not in groups:
            continue
        red, green, blue = colors[geom].tolist()
        yield DrawnShape(
            str(model.body(int(model.geom_bodyid[geom])).name),
            str(model.geom(geom).name),
            kind,
            model.geom_pos[geom].copy(),
            model.geom_quat[geom].copy(),
            model.geom_size[geom].copy(),
            (red, green, blue, opacity),
            _mesh(model, int(model.geom_dataid[geom])) if kind == "mesh" else None,
        )


def _mesh(model: mujoco.MjModel, mesh: int) -> Mesh:
    first = int(model.mesh_vertadr[mesh])
    count = int(model.mesh_vertnum[mesh])
    start = int(model.mesh_faceadr[mesh])
    faces = int(model.mesh_facenum[mesh])
    return Mesh(
        model.mesh_vert[first : first + count].astype(np.float32),
        model.mesh_face[start : start + faces].astype(np.uint32),
    )
