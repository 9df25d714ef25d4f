"""Grasps, dimensions of grippers, and the least force with which a grip holds a load.

- `Grasp` is a pose of the tool on an object, with its force and margin.
- `JawMeasures` and `CupMeasures` are what counts of a gripper; their tool frame has its z axis out
  of the tool. A parallel gripper closes along y, with the tool frame in the middle of its pads.
- `pinching_force` models the pads as soft fingers, `suction_force` the rim of a cup as a ring.
- `pad_contact` and `held` find where flat pads touch a solid.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass

import numpy as np

from bt_dualarm.core.pose import Matrix, Pose, Vector
from bt_dualarm.grasping.solids import Solid

_DIRECTIONS = np.array([d for d in itertools.product((-1.0, 0.0, 1.0), repeat=3) if any(d)])

SHAKE_DIRECTIONS: Matrix = _DIRECTIONS / np.linalg.norm(_DIRECTIONS, axis=1)[:, None]
"""Directions of the tool's acceleration under which a grip must hold: the faces, edges and corners
of a cube, of unit length, of shape (26, 3)."""


@dataclass(frozen=True, eq=False)
class Grasp:
    """Grasp of an object.

    Attributes:
        tool: Pose of the tool frame in the object's frame.
        width: Distance of the pads on contact, m; 0 for suction.
        force: Least force that holds the load, of each pad or of the suction, N.
        margin: Largest force of the gripper divided by that force.
    """

    tool: Pose
    width: float
    force: float
    margin: float


@dataclass(frozen=True, eq=False)
class JawMeasures:
    """Dimensions of a parallel gripper with two fingers.

    Attributes:
        least_opening: Distance of the pads when closed, m.
        widest_opening: Distance of the pads when open, m.
        pad_length: Length of a pad along the tool's z axis, m.
        pad_width: Width of a pad along the tool's x axis, m.
        palm: Distance from the tool frame back to the palm, m.
        tip: Distance from the tool frame forward to the fingertips, m.
        thickness: Thickness of a finger along the tool's y axis, m.
        least_force: Least force of each pad on a grasped object, N.
        most_force: Largest force of each pad on a grasped object, N.
        friction: Coefficient of sliding friction of the pads.
        pad_center: Distance from the tool frame to the center of the pads, along z, m.
        palm_radius: Radius of the palm about the tool's z axis, m.
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
    """Dimensions of a suction cup with its rim at the tool frame.

    Attributes:
        radius: Radius of the rim, m.
        bends: Depth by which the rim adapts to a curved surface, m.
        most_force: Largest suction force, N.
        friction: Coefficient of sliding friction of the rim.
    """

    radius: float
    bends: float
    most_force: float
    friction: float


@dataclass(frozen=True, eq=False)
class Load:
    """Load on a grip.

    Attributes:
        mass: Mass, kg.
        gravity: Acceleration of gravity in the object's frame, of shape (3,), m/s².
        shake: Largest acceleration of the tool in any direction, m/s².
        center: Center of mass in the object's frame, of shape (3,), m.
    """

    mass: float
    gravity: Vector
    shake: float
    center: Vector


def pinching_force(
    load: Load, center: Vector, axis: Vector, width: float, levers: float, friction: float
) -> float:
    """Least force of each of two pads that holds a load under any acceleration of the tool, N.

    A pad is a soft finger (R. M. Murray, Z. Li, S. S. Sastry, A Mathematical Introduction to
    Robotic Manipulation, 1994, chapter 5): a normal force, friction in its plane, and a frictional
    moment about the normal. The limit of both together is an ellipsoid, the limit surface (R. D.
    Howe, M. R. Cutkosky, Practical force-motion models for sliding manipulation, IJRR 1996). A
    moment across the grasp axis is balanced by opposite forces in the planes of the pads; a shift
    of pressure within a pad is neglected. A force along the axis loads one pad and relieves the
    other.

    Args:
        load: Mass, gravity, shake and center of mass, in the object's frame.
        center: Center between the pads, of shape (3,), m.
        axis: Unit vector along which the pads close, of shape (3,).
        width: Distance of the pads, m.
        levers: Lever of the frictional moment about the normal: the smaller one of both pads, m.
        friction: Coefficient of friction, reduced by the slope of the surface.

    Returns:
        Force in N; infinite if friction or its moment cannot hold the load.
    """
    needed = pinching_forces(shaken(load), load.center - center, axis, width, levers, friction)
    return float(needed.max())


def pinching_forces(
    forces: Matrix, offset: Vector, axis: Vector, width: float, lever: float, friction: float
) -> Vector:
    """Least force of each of two pads under each of several loads, of shape (n,), N.

    Args:
        forces: Forces on the object at its center of mass, of shape (n, 3), N.
        offset: Vector from the center between the pads to the center of mass, of shape (3,), m.
        axis: Unit vector along which the pads close, of shape (3,).
        width: Distance of the pads, m.
        lever: Lever of the frictional moment about the normal: the smaller one of both pads, m.
        friction: Coefficient of friction, reduced by the slope of the surface.

    Returns:
        Forces; infinite if friction or its moment cannot hold a load.
    """
    from bt_dualarm.grasping.grasp_kernels import pinch

    # The kernel is compiled for contiguous arrays of floats alone.
    forces, offset, axis = (
        np.ascontiguousarray(array, dtype=float) for array in (forces, offset, axis)
    )
    return pinch(forces, offset, axis, float(width), float(lever), float(friction))


def suction_force(load: Load, place: Vector, normal: Vector, cup: CupMeasures) -> float:
    """Least suction force of a cup that holds a load under any acceleration of the tool, N.

    The rim is a ring that can be pulled off, slide, turn and tip: J. Mahler, M. Matl, X. Liu, A.
    Li, D. Gealy, K. Goldberg, Dex-Net 3.0, ICRA 2018.

    Args:
        load: Mass, gravity, shake and center of mass, in the object's frame.
        place: Center of the rim on the object, of shape (3,), m.
        normal: Unit vector from the object to the cup, of shape (3,).
        cup: Measures of the cup.
    """
    return float(suction_forces(shaken(load), load.center - place, normal, cup).max())


def suction_forces(forces: Matrix, offset: Vector, normal: Vector, cup: CupMeasures) -> Vector:
    """Least suction force of a cup under each of several loads, of shape (n,), N.

    Args:
        forces: Forces on the object at its center of mass, of shape (n, 3), N.
        offset: Vector from the center of the rim to the center of mass, of shape (3,), m.
        normal: Unit vector from the object to the cup, of shape (3,).
        cup: Measures of the cup.
    """
    if cup.friction <= 0.0:
        return np.full(len(forces), math.inf)
    moments = np.asarray(np.cross(offset, forces), dtype=float)
    # Suction less the pull on the object presses the rim on. That must be enough for friction to
    # hold against sliding and turning about the normal, and to keep the rim from tipping off.
    pulling = np.maximum(-(forces @ normal), 0.0)
    sliding = np.hypot(_across(forces, normal), np.abs(moments @ normal) / cup.radius)
    tipping = _across(moments, normal) / cup.radius
    needed: Vector = pulling + np.maximum(sliding / cup.friction, tipping)
    return needed


def shaken(load: Load) -> Matrix:
    """Forces on a load at its center of mass, one per direction of shake, of shape (26, 3), N."""
    forces: Matrix = load.mass * (load.gravity + load.shake * SHAKE_DIRECTIONS)
    return forces


def _across(vectors: Matrix, axis: Vector) -> Vector:
    """Lengths of the components of vectors, of shape (n, 3), across a unit axis; of shape (n,)."""
    lengths: Vector = np.linalg.norm(vectors - (vectors @ axis)[:, None] * axis, axis=1)
    return lengths


@dataclass(frozen=True, eq=False)
class PadContact:
    """Contact patch of a pad.

    Attributes:
        middle: Center of the patch, of shape (3,), m.
        share: Share of the pad in contact, in [0, 1].
        lever: Mean distance of the patch from its center, m: times the friction force, the largest
            frictional moment about the normal under even pressure.
        slope: Smallest angle between the normals of pad and surface in the patch, rad.
    """

    middle: Vector
    share: float
    lever: float
    slope: float


@dataclass(frozen=True, eq=False)
class PadHold:
    """Solid between two pads.

    Attributes:
        center: Center between both contact patches, of shape (3,), m.
        width: Distance of the pads, m.
        lever: Smaller one of both pads' levers, m.
        tilt: Largest of the angles between the pads' normal and the surface on either side, or the
            line between the patches, rad.
    """

    center: Vector
    width: float
    lever: float
    tilt: float


def pad_contact(
    solid: Solid, center: Vector, normal: Vector, along: Vector, size: Vector
) -> PadContact | None:
    """Contact patch of one pad that approaches a solid from outside; None if it misses the solid.

    Args:
        solid: Solid against which it is pressed.
        center: Any point on the line along which the pad's center approaches, of shape (3,), m.
        normal: Unit vector from the solid to the pad, of shape (3,).
        along: Unit vector along the pad's length, perpendicular to the normal, of shape (3,).
        size: Length and width of the pad, of shape (2,), m.
    """
    from bt_dualarm.grasping.grasp_kernels import press

    met = np.empty(6)
    if not press(*solid.form, center, normal, along, size, met):
        return None
    return PadContact(met[:3], float(met[3]), float(met[4]), float(met[5]))


def held(solid: Solid, center: Vector, axis: Vector, along: Vector, size: Vector) -> PadHold | None:
    """Contact of two pads that close along an axis; None if one of them misses the solid.

    Args:
        solid: Solid between them.
        center: Point on the line between the pads' centers, of shape (3,), m.
        axis: Unit vector along which they close, of shape (3,).
        along: Unit vector along the pads' length, perpendicular to the axis, of shape (3,).
        size: Length and width of a pad, of shape (2,), m.
    """
    from bt_dualarm.grasping.grasp_kernels import hold

    between = np.empty(6)
    if not hold(*solid.form, center, axis, along, size, between):
        return None
    return PadHold(between[:3], float(between[3]), float(between[4]), float(between[5]))
