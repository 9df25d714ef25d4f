"""The declared shape of an object: its outline, its resting orientations and its symmetries."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np

from bt_dualarm.core.pose import Matrix, Pose, Vector
from bt_dualarm.spec.values import ShapeName

_ROUND: Final = 48
"""Points of a circle; their polygon deviates from it by 0.2 % of the radius."""

_AROUND: Final = np.arange(_ROUND) * (2.0 * math.pi / _ROUND)
_COSINES: Final = np.cos(_AROUND)
_SINES: Final = np.sin(_AROUND)

_YAW_STEP: Final = math.radians(15.0)
_AXISYMMETRIC: Final = ("cylinder", "capsule")

_SAME: Final = 1e-6
"""Difference of two edges in m below which they are equal."""

_TILTS: Final = (0.0, 25.0, 50.0)
"""Initial guesses of the tilt of an object that does not lie flat, degrees."""


@dataclass(frozen=True)
class KnownShape:
    """A convex shape, as an object of a tree file declares it.

    Attributes:
        kind: Kind of shape, which determines the meaning of ``size``.
        size: Edges of a box; radius and length of a cylinder, or of a capsule without its caps;
            radius of a sphere; m.
    """

    kind: ShapeName
    size: tuple[float, ...]

    @cached_property
    def points(self) -> Matrix:
        """Points whose convex hull is the shape, (n, 3), in its frame; empty for round shapes."""
        if self.kind == "box":
            signs = np.array(list(itertools.product((-0.5, 0.5), repeat=3)))
            corners: Matrix = signs * np.array(self.size)
            return corners
        if self.is_round:
            return np.zeros((0, 3))
        radius, length = self.size
        around = radius * np.column_stack((_COSINES, _SINES, np.zeros(_ROUND)))
        ends = np.array(((0.0, 0.0, -0.5 * length), (0.0, 0.0, 0.5 * length)))
        circles: Matrix = np.vstack((around, around)) + np.repeat(ends, _ROUND, axis=0)
        return circles

    def seen_from(self, eye: Vector, rotation: Matrix) -> Matrix:
        """Points relative to its center whose projection has the shape's outline, (n, 3), m.

        Args:
            eye: Position of the camera relative to the center, world axes, of shape (3,), m.
            rotation: Rotation of the shape in the world, of shape (3, 3).

        Returns:
            Points in the axes of the world.
        """
        if self.is_round:
            centers = self.ball_centers(rotation)
            rings = [self._ring(eye - center) for center in centers[::_ROUND]]
            return centers + np.vstack(rings)
        turned: Matrix = self.points @ rotation.T
        return turned

    @property
    def is_round(self) -> bool:
        """Whether it is a ball or the hull of two, whose outlines determine its outline."""
        return self.kind in ("sphere", "capsule")

    def ball_centers(self, rotation: Matrix) -> Matrix:
        """Center of the ball for each point of `seen_from`, of shape (n, 3), world axes, m."""
        if self.kind == "sphere":
            return np.zeros((_ROUND, 3))
        end = 0.5 * self.size[1] * rotation[:, 2]
        return np.repeat((end, -end), _ROUND, axis=0)

    def _ring(self, eye: Vector) -> Matrix:
        """Outline circle of a ball relative to its center, seen from ``eye``, (n, 3), m."""
        away = float(np.linalg.norm(eye))
        radius = self.size[0]
        toward = eye / max(away, radius * (1.0 + 1e-9))
        side = _crossed(toward, np.eye(3)[int(np.argmin(np.abs(toward)))])
        side /= np.linalg.norm(side)
        sine = min(radius / away, 1.0 - 1e-9)
        ring = np.outer(_COSINES, side) + np.outer(_SINES, _crossed(toward, side))
        circle: Matrix = radius * (sine * toward + math.sqrt(1.0 - sine * sine) * ring)
        return circle

    @property
    def extent(self) -> float:
        """Distance from its center to its farthest point, m."""
        if self.is_round:
            return self.size[0] + 0.5 * sum(self.size[1:])
        return float(np.linalg.norm(self.points, axis=1).max())

    def guesses(self, *, flat: bool) -> list[Matrix]:
        """Rotations in the world, of shape (3, 3), one of which is close to any possible pose.

        Args:
            flat: Whether it lies flat on a level surface.
        """
        if self.kind == "sphere":
            return [np.eye(3)]
        lying = [_about_z(yaw) @ up for up in self._resting_rotations() for yaw in self._yaws(up)]
        if flat:
            return lying
        toward = [_about_z(math.radians(angle)) for angle in range(0, 360, 45)]
        tilts = [
            turn @ _about_x(math.radians(tilt)) @ turn.T
            for tilt in _TILTS
            for turn in (toward if tilt else toward[:1])
        ]
        return [tilt @ rotation for tilt in tilts for rotation in lying]

    def upward(self, rotation: Matrix) -> Vector:
        """The axis of the shape's frame that is closest to the vertical, of shape (3,)."""
        axis = int(np.argmax(np.abs(rotation[2])))
        up: Vector = np.eye(3)[axis] * np.sign(rotation[2, axis])
        return up

    @property
    def spins(self) -> Vector | None:
        """Axis of rotational symmetry in its frame, of shape (3,), if there is one."""
        return np.array((0.0, 0.0, 1.0)) if self.kind in _AXISYMMETRIC else None

    def canonical(self, pose: Pose) -> Pose:
        """The equivalent pose with the least rotation from the axes of the world."""
        axes = pose.rotation_matrix
        if self.kind == "sphere":
            return Pose(pose.position, np.array((1.0, 0.0, 0.0, 0.0)))
        if self.kind in _AXISYMMETRIC:
            return _pose(pose.position, _least_turn_to(axes[:, 2] * (np.sign(axes[2, 2]) or 1.0)))
        alike = [axes @ turn for turn in self._symmetries]
        return _pose(pose.position, max(alike, key=lambda one: float(np.trace(one))))

    def angle(self, one: Pose, other: Pose) -> float:
        """Angle between two poses in rad, up to the shape's symmetry."""
        if self.kind == "sphere":
            return 0.0
        first = one.rotation_matrix
        second = other.rotation_matrix
        if self.kind in _AXISYMMETRIC:
            return math.acos(min(abs(float(first[:, 2] @ second[:, 2])), 1.0))
        traces = [float(np.trace(first.T @ second @ turn)) for turn in self._symmetries]
        return math.acos(min(max((max(traces) - 1.0) / 2.0, -1.0), 1.0))

    @cached_property
    def _symmetries(self) -> tuple[Matrix, ...]:
        """Rotations of the box into itself."""
        found = []
        for order in itertools.permutations(range(3)):
            if all(abs(self.size[i] - self.size[k]) < _SAME for i, k in enumerate(order)):
                for signs in itertools.product((-1.0, 1.0), repeat=3):
                    turn = np.zeros((3, 3))
                    turn[range(3), order] = signs
                    if np.linalg.det(turn) > 0.0:
                        found.append(turn)
        return tuple(found)

    def _resting_rotations(self) -> list[Matrix]:
        """Rotations in the world, one for each axis of the shape that may be vertical."""
        upright = np.eye(3)
        on_side = _about_x(math.pi / 2)
        on_end = _about_y(math.pi / 2)
        if self.kind in _AXISYMMETRIC:
            return [upright, on_end]
        a, b, c = self.size
        rotations = [upright]
        if abs(b - c) > _SAME:
            rotations.append(on_side)
        if abs(a - c) > _SAME and abs(a - b) > _SAME:
            rotations.append(on_end)
        return rotations

    def _yaws(self, up: Matrix) -> list[float]:
        """Distinguishable rotations about the vertical, in steps, rad."""
        if self.kind in _AXISYMMETRIC:
            whole = 0.0 if abs(up[2, 2]) > 0.5 else math.pi
        else:
            level = np.delete(np.array(self.size), int(np.argmax(np.abs(up[2]))))
            whole = math.pi / 2 if abs(level[0] - level[1]) < _SAME else math.pi
        return [step * _YAW_STEP for step in range(max(round(whole / _YAW_STEP), 1))]


def _pose(position: Vector, axes: Matrix) -> Pose:
    matrix = np.eye(4)
    matrix[:3, :3] = axes
    matrix[:3, 3] = position
    return Pose.from_matrix(matrix)


def _least_turn_to(z: Vector) -> Matrix:
    """The least rotation that maps the world's z axis to ``z``, which must not point down."""
    x, y, up = z.tolist()
    share = 1.0 / (1.0 + up)
    return np.array(
        (
            (1.0 - share * x * x, -share * x * y, x),
            (-share * x * y, 1.0 - share * y * y, y),
            (-x, -y, up),
        )
    )


def _about_x(angle: float) -> Matrix:
    c = math.cos(angle)
    s = math.sin(angle)
    return np.array(((1.0, 0.0, 0.0), (0.0, c, -s), (0.0, s, c)))


def _about_y(angle: float) -> Matrix:
    c = math.cos(angle)
    s = math.sin(angle)
    return np.array(((c, 0.0, s), (0.0, 1.0, 0.0), (-s, 0.0, c)))


def _about_z(angle: float) -> Matrix:
    c = math.cos(angle)
    s = math.sin(angle)
    return np.array(((c, -s, 0.0), (s, c, 0.0), (0.0, 0.0, 1.0)))


def _crossed(one: Vector, other: Vector) -> Vector:
    """Cross product of two vectors; `numpy.cross` takes twenty times as long."""
    (a, b, c) = one.tolist()
    (x, y, z) = other.tolist()
    return np.array((b * z - c * y, c * x - a * z, a * y - b * x))
