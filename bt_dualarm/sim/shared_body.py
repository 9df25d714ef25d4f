"""The body of a robot with several arms, each of which is an arm of its own in the tree file.

Descriptions such as `baxter_left` and `baxter_right` name each other (``other_arms``). Two arms of
a file that are such a pair and have the same base are one robot: what moves with neither of them
(torso, head, pedestal) is in the world once. It belongs to no arm, like a table, and its distance
to the arms is that of a link of the same robot.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import mujoco
import numpy as np

from bt_dualarm.core.errors import LockedJointError
from bt_dualarm.core.pose import Pose
from bt_dualarm.robots.mjspec import robot_spec
from bt_dualarm.robots.robot import Robot
from bt_dualarm.spec.document import ArmSpec


@dataclass(frozen=True, eq=False)
class SharedBody:
    """The part of a robot that its arms have in common.

    Attributes:
        name: Prefix of its bodies in the world, without the slash: the names of the arms.
        base: Pose of the robot's base link in the world.
        robots: Robots by the names of their arms.
    """

    name: str
    base: Pose
    robots: Mapping[str, Robot]

    def spec(self, *, visuals: bool) -> mujoco.MjSpec:
        """MjSpec of the shared links alone.

        Args:
            visuals: Also load the full visual meshes.
        """
        robot = next(iter(self.robots.values()))
        spec = robot_spec(robot, visuals=visuals)
        for first in (robot.joints[0], *self._first_locked(robot)):
            _delete_below(spec, _link_of(robot, first))
        _delete_unused_meshes(spec)
        return spec

    def remove_from(self, child: mujoco.MjSpec, arm: str) -> Iterator[tuple[str, str]]:
        """Remove the shapes of the shared links, and the other arms, from the MjSpec of an arm.

        Args:
            child: MjSpec of the arm, with all links of its description; changed in place.
            arm: Name of the arm.

        Yields:
            Each shared link with a link of the arm whose contacts with it are ignored.
        """
        robot = self.robots[arm]
        for first in self._first_locked(robot):
            _delete_below(child, _link_of(robot, first))
        first_link = child.body(_link_of(robot, robot.joints[0]))
        own = {body.name for body in (first_link, *first_link.find_all("body"))}
        shared = {body.name for body in child.bodies if body.name not in own}
        for body in [body for body in child.bodies if body.name in shared]:
            for geom in list(body.geoms):
                child.delete(geom)
        _delete_unused_meshes(child)
        for exclude in child.excludes:
            for one, other in (
                (exclude.bodyname1, exclude.bodyname2),
                (exclude.bodyname2, exclude.bodyname1),
            ):
                if one in shared and other in own:
                    yield one, other

    def _first_locked(self, robot: Robot) -> list[str]:
        """First joints of the other arms in the file, which are locked in an arm's description."""
        return [other.joints[0] for other in self.robots.values() if other is not robot]


def shared_bodies(arms: Mapping[str, ArmSpec], robots: Mapping[str, Robot]) -> list[SharedBody]:
    """Find the arms of a file that belong to one robot.

    Args:
        arms: Arms of the file by name.
        robots: Their robots.

    Raises:
        LockedJointError: A joint that is locked for one of them is moved by another, or is locked
            elsewhere for it.
    """
    found = []
    seen: set[str] = set()
    for name, robot in robots.items():
        if name in seen or not robot.other_arms:
            continue
        base = arms[name].base.pose
        members = {name: robot}
        for other, its in robots.items():
            if other in members or not _is_at(arms[other].base.pose, base):
                continue
            if all(its.name in one.other_arms for one in members.values()):
                members[other] = its
        seen |= members.keys()
        if len(members) > 1:
            body = SharedBody("+".join(members), base, members)
            _refuse_contradictions(body, arms)
            found.append(body)
    return found


def _is_at(pose: Pose, base: Pose) -> bool:
    return bool(np.allclose(pose.matrix, base.matrix, atol=1e-9))


def _refuse_contradictions(body: SharedBody, arms: Mapping[str, ArmSpec]) -> None:
    """Check the locked joints that a file gives for arms of one robot."""
    movers = {joint: name for name, robot in body.robots.items() for joint in robot.joints}
    for name, robot in body.robots.items():
        for joint in arms[name].locked:
            one = robot.locked[joint]
            if joint in movers:
                message = f"'{joint}' is moved by {movers[joint]}, another arm of the same robot"
                raise LockedJointError(name, joint, message)
            for other, its in body.robots.items():
                held = its.locked.get(joint)
                if one.link in its.other_arms.get(robot.name, ()) or held is None:
                    continue  # it is in the arm itself, such as a finger
                if held.at != one.at:
                    raise LockedJointError(
                        name,
                        joint,
                        f"'{joint}' is at {one.at:g} {one.unit}, but for {other}, another arm of "
                        f"the same robot, at {held.at:g}",
                    )


def _link_of(robot: Robot, joint: str) -> str:
    """The link that a joint of a robot moves."""
    if joint in robot.locked:
        return robot.locked[joint].link
    return next(
        link
        for link, part in robot.model.parts.items()
        if part.joint is not None and part.joint.name == joint
    )


def _delete_below(spec: mujoco.MjSpec, link: str) -> None:
    """Delete a link with all its descendants, if the spec has it."""
    body = spec.body(link)
    if body is not None:
        spec.delete(body)


def _delete_unused_meshes(spec: mujoco.MjSpec) -> None:
    used = {geom.meshname for geom in spec.geoms}
    for mesh in [mesh for mesh in spec.meshes if mesh.name not in used]:
        spec.delete(mesh)
