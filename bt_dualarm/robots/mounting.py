"""Mounting of a gripper on a robot: the arm that carries it, as one kinematic model."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Final

from bt_dualarm.core.errors import CatalogError
from bt_dualarm.core.pose import Pose
from bt_dualarm.robots.gripper import PALM, Gripper, load_gripper, placed, together
from bt_dualarm.robots.robot import CameraMount, Robot
from bt_dualarm.robots.robot_description import load_robot
from bt_dualarm.robots.urdf import Inertial, Part
from bt_dualarm.robots.urdf_arm import Urdf
from bt_dualarm.robots.urdf_xml import Origin
from bt_dualarm.spec.document import ArmSpec

COMES_OFF: Final = "joint '{joint}' is one of the robot's own tool, which comes off for {gripper}"
"""Error text for a locked joint of a stock tool that a gripper replaces."""


def load_arm(arm: ArmSpec, root: Path | None = None) -> tuple[Robot, Gripper | None]:
    """Load the robot of an arm of a tree file, with its gripper mounted if it has one.

    Args:
        arm: Part of the tree file about the arm.
        root: Folder in which paths of descriptions begin; by default the current one.

    Returns:
        The robot with its gripper mounted, and the gripper or None.

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
    """Locked joints of the robot's stock tool, which a gripper replaces."""
    removed = _subtrees(robot.model, robot.flange.stock)
    return frozenset(name for name, joint in robot.locked.items() if joint.link in removed)


def with_gripper(robot: Robot, gripper: Gripper) -> Robot:
    """Replace the stock tool of a robot by a gripper.

    In the kinematic and the nominal model the gripper is one rigid link, half open. The remaining
    payload is the robot's less the gripper's mass, or the gripper's own if that is smaller.
    """
    flange = robot.flange
    removed = _subtrees(robot.model, flange.stock)
    parts = {link: part for link, part in robot.model.parts.items() if link not in removed}
    parts[PALM] = _palm(parts[flange.link], flange.pose @ gripper.mount, gripper)
    payload = gripper.payload
    if robot.payload is not None:
        payload = min(payload, max(robot.payload - gripper.mass, 0.0))
    return replace(
        robot,
        model=Urdf(parts),
        tool_link=PALM,
        tool=gripper.tool,
        tool_shape=None,
        payload=payload,
        cameras={
            name: _on_remaining_link(robot, mount, removed) for name, mount in robot.cameras.items()
        },
        exclusions=frozenset(pair for pair in robot.exclusions if not pair & removed),
        locked={name: joint for name, joint in robot.locked.items() if joint.link not in removed},
    )


def _subtrees(model: Urdf, links: tuple[str, ...]) -> frozenset[str]:
    """The given links and all their descendants."""
    found = set(links)
    for link, part in model.parts.items():  # parents come before their children
        if part.parent in found:
            found.add(link)
    return frozenset(found)


def _palm(carrier: Part, pose: Pose, gripper: Gripper) -> Part:
    """The gripper as one rigid link, its fingers half open."""
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


def _on_remaining_link(robot: Robot, mount: CameraMount, removed: frozenset[str]) -> CameraMount:
    """The same camera pose, expressed in the nearest ancestor link that is not removed."""
    link = mount.link
    pose = mount.pose
    while link in removed:
        part = robot.model.parts[link]
        link = str(part.parent)
        pose = part.pose @ pose
    return CameraMount(link, pose)
