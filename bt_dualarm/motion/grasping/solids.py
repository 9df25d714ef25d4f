"""Solids in their own frame, centred: how far they reach, and how far points are from them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from bt_dualarm.motion.pinching.kernel_forms import BOX, CAPSULE, CYLINDER, Form
from bt_dualarm.pose import Matrix, Vector


class Solid:
    """What grasps are looked for on."""

    @property
    def form(self) -> Form:
        """The solid in numbers."""
        raise NotImplementedError

    def reach(self, direction: Vector) -> float:
        """Largest coordinate in m along a unit direction of shape (3,): the support function."""
        from bt_dualarm.motion.pinching.solid_kernels import reach

        return reach(*self.form, np.ascontiguousarray(direction, dtype=float))

    def distance(self, points: Matrix) -> Vector:
        """Signed distances in m of points of shape (n, 3), negative inside; of shape (n,).

        Exact, but for a convex mesh: there, outside, it is that of the farthest plane.
        """
        from bt_dualarm.motion.pinching.solid_kernels import distances

        return distances(*self.form, np.ascontiguousarray(points, dtype=float))


@dataclass(frozen=True, eq=False)
class Box(Solid):
    """A box around the origin.

    Attributes:
        half: Half of its edges, of shape (3,), m.
    """

    half: Vector

    @cached_property
    def form(self) -> Form:
        """As `Solid.form`."""
        return Form(BOX, np.array([self.half], dtype=float))


@dataclass(frozen=True, eq=False)
class Cylinder(Solid):
    """A cylinder around the z axis.

    Attributes:
        radius: Radius in m.
        half_length: Half of its length in m.
    """

    radius: float
    half_length: float

    @cached_property
    def form(self) -> Form:
        """As `Solid.form`."""
        return Form(CYLINDER, np.array([[self.radius, self.half_length]], dtype=float))


@dataclass(frozen=True, eq=False)
class Capsule(Solid):
    """A ball moved along the z axis; a sphere where it is not moved.

    Attributes:
        radius: Radius in m.
        half_length: Half of the straight part in m, 0 of a sphere.
    """

    radius: float
    half_length: float = 0.0

    @cached_property
    def form(self) -> Form:
        """As `Solid.form`."""
        return Form(CAPSULE, np.array([[self.radius, self.half_length]], dtype=float))


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
