"""Parts of an object at which several arms hold it: near opposite ends, or at opposite rims."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from bt_dualarm.core.pose import Pose, Vector
from bt_dualarm.grasping.grasp import Box, Capsule, Cylinder, Grasp, Solid

HALF_M: Final = 0.03
"""Half the length of a section, m: about a pad's."""

_ACROSS: Final = 0.1
"""Cosine up to which a direction counts as perpendicular."""

_FLAT: Final = 0.5
"""Fraction of its diameter up to which a cylinder counts as a disk."""


@dataclass(frozen=True, eq=False)
class Section:
    """Part of a solid at which one arm holds it.

    Attributes:
        solid: The part.
        pose: Its pose in the solid's frame; only shifted.
        outward: Unit vector from the solid's center to it, of shape (3,); zero for the middle.
        axis: Direction in which the solid continues beyond the section, of shape (3,).
        closing: Only direction in which fingers may close, of shape (3,); None for any across
            ``axis``.
    """

    solid: Solid
    pose: Pose
    outward: Vector
    axis: Vector
    closing: Vector | None = None

    def allows(self, grasp: Grasp) -> bool:
        """Whether the solid leaves room for a grasp of the section, in the section's frame."""
        axes = grasp.tool.rotation_matrix
        if abs(float(axes[:, 1] @ self.axis)) > _ACROSS and grasp.width > 0.0:
            return False
        if self.closing is not None and abs(float(axes[:, 1] @ self.closing)) < 1.0 - _ACROSS:
            return False
        approach = axes[:, 2]
        if not self.outward.any():
            return abs(float(approach @ self.axis)) <= _ACROSS
        return float(approach @ self.outward) <= _ACROSS


def sections(solid: Solid, count: int, spread: float) -> list[Section]:
    """Sections of a solid along its longest axis, from one end to the other.

    Args:
        solid: The solid.
        count: Number of sections, at least 2.
        spread: Distance of the outer ones, as a fraction of the largest possible one.

    Returns:
        The sections; none if the solid is too short for them, or has no two ends.
    """
    axis, half = _long_axis(solid)
    if half <= 2.0 * HALF_M:
        return []
    direction = np.eye(3)[axis]
    found = []
    for share in np.linspace(-1.0, 1.0, count):
        place = share * spread * (half - HALF_M)
        outward = np.sign(round(place, 9)) * direction
        pose = Pose(place * direction, np.array((1.0, 0.0, 0.0, 0.0)))
        part, closing = _part(solid, axis)
        found.append(Section(part, pose, outward, direction, closing))
    return found


def shares_at(places: Sequence[Vector]) -> list[float]:
    """Fraction of a load that each of several grasps bears, by the law of the lever.

    The shares have the smallest sum of squares for which the center of the shares
    is nearest to the center of mass; none is negative.

    Args:
        places: Positions of the grasps from the center of mass, each of shape (3,), m.
    """
    count = len(places)
    points = np.array(places)
    weight = 1e3 / max(float(np.abs(points).max()), 1e-9)
    left = np.vstack((weight * points.T, 1e6 * np.ones(count), 1e-3 * np.eye(count)))
    right = np.concatenate((np.zeros(3), (1e6,), np.full(count, 1e-3 / count)))
    found = np.linalg.lstsq(left, right, rcond=None)[0].clip(0.05, 1.0)
    return [float(one) for one in found / found.sum()]


def _long_axis(solid: Solid) -> tuple[int, float]:
    """Index of the longest axis of a solid, and half its length along it, m; 0 for no axis."""
    if isinstance(solid, Box):
        axis = int(np.argmax(solid.half))
        return axis, float(solid.half[axis])
    if isinstance(solid, Cylinder):
        if solid.half_length < _FLAT * solid.radius:
            return 0, float(solid.radius)
        return 2, float(solid.half_length)
    if isinstance(solid, Capsule):
        return 2, float(solid.half_length)
    return 0, 0.0


def _part(solid: Solid, axis: int) -> tuple[Solid, Vector | None]:
    """A section of a solid, and the only direction in which fingers may close on it."""
    if isinstance(solid, Box):
        half = solid.half.copy()
        half[axis] = HALF_M
        return Box(half), None
    if isinstance(solid, Cylinder) and axis == 2:
        return Cylinder(solid.radius, HALF_M), None
    if isinstance(solid, Cylinder):  # the rim of a disk
        return Box(np.array((HALF_M, HALF_M, solid.half_length))), np.array((0.0, 0.0, 1.0))
    return Cylinder(float(getattr(solid, "radius", HALF_M)), HALF_M), None
