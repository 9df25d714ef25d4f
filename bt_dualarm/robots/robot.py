"""Robot: joints, limits, friction, tool, postures, camera mounts."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Final

import mujoco
import numpy as np
import numpy.typing as npt

from bt_dualarm.core.pose import Pose, Vector
from bt_dualarm.robots.description_file import LockedJoint, ToolShape
from bt_dualarm.robots.urdf_arm import Urdf
from bt_dualarm.spec.document import LimitShares

GEOM_TYPES: Final[Mapping[str, mujoco.mjtGeom]] = {
    "box": mujoco.mjtGeom.mjGEOM_BOX,
    "cylinder": mujoco.mjtGeom.mjGEOM_CYLINDER,
    "capsule": mujoco.mjtGeom.mjGEOM_CAPSULE,
    "sphere": mujoco.mjtGeom.mjGEOM_SPHERE,
}


def half_sizes(kind: str, size: Sequence[float]) -> tuple[float, float, float]:
    """Sizes of a shape as MuJoCo has them, m: half lengths, and zeros where there is no size.

    Args:
        kind: A key of `GEOM_TYPES`.
        size: Full lengths of a box, radius and length of a cylinder, or of a capsule between its
            half balls, radius of a sphere.
    """
    if kind == "box":
        x, y, z = size
        return x / 2, y / 2, z / 2
    if kind in ("cylinder", "capsule"):
        radius, length = size
        return radius, length / 2, 0.0
    return size[0], 0.0, 0.0


# Groups of geoms, by which renderers choose what they show.
#
# MuJoCo has the groups 0 to 5 (``mjNGROUP``); their meaning is defined here.


SCENE_GROUP: Final = 0
"""Ground, tables, pedestals."""

OBJECT_GROUP: Final = 1
"""The objects of a tree file."""

VISUAL_GROUP: Final = 2
"""Full visual meshes of the arms, for images only."""

COLLISION_GROUP: Final = 3
"""Low-polygon shapes of the arms, one a mesh: for cameras, and for contacts where it is convex."""

PARTS_GROUP: Final = 4
"""Convex parts of the other meshes, for contacts only: cameras see the hull around them."""

LOOP_GROUPS: Final = (SCENE_GROUP, OBJECT_GROUP, COLLISION_GROUP)
"""Groups that cameras in the loop show."""


TYPICAL_COULOMB: Final = 0.04
"""Default of dry friction as a share of the effort limit: strain-wave gears of this size have 3 to
7 %."""

TYPICAL_VISCOUS: Final = 0.01
"""Default of viscous friction as a share of the effort limit for each rad/s."""


@dataclass(frozen=True, eq=False)
class JointFriction:
    """Friction of the joints, base to tip, each array of shape (dof,).

    ``τ(v) = (c + (s - c) exp(-(v/v_s)²)) T(v) + b v``: dry friction that falls from its static
    level (Stribeck), and viscous friction (Armstrong-Hélouvry, Dupont, Canudas de Wit, Automatica
    1994). ``T`` is the sign of ``v``, or, where dry friction builds up over a speed ``r``,
    ``tanh((v + o)/r) - tanh(o/r)``: the sigmoid of Gaz et al., RA-L 2019, has this form.

    Attributes:
        coulomb: Dry friction c, N m.
        viscous: Viscous friction b, N m s/rad.
        static: Static friction s, N m.
        stribeck_velocity: Stribeck velocity v_s, rad/s.
        rise: Speed r over which dry friction builds up, rad/s; 0 for a step.
        offset: Offset o of the speed in the sigmoid, rad/s.
        uncertainty: Relative uncertainty of dry friction.
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
        """Default friction of an arm without published values, from its efforts, N m."""
        coulomb = TYPICAL_COULOMB * effort
        nothing = np.zeros_like(effort)
        return cls(
            coulomb, TYPICAL_VISCOUS * effort, coulomb, np.full_like(effort, 0.1), nothing, nothing
        )

    @classmethod
    def none(cls, dof: int) -> JointFriction:
        """Frictionless joints."""
        nothing = np.zeros(dof)
        return cls(nothing, nothing, nothing, np.ones(dof), nothing, nothing)

    def torque(self, v: Vector) -> Vector:
        """Torque in N m, of shape (dof,), that keeps the joints at velocities ``v`` in rad/s.

        Friction itself is its negative.
        """
        torque: Vector = self.level(v) * self.build_up(v) + self.viscous * v
        return torque

    def level(self, v: Vector) -> Vector:
        """Dry friction at velocities, of shape (dof,), N m."""
        if self._falling is None:
            return self.coulomb
        drop, narrow = self._falling
        level: Vector = v * v
        np.multiply(level, narrow, level)
        np.exp(level, level)
        np.multiply(level, drop, level)
        return np.add(level, self.coulomb, level)

    @cached_property
    def _falling(self) -> tuple[Vector, Vector] | None:
        """Decrease of dry friction from rest to motion, N m, and -1/v_s²; None if there is none."""
        drop = self.static - self.coulomb
        return (drop, -1.0 / np.square(self.stribeck_velocity)) if drop.any() else None

    @cached_property
    def is_sudden(self) -> bool:
        """Whether dry friction of all joints is a step at zero speed."""
        return not (self.rise > 0.0).any()

    def build_up(self, v: Vector) -> Vector:
        """Share of the dry friction that acts at velocities, of shape (dof,), from -1 to 1."""
        gentle, rise, start = self._rising
        smooth = np.tanh((v + self.offset) / rise) - start
        share: Vector = smooth if gentle.all() else np.where(gentle, smooth, np.sign(v))
        return share

    @cached_property
    def _rising(self) -> tuple[npt.NDArray[np.bool_], Vector, Vector]:
        """Joints whose friction builds up over a speed, that speed, and the sigmoid at rest."""
        gentle = self.rise > 0
        rise = np.where(gentle, self.rise, 1.0)
        return gentle, rise, np.tanh(self.offset / rise)

    def scaled(self, dry: Vector, viscous: Vector, most: Vector) -> JointFriction:
        """Friction of another specimen of the robot.

        Args:
            dry: Factors of the dry friction, of shape (dof,).
            viscous: Factors of the viscous friction, likewise.
            most: Largest dry friction, static too, in N m.
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
    """Mount of a camera on an arm: pose in a link (x right, y down, z forward)."""

    link: str
    pose: Pose


@dataclass(frozen=True, eq=False)
class Flange:
    """Flange of an arm, on which grippers are mounted.

    Attributes:
        link: Link of the flange.
        pose: Pose in the link; the z axis points away from the arm.
        stock: Links of the stock tool, which a gripper replaces with their subtrees.
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
        rotor_inertia: Inertia of the motors' rotors behind the gears, of shape (dof,), kg m².
        flange: Flange for grippers.
        tool_shape: A cylinder that ends in the tool frame, if the URDF has no tool of its own.
        payload: Largest mass that it may hold, kg; None where the description gives none.
        exclusions: Pairs of links whose contacts are ignored.
        colors: RGBA of links by name; ``default`` is for all others.
        locked: Locked joints by name.
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
        """The same arm with a share of its limits."""
        return replace(self, limits=self.limits.derated(shares))

    @cached_property
    def urdf_text(self) -> str:
        """URDF of the kinematic chain with inertias, without shapes."""
        return self.model.kinematic_text
