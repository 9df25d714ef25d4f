"""A gripper in an arm's MjSpec: palm, fingers that slide, pads, their drive; or a cup."""

from __future__ import annotations

import itertools
from collections.abc import Iterable
from typing import Final

import mujoco
import numpy as np

from bt_dualarm.pose import Pose
from bt_dualarm.world.grippers.gripper import FINGERS, PALM, Finger, Gripper, RigidPart, Solid
from bt_dualarm.world.robots.geom_groups import COLLISION_GROUP, VISUAL_GROUP
from bt_dualarm.world.robots.mjspec import add_solid, add_visual, rigid_groups
from bt_dualarm.world.robots.robot import Robot

DRIVE: Final = "gripper/drive"
"""Actuator of the fingers, or of the cup."""

WIDTH: Final = "gripper/width"
"""Tendon whose length is the opening."""

CUP: Final = "gripper/cup"
"""Body of a suction cup."""

PAD: Final = "pad"
"""End of the names of what takes hold of things."""

FELT: Final = "felt"
"""End of the names of the sensors that feel the force on a pad."""

_FORCE_OF_ALL: Final = (1 << int(mujoco.mjtConDataField.mjCONDATA_FORCE), 3, 1)
"""Of a contact sensor: the force, summed over all contacts (``reduce="netforce"``), once."""

_SOLREF: Final = (0.004, 1.0)  # s, damping ratio: as good as rigid at a 2 ms step
_PAD_SOLIMP: Final = (0.95, 0.99, 0.001)
_DOMINANT: Final = 1e4
"""Weight of a pad's contact parameters against those of the thing that it holds."""

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
    body.mass, body.ipos = part.mass, part.center
    body.iquat, body.inertia = (1.0, 0.0, 0.0, 0.0), np.zeros(3)
    body.fullinertia = (*np.diag(inertia), inertia[0, 1], inertia[0, 2], inertia[1, 2])


def _add_shapes(
    spec: mujoco.MjSpec, body: str, part: RigidPart, gripper: Gripper, *, visuals: bool
) -> None:
    for number, solid in enumerate(part.collision):
        for geom in add_solid(spec, body, f"{body}_{number}", solid):
            geom.rgba, geom.density = gripper.color, 0
    if visuals:
        for number, solid in enumerate(part.visual or part.collision):
            _add_seen(spec, body, f"{body}_visual_{number}", solid).rgba = gripper.color


def _add_seen(spec: mujoco.MjSpec, body: str, name: str, solid: Solid) -> mujoco.MjsGeom:
    """A shape for pictures, which touches nothing."""
    geom = add_visual(spec, body, name, solid)
    geom.group, geom.density = VISUAL_GROUP, 0
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


def add_hold(spec: mujoco.MjSpec, body: str, solid: Solid, gripper: Gripper) -> mujoco.MjsGeom:
    """A shape that takes hold of things: stiff, and with the friction that the thing has."""
    (geom,) = add_solid(spec, body, f"{body}/{PAD}", solid)
    geom.rgba = tuple(0.5 * part for part in gripper.color[:3]) + gripper.color[3:]
    geom.density, geom.group = 0, COLLISION_GROUP
    geom.condim, geom.friction = _WITH_TORSION, (gripper.friction, _TORSION, 1e-4)
    geom.solref, geom.solimp[:3] = _SOLREF, _PAD_SOLIMP
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
    coupling.solref, coupling.solimp[:3] = _SOLREF, _COUPLING_SOLIMP
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
    lip = Solid(
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
