"""Shapes that cameras know: outline, resting orientations and symmetry of a declared object."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass
from functools import cache, cached_property
from typing import Final, Literal

import numpy as np

from bt_dualarm.core.pose import Matrix, Pose, Vector
from bt_dualarm.sim.object_body import Folds, body_of, half_extents
from bt_dualarm.spec.document import ObjectSpec
from bt_dualarm.spec.shapes import DEFAULT_SIDES
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
    """The convex hull of a shape, as an object of a tree file declares it.

    Attributes:
        kind: Kind of shape, which determines the meaning of ``size``; ``hull`` for any other than
            those of `ShapeName`.
        size: Edges of a box; radius and length of a cylinder, or of a capsule without its caps;
            radius of a sphere; distance of the farthest corner of a hull; m.
        hull: Corners of a hull relative to its center, for a farthest distance of 1.
        fold: Number of rotations about the z axis, in a whole turn, of a hull into itself; 0 for
            any rotation.
        flips: Whether half a turn about the x axis brings a hull into itself.
        one_way: Whether such a turn changes the object nevertheless: the opening of a cup does not
            show in its outline. Among poses that look alike, the one with the smallest rotation is
            assumed.
        concave: Whether the outline may be concave, of which only the convex hull is known.
        hull_folds: Symmetry of the hull of a concave shape.
        folds: Symmetry of the object itself, whose outline may have more.
        center: Position of the shape's center in the frame of the object, m: compounds and meshes
            may have that frame anywhere. The shape's frame has the same axes.
    """

    kind: ShapeName | Literal["hull"]
    size: tuple[float, ...]
    hull: tuple[tuple[float, float, float], ...] = ()
    fold: int = 1
    flips: bool = False
    one_way: bool = False
    concave: bool = False
    hull_folds: Folds = (1, 1, 1)
    folds: Folds = (1, 1, 1)
    center: tuple[float, float, float] = (0.0, 0.0, 0.0)

    @classmethod
    def of(cls, obj: ObjectSpec) -> KnownShape:
        """Shape of a declared object."""
        if obj.shape in ("box", "cylinder", "capsule", "sphere"):
            return cls(obj.shape, obj.size)
        body = body_of(obj)
        x, y, z = body.middle.tolist()
        center = (x, y, z)
        corners = body.corners - body.middle
        far = float(np.linalg.norm(corners, axis=1).max())
        unit = tuple((x, y, z) for x, y, z in (corners / far).tolist())
        if obj.shape in ("compound", "mesh"):
            hull = body.hull_folds
            own = body.folds
            if body.is_coaxial:
                flips = hull[0] % 2 == 0
                one_way = flips and own[0] % 2 > 0
                return cls("hull", (far,), unit, 0, flips, one_way, concave=True, center=center)
            return cls(
                "hull", (far,), unit, concave=True, hull_folds=hull, folds=own, center=center
            )
        return cls("hull", (far,), unit, *_symmetry(obj))

    @cached_property
    def points(self) -> Matrix:
        """Points whose convex hull is the shape, (n, 3), from its center; of round ones none."""
        if self.kind == "hull":
            scaled: Matrix = self.size[0] * np.array(self.hull)
            return scaled
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
        return np.array((0.0, 0.0, 1.0)) if self._is_axisymmetric else None

    @property
    def _is_axisymmetric(self) -> bool:
        return self.kind in _AXISYMMETRIC or self.fold == 0

    def half_height(self, rotation: Matrix) -> float:
        """Height of its center above its lowest point, m.

        Args:
            rotation: Rotation of the shape in the world, of shape (3, 3).
        """
        if self.kind == "hull":
            return -float((self.points @ rotation[2]).min())
        return float(half_extents(self.kind, self.size, rotation)[2])

    def canonical(self, pose: Pose) -> Pose:
        """The pose of the object that looks alike and has the smallest rotation in the world."""
        if self.kind == "sphere":
            return Pose(pose.position, np.array((1.0, 0.0, 0.0, 0.0)))
        axes = pose.rotation_matrix
        if self._is_axisymmetric:
            looks_alike = self.kind != "hull" or self.flips
            up = axes[:, 2] * (np.sign(axes[2, 2]) or 1.0) if looks_alike else axes[:, 2]
            smallest = _least_turn_to(up)
        else:
            alike = [axes @ turn for turn in self._symmetries]
            smallest = max(alike, key=lambda one: float(np.trace(one)))
        return Pose.from_axes(self._turned_about_center(pose, smallest), smallest.tolist())

    def nearest(self, pose: Pose, goal: Pose) -> Pose:
        """Of the poses in which the object is as in one, that with the smallest angle to a goal.

        Its frame moves with it if that is not at the center.
        """
        axes = pose.rotation_matrix
        wanted = goal.rotation_matrix
        turned = axes @ max(self._own_turns, key=lambda turn: self._cosine(wanted, axes, turn))
        return Pose.from_axes(self._turned_about_center(pose, turned), turned.tolist())

    def away(self, pose: Pose, goal: Pose) -> tuple[float, float]:
        """Distance, m, and angle, rad, of the `nearest` pose from a goal."""
        return self.nearest(pose, goal).distance(goal), self.angle(pose, goal)

    def angle(self, one: Pose, other: Pose) -> float:
        """Angle between two poses in rad, up to the symmetry of the object."""
        if self.kind == "sphere":
            return 0.0
        first = one.rotation_matrix
        second = other.rotation_matrix
        cosine = max(self._cosine(first, second, turn) for turn in self._own_turns)
        return math.acos(min(max(cosine, -1.0), 1.0))

    def tilt(self, pose: Pose) -> float:
        """Angle of the object's z axis from the vertical, rad, up to its symmetry.

        A box that is turned upside down is not tilted, and a ball never is.
        """
        if self.kind == "sphere":
            return 0.0
        up = pose.rotation_matrix[2]
        cosine = max(float(up @ turn[:, 2]) for turn in self._own_turns)
        return math.acos(min(max(cosine, -1.0), 1.0))

    def _turned_about_center(self, pose: Pose, axes: Matrix) -> Vector:
        """Position of the object's frame, of shape (3,), m, after a rotation about its center."""
        if not any(self.center):
            return pose.position
        moved: Vector = pose.position + (pose.rotation_matrix - axes) @ np.array(self.center)
        return moved

    def _cosine(self, first: Matrix, second: Matrix, turn: Matrix) -> float:
        """Cosine of the angle of rotations, the second one after a turn; of what spins, of axes."""
        if self._is_axisymmetric:
            return float(first[:, 2] @ second[:, 2]) * float(turn[2, 2])
        return (float(np.trace(first.T @ second @ turn)) - 1.0) / 2.0

    @cached_property
    def _own_turns(self) -> tuple[Matrix, ...]:
        """Rotations of the object into itself; not those about its axis if any is."""
        if self.kind == "sphere":
            return (np.eye(3),)
        if self._is_axisymmetric:
            is_reversible = self.kind != "hull" or (self.flips and not self.one_way)
            over = np.diag((1.0, -1.0, -1.0))
            return (np.eye(3), over) if is_reversible else (np.eye(3),)
        turns = _group(self.folds) if self.concave else self._symmetries
        # Of the symmetries of its outline, half turns are none of the object if it has an opening.
        return turns[: self.fold] if self.one_way else turns

    @cached_property
    def _symmetries(self) -> tuple[Matrix, ...]:
        """Rotations of a box, or of a hull that is not a body of revolution, into itself."""
        if self.concave:
            return _group(self.hull_folds)
        if self.kind == "hull":
            about = [_about_z(2.0 * math.pi * k / self.fold) for k in range(self.fold)]
            over = [turn @ _about_x(math.pi) for turn in about] if self.flips else []
            return (*about, *over)  # in this order, see `_own_turns`
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
        if self.kind == "hull":
            over = _about_x(math.pi)
            ups = [upright, on_end] if self._is_axisymmetric else [upright, on_side, on_end]
            return ups if self.flips else [*ups, *(over @ up for up in ups)]
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
        if self.kind == "hull":
            upright = abs(up[2, 2]) > 0.5
            whole = 2.0 * math.pi / (self.fold or math.inf) if upright else 2.0 * math.pi
        elif self.kind in _AXISYMMETRIC:
            whole = 0.0 if abs(up[2, 2]) > 0.5 else math.pi
        else:
            level = np.delete(np.array(self.size), int(np.argmax(np.abs(up[2]))))
            whole = math.pi / 2 if abs(level[0] - level[1]) < _SAME else math.pi
        return [step * _YAW_STEP for step in range(max(round(whole / _YAW_STEP), 1))]


@cache
def _group(folds: Folds) -> tuple[Matrix, ...]:
    """All rotations that follow from those about the three axes, the identity first."""
    about = (_about_x, _about_y, _about_z)
    steps = [
        turn(2.0 * math.pi / fold) for turn, fold in zip(about, folds, strict=True) if fold > 1
    ]
    found = [np.eye(3)]
    for one in found:  # which grows meanwhile
        for step in steps:
            turn = one @ step
            whole = np.round(turn)
            turn = np.where(np.abs(turn - whole) < _ROUNDING, whole, turn)
            if np.abs(np.array(found) - turn).max(axis=(1, 2)).min() > _SAME_TURN:
                found.append(turn)
    return tuple(found)


_ROUNDING: Final = 1e-12
_SAME_TURN: Final = 1e-6


def _symmetry(obj: ObjectSpec) -> tuple[int, bool, bool]:
    """`KnownShape.fold`, `flips` and `one_way` of a declared object."""
    if body_of(obj).is_axisymmetric:
        return 0, obj.shape in ("tube", "cup"), obj.shape == "cup"
    if obj.shape == "prism":
        return obj.sides or DEFAULT_SIDES, True, False
    is_square = abs(obj.size[0] - obj.size[1]) < _SAME
    if obj.shape == "ellipsoid":
        return (0 if is_square else 2), True, False
    if obj.shape == "shelf":
        return 1, False, False
    return (4 if is_square else 2), True, True  # a bin, tray or table


def _least_turn_to(z: Vector) -> Matrix:
    """The smallest rotation that maps the world's z axis to ``z``."""
    x, y, up = z.tolist()
    if up < -1.0 + 1e-9:  # every axis across it is as near
        return _about_x(math.pi)
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
