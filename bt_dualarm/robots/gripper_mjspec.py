"""A gripper in an arm's MjSpec, and the arm that carries it."""

from __future__ import annotations

import itertools
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path
from typing import Final

import mujoco
import numpy as np

from bt_dualarm.core.errors import CatalogError
from bt_dualarm.core.pose import Pose
from bt_dualarm.robots.gripper import (
    FINGERS,
    PALM,
    Finger,
    Gripper,
    GripperShape,
    RigidPart,
    load_gripper,
    placed,
    together,
)
from bt_dualarm.robots.mjspec import add_solid, add_visual, rigid_groups
from bt_dualarm.robots.robot import COLLISION_GROUP, VISUAL_GROUP, CameraMount, Robot
from bt_dualarm.robots.robot_description import load_robot
from bt_dualarm.robots.urdf import Inertial, Part
from bt_dualarm.robots.urdf_arm import Urdf
from bt_dualarm.robots.urdf_xml import Origin
from bt_dualarm.spec.document import ArmSpec

DRIVE: Final = "gripper/drive"
"""Actuator of the fingers, or of the cup."""

WIDTH: Final = "gripper/width"
"""Tendon whose length is the opening."""

CUP: Final = "gripper/cup"
"""Body of a suction cup."""

PAD: Final = "pad"
"""End of the names of what takes hold of objects."""

FELT: Final = "felt"
"""End of the names of the sensors that feel the force on a pad."""

_FORCE_OF_ALL: Final = (1 << int(mujoco.mjtConDataField.mjCONDATA_FORCE), 3, 1)
"""Of a contact sensor: the force, summed over all contacts (``reduce="netforce"``), once."""

_SOLREF: Final = (0.004, 1.0)  # s, damping ratio: as good as rigid at a 2 ms step
_PAD_SOLIMP: Final = (0.95, 0.99, 0.001)
_DOMINANT: Final = 1e4
"""Weight of a pad's contact parameters against those of the object that it holds."""

_TORSION: Final = 0.005
"""m; radius of the patch with which a soft pad resists a turn about the normal of the contact."""

_WITH_TORSION: Final = 4
_STRETCHES: Final = 0.001
"""m; by which a lip gives as it is pulled at, before it comes off: suction acts over that gap."""

_COUPLING_SOLIMP: Final = (0.999, 0.9999, 0.001)


def add_gripper(spec: mujoco.MjSpec, robot: Robot, gripper: Gripper, *, visuals: bool) -> None:
    """Make the palm of an arm's MjSpec, one rigid link so far, the gripper that it stands for.

    Args:
        spec: MjSpec of the arm with the gripper mounted.
        robot: Arm with the gripper mounted.
        gripper: Gripper on its flange.
        visuals: Also load the full visual meshes.
    """
    palm = spec.body(PALM)
    _weigh(palm, gripper.palm)
    _add_shapes(spec, PALM, gripper.palm, gripper, visuals=visuals)
    bodies = [PALM]
    if gripper.fingers:
        for name, finger in zip(FINGERS, gripper.fingers, strict=True):
            _add_finger(spec, palm, name, finger, gripper, visuals=visuals)
        _add_drive(spec, gripper)
        if gripper.tactile is not None:
            _add_felt(spec)
        bodies += FINGERS
    else:
        _add_cup(spec, palm, gripper)
        bodies.append(CUP)
    _exclude(spec, robot, bodies)


def _weigh(body: mujoco.MjsBody, part: RigidPart) -> None:
    inertia = part.inertia
    body.explicitinertial = True
    body.mass = part.mass
    body.ipos = part.center
    body.iquat = (1.0, 0.0, 0.0, 0.0)
    body.inertia = np.zeros(3)
    body.fullinertia = (*np.diag(inertia), inertia[0, 1], inertia[0, 2], inertia[1, 2])


def _add_shapes(
    spec: mujoco.MjSpec, body: str, part: RigidPart, gripper: Gripper, *, visuals: bool
) -> None:
    for number, solid in enumerate(part.collision):
        for geom in add_solid(spec, body, f"{body}_{number}", solid):
            geom.rgba = gripper.color
            geom.density = 0
    if visuals:
        for number, solid in enumerate(part.visual or part.collision):
            _add_seen(spec, body, f"{body}_visual_{number}", solid).rgba = gripper.color


def _add_seen(spec: mujoco.MjSpec, body: str, name: str, solid: GripperShape) -> mujoco.MjsGeom:
    """A shape for images, which touches nothing."""
    geom = add_visual(spec, body, name, solid)
    geom.group = VISUAL_GROUP
    geom.density = 0
    geom.contype = geom.conaffinity = 0
    return geom


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
    _weigh(body, finger.part)
    body.add_joint(
        name=name,
        type=mujoco.mjtJoint.mjJNT_SLIDE,
        axis=finger.pose.rotation_matrix.T @ finger.axis,
        range=(0.0, 0.5 * gripper.stroke),
        limited=mujoco.mjtLimited.mjLIMITED_TRUE,
        armature=gripper.drive_mass,
        solref_limit=_SOLREF,
    )
    _add_shapes(spec, name, finger.part, gripper, visuals=visuals)
    pad = add_hold(spec, name, finger.pad, gripper)
    if visuals and not finger.part.visual:
        _add_seen(spec, name, f"{pad.name}_visual", finger.pad).rgba = pad.rgba


def _add_felt(spec: mujoco.MjSpec) -> None:
    """Sensors of the force on each pad; they change nothing else."""
    for name in FINGERS:
        spec.add_sensor(
            name=f"{name}/{FELT}",
            type=mujoco.mjtSensor.mjSENS_CONTACT,
            objtype=mujoco.mjtObj.mjOBJ_GEOM,
            objname=f"{name}/{PAD}",
            intprm=_FORCE_OF_ALL,
        )


def add_hold(
    spec: mujoco.MjSpec, body: str, solid: GripperShape, gripper: Gripper
) -> mujoco.MjsGeom:
    """A shape that takes hold of objects: stiff, and with the friction that the object has."""
    (geom,) = add_solid(spec, body, f"{body}/{PAD}", solid)
    geom.rgba = tuple(0.5 * part for part in gripper.color[:3]) + gripper.color[3:]
    geom.density = 0
    geom.group = COLLISION_GROUP
    geom.condim = _WITH_TORSION
    geom.friction = (gripper.friction, _TORSION, 1e-4)
    geom.solref = _SOLREF
    geom.solimp[:3] = _PAD_SOLIMP
    geom.solmix = _DOMINANT
    return geom


def _add_drive(spec: mujoco.MjSpec, gripper: Gripper) -> None:
    """Both fingers as one: what is between them is pressed from both sides with the same force."""
    first, second = FINGERS
    coupling = spec.add_equality(
        name="gripper/coupling",
        type=mujoco.mjtEq.mjEQ_JOINT,
        objtype=mujoco.mjtObj.mjOBJ_JOINT,
        name1=second,
        name2=first,
    )
    coupling.data[:5] = (0.0, 1.0, 0.0, 0.0, 0.0)
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
    """A lip at the tool frame that adheres to what it touches, with the force that is asked for."""
    cup = gripper.cup
    assert cup is not None  # noqa: S101 - what has no fingers has a cup
    palm.add_body(name=CUP, pos=gripper.tool.position, quat=gripper.tool.quaternion)
    lip = GripperShape(
        "cylinder", (cup.radius, cup.depth), Pose.from_rpy((0.0, 0.0, -0.5 * cup.depth), (0, 0, 0))
    )
    rim = add_hold(spec, CUP, lip, gripper)
    rim.gap = _STRETCHES
    drive = spec.add_actuator(
        name=DRIVE, target=CUP, trntype=mujoco.mjtTrn.mjTRN_BODY, ctrlrange=(0.0, 1.0)
    )
    drive.ctrllimited = mujoco.mjtLimited.mjLIMITED_TRUE
    drive.set_to_adhesion(gain=gripper.force.most)


def _exclude(spec: mujoco.MjSpec, robot: Robot, bodies: Iterable[str]) -> None:
    """Contacts that do not count: within the gripper, with its link, and with the one before."""
    names = list(bodies)
    for a, b in itertools.combinations(names, 2):
        spec.add_exclude(bodyname1=a, bodyname2=b)
    groups = rigid_groups(spec, robot)
    last = spec.joint(robot.joints[-1]).parent
    near = {groups[PALM], groups[last.parent.name]}
    for link, group in groups.items():
        if group in near and link != PALM:
            for name in names:
                spec.add_exclude(bodyname1=link, bodyname2=name)


# Mounting a gripper on a robot


COMES_OFF: Final = "joint '{joint}' is one of the robot's own tool, which comes off for {gripper}"
"""What is wrong with locking a joint of a stock tool where a gripper is mounted."""


def load_arm(arm: ArmSpec, root: Path | None = None) -> tuple[Robot, Gripper | None]:
    """The robot of an arm of a tree file, with its gripper mounted, and the gripper if it has one.

    Raises:
        CatalogError: There is no such robot or gripper, or its description is wrong.
    """
    robot = load_robot(arm.robot, root, arm.locked)
    if arm.gripper is None:
        return robot, None
    gripper = load_gripper(arm.gripper, root)
    for joint in arm.locked:
        if joint in stock_joints(robot):
            raise CatalogError(f"locked: {COMES_OFF.format(joint=joint, gripper=gripper.name)}")
    return with_gripper(robot, gripper), gripper


def stock_joints(robot: Robot) -> frozenset[str]:
    """Locked joints of the robot's stock tool, which comes off for a gripper."""
    off = _hanging(robot.model, robot.flange.stock)
    return frozenset(name for name, joint in robot.locked.items() if joint.link in off)


def with_gripper(robot: Robot, gripper: Gripper) -> Robot:
    """The robot whose stock tool is taken off and whose flange carries the gripper.

    To its kinematics and its nominal model the gripper is one rigid link at its half opening. The
    payload that is left is the robot's less the gripper, or the gripper's own if that is less.
    """
    flange = robot.flange
    off = _hanging(robot.model, flange.stock)
    parts = {link: part for link, part in robot.model.parts.items() if link not in off}
    parts[PALM] = _palm(parts[flange.link], flange.pose @ gripper.mount, gripper)
    carried = gripper.payload
    if robot.payload is not None:
        carried = min(carried, max(robot.payload - gripper.mass, 0.0))
    return replace(
        robot,
        model=Urdf(parts),
        tool_link=PALM,
        tool=gripper.tool,
        tool_shape=None,
        payload=carried,
        cameras={name: _moved(robot, mount, off) for name, mount in robot.cameras.items()},
        exclusions=frozenset(pair for pair in robot.exclusions if not pair & off),
        locked={name: joint for name, joint in robot.locked.items() if joint.link not in off},
    )


def _hanging(model: Urdf, links: tuple[str, ...]) -> frozenset[str]:
    """These links and all that hang on them."""
    off = set(links)
    for link, part in model.parts.items():  # each after the one that it hangs on
        if part.parent in off:
            off.add(link)
    return frozenset(off)


def _palm(carrier: Part, pose: Pose, gripper: Gripper) -> Part:
    """The gripper as one link, its fingers half open."""
    half = 0.25 * gripper.stroke
    bodies = [placed(Pose.identity(), gripper.palm)]
    for finger in gripper.fingers:
        shifted = Pose(finger.pose.position + half * finger.axis, finger.pose.quaternion)
        bodies.append(placed(shifted, finger.part))
    mass, center, tensor = together(bodies)
    x, y, z = (float(part) for part in center)
    xx, yy, zz, xy, xz, yz = (
        float(tensor[pair]) for pair in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))
    )
    inertial = Inertial(mass, Origin((x, y, z)), (xx, yy, zz, xy, xz, yz))
    return Part(
        link=PALM,
        parent=carrier.link,
        origin=Origin.of(pose),
        joint=None,
        axis=None,
        stops=None,
        top=carrier.top,
        inertial=inertial,
        collision=(),
        visual=(),
    )


def _moved(robot: Robot, mount: CameraMount, off: frozenset[str]) -> CameraMount:
    """A camera's mount where it is, on a link that stays on the arm."""
    link = mount.link
    pose = mount.pose
    while link in off:
        part = robot.model.parts[link]
        link = str(part.parent)
        pose = part.pose @ pose
    return CameraMount(link, pose)
