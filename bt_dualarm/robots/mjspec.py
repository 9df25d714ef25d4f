"""MjSpec of a robot, which can be attached to that of a world."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from pathlib import Path
from typing import Protocol

import mujoco
import numpy as np
import numpy.typing as npt

from bt_dualarm.core.pose import Pose
from bt_dualarm.robots.meshes import Hull, as_stl, mesh_shapes
from bt_dualarm.robots.robot import (
    COLLISION_GROUP,
    GEOM_TYPES,
    PARTS_GROUP,
    VISUAL_GROUP,
    Robot,
    half_sizes,
)


class GeomShape(Protocol):
    """A shape of a link, as `bt_dualarm.robots.urdf.Shape` has it."""

    @property
    def kind(self) -> str:
        """``box``, ``cylinder``, ``sphere`` or ``mesh``."""

    @property
    def size(self) -> tuple[float, ...]:
        """Full lengths, radius and length, radius (m); the scale of a mesh."""

    @property
    def pose(self) -> Pose:
        """Pose in the link."""

    @property
    def mesh(self) -> Path | None:
        """File of a mesh."""


TOOL_SITE = "tool"
TOOL_GEOM = "tool"

_COMPILER = (
    '<mujoco><compiler strippath="false" fusestatic="false" balanceinertia="true"/></mujoco>'
)
_TURNS_JOINT = mujoco.mjtTrn.mjTRN_JOINT
_SHELL = mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL  # visual meshes may be flat
_GREY = (0.7, 0.7, 0.7, 1.0)
_TOOL_COLOR = (0.15, 0.15, 0.16, 1.0)


def robot_spec(robot: Robot, *, visuals: bool) -> mujoco.MjSpec:
    """MjSpec of an arm: chain, inertias, shapes, torque motors, tool site, exclusions.

    Args:
        robot: An arm of the catalog.
        visuals: Also load the full visual meshes (for images; tens of thousands of triangles).
    """
    spec = chain_spec(robot)
    for link in robot.model.links:
        _add_shapes(spec, robot, link, visuals=visuals)
    _add_tool_shape(spec, robot)
    _add_motors(spec, robot)
    _add_exclusions(spec, robot)
    return spec


def chain_spec(robot: Robot) -> mujoco.MjSpec:
    """MjSpec of chain, inertias and tool site alone."""
    text = robot.urdf_text.replace("</robot>", f"{_COMPILER}</robot>")
    spec = mujoco.MjSpec.from_string(text)
    link = spec.body(robot.tool_link)
    link.add_site(name=TOOL_SITE, pos=robot.tool.position, quat=robot.tool.quaternion)
    for name in robot.joints:  # those in the URDFs are no published values
        spec.joint(name).damping = np.zeros(3)
        spec.joint(name).frictionloss = 0.0
    return spec


def _add_shapes(spec: mujoco.MjSpec, robot: Robot, link: str, *, visuals: bool) -> None:
    color = robot.colors.get(link, robot.colors.get("default", _GREY))
    for number, shape in enumerate(robot.model.shapes(link, "collision")):
        for geom in add_solid(spec, link, f"{link}_{number}", shape):
            geom.rgba = color
            geom.density = 0
    if visuals:
        for number, shape in enumerate(robot.model.shapes(link, "visual")):
            geom = add_visual(spec, link, f"{link}_visual_{number}", shape)
            geom.group = VISUAL_GROUP
            geom.rgba = color
            geom.density = 0
            geom.contype = geom.conaffinity = 0


def add_solid(
    spec: mujoco.MjSpec, link: str, name: str, shape: GeomShape
) -> Iterator[mujoco.MjsGeom]:
    """Add collision geoms to a link, and the geom that cameras see where that differs."""
    if shape.mesh is None:
        solid = _add_primitive(spec, link, name, shape)
        solid.group = COLLISION_GROUP
        yield solid
        return
    shapes = mesh_shapes(shape.mesh, shape.size)
    outline = _add_hull(spec, link, name, shape.pose, shapes.outline)
    outline.group = COLLISION_GROUP
    yield outline
    if len(shapes.parts) > 1:
        outline.contype = outline.conaffinity = 0
        for number, part in enumerate(shapes.parts):
            solid = _add_hull(spec, link, f"{name}_part_{number}", shape.pose, part)
            solid.group = PARTS_GROUP
            yield solid


def _add_primitive(spec: mujoco.MjSpec, link: str, name: str, shape: GeomShape) -> mujoco.MjsGeom:
    return spec.body(link).add_geom(
        name=name,
        type=GEOM_TYPES[shape.kind],
        size=half_sizes(shape.kind, shape.size),
        pos=shape.pose.position,
        quat=shape.pose.quaternion,
    )


def _add_hull(spec: mujoco.MjSpec, link: str, name: str, pose: Pose, hull: Hull) -> mujoco.MjsGeom:
    spec.add_mesh(name=name, uservert=hull.vertices.ravel(), userface=hull.triangles.ravel())
    return spec.body(link).add_geom(
        name=name,
        type=mujoco.mjtGeom.mjGEOM_MESH,
        meshname=name,
        pos=pose.position,
        quat=pose.quaternion,
    )


def add_visual(spec: mujoco.MjSpec, link: str, name: str, shape: GeomShape) -> mujoco.MjsGeom:
    """Add a shape of a link for images."""
    if shape.mesh is None:
        return _add_primitive(spec, link, name, shape)
    geom = spec.body(link).add_geom(name=name, type=mujoco.mjtGeom.mjGEOM_MESH, meshname=name)
    geom.pos = shape.pose.position
    geom.quat = shape.pose.quaternion
    mesh = spec.add_mesh(name=name, file=str(as_stl(shape.mesh)), scale=shape.size)
    mesh.inertia = _SHELL
    return geom


def _add_tool_shape(spec: mujoco.MjSpec, robot: Robot) -> None:
    if robot.tool_shape is None:
        return
    link = spec.body(robot.tool_link)
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


def _add_motors(spec: mujoco.MjSpec, robot: Robot) -> None:
    """One motor a joint, its torque limited to the joint's effort."""
    for name, effort in zip(robot.joints, robot.limits.effort, strict=True):
        motor = spec.add_actuator(
            name=name, target=name, trntype=mujoco.mjtTrn.mjTRN_JOINT, ctrlrange=(-effort, effort)
        )
        motor.ctrllimited = mujoco.mjtLimited.mjLIMITED_TRUE
        motor.set_to_motor()


def joint_motors(model: mujoco.MjModel, arm: str) -> npt.NDArray[np.int64]:
    """Ids of the motors of an arm's joints in a compiled world, base to tip, of shape (dof,).

    It needs no description of the robot, so it serves models that were read from a record, too. A
    joint's motor has the joint's name. What else is driven below the arm's prefix is a gripper's:
    a tendon between its fingers, a body that adheres.

    Args:
        model: The compiled world.
        arm: Name of the arm; of one that is not in the world there are none.
    """
    found = []
    for motor in range(model.nu):
        name = model.actuator(motor).name
        if model.actuator_trntype[motor] == _TURNS_JOINT and name.startswith(f"{arm}/"):
            joint = int(model.actuator_trnid[motor, 0])
            if model.joint(joint).name == name:
                found.append(motor)
    return np.array(found, np.int64)


def _add_exclusions(spec: mujoco.MjSpec, robot: Robot) -> None:
    """Contacts that do not count: those of the SRDF, and those at the arm's own joints.

    Links without a joint between them count as one. MuJoCo itself lets a link touch its parent,
    but not where the parent stands still, as the base does.
    """
    rigid = rigid_groups(spec, robot)
    excluded = {frozenset(rigid[link] for link in pair) for pair in robot.exclusions}
    for name in robot.joints:
        link = spec.joint(name).parent
        excluded.add(frozenset((rigid[link.name], rigid[link.parent.name])))
    links = sorted(
        link
        for link in robot.model.links
        if link == robot.tool_link or robot.model.shapes(link, "collision")
    )
    links = [link for link in links if "/" not in link]  # what was mounted excludes its own
    for a, b in itertools.combinations(links, 2):
        groups = frozenset((rigid[a], rigid[b]))
        if len(groups) == 1 or groups in excluded:
            spec.add_exclude(bodyname1=a, bodyname2=b)


def rigid_groups(spec: mujoco.MjSpec, robot: Robot) -> dict[str, str]:
    """Each link's nearest ancestor that hangs on a joint, or the base."""
    groups = {}
    for link in robot.model.links:
        body = spec.body(link)
        while body.parent is not None and body.parent.name != "world" and not body.joints:
            body = body.parent
        groups[link] = body.name
    return groups
