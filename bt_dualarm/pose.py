"""Rigid transforms. ``Pose`` of B in A maps coordinates in B to coordinates in A."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import Rotation

Vector: TypeAlias = npt.NDArray[np.float64]
"""A one-dimensional array of floats; the docstring that uses it gives the shape."""

Matrix: TypeAlias = npt.NDArray[np.float64]
"""A two-dimensional array of floats; the docstring that uses it gives the shape."""


@dataclass(frozen=True, eq=False)
class Pose:
    """Position in metres, of shape (3,), and orientation as a unit quaternion wxyz, of shape (4,)."""

    position: Vector
    quaternion: Vector

    @classmethod
    def identity(cls) -> Pose:
        """The transform that changes nothing."""
        return cls(np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0]))

    @classmethod
    def from_rpy(cls, xyz: Sequence[float], rpy: Sequence[float] = (0.0, 0.0, 0.0)) -> Pose:
        """Roll, pitch, yaw in radians about the fixed axes x, y, z in that order (URDF)."""
        return cls.from_rotation(xyz, Rotation.from_euler("xyz", rpy))

    @classmethod
    def from_rotation(cls, xyz: Sequence[float] | Vector, rotation: Rotation) -> Pose:
        """Position and a SciPy rotation."""
        return cls(np.array(xyz, dtype=float), rotation.as_quat(canonical=True, scalar_first=True))

    @classmethod
    def from_matrix(cls, matrix: Matrix) -> Pose:
        """A homogeneous transform, of shape (4, 4)."""
        return cls.from_rotation(matrix[:3, 3], Rotation.from_matrix(matrix[:3, :3]))

    @property
    def rotation(self) -> Rotation:
        """The orientation as a SciPy rotation."""
        return Rotation.from_quat(self.quaternion, scalar_first=True)

    @property
    def matrix(self) -> Matrix:
        """The homogeneous transform, of shape (4, 4)."""
        matrix = np.eye(4)
        matrix[:3, :3] = self.rotation.as_matrix()
        matrix[:3, 3] = self.position
        return matrix

    @property
    def inverse(self) -> Pose:
        """The pose of A in B."""
        back = self.rotation.inv()
        return Pose.from_rotation(-back.apply(self.position), back)

    def __matmul__(self, other: Pose) -> Pose:
        """Compose: (B in A) @ (C in B) is C in A."""
        turn = self.rotation
        return Pose.from_rotation(
            self.position + turn.apply(other.position), turn * other.rotation
        )

    def apply(self, point: Vector) -> Vector:
        """A point of shape (3,), or points of shape (n, 3), of B in the coordinates of A."""
        moved: Vector = self.rotation.apply(point) + self.position
        return moved

    def distance(self, other: Pose) -> float:
        """Distance between the two origins in metres."""
        return float(np.linalg.norm(self.position - other.position))

    def angle(self, other: Pose) -> float:
        """Angle between the two orientations in radians."""
        return float((self.rotation.inv() * other.rotation).magnitude())
