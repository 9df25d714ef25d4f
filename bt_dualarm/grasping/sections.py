"""Parts of an object at which several arms hold it: near its ends, at its rim, at its handles."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from bt_dualarm.core.pose import Pose, Vector
from bt_dualarm.core.triangles import cut_at
from bt_dualarm.grasping.grasp import (
    Box,
    Capsule,
    CompoundSolid,
    Cylinder,
    Grasp,
    MeshSolid,
    Solid,
)

HALF_M: Final = 0.03
"""Half the length of a section, m: about a pad's."""

_ACROSS: Final = 0.1
"""Cosine up to which a direction counts as perpendicular."""

_FLAT: Final = 0.5
"""Fraction of its diameter up to which a cylinder counts as a disk."""

_RIM_STEP: Final = np.radians(5.0)
"""Increment of the rotations of the grasps around a disk that are tried, rad."""


@dataclass(frozen=True, eq=False)
class Section:
    """Part of a solid at which one arm holds it.

    Attributes:
        solid: The part.
        pose: Its pose in the solid's frame.
        outward: Unit vector from the solid's center to it, in its own frame, of shape (3,); zero
            for the middle, and for a part that leaves room around it.
        axis: Direction in which the solid continues beyond the section, of shape (3,); zero for
            such a part.
        closing: Only direction in which fingers may close, of shape (3,); None for any across
            ``axis``.
        most_outward: Largest cosine of the approach with ``outward``: the solid is in the way of a
            hand that comes from within, and a disk also of one that comes along its rim.
    """

    solid: Solid
    pose: Pose
    outward: Vector
    axis: Vector
    closing: Vector | None = None
    most_outward: float = _ACROSS

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
        return float(approach @ self.outward) <= self.most_outward


def sections(
    solid: Solid, count: int, spread: float, bases: Sequence[Vector] = ()
) -> list[Section]:
    """Sections of a solid along its longest axis, from one end to the other, or around a disk.

    The longest axis of a mesh is that of its bounding box.

    Args:
        solid: The solid.
        count: Number of sections, at least 2.
        spread: Distance of the outer ones, as a fraction of the largest possible one.
        bases: Positions of the arms' bases in the solid's frame, each of shape (3,), m. The
            sections of a disk face them.

    Returns:
        The sections; none if the solid is too short for them, or has no two ends.
    """
    axis, low, high = _long_axis(solid)
    half = 0.5 * (high - low)
    if half <= 2.0 * HALF_M:
        return []
    if isinstance(solid, Cylinder) and axis == 0:
        return _around(solid, count, spread * (half - HALF_M), bases)
    direction = np.eye(3)[axis]
    found = []
    for share in np.linspace(-1.0, 1.0, count):
        place = share * spread * (half - HALF_M)
        outward = np.sign(round(place, 9)) * direction
        part, center = _part(solid, axis, 0.5 * (low + high) + place)
        pose = Pose(center, np.array((1.0, 0.0, 0.0, 0.0)))
        found.append(Section(part, pose, outward, direction))
    return found


def _around(disk: Cylinder, count: int, radius: float, bases: Sequence[Vector]) -> list[Section]:
    """Sections at equal angles around a disk, at a distance from its axis, m."""
    whole = 2.0 * math.pi
    angles = math.pi + whole * np.arange(count) / count
    sides = [math.atan2(base[1], base[0]) for base in bases]

    def turned_away(turn: float) -> float:
        """Angle between the sections and the arms in the best order, rad."""
        return min(
            sum(
                abs(math.remainder(angle + turn - side, whole))
                for angle, side in zip(order, sides, strict=False)
            )
            for order in itertools.permutations(angles.tolist())
        )

    turns = np.arange(0.0, whole / count, _RIM_STEP).tolist()
    turn = min(turns, key=lambda one: round(turned_away(one), 9))
    x = np.array((1.0, 0.0, 0.0))
    part = Box(np.array((HALF_M, HALF_M, disk.half_length)))
    return [
        Section(
            part,
            Pose.from_rpy((0.0, 0.0, 0.0), (0.0, 0.0, angle + turn))
            @ Pose.from_rpy((radius, 0.0, 0.0)),
            x,
            x,
            closing=np.array((0.0, 0.0, 1.0)),
            most_outward=-0.9,
        )
        for angle in angles.tolist()
    ]


def section_at(part: CompoundSolid, center: Vector) -> Section:
    """Section that is a part of a compound, such as a handle.

    Args:
        part: Compound of which only that part can be grasped; the others are in the way.
        center: Center of the part in the compound's frame, of shape (3,), m.
    """
    back = Pose(-center, np.array((1.0, 0.0, 0.0, 0.0)))
    moved = replace(
        part,
        parts=tuple((solid, back @ pose) for solid, pose in part.parts),
        envelopes=tuple((solid, back @ pose) for solid, pose in part.envelopes),
        surfaces=tuple(points - center for points in part.surfaces),
    )
    return Section(moved, back.inverse, np.zeros(3), np.zeros(3))


def farthest_apart(centers: Mapping[str, Vector], count: int) -> tuple[str, ...]:
    """Names of the parts with the largest least distance from each other.

    Args:
        centers: Center of each part by name, of shape (3,), m.
        count: Number of parts.

    Returns:
        Their names in the order of ``centers``; none if there are fewer, or if they are less than
        two sections apart.
    """

    def least(names: tuple[str, ...]) -> float:
        pairs = itertools.combinations(names, 2)
        return min(float(np.linalg.norm(centers[a] - centers[b])) for a, b in pairs)

    best = max(
        itertools.combinations(centers, count), key=lambda some: round(least(some), 9), default=()
    )
    return best if best and least(best) > 4.0 * HALF_M else ()


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


def _long_axis(solid: Solid) -> tuple[int, float, float]:
    """Index of the longest axis of a solid, and where it begins and ends, m; 0 for no axis."""
    if isinstance(solid, MeshSolid):
        points = solid.corners.reshape(-1, 3)
        low = points.min(axis=0)
        high = points.max(axis=0)
        axis = int(np.argmax(high - low))
        return axis, float(low[axis]), float(high[axis])
    axis = 2
    half = 0.0
    if isinstance(solid, Box):
        axis = int(np.argmax(solid.half))
        half = float(solid.half[axis])
    elif isinstance(solid, Cylinder) and solid.half_length < _FLAT * solid.radius:
        axis, half = 0, float(solid.radius)
    elif isinstance(solid, Cylinder | Capsule):
        half = float(solid.half_length)
    return axis, -half, half


def _part(solid: Solid, axis: int, place: float) -> tuple[Solid, Vector]:
    """A section of a solid about a place along one of its axes, m, and its center, (3,), m."""
    center = place * np.eye(3)[axis]
    if isinstance(solid, Box):
        half = solid.half.copy()
        half[axis] = HALF_M
        return Box(half), center
    if isinstance(solid, MeshSolid):
        _, above = cut_at(solid.corners, axis, place - HALF_M)
        within, _ = cut_at(above, axis, place + HALF_M)
        points = within.reshape(-1, 3)
        center = 0.5 * (points.min(axis=0) + points.max(axis=0))
        return MeshSolid.hull_of(points - center), center
    return Cylinder(float(getattr(solid, "radius", HALF_M)), HALF_M), center
