"""A robot of the catalogue as everybody works with it: joints, limits, tool, postures, mounts."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property

from bt_dualarm.pose import Pose, Vector
from bt_dualarm.spec.document import LimitShares
from bt_dualarm.world.robots.friction import JointFriction
from bt_dualarm.world.robots.page import ToolShape
from bt_dualarm.world.robots.urdf import Urdf


@dataclass(frozen=True, eq=False)
class JointLimits:
    """Limits of an arm's joints, base to tip, each of shape (dof,).

    Units: rad, rad/s, rad/s², rad/s³ and N m.
    """

    lower: Vector
    upper: Vector
    velocity: Vector
    acceleration: Vector
    jerk: Vector
    effort: Vector

    def scaled(self, speed: float) -> JointLimits:
        """Velocity, acceleration and jerk times ``speed``, the share in (0, 1].

        A guarded motion far from the base may ask for less than the 0.001 that a file may ask for.
        """
        return replace(
            self,
            velocity=self.velocity * speed,
            acceleration=self.acceleration * speed,
            jerk=self.jerk * speed,
        )

    def derated(self, shares: LimitShares) -> JointLimits:
        """Velocity, acceleration and jerk times a share of each."""
        return replace(
            self,
            velocity=self.velocity * shares.velocity,
            acceleration=self.acceleration * shares.acceleration,
            jerk=self.jerk * shares.jerk,
        )


@dataclass(frozen=True, eq=False)
class CameraMount:
    """A place for a camera on an arm: its pose in a link (x right, y down, z forward)."""

    link: str
    pose: Pose


@dataclass(frozen=True, eq=False)
class Flange:
    """Where grippers are mounted on an arm.

    Attributes:
        link: Link that it is on.
        pose: Its pose in the link; its z axis points away from the arm.
        stock: Links of the stock tool, which comes off with all that hangs on them.
    """

    link: str
    pose: Pose
    stock: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class Robot:
    """An arm of the catalogue; lengths in metres, angles in radians.

    Attributes:
        tool: The tool frame in ``tool_link``; its z axis points out of the tool.
        friction: Friction of the joints.
        rotor_inertia: Inertia of the motors' rotors behind the gears, of shape (dof,), kg m².
        flange: Where grippers are mounted on it.
        tool_shape: A cylinder that ends in the tool frame, if the URDF has no tool of its own.
        payload: Largest mass in kg that it may hold, None where its page gives none.
        exclusions: Pairs of links whose contacts do not count.
        colors: RGBA of links by name; ``default`` is for all others.
    """

    name: str
    title: str
    model: Urdf
    base_link: str
    tool_link: str
    tool: Pose
    tool_shape: ToolShape | None
    flange: Flange
    joints: tuple[str, ...]
    limits: JointLimits
    payload: float | None
    friction: JointFriction
    rotor_inertia: Vector
    postures: Mapping[str, Vector]
    cameras: Mapping[str, CameraMount]
    exclusions: frozenset[frozenset[str]]
    colors: Mapping[str, tuple[float, float, float, float]]

    @property
    def dof(self) -> int:
        """Number of joints of the arm."""
        return len(self.joints)

    def derated(self, shares: LimitShares) -> Robot:
        """The same arm that keeps to a share of its limits."""
        return replace(self, limits=self.limits.derated(shares))

    @cached_property
    def urdf_text(self) -> str:
        """The kinematic chain with inertias, without any shape."""
        return self.model.kinematic_text
