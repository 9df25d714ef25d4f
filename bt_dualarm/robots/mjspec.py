"""MuJoCo specs of robots and grippers, to be attached to the spec of a world.

`robot_spec` turns a robot of the catalog into an `mujoco.MjSpec`: links, inertias, collision
shapes, torque motors and the tool site. `add_gripper` then replaces the rigid palm of that spec by
the gripper's moving parts. The geom groups, which decide what a camera shows, are defined here.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Final, Protocol

import mujoco
import numpy as np
import numpy.typing as npt

from bt_dualarm.core.pose import Pose
from bt_dualarm.robots.gripper import FINGERS, PALM, Finger, Gripper, GripperShape, RigidPart
from bt_dualarm.robots.meshes import Hull, as_stl, mesh_shapes
from bt_dualarm.robots.robot import Robot

# Renderers choose what they show by the group of a geom. MuJoCo has the groups 0 to 5
# (``mjNGROUP``) and leaves their meaning to the application.

SCENE_GROUP: Final = 0
"""Ground, tables, pedestals."""

OBJECT_GROUP: Final = 1
"""The objects of a tree file."""

VISUAL_GROUP: Final = 2
"""Full visual meshes of the arms, for still images only."""

COLLISION_GROUP: Final = 3
"""Low-polygon shapes of the arms, one per mesh: for cameras, and for contacts if it is convex."""

PARTS_GROUP: Final = 4
"""Convex parts of the other meshes, for contacts only: cameras see the hull around them."""

LOOP_GROUPS: Final = (SCENE_GROUP, OBJECT_GROUP, COLLISION_GROUP)
"""Groups that cameras in the control loop show."""

GEOM_TYPES: Final[Mapping[str, mujoco.mjtGeom]] = {
    "box": mujoco.mjtGeom.mjGEOM_BOX,
    "cylinder": mujoco.mjtGeom.mjGEOM_CYLINDER,
    "capsule": mujoco.mjtGeom.mjGEOM_CAPSULE,
    "sphere": mujoco.mjtGeom.mjGEOM_SPHERE,
    "ellipsoid": mujoco.mjtGeom.mjGEOM_ELLIPSOID,
}

TOOL_SITE = "tool"
TOOL_GEOM = "tool"

_COMPILER = (
    '<mujoco><compiler strippath="false" fusestatic="false" balanceinertia="true"/></mujoco>'
)
_GREY = (0.7, 0.7, 0.7, 1.0)
_TOOL_COLOR = (0.15, 0.15, 0.16, 1.0)


def half_sizes(kind: str, size: Sequence[float]) -> tuple[float, float, float]:
    """Size of a shape in MuJoCo's convention (half lengths), padded with zeros, m.

    Args:
        kind: A key of `GEOM_TYPES`.
        size: Full lengths of a box or ellipsoid; radius and length of a cylinder, or of a capsule
            without its caps; radius of a sphere.
    """
    if kind in ("box", "ellipsoid"):
        x, y, z = size
        return x / 2, y / 2, z / 2
    if kind in ("cylinder", "capsule"):
        radius, length = size
        return radius, length / 2, 0.0
    return size[0], 0.0, 0.0


class GeomShape(Protocol):
    """A shape of a link, as in `bt_dualarm.robots.urdf.Shape`."""

    @property
    def kind(self) -> str:
        """``box``, ``cylinder``, ``sphere`` or ``mesh``."""

    @property
    def size(self) -> tuple[float, ...]:
        """Full lengths; radius and length; radius (m); the scale of a mesh."""

    @property
    def pose(self) -> Pose:
        """Pose in the link."""

    @property
    def mesh(self) -> Path | None:
        """File of a mesh."""


def robot_spec(robot: Robot, *, visuals: bool) -> mujoco.MjSpec:
    """MjSpec of an arm: links, inertias, shapes, torque motors, tool site, contact exclusions.

    Args:
        robot: An arm of the catalog.
        visuals: Also load the full visual meshes (tens of thousands of triangles).
    """
    spec = chain_spec(robot)
    for link in robot.model.links:
        color = robot.colors.get(link, robot.colors.get("default", _GREY))
        for number, shape in enumerate(robot.model.shapes(link, "collision")):
            for geom in _add_collision_shape(spec, link, f"{link}_{number}", shape):
                geom.rgba = color
        if visuals:
            for number, shape in enumerate(robot.model.shapes(link, "visual")):
                _add_visual_shape(spec, link, f"{link}_visual_{number}", shape).rgba = color
    _add_tool_shape(spec, robot)
    for name, effort in zip(robot.joints, robot.limits.effort, strict=True):
        motor = spec.add_actuator(
            name=name, target=name, trntype=mujoco.mjtTrn.mjTRN_JOINT, ctrlrange=(-effort, effort)
        )
        motor.ctrllimited = mujoco.mjtLimited.mjLIMITED_TRUE
        motor.set_to_motor()
        # The limit of a URDF would apply to the sum of all actuators, which contains the torque by
        # which a suction cup's adhesion balances its contact force.
        spec.joint(name).actfrclimited = mujoco.mjtLimited.mjLIMITED_FALSE
    _add_exclusions(spec, robot)
    return spec


def chain_spec(robot: Robot) -> mujoco.MjSpec:
    """MjSpec of an arm's links, inertias and tool site alone."""
    text = robot.urdf_text.replace("</robot>", f"{_COMPILER}</robot>")
    spec = mujoco.MjSpec.from_string(text)
    link = spec.body(robot.tool_link)
    link.add_site(name=TOOL_SITE, pos=robot.tool.position, quat=robot.tool.quaternion)
    # Damping and friction in URDFs are placeholders, not published values.
    for name in robot.joints:
        spec.joint(name).damping = np.zeros(3)
        spec.joint(name).frictionloss = 0.0
    return spec


def joint_motors(model: mujoco.MjModel, arm: str) -> npt.NDArray[np.int64]:
    """Ids of the motors of an arm's joints in a compiled world, base to tip, of shape (dof,).

    Works without the robot's description, so also for models read from a record. A joint's motor
    has the joint's name. The other actuators below the arm's prefix are the gripper's: a tendon
    between its fingers, or an adhesive body.

    Args:
        model: The compiled world.
        arm: Name of the arm; the result is empty if it is not in the world.
    """
    found = []
    for motor in range(model.nu):
        name = model.actuator(motor).name
        drives_joint = model.actuator_trntype[motor] == mujoco.mjtTrn.mjTRN_JOINT
        if drives_joint and name.startswith(f"{arm}/"):
            joint = int(model.actuator_trnid[motor, 0])
            if model.joint(joint).name == name:
                found.append(motor)
    return np.array(found, np.int64)


def _add_collision_shape(
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
        density=0,  # inertias come from the description, not from the shapes
    )


def _add_hull(spec: mujoco.MjSpec, link: str, name: str, pose: Pose, hull: Hull) -> mujoco.MjsGeom:
    spec.add_mesh(name=name, uservert=hull.vertices.ravel(), userface=hull.triangles.ravel())
    return spec.body(link).add_geom(
        name=name,
        type=mujoco.mjtGeom.mjGEOM_MESH,
        meshname=name,
        pos=pose.position,
        quat=pose.quaternion,
        density=0,
    )


def _add_visual_shape(
    spec: mujoco.MjSpec, link: str, name: str, shape: GeomShape
) -> mujoco.MjsGeom:
    """Add a shape for images, without contacts."""
    if shape.mesh is None:
        geom = _add_primitive(spec, link, name, shape)
    else:
        geom = spec.body(link).add_geom(name=name, type=mujoco.mjtGeom.mjGEOM_MESH, meshname=name)
        geom.pos = shape.pose.position
        geom.quat = shape.pose.quaternion
        geom.density = 0
        mesh = spec.add_mesh(name=name, file=str(as_stl(shape.mesh)), scale=shape.size)
        # MuJoCo refuses flat meshes unless their inertia is that of a shell.
        mesh.inertia = mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL
    geom.group = VISUAL_GROUP
    geom.contype = geom.conaffinity = 0
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


def _add_exclusions(spec: mujoco.MjSpec, robot: Robot) -> None:
    """Ignore the contacts that the SRDF disables, and those between neighboring links.

    Links without a movable joint between them count as one, except below the base: of a robot with
    several arms, that is its torso and all other arms. MuJoCo excludes contacts of a link with its
    parent by itself, but not if the parent is static, as the base is.
    """
    rigid = _rigid_groups(spec, robot)
    base = rigid[robot.base_link]
    excluded = {frozenset(rigid[link] for link in pair) for pair in robot.exclusions}
    excluded = {pair for pair in excluded if base not in pair}
    for name in robot.joints:
        link = spec.joint(name).parent
        excluded.add(frozenset((rigid[link.name], rigid[link.parent.name])))
    links = sorted(
        link
        for link in robot.model.links
        if link == robot.tool_link or robot.model.shapes(link, "collision")
    )
    links = [link for link in links if "/" not in link]  # add_gripper excludes the gripper's own
    for a, b in itertools.combinations(links, 2):
        groups = frozenset((rigid[a], rigid[b]))
        is_listed = frozenset((a, b)) in robot.exclusions
        if len(groups) == 1 or groups in excluded or is_listed:
            spec.add_exclude(bodyname1=a, bodyname2=b)


def _rigid_groups(spec: mujoco.MjSpec, robot: Robot) -> dict[str, str]:
    """Map each link to its nearest ancestor with a joint of its own, otherwise to the base."""
    groups = {}
    for link in robot.model.links:
        body = spec.body(link)
        while body.parent is not None and body.parent.name != "world" and not body.joints:
            body = body.parent
        groups[link] = body.name
    return groups


# Grippers

DRIVE: Final = "gripper/drive"
"""Actuator of the fingers, or of the cup."""

WIDTH: Final = "gripper/width"
"""Tendon whose length is the opening."""

CUP: Final = "gripper/cup"
"""Body of a suction cup."""

PAD: Final = "pad"
"""Suffix of the names of the geoms that grasp objects."""

PAD_FORCE: Final = "felt"
"""Suffix of the names of the sensors of the force on a pad."""

_NET_FORCE: Final = (1 << int(mujoco.mjtConDataField.mjCONDATA_FORCE), 3, 1)
"""``intprm`` of a contact sensor that reads the sum of all contact forces (``reduce="netforce"``)
as one vector."""

_SOLREF: Final = (0.004, 1.0)  # s, damping ratio: the stiffest that is stable at a 2 ms step
_PAD_SOLIMP: Final = (0.95, 0.99, 0.001)
_COUPLING_SOLIMP: Final = (0.999, 0.9999, 0.001)
_PAD_SOLMIX: Final = 1e4
"""Weight of a pad's contact parameters against those of the object: the pad's win."""

_TORSION: Final = 0.005
"""Radius in m of the patch by which a soft pad resists torsion about the contact normal."""

_CONDIM_WITH_TORSION: Final = 4
_LIP_GAP: Final = 0.001
"""Gap in m over which adhesion still acts: the lip of a cup stretches before it comes off."""


def add_gripper(spec: mujoco.MjSpec, robot: Robot, gripper: Gripper, *, visuals: bool) -> None:
    """Replace the rigid palm in an arm's MjSpec by the palm, fingers or cup of its gripper.

    Args:
        spec: MjSpec of the arm with the gripper mounted, changed in place.
        robot: Arm with the gripper mounted.
        gripper: Gripper on its flange.
        visuals: Also load the full visual meshes.
    """
    palm = spec.body(PALM)
    _set_inertia(palm, gripper.palm)
    _add_part(spec, PALM, gripper.palm, gripper, visuals=visuals)
    bodies = [PALM]
    if gripper.fingers:
        for name, finger in zip(FINGERS, gripper.fingers, strict=True):
            _add_finger(spec, palm, name, finger, gripper, visuals=visuals)
        _add_finger_drive(spec, gripper)
        if gripper.tactile is not None:
            for name in FINGERS:
                spec.add_sensor(
                    name=f"{name}/{PAD_FORCE}",
                    type=mujoco.mjtSensor.mjSENS_CONTACT,
                    objtype=mujoco.mjtObj.mjOBJ_GEOM,
                    objname=f"{name}/{PAD}",
                    intprm=_NET_FORCE,
                )
        bodies += FINGERS
    else:
        _add_cup(spec, palm, gripper)
        bodies.append(CUP)
    _exclude_gripper_contacts(spec, robot, bodies)


def _set_inertia(body: mujoco.MjsBody, part: RigidPart) -> None:
    inertia = part.inertia
    body.explicitinertial = True
    body.mass = part.mass
    body.ipos = part.center
    body.iquat = (1.0, 0.0, 0.0, 0.0)
    body.inertia = np.zeros(3)
    body.fullinertia = (*np.diag(inertia), inertia[0, 1], inertia[0, 2], inertia[1, 2])


def _add_part(
    spec: mujoco.MjSpec, body: str, part: RigidPart, gripper: Gripper, *, visuals: bool
) -> None:
    for number, shape in enumerate(part.collision):
        for geom in _add_collision_shape(spec, body, f"{body}_{number}", shape):
            geom.rgba = gripper.color
    if visuals:
        for number, shape in enumerate(part.visual or part.collision):
            geom = _add_visual_shape(spec, body, f"{body}_visual_{number}", shape)
            geom.rgba = gripper.color


def _add_finger(
    spec: mujoco.MjSpec,
    palm: mujoco.MjsBody,
    name: str,
    finger: Finger,
    gripper: Gripper,
    *,
    visuals: bool,
) -> None:
    body = palm.add_body(name=name, pos=finger.pose.position, quat=finger.pose.quaternion)
    _set_inertia(body, finger.part)
    body.add_joint(
        name=name,
        type=mujoco.mjtJoint.mjJNT_SLIDE,
        axis=finger.pose.rotation_matrix.T @ finger.axis,
        range=(0.0, 0.5 * gripper.stroke),
        limited=mujoco.mjtLimited.mjLIMITED_TRUE,
        armature=gripper.drive_mass,
        solref_limit=_SOLREF,
    )
    _add_part(spec, name, finger.part, gripper, visuals=visuals)
    pad = _add_pad(spec, name, finger.pad, gripper)
    if visuals and not finger.part.visual:
        _add_visual_shape(spec, name, f"{pad.name}_visual", finger.pad).rgba = pad.rgba


def _add_pad(
    spec: mujoco.MjSpec, body: str, shape: GripperShape, gripper: Gripper
) -> mujoco.MjsGeom:
    """Add a geom that grasps objects: stiff, with at least the friction of the object."""
    (geom,) = _add_collision_shape(spec, body, f"{body}/{PAD}", shape)
    geom.rgba = tuple(0.5 * part for part in gripper.color[:3]) + gripper.color[3:]
    geom.condim = _CONDIM_WITH_TORSION
    # MuJoCo takes the larger friction coefficient of the two geoms in contact.
    geom.friction = (gripper.friction, _TORSION, 1e-4)
    geom.solref = _SOLREF
    geom.solimp[:3] = _PAD_SOLIMP
    geom.solmix = _PAD_SOLMIX
    return geom


def _add_finger_drive(spec: mujoco.MjSpec, gripper: Gripper) -> None:
    """Couple both fingers and drive them by one motor: both pads press with the same force."""
    first, second = FINGERS
    coupling = spec.add_equality(
        name="gripper/coupling",
        type=mujoco.mjtEq.mjEQ_JOINT,
        objtype=mujoco.mjtObj.mjOBJ_JOINT,
        name1=second,
        name2=first,
    )
    coupling.data[:5] = (0.0, 1.0, 0.0, 0.0, 0.0)  # second = 0 + 1 · first
    coupling.solref = _SOLREF
    coupling.solimp[:3] = _COUPLING_SOLIMP
    width = spec.add_tendon(name=WIDTH)
    for name in FINGERS:
        width.wrap_joint(name, 1.0)
    most = gripper.force.most
    drive = spec.add_actuator(
        name=DRIVE, target=WIDTH, trntype=mujoco.mjtTrn.mjTRN_TENDON, ctrlrange=(-most, most)
    )
    drive.ctrllimited = mujoco.mjtLimited.mjLIMITED_TRUE
    drive.set_to_motor()


def _add_cup(spec: mujoco.MjSpec, palm: mujoco.MjsBody, gripper: Gripper) -> None:
    """Add a lip at the tool frame that adheres to objects with the commanded force."""
    cup = gripper.cup
    assert cup is not None  # noqa: S101 - a gripper without fingers has a cup
    palm.add_body(name=CUP, pos=gripper.tool.position, quat=gripper.tool.quaternion)
    lip = GripperShape(
        "cylinder", (cup.radius, cup.depth), Pose.from_rpy((0.0, 0.0, -0.5 * cup.depth), (0, 0, 0))
    )
    rim = _add_pad(spec, CUP, lip, gripper)
    rim.gap = _LIP_GAP
    drive = spec.add_actuator(
        name=DRIVE, target=CUP, trntype=mujoco.mjtTrn.mjTRN_BODY, ctrlrange=(0.0, 1.0)
    )
    drive.ctrllimited = mujoco.mjtLimited.mjLIMITED_TRUE
    drive.set_to_adhesion(gain=gripper.force.most)


def _exclude_gripper_contacts(spec: mujoco.MjSpec, robot: Robot, bodies: Iterable[str]) -> None:
    """Ignore contacts within the gripper, with the link that carries it, and with the previous."""
    names = list(bodies)
    for a, b in itertools.combinations(names, 2):
        spec.add_exclude(bodyname1=a, bodyname2=b)
    groups = _rigid_groups(spec, robot)
    last = spec.joint(robot.joints[-1]).parent
    near = {groups[PALM], groups[last.parent.name]}
    for link, group in groups.items():
        if group in near and link != PALM:
            for name in names:
                spec.add_exclude(bodyname1=link, bodyname2=name)
