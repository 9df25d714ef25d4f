"""A robot of the catalog as data: joints, limits, friction, tool, postures, camera mounts."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Final

import numpy as np
import numpy.typing as npt

from bt_dualarm.core.pose import Pose, Vector
from bt_dualarm.robots.description_file import LockedJoint, ToolShape
from bt_dualarm.robots.urdf_arm import Urdf
from bt_dualarm.spec.document import LimitShares

TYPICAL_COULOMB: Final = 0.04
"""Default Coulomb friction as a share of the effort limit: strain-wave gears of this size have 3 to
7 %."""

TYPICAL_VISCOUS: Final = 0.01
"""Default viscous friction as a share of the effort limit per rad/s."""


@dataclass(frozen=True, eq=False)
class JointFriction:
    """Friction of the joints, base to tip, each array of shape (dof,).

    ``τ(v) = (c + (s - c) exp(-(v/v_s)²)) T(v) + b v``: Coulomb friction with the Stribeck effect,
    and viscous friction (Armstrong-Hélouvry, Dupont, Canudas de Wit, Automatica 1994). ``T`` is the
    sign of ``v``, or, if dry friction builds up over a speed ``r``, the sigmoid
    ``tanh((v + o)/r) - tanh(o/r)`` (the form of Gaz et al., RA-L 2019).

    Attributes:
        coulomb: Coulomb friction c, N m.
        viscous: Viscous friction b, N m s/rad.
        static: Static friction s, N m: dry friction at rest.
        stribeck_velocity: Stribeck velocity v_s, rad/s.
        rise: Speed r over which dry friction builds up, rad/s; 0 for a step.
        offset: Offset o of the speed in the sigmoid, rad/s.
        uncertainty: Relative uncertainty of the dry friction.
    """

    coulomb: Vector
    viscous: Vector
    static: Vector
    stribeck_velocity: Vector
    rise: Vector
    offset: Vector
    uncertainty: float = 0.0

    @classmethod
    def typical(cls, effort: Vector) -> JointFriction:
        """Default friction of an arm without published values, from its effort limits in N m."""
        coulomb = TYPICAL_COULOMB * effort
        zero = np.zeros_like(effort)
        return cls(
            coulomb, TYPICAL_VISCOUS * effort, coulomb, np.full_like(effort, 0.1), zero, zero
        )

    @classmethod
    def none(cls, dof: int) -> JointFriction:
        """Frictionless joints."""
        zero = np.zeros(dof)
        return cls(zero, zero, zero, np.ones(dof), zero, zero)

    def torque(self, v: Vector) -> Vector:
        """Torque in N m, of shape (dof,), that keeps the joints at velocities ``v`` in rad/s.

        The friction torque itself is its negative.
        """
        torque: Vector = self.level(v) * self.build_up(v) + self.viscous * v
        return torque

    def level(self, v: Vector) -> Vector:
        """Magnitude of dry friction at velocities ``v`` in rad/s, of shape (dof,), N m."""
        if self._stribeck is None:
            return self.coulomb
        drop, factor = self._stribeck
        level: Vector = v * v  # in place from here on: this is called in every control step
        np.multiply(level, factor, level)
        np.exp(level, level)
        np.multiply(level, drop, level)
        return np.add(level, self.coulomb, level)

    @cached_property
    def _stribeck(self) -> tuple[Vector, Vector] | None:
        """Drop of dry friction from rest to motion, N m, and -1/v_s²; None if there is none."""
        drop = self.static - self.coulomb
        return (drop, -1.0 / np.square(self.stribeck_velocity)) if drop.any() else None

    @cached_property
    def is_sudden(self) -> bool:
        """Whether the dry friction of every joint is a step at zero speed."""
        return not (self.rise > 0.0).any()

    def build_up(self, v: Vector) -> Vector:
        """Signed share T of the dry friction at velocities ``v``, of shape (dof,), from -1 to 1."""
        is_smooth, rise, start = self._sigmoid
        smooth = np.tanh((v + self.offset) / rise) - start
        share: Vector = smooth if is_smooth.all() else np.where(is_smooth, smooth, np.sign(v))
        return share

    @cached_property
    def _sigmoid(self) -> tuple[npt.NDArray[np.bool_], Vector, Vector]:
        """Which joints have a sigmoid, its speed r (1 for the others), and tanh(o/r)."""
        is_smooth = self.rise > 0
        rise = np.where(is_smooth, self.rise, 1.0)
        return is_smooth, rise, np.tanh(self.offset / rise)

    def scaled(self, dry: Vector, viscous: Vector, most: Vector) -> JointFriction:
        """Friction of another specimen of the robot.

        Args:
            dry: Factors of the Coulomb and static friction, of shape (dof,).
            viscous: Factors of the viscous friction, likewise.
            most: Upper limit of the Coulomb and static friction, of shape (dof,), N m.
        """
        peak = np.maximum(self.static, self.coulomb) * dry
        dry = dry * np.minimum(1.0, most / np.maximum(peak, 1e-12))
        return replace(
            self,
            coulomb=self.coulomb * dry,
            static=self.static * dry,
            viscous=self.viscous * viscous,
        )


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
        """Scale velocity, acceleration and jerk by ``speed``, a share in (0, 1].

        Unlike the shares of a tree file it may be below 0.001: guarded motions far from the base
        ask for that.
        """
        return replace(
            self,
            velocity=self.velocity * speed,
            acceleration=self.acceleration * speed,
            jerk=self.jerk * speed,
        )

    def derated(self, shares: LimitShares) -> JointLimits:
        """Scale velocity, acceleration and jerk by a share of each."""
        return replace(
            self,
            velocity=self.velocity * shares.velocity,
            acceleration=self.acceleration * shares.acceleration,
            jerk=self.jerk * shares.jerk,
        )


@dataclass(frozen=True, eq=False)
class CameraMount:
    """Mount of a camera on an arm: a link, and the camera's pose in it (OpenCV's axes)."""

    link: str
    pose: Pose


@dataclass(frozen=True, eq=False)
class Flange:
    """Flange of an arm, on which grippers are mounted.

    Attributes:
        link: Link of the flange.
        pose: Pose in the link; the z axis points away from the arm.
        stock: Links of the stock tool; a gripper replaces them and their subtrees.
    """

    link: str
    pose: Pose
    stock: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class Robot:
    """An arm of the catalog; lengths in meters, angles in radians.

    Attributes:
        tool: The tool frame in ``tool_link``; its z axis points out of the tool.
        friction: Friction of the joints.
        rotor_inertia: Rotor inertias reflected through the gears, of shape (dof,), kg m².
        flange: Flange on which grippers are mounted.
        tool_shape: Cylinder that ends in the tool frame, if the URDF has no tool of its own.
        payload: Largest mass that it may carry, kg; None if the description gives none.
        exclusions: Pairs of links whose contacts are ignored.
        colors: RGBA of links by name; ``default`` is for all others.
        locked: Joints that could move but are locked, by name.
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
    locked: Mapping[str, LockedJoint] = field(default_factory=dict)

    @property
    def dof(self) -> int:
        """Number of joints of the arm."""
        return len(self.joints)

    def derated(self, shares: LimitShares) -> Robot:
        """The same robot with a share of its velocity, acceleration and jerk limits."""
        return replace(self, limits=self.limits.derated(shares))

    @cached_property
    def urdf_text(self) -> str:
        """URDF of links, joints and inertias, without shapes."""
        return self.model.kinematic_text
