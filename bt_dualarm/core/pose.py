"""Rigid transforms. ``Pose`` of B in A maps coordinates in B to coordinates in A."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TypeAlias

import mujoco
import numpy as np
import numpy.typing as npt
import scipy

# Composition, inversion and application are written out, because skills and cameras use them in
# every tick and SciPy's rotations cost 50 µs each. Rare operations use SciPy, which is imported on
# demand: that takes 0.3 s, and many runs do not need it.


Vector: TypeAlias = npt.NDArray[np.float64]
"""A one-dimensional array of floats; the docstring that uses it gives the shape."""

Matrix: TypeAlias = npt.NDArray[np.float64]
"""A two-dimensional array of floats; the docstring that uses it gives the shape."""


_UPRIGHT = 1e-9
"""Cosine of the pitch below which roll and yaw have the same axis (gimbal lock)."""

_CONJUGATE = np.array([1.0, -1.0, -1.0, -1.0])


@dataclass(frozen=True, eq=False)
class Pose:
    """Position in meters, of shape (3,), and orientation as a unit quaternion wxyz, shape (4,)."""

    position: Vector
    quaternion: Vector

    @classmethod
    def identity(cls) -> Pose:
        """Identity transform."""
        return cls(np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0]))

    @classmethod
    def from_rpy(cls, xyz: Sequence[float], rpy: Sequence[float] = (0.0, 0.0, 0.0)) -> Pose:
        """Roll, pitch, yaw in radians about the fixed axes x, y, z in that order (URDF).

        Raises:
            ValueError: Not three numbers each.
        """
        if len(xyz) != len(rpy):
            raise ValueError(f"a position is three numbers, not {tuple(xyz)}")
        (cr, sr), (cp, sp), (cy, sy) = ((math.cos(a / 2.0), math.sin(a / 2.0)) for a in rpy)
        quaternion = np.array(
            (
                cr * cp * cy + sr * sp * sy,
                sr * cp * cy - cr * sp * sy,
                cr * sp * cy + sr * cp * sy,
                cr * cp * sy - sr * sp * cy,
            )
        )
        return cls(np.array(xyz, dtype=float), _canonical(quaternion))

    @classmethod
    def from_rotation(
        cls, xyz: Sequence[float] | Vector, rotation: scipy.spatial.transform.Rotation
    ) -> Pose:
        """Position and a SciPy rotation."""
        return cls(np.array(xyz, dtype=float), rotation.as_quat(canonical=True, scalar_first=True))

    @classmethod
    def from_matrix(cls, matrix: Matrix) -> Pose:
        """A homogeneous transform, of shape (4, 4)."""
        return cls(matrix[:3, 3].copy(), _quaternion_of(matrix[:3, :3].tolist()))

    @classmethod
    def from_axes(cls, position: Vector, axes: Sequence[Sequence[float]]) -> Pose:
        """A position, of shape (3,), and the rows of a rotation, whose columns are the axes."""
        return cls(position, _quaternion_of(axes))

    @property
    def rotation(self) -> scipy.spatial.transform.Rotation:
        """The orientation as a SciPy rotation."""
        return scipy.spatial.transform.Rotation.from_quat(self.quaternion, scalar_first=True)

    @cached_property
    def rotation_matrix(self) -> Matrix:
        """The orientation, of shape (3, 3): its columns are the axes of B in A.

        Worked out once, and read-only.
        """
        matrix = np.array(_axes(self.quaternion))
        matrix.flags.writeable = False
        return matrix

    @property
    def rpy(self) -> tuple[float, float, float]:
        """Roll, pitch, yaw in radians, as `from_rpy` takes them; no roll where pitch is upright."""
        (a, _, _), (d, _, _), (g, h, i) = self.rotation_matrix.tolist()
        level = math.hypot(a, d)
        pitch = math.atan2(-g, level)
        if level > _UPRIGHT:
            return math.atan2(h, i), pitch, math.atan2(d, a)
        b, e = self.rotation_matrix[:2, 1].tolist()
        return 0.0, pitch, math.atan2(-b, e)

    @property
    def matrix(self) -> Matrix:
        """The homogeneous transform, of shape (4, 4)."""
        x, y, z = self.position.tolist()
        first, second, third = _axes(self.quaternion)
        return np.array(((*first, x), (*second, y), (*third, z), (0.0, 0.0, 0.0, 1.0)))

    @property
    def inverse(self) -> Pose:
        """The pose of A in B."""
        return Pose(-(self.position @ self.rotation_matrix), self.quaternion * _CONJUGATE)

    def __matmul__(self, other: Pose) -> Pose:
        """Compose: (B in A) @ (C in B) is C in A."""
        return Pose(self.apply(other.position), _product(self.quaternion, other.quaternion))

    def apply(self, point: Vector) -> Vector:
        """A point of shape (3,), or points of shape (n, 3), of B in the coordinates of A."""
        moved: Vector = point @ self.rotation_matrix.T + self.position
        return moved

    def turn(self, direction: Vector) -> Vector:
        """A direction of B, of shape (3,) or (n, 3), in the coordinates of A."""
        turned: Vector = direction @ self.rotation_matrix.T
        return turned

    def shifted(self, offset: Vector) -> Pose:
        """This pose, moved by an offset in A, of shape (3,), m."""
        return Pose(self.position + offset, self.quaternion)

    def raised(self, height: float) -> Pose:
        """This pose, moved by a height in m along the z axis of A: upward in the world."""
        return self.shifted(np.array((0.0, 0.0, height)))

    def distance(self, other: Pose) -> float:
        """Distance between the two origins in meters."""
        return float(np.linalg.norm(self.position - other.position))

    def angle(self, other: Pose) -> float:
        """Angle between the two orientations in radians."""
        step = _product(self.quaternion * _CONJUGATE, other.quaternion)
        return 2.0 * float(np.arctan2(np.linalg.norm(step[1:]), abs(step[0])))


_Row = tuple[float, float, float]


def _axes(quaternion: Vector) -> tuple[_Row, _Row, _Row]:
    """Rows of the rotation matrix of a quaternion wxyz of any nonzero length."""
    w, x, y, z = quaternion.tolist()
    s = 2.0 / (w * w + x * x + y * y + z * z)
    return (
        (1.0 - s * (y * y + z * z), s * (x * y - z * w), s * (x * z + y * w)),
        (s * (x * y + z * w), 1.0 - s * (x * x + z * z), s * (y * z - x * w)),
        (s * (x * z - y * w), s * (y * z + x * w), 1.0 - s * (x * x + y * y)),
    )


def _quaternion_of(rows: Sequence[Sequence[float]]) -> Vector:
    """Quaternion wxyz of a rotation matrix, from its largest component (Shepperd 1978).

    Each branch gives the quaternion times four times that component, which is then normalized.
    """
    (a, b, c), (d, e, f), (g, h, i) = rows
    squares = 1.0 + a + e + i, 1.0 + a - e - i, 1.0 - a + e - i, 1.0 - a - e + i
    w, x, y, z = squares
    largest = max(squares)
    if w == largest:
        return _canonical(np.array((w, h - f, c - g, d - b)))
    if x == largest:
        return _canonical(np.array((h - f, x, b + d, c + g)))
    if y == largest:
        return _canonical(np.array((c - g, b + d, y, f + h)))
    return _canonical(np.array((d - b, c + g, f + h, z)))


def _canonical(quaternion: Vector) -> Vector:
    """Normalized quaternion; of the two equivalent ones, that with w ≥ 0."""
    length = math.sqrt(quaternion.dot(quaternion))
    unit: Vector = quaternion / (-length if quaternion[0] < 0.0 else length)
    return unit


def _product(p: Vector, q: Vector) -> Vector:
    """Hamilton product of quaternions wxyz, normalized."""
    a, b, c, d = p.tolist()
    w, x, y, z = q.tolist()
    product = np.array(
        (
            a * w - b * x - c * y - d * z,
            a * x + b * w + c * z - d * y,
            a * y - b * z + c * w + d * x,
            a * z + b * y - c * x + d * w,
        )
    )
    unit: Vector = product / math.sqrt(product.dot(product))
    return unit


def camera_pose(data: mujoco.MjData, camera_id: int) -> Pose:
    """Pose of a camera in the world: x right, y down, z forward (in MuJoCo -z forward, y up)."""
    a, b, c, d, e, f, g, h, i = data.cam_xmat[camera_id].tolist()
    axes = (a, -b, -c), (d, -e, -f), (g, -h, -i)
    return Pose.from_axes(data.cam_xpos[camera_id].copy(), axes)
