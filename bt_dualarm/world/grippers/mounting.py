"""A gripper on a robot: the arm that everybody then works with, with the gripper as its tool."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from bt_dualarm.pose import Pose
from bt_dualarm.spec.document import ArmSpec
from bt_dualarm.world.grippers.gripper import PALM, Gripper
from bt_dualarm.world.grippers.named import load_gripper
from bt_dualarm.world.grippers.parts import placed, together
from bt_dualarm.world.robots.catalogue import load_robot
from bt_dualarm.world.robots.robot import CameraMount, Robot
from bt_dualarm.world.robots.urdf import Urdf
from bt_dualarm.world.urdf.attributes import Origin
from bt_dualarm.world.urdf.link import Inertial
from bt_dualarm.world.urdf.part import Part


def load_arm(arm: ArmSpec, root: Path | None = None) -> tuple[Robot, Gripper | None]:
    """The robot of an arm of a tree file, with its gripper mounted, and the gripper if it has one.

    Raises:
        CatalogueError: There is no such robot or gripper, or its page is wrong.
    """
    robot = load_robot(arm.robot, root)
    if arm.gripper is None:
        return robot, None
    gripper = load_gripper(arm.gripper, root)
    return with_gripper(robot, gripper), gripper


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
    link, pose = mount.link, mount.pose
    while link in off:
        part = robot.model.parts[link]
        link, pose = str(part.parent), part.pose @ pose
    return CameraMount(link, pose)
