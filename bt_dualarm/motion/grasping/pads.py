"""What flat pads meet when they shut on a solid: where, how much of them, how it slopes there."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bt_dualarm.motion.grasping.solids import Solid
from bt_dualarm.pose import Matrix, Vector

PRESSED = 3e-4
"""Depth in m to which a pad gives way; rubber and MuJoCo's contacts do about as much."""

_SPOT = 1.5e-3  # m: lever of what touches at a spot, which a soft pad makes a patch; of a ball of
# 10 mm that is pressed in by 0.3 mm it is 1.6 mm
_ROWS = 7
_STEPS = 20  # of a trace: each is as long as the distance to the solid
_HIT = 2e-5  # m
_SLOPE = 1e-5  # m, over which normals are measured


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
class Hold:
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


def pressed(
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
    steps = size[:, None] * ((np.arange(_ROWS) + 0.5) / _ROWS - 0.5)
    flat = np.array(np.meshgrid(*steps)).reshape(2, -1).T
    start = center + (solid.reach(normal) - center @ normal) * normal
    points = start + flat @ np.vstack((along, np.cross(normal, along)))
    lines = _traced(solid, points, -normal)
    if not len(lines):
        return None
    on, at = points[lines[:, 0].astype(int)], lines[:, 1]
    touching = at <= at.min() + PRESSED
    met = on[touching] - at[touching][:, None] * normal
    middle = met.mean(axis=0)
    middle = middle + float(((on - at.min() * normal) - middle).mean(axis=0) @ normal) * normal
    spread = np.linalg.norm(met - met.mean(axis=0), axis=1)
    cosine = float((normals(solid, met) @ normal).max())
    share, slope = len(met) / len(points), float(np.arccos(min(cosine, 1.0)))
    return PadContact(middle, share, max(float(spread.mean()), _SPOT), slope)


def _traced(solid: Solid, points: Matrix, direction: Vector) -> Matrix:
    """Which rays from points of shape (n, 3) meet a solid, and after how many metres: (m, 2)."""
    gone, farthest = np.zeros(len(points)), solid.reach(direction) + solid.reach(-direction)
    left = np.arange(len(points))
    for _ in range(_STEPS):
        away = solid.distance(points[left] + gone[left, None] * direction)
        gone[left] += np.maximum(away, 0.0)
        left = left[(away >= _HIT) & (gone[left] <= farthest)]
        if not len(left):
            break
    gone[left] = np.inf  # it passes close by
    met = np.flatnonzero(gone <= farthest)
    return np.column_stack((met, gone[met]))


def held(solid: Solid, center: Vector, axis: Vector, along: Vector, size: Vector) -> Hold | None:
    """What two pads hold that shut along an axis; None if one of them meets nothing.

    Args:
        solid: Solid between them.
        center: Place on the line between the pads' middles, of shape (3,), m.
        axis: Direction in which they close, of unit length, of shape (3,).
        along: Direction of their length, of unit length, square to the axis.
        size: Length and width of a pad, of shape (2,), m.
    """
    one = pressed(solid, center, axis, along, size)
    other = pressed(solid, center, -axis, along, size)
    if one is None or other is None:
        return None
    line = one.middle - other.middle
    width = float(line @ axis)
    if width <= 0.0:
        return None
    skew = float(np.arccos(np.clip(width / np.linalg.norm(line), 0.0, 1.0)))
    return Hold(
        0.5 * (one.middle + other.middle),
        width,
        min(one.lever, other.lever),
        max(one.slope, other.slope, skew),
    )


def normals(solid: Solid, points: Matrix) -> Matrix:
    """Unit normals of a solid at points of its surface, each of shape (n, 3)."""
    steps = _SLOPE * np.vstack((np.eye(3), -np.eye(3)))
    around = (points[:, None] + steps).reshape(-1, 3)
    away = solid.distance(around).reshape(len(points), 2, 3)
    slope = away[:, 0] - away[:, 1]
    unit: Matrix = slope / np.maximum(np.linalg.norm(slope, axis=1), 1e-12)[:, None]
    return unit
