"""From a robot of the catalogue to an MjSpec that can be attached to a world."""

from __future__ import annotations

import itertools
from typing import Any

import mujoco
import numpy as np

from bt_dualarm.pose import Pose
from bt_dualarm.world.catalogue import Robot
from bt_dualarm.world.hulls import low_poly_hull
from bt_dualarm.world.meshes import as_stl
from bt_dualarm.world.urdf import Shape

COLLISION_GROUP = 3
VISUAL_GROUP = 2
TOOL_SITE = "tool"
TOOL_GEOM = "tool"

_COMPILER = (
    '<mujoco><compiler strippath="false" fusestatic="false" balanceinertia="true"/></mujoco>'
)
_GREY = (0.7, 0.7, 0.7, 1.0)
_TOOL_COLOR = (0.15, 0.15, 0.16, 1.0)
_GEOM_TYPES = {
    "box": mujoco.mjtGeom.mjGEOM_BOX,
    "cylinder": mujoco.mjtGeom.mjGEOM_CYLINDER,
    "sphere": mujoco.mjtGeom.mjGEOM_SPHERE,
}


def robot_spec(robot: Robot, *, visuals: bool) -> Any:
    """The arm as an MjSpec: chain, inertias, shapes, torque motors, tool site, exclusions.

    Args:
        robot: An arm of the catalogue.
        visuals: Also load the full visual meshes (for pictures; tens of thousands of triangles).
    """
    text = robot.urdf_text.replace("</robot>", f"{_COMPILER}</robot>")
    spec = mujoco.MjSpec.from_string(text)
    _place_base(spec, robot)
    for link in robot.model.links:
        if link != "world":
            _add_shapes(spec, robot, link, visuals=visuals)
    _add_tool(spec, robot)
    _add_motors(spec, robot)
    _add_exclusions(spec, robot)
    return spec


def _place_base(spec: Any, robot: Robot) -> None:
    """The base link at the origin, whatever the URDF's world joint says."""
    base = spec.body(robot.base_link)
    base.pos, base.quat = np.zeros(3), (1, 0, 0, 0)


def _add_shapes(spec: Any, robot: Robot, link: str, *, visuals: bool) -> None:
    color = robot.colors.get(link, robot.colors.get("default", _GREY))
    for number, shape in enumerate(robot.model.shapes(link, "collision")):
        geom = _add_geom(spec, link, f"{link}_{number}", shape)
        geom.group, geom.rgba, geom.density = COLLISION_GROUP, color, 0
    if visuals:
        for number, shape in enumerate(robot.model.shapes(link, "visual")):
            geom = _add_visual(spec, link, f"{link}_visual_{number}", shape)
            geom.group, geom.rgba, geom.density = VISUAL_GROUP, color, 0
            geom.contype = geom.conaffinity = 0


def _add_geom(spec: Any, link: str, name: str, shape: Shape) -> Any:
    geom = spec.body(link).add_geom(name=name)
    geom.pos, geom.quat = shape.pose.position, shape.pose.quaternion
    if shape.mesh is not None:
        vertices, triangles = low_poly_hull(shape.mesh, shape.size)
        spec.add_mesh(name=name, uservert=vertices.ravel(), userface=triangles.ravel())
        geom.type, geom.meshname = mujoco.mjtGeom.mjGEOM_MESH, name
    else:
        geom.type = _GEOM_TYPES[shape.kind]
        geom.size = _half_sizes(shape)
    return geom


def _add_visual(spec: Any, link: str, name: str, shape: Shape) -> Any:
    if shape.mesh is None:
        return _add_geom(spec, link, name, shape)
    geom = spec.body(link).add_geom(name=name, type=mujoco.mjtGeom.mjGEOM_MESH, meshname=name)
    geom.pos, geom.quat = shape.pose.position, shape.pose.quaternion
    spec.add_mesh(name=name, file=str(as_stl(shape.mesh)), scale=shape.size)
    return geom


def _half_sizes(shape: Shape) -> tuple[float, float, float]:
    """MuJoCo counts half lengths."""
    if shape.kind == "box":
        x, y, z = shape.size
        return x / 2, y / 2, z / 2
    if shape.kind == "cylinder":
        radius, length = shape.size
        return radius, length / 2, 0
    return shape.size[0], 0, 0


def _add_tool(spec: Any, robot: Robot) -> None:
    link = spec.body(robot.tool_link)
    link.add_site(name=TOOL_SITE, pos=robot.tool.position, quat=robot.tool.quaternion)
    if robot.tool_shape is None:
        return
    length = robot.tool_shape.length
    middle = robot.tool @ Pose.from_rpy((0, 0, -length / 2))
    link.add_geom(
        name=TOOL_GEOM,
        type=mujoco.mjtGeom.mjGEOM_CYLINDER,
        size=(robot.tool_shape.radius, length / 2, 0),
        pos=middle.position,
        quat=middle.quaternion,
        rgba=_TOOL_COLOR,
        group=COLLISION_GROUP,
        density=0,
    )


def _add_motors(spec: Any, robot: Robot) -> None:
    """One motor a joint, its torque limited to the joint's effort."""
    for name, effort in zip(robot.joints, robot.limits.effort, strict=True):
        joint = spec.joint(name)
        joint.damping, joint.frictionloss = np.zeros(3), 0.0
        motor = spec.add_actuator(
            name=name, target=name, trntype=mujoco.mjtTrn.mjTRN_JOINT, ctrlrange=(-effort, effort)
        )
        motor.ctrllimited = mujoco.mjtLimited.mjLIMITED_TRUE
        motor.set_to_motor()


def _add_exclusions(spec: Any, robot: Robot) -> None:
    """Contacts that do not count: those of the SRDF, and those at the arm's own joints.

    Links without a joint between them count as one. MuJoCo itself lets a link touch its parent,
    but not where the parent stands still, as the base does.
    """
    rigid = _rigid_groups(spec, robot)
    excluded = {frozenset(rigid[link] for link in pair) for pair in robot.exclusions}
    for name in robot.joints:
        link = spec.joint(name).parent
        excluded.add(frozenset((rigid[link.name], rigid[link.parent.name])))
    links = sorted(set(robot.model.links) - {"world"})
    for a, b in itertools.combinations(links, 2):
        groups = frozenset((rigid[a], rigid[b]))
        if len(groups) == 1 or groups in excluded:
            spec.add_exclude(bodyname1=a, bodyname2=b)


def _rigid_groups(spec: Any, robot: Robot) -> dict[str, str]:
    """Each link's nearest ancestor that hangs on a joint, or the base."""
    groups = {}
    for link in robot.model.links:
        body = spec.body(link)
        while body.parent is not None and body.parent.name != "world" and not body.joints:
            body = body.parent
        groups[link] = body.name
    return groups
