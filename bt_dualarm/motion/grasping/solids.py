"""Solids in their own frame, centred: how far they reach, and how far points are from them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from bt_dualarm.pose import Matrix, Vector


class Solid(Protocol):
    """What grasps are looked for on."""

    def reach(self, direction: Vector) -> float:
        """Largest coordinate in m along a unit direction of shape (3,): the support function."""
        ...

    def distance(self, points: Matrix) -> Vector:
        """Signed distances in m of points of shape (n, 3), negative inside; of shape (n,)."""
        ...


@dataclass(frozen=True, eq=False)
class Box:
    """A box around the origin.

    Attributes:
        half: Half of its edges, of shape (3,), m.
    """

    half: Vector

    def reach(self, direction: Vector) -> float:
        """As `Solid.reach`: where the corner is that lies farthest."""
        return float(np.abs(direction) @ self.half)

    def distance(self, points: Matrix) -> Vector:
        """As `Solid.distance`, exact inside and outside."""
        return _outside(np.abs(points) - self.half)


@dataclass(frozen=True, eq=False)
class Cylinder:
    """A cylinder around the z axis.

    Attributes:
        radius: Radius in m.
        half_length: Half of its length in m.
    """

    radius: float
    half_length: float

    def reach(self, direction: Vector) -> float:
        """As `Solid.reach`: on the edge of an end."""
        across = float(np.hypot(direction[0], direction[1]))
        return self.radius * across + self.half_length * abs(float(direction[2]))

    def distance(self, points: Matrix) -> Vector:
        """As `Solid.distance`, exact inside and outside."""
        across = np.hypot(points[:, 0], points[:, 1]) - self.radius
        return _outside(np.column_stack((across, np.abs(points[:, 2]) - self.half_length)))


@dataclass(frozen=True, eq=False)
class Capsule:
    """A ball moved along the z axis; a sphere where it is not moved.

    Attributes:
        radius: Radius in m.
        half_length: Half of the straight part in m, 0 of a sphere.
    """

    radius: float
    half_length: float = 0.0

    def reach(self, direction: Vector) -> float:
        """As `Solid.reach`: on one of the two balls at its ends."""
        return self.radius + self.half_length * abs(float(direction[2]))

    def distance(self, points: Matrix) -> Vector:
        """As `Solid.distance`, exact inside and outside."""
        middle = np.clip(points[:, 2], -self.half_length, self.half_length)
        along = points[:, 2] - middle
        away: Vector = np.sqrt(points[:, 0] ** 2 + points[:, 1] ** 2 + along**2) - self.radius
        return away


def solid_of(shape: str, size: Sequence[float]) -> Solid:
    """The solid that a tree file declares.

    Args:
        shape: Name of the form: ``box``, ``cylinder``, ``capsule`` or ``sphere``.
        size: Edges of a box; radius and length of a cylinder, radius and length of the straight
            part of a capsule; radius of a sphere; m.

    Raises:
        ValueError: The form is none of these.
    """
    if shape == "box":
        return Box(0.5 * np.asarray(size, dtype=float))
    if shape == "cylinder":
        return Cylinder(float(size[0]), 0.5 * float(size[1]))
    if shape == "capsule":
        return Capsule(float(size[0]), 0.5 * float(size[1]))
    if shape == "sphere":
        return Capsule(float(size[0]))
    raise ValueError(f"no grasps are known of a {shape!r}: box, cylinder, capsule, sphere are")


def _outside(beyond: Matrix) -> Vector:
    """Distances from what is bounded along independent axes.

    Args:
        beyond: Distances beyond the bound of each axis, negative within, of shape (n, axes), m.
    """
    outside = np.sqrt(np.square(np.maximum(beyond, 0.0)).sum(axis=1))
    distance: Vector = outside + np.minimum(beyond.max(axis=1), 0.0)
    return distance
