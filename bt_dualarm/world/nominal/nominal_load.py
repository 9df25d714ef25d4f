"""What an arm holds, as far as the tree file says what it is, or the arm has weighed it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bt_dualarm.pose import Pose, Vector
from bt_dualarm.spec.document import ObjectSpec


@dataclass(frozen=True, eq=False)
class NominalLoad:
    """An object at an arm's tool.

    Attributes:
        object: Name of the object.
        mass: Mass in kg, None where nobody knows it.
        inertia: Moments of inertia about the axes of ``pose``, of shape (3,), kg m²; None likewise.
        pose: Pose of its centre of mass in the tool's link, as it was when it was attached.
        gyration: Moments of inertia of its shape for 1 kg, of shape (3,), m².
        is_told: Whether the file says the mass; else the arm has to weigh it.
        mass_doubt: Standard deviation of a mass that was weighed, kg.
        center_doubt: Standard deviation of a centre that was, along an axis, m.
    """

    object: str
    mass: float | None
    inertia: Vector | None
    pose: Pose
    gyration: Vector
    is_told: bool = True
    mass_doubt: float = 0.0
    center_doubt: float = 0.0

    @classmethod
    def of(cls, name: str, thing: ObjectSpec, pose: Pose, *, known: bool = True) -> NominalLoad:
        """The load that a declared object is: its mass is spread evenly, and known or not."""
        gyration = inertia_per_mass(thing)
        if not known:
            return cls(name, None, None, pose, gyration, is_told=False)
        return cls(name, thing.mass, thing.mass * gyration, pose, gyration)


def inertia_per_mass(thing: ObjectSpec) -> Vector:
    """Moments of inertia of an even body about its axes, for 1 kg, of shape (3,), m²."""
    if thing.shape == "box":
        x, y, z = np.square(thing.size)
        return np.array([y + z, z + x, x + y]) / 12
    if thing.shape == "cylinder":
        radius, length = np.square(thing.size)
        return np.array([3 * radius + length, 3 * radius + length, 6 * radius]) / 12
    if thing.shape == "capsule":
        radius, length = thing.size
        straight = length / (length + 4.0 / 3.0 * radius)  # its share of the mass
        ball = 1.0 - straight
        along = (0.5 * straight + 0.4 * ball) * radius**2
        across = straight * (length**2 / 12 + radius**2 / 4)
        across += ball * (0.4 * radius**2 + length**2 / 4 + 0.375 * length * radius)
        return np.array([across, across, along])
    return np.full(3, 0.4 * thing.size[0] ** 2)
