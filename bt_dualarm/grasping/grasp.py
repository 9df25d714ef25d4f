"""A grasp, the measures of a gripper, pad contact, and the force that holds a load."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass

import numpy as np

from bt_dualarm.core.pose import Matrix, Pose, Vector
from bt_dualarm.grasping.solids import Solid

# A grasp: where the tool is on the object, and what it takes to hold it there.


@dataclass(frozen=True, eq=False)
class Grasp:
    """A way to take an object.

    Attributes:
        tool: Pose of the tool frame in the object's frame.
        width: Distance of the pads in m when they touch; 0 of suction.
        force: Least force in N, of each pad or of the suction, that bears the load.
        margin: Largest force of the gripper over that force: how many times the load it bears.
    """

    tool: Pose
    width: float
    force: float
    margin: float


# What of a gripper counts for where it can grasp: measures in its tool frame, z out of the tool.
#
# The tool frame lies in the middle between the pads; they close along its y axis.


@dataclass(frozen=True, eq=False)
class JawMeasures:
    """A parallel gripper of two fingers.

    Attributes:
        least_opening: Distance of the pads in m when it is shut.
        widest_opening: Distance of the pads in m when it is open.
        pad_length: Length of a pad along the tool's z axis, m.
        pad_width: Width of a pad along the tool's x axis, m.
        pad_center: Distance in m from the tool frame to the pads' middle, along z.
        palm: Distance in m from the tool frame back to the palm.
        tip: Distance in m from the tool frame forward to the fingers' tips.
        thickness: Thickness of a finger along the tool's y axis, m.
        least_force: Least force in N of each pad on what is held.
        most_force: Largest force in N, likewise.
        friction: Coefficient of sliding friction of the pads.
        palm_radius: Radius in m that the palm has about the tool's z axis.
    """

    least_opening: float
    widest_opening: float
    pad_length: float
    pad_width: float
    palm: float
    tip: float
    thickness: float
    least_force: float
    most_force: float
    friction: float
    pad_center: float = 0.0
    palm_radius: float = 0.04


@dataclass(frozen=True, eq=False)
class CupMeasures:
    """A suction cup whose rim is at the tool frame.

    Attributes:
        radius: Radius in m of the rim.
        bends: Depth in m by which the rim follows what is not flat.
        most_force: Largest force in N with which it pulls.
        friction: Coefficient of sliding friction of the rim.
    """

    radius: float
    bends: float
    most_force: float
    friction: float


@dataclass(frozen=True, eq=False)
class Load:
    """What a grip has to bear.

    Attributes:
        mass: Mass in kg.
        gravity: Acceleration of gravity in the object's frame, of shape (3,), m/s².
        shake: Largest acceleration of the tool in any direction, m/s².
        center: Center of mass in the object's frame, of shape (3,), m.
    """

    mass: float
    gravity: Vector
    shake: float
    center: Vector


# What flat pads meet when they shut on a solid: where, how much of them, how it slopes there.


@dataclass(frozen=True, eq=False)
class PadContact:
    """The part of a pad that touches.

    Attributes:
        middle: Middle of it, of shape (3,), m.
        share: Share of the pad that touches, from 0 to 1.
        lever: Mean distance in m of what touches from its middle: friction times this is the
            largest moment of friction about the normal, where pressure is even.
        slope: Angle in rad between the pad's normal and the surface's there.
    """

    middle: Vector
    share: float
    lever: float
    slope: float


@dataclass(frozen=True, eq=False)
class PadHold:
    """A solid between two pads.

    Attributes:
        center: Place in the middle between what touches, of shape (3,), m.
        width: Distance of the pads in m.
        lever: Smaller one of both pads' levers, m.
        tilt: Largest angle in rad from the pads' normal of the surface, and of the line between
            what touches on both sides.
    """

    center: Vector
    width: float
    lever: float
    tilt: float


def pad_contact(
    solid: Solid, center: Vector, normal: Vector, along: Vector, size: Vector
) -> PadContact | None:
    """What one pad meets that comes from outside; None if that is nothing.

    Args:
        solid: Solid that it is pressed against.
        center: Any place on the line along which the pad's middle comes, of shape (3,), m.
        normal: Direction from the solid to the pad, of unit length, of shape (3,).
        along: Direction of the pad's length, of unit length, square to the normal.
        size: Length and width of the pad, of shape (2,), m.
    """
    from bt_dualarm.grasping.grasp_kernels import press

    met = np.empty(6)
    if not press(*solid.form, center, normal, along, size, met):
        return None
    return PadContact(met[:3], float(met[3]), float(met[4]), float(met[5]))


def held(solid: Solid, center: Vector, axis: Vector, along: Vector, size: Vector) -> PadHold | None:
    """What two pads hold that shut along an axis; None if one of them meets nothing.

    Args:
        solid: Solid between them.
        center: Place on the line between the pads' middles, of shape (3,), m.
        axis: Direction in which they close, of unit length, of shape (3,).
        along: Direction of their length, of unit length, square to the axis.
        size: Length and width of a pad, of shape (2,), m.
    """
    from bt_dualarm.grasping.grasp_kernels import hold

    between = np.empty(6)
    if not hold(*solid.form, center, axis, along, size, between):
        return None
    return PadHold(between[:3], float(between[3]), float(between[4]), float(between[5]))


# The least force with which a grip bears its load, by friction of soft fingers.


_DIRECTIONS = np.array([d for d in itertools.product((-1.0, 0.0, 1.0), repeat=3) if any(d)])
SHAKEN_WAYS: Matrix = _DIRECTIONS / np.linalg.norm(_DIRECTIONS, axis=1)[:, None]
"""Directions in which a load is shaken, of shape (26, 3)."""


def pinching_force(
    load: Load, center: Vector, axis: Vector, width: float, levers: float, friction: float
) -> float:
    """Least force in N of each of two pads that holds a load however it is shaken.

    A pad is a soft finger (Murray, Li, Sastry, A Mathematical Introduction to Robotic Manipulation,
    1994, ch. 5): a normal force, friction in its plane, and a moment of friction about the normal.
    What friction bears of both at once lies in an ellipsoid, the limit surface (Howe and Cutkosky,
    Practical force-motion models for sliding manipulation, IJRR 1996). Of a moment across the line
    between the pads each bears half by a force in its plane; that their pressure may shift is not
    counted. A force along the line presses on one pad and eases the other.

    Args:
        load: Mass, gravity, shake and center of mass, in the object's frame.
        center: Place between the pads, of shape (3,), m.
        axis: Direction in which they close, of unit length, of shape (3,).
        width: Distance between them in m.
        levers: Lever in m of the friction about the normal: the smaller one of both patches.
        friction: Coefficient of friction, less what the surface's slope takes.

    Returns:
        The force; infinite where friction, or the moment of it, cannot hold the load.
    """
    needed = pinching_forces(shaken(load), load.center - center, axis, width, levers, friction)
    return float(needed.max())


def pinching_forces(
    forces: Matrix, offset: Vector, axis: Vector, width: float, lever: float, friction: float
) -> Vector:
    """Least force in N of each of two pads under each of several loads, of shape (n,).

    Args:
        forces: Forces on what is held at its center of mass, of shape (n, 3), N.
        offset: Place of that center from the middle between the pads, of shape (3,), m.
        axis: Direction in which they close, of unit length, of shape (3,).
        width: Distance between them in m.
        lever: Lever in m of the friction about the normal: the smaller one of both patches.
        friction: Coefficient of friction, less what the surface's slope takes.

    Returns:
        The forces; infinite where friction, or the moment of it, cannot hold a load.
    """
    from bt_dualarm.grasping.grasp_kernels import pinch

    loads, apart, line = (np.ascontiguousarray(one, dtype=float) for one in (forces, offset, axis))
    return pinch(loads, apart, line, float(width), float(lever), float(friction))


def shaken(load: Load) -> Matrix:
    """Forces in N on a load at its center, one for each way of the shake, of shape (26, 3)."""
    forces: Matrix = load.mass * (load.gravity + load.shake * SHAKEN_WAYS)
    return forces


def suction_forces(forces: Matrix, offset: Vector, normal: Vector, cup: CupMeasures) -> Vector:
    """Least force in N of a cup's suction under each of several loads, of shape (n,).

    Args:
        forces: Forces on what is held at its center of mass, of shape (n, 3), N.
        offset: Place of that center from the middle of the rim, of shape (3,), m.
        normal: Direction from the object to the cup, of unit length, of shape (3,).
        cup: Measures of the cup.
    """
    if cup.friction <= 0.0:
        return np.full(len(forces), math.inf)
    moments = np.asarray(np.cross(offset, forces), dtype=float)
    pulling = np.maximum(-(forces @ normal), 0.0)
    sliding = np.hypot(_across(forces, normal), np.abs(moments @ normal) / cup.radius)
    tipping = _across(moments, normal) / cup.radius
    needed: Vector = pulling + np.maximum(sliding / cup.friction, tipping)
    return needed


def suction_force(load: Load, place: Vector, normal: Vector, cup: CupMeasures) -> float:
    """Least force in N of a cup's suction that holds a load however it is shaken.

    The rim is a ring that is pulled off, slides, turns and tips: Mahler, Matl, Liu, Li, Gealy,
    Goldberg, Dex-Net 3.0, ICRA 2018.

    Args:
        load: Mass, gravity, shake and center of mass, in the object's frame.
        place: Middle of the rim on the object, of shape (3,), m.
        normal: Direction from the object to the cup, of unit length, of shape (3,).
        cup: Measures of the cup.
    """
    return float(suction_forces(shaken(load), load.center - place, normal, cup).max())


def _across(vectors: Matrix, axis: Vector) -> Vector:
    """Lengths of vectors, of shape (n, 3), without their parts along a unit axis; of shape (n,)."""
    lengths: Vector = np.linalg.norm(vectors - (vectors @ axis)[:, None] * axis, axis=1)
    return lengths
