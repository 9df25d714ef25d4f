"""The least force with which a grip bears its load, by friction of soft fingers."""

from __future__ import annotations

import itertools
import math

import numpy as np

from bt_dualarm.motion.grasping.gripper_measures import CupMeasures, Load
from bt_dualarm.pose import Matrix, Vector

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
        load: Mass, gravity, shake and centre of mass, in the object's frame.
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
        forces: Forces on what is held at its centre of mass, of shape (n, 3), N.
        offset: Place of that centre from the middle between the pads, of shape (3,), m.
        axis: Direction in which they close, of unit length, of shape (3,).
        width: Distance between them in m.
        lever: Lever in m of the friction about the normal: the smaller one of both patches.
        friction: Coefficient of friction, less what the surface's slope takes.

    Returns:
        The forces; infinite where friction, or the moment of it, cannot hold a load.
    """
    from bt_dualarm.motion.pinching.pad_kernels import pinch

    loads, apart, line = (np.ascontiguousarray(one, dtype=float) for one in (forces, offset, axis))
    return pinch(loads, apart, line, float(width), float(lever), float(friction))


def shaken(load: Load) -> Matrix:
    """Forces in N on a load at its centre, one for each way of the shake, of shape (26, 3)."""
    forces: Matrix = load.mass * (load.gravity + load.shake * SHAKEN_WAYS)
    return forces


def suction_forces(forces: Matrix, offset: Vector, normal: Vector, cup: CupMeasures) -> Vector:
    """Least force in N of a cup's suction under each of several loads, of shape (n,).

    Args:
        forces: Forces on what is held at its centre of mass, of shape (n, 3), N.
        offset: Place of that centre from the middle of the rim, of shape (3,), m.
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
        load: Mass, gravity, shake and centre of mass, in the object's frame.
        place: Middle of the rim on the object, of shape (3,), m.
        normal: Direction from the object to the cup, of unit length, of shape (3,).
        cup: Measures of the cup.
    """
    return float(suction_forces(shaken(load), load.center - place, normal, cup).max())


def _across(vectors: Matrix, axis: Vector) -> Vector:
    """Lengths of vectors, of shape (n, 3), without their parts along a unit axis; of shape (n,)."""
    lengths: Vector = np.linalg.norm(vectors - (vectors @ axis)[:, None] * axis, axis=1)
    return lengths
