"""A robot for people: what its page and its URDF say, in degrees and millimetres."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from bt_dualarm.motion.kinematics.workspace import Workspace
from bt_dualarm.pose import Pose, Vector
from bt_dualarm.world.robots.robot import Robot

Triple = tuple[float, float, float]


@dataclass(frozen=True)
class JointSheet:
    """A joint; degrees and degrees a second."""

    name: str
    lower_deg: float
    upper_deg: float
    velocity_deg_s: float


@dataclass(frozen=True)
class PostureSheet:
    """A posture: an angle for each joint, and where the tool then is, seen from the base link.

    Attributes:
        points: Along the tool's z axis, out of the tool; a unit vector.
    """

    name: str
    angles_deg: tuple[float, ...]
    tool_m: Triple
    points: Triple


@dataclass(frozen=True)
class MountSheet:
    """A place for a camera: where it is in its link, and which way it looks there."""

    name: str
    link: str
    xyz_m: Triple
    looks: Triple


@dataclass(frozen=True)
class RobotSummary:
    """What a tree file needs to know of a robot.

    Attributes:
        tool_link: Link that the tool frame is fixed to.
        tool_m: Place of the tool frame in that link.
        centre_m: Place of the first joint, seen from the base link.
        reach_m: Largest distance of the tool from there.
        payload_kg: Largest mass that the arm may hold, None where its page gives none.
    """

    name: str
    title: str
    base_link: str
    tool_link: str
    tool_m: Triple
    centre_m: Triple
    reach_m: float
    payload_kg: float | None
    joints: tuple[JointSheet, ...]
    postures: tuple[PostureSheet, ...]
    cameras: tuple[MountSheet, ...]


def robot_summary(robot: Robot) -> RobotSummary:
    """The summary of a robot of the catalogue, or of one's own."""
    arm = Workspace(robot, Pose.identity())
    limits = robot.limits
    rates = zip(limits.lower, limits.upper, limits.velocity, strict=True)
    joints = (map(_degrees, row) for row in rates)
    return RobotSummary(
        name=robot.name,
        title=robot.title,
        base_link=robot.base_link,
        tool_link=robot.tool_link,
        tool_m=_triple(robot.tool.position),
        centre_m=_triple(arm.bounding_ball[0]),
        reach_m=round(arm.farthest(), 2),
        payload_kg=robot.payload,
        joints=tuple(
            JointSheet(name, *row) for name, row in zip(robot.joints, joints, strict=True)
        ),
        postures=tuple(_posture(arm, name, q) for name, q in robot.postures.items()),
        cameras=tuple(
            MountSheet(name, mount.link, _triple(mount.pose.position), _ahead(mount.pose))
            for name, mount in robot.cameras.items()
        ),
    )


def direction(axis: Triple) -> str:
    """An axis of a frame as ``+x``, any other unit vector by its numbers."""
    for name, value in zip("xyz", axis, strict=True):
        if abs(value) == 1.0:
            return f"{'+' if value > 0 else '-'}{name}"
    return numbers(axis)


def numbers(values: Iterable[float]) -> str:
    """As they may stand in a file: as short as they can be."""
    return ", ".join(f"{value:g}" for value in values)


def _posture(arm: Workspace, name: str, q: Vector) -> PostureSheet:
    tool = arm.forward(q)
    return PostureSheet(name, tuple(map(_degrees, q)), _triple(tool.position), _ahead(tool))


def _ahead(pose: Pose) -> Triple:
    """Of the z axis, a hundredth at best: which way, not how exactly."""
    return _triple(pose.rotation_matrix[:, 2], 2)


def _degrees(angle: float) -> float:
    """To a hundredth; the zero has no sign."""
    return round(float(np.rad2deg(angle)), 2) + 0.0


def _triple(values: Iterable[float], digits: int = 3) -> Triple:
    x, y, z = (round(float(value), digits) + 0.0 for value in values)
    return x, y, z
