"""Where to look at a scene from, so that all of what matters is in the picture."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from bt_dualarm.pose import Matrix, Vector

_MARGIN = 1.06
"""So much farther away than needed, so that nothing touches the edge of the picture."""


@dataclass(frozen=True, eq=False)
class Viewpoint:
    """A pinhole camera for people, outside of the world.

    Attributes:
        eye: Position of the eye in the world, of shape (3,), in m.
        look_at: Point of the world that appears in the middle, of shape (3,), in m.
        fov_deg: Angle that the height of the picture spans.
    """

    eye: Vector
    look_at: Vector
    fov_deg: float

    @cached_property
    def axes(self) -> Matrix:
        """Axes as columns, of shape (3, 3), in MuJoCo's convention: x right, y up, z backward."""
        return _axes_towards(self.eye - self.look_at)

    def pixels(self, points: Matrix, width: int, height: int) -> Matrix:
        """Where points of the world, of shape (n, 3), appear in a picture: of shape (n, 2)."""
        inside = (points - self.eye) @ self.axes
        focal = height / 2 / math.tan(math.radians(self.fov_deg) / 2)
        x = width / 2 - focal * inside[:, 0] / inside[:, 2]
        y = height / 2 + focal * inside[:, 1] / inside[:, 2]
        return np.column_stack((x, y))


def fitted(points: Matrix, direction: Vector, fov_deg: float, aspect: float) -> Viewpoint:
    """The nearest viewpoint in a direction that has all points in its picture.

    Args:
        points: Points of the world, of shape (n, 3), at least one, in m.
        direction: Vector from the scene to the eye, of shape (3,), not vertical.
        fov_deg: Angle that the height of the picture spans.
        aspect: Width of the picture by its height.
    """
    axes = _axes_towards(direction)
    inside = points @ axes
    middle = (inside.min(axis=0) + inside.max(axis=0)) / 2
    inside -= middle
    slope = math.tan(math.radians(fov_deg) / 2) / _MARGIN
    needs = np.abs(inside[:, :2]) / (slope * aspect, slope) + inside[:, 2:]
    look_at = axes @ middle
    return Viewpoint(look_at + float(needs.max()) * axes[:, 2], look_at, fov_deg)


def _axes_towards(backward: Vector) -> Matrix:
    z = backward / np.linalg.norm(backward)
    x = np.cross((0.0, 0.0, 1.0), z)
    x /= np.linalg.norm(x)
    return np.column_stack((x, np.cross(z, x), z))
