"""Where rays enter planes, spheres, cylinders and capsules.

All in the shape's own axes: planes are z = 0 seen from above, the others lie about the origin along
z. ``eye`` and ``ray`` are of shape (3,), rays of length one. From inside a shape is invisible, as
in OpenGL.
"""

from __future__ import annotations

import math

import numpy as np

from bt_dualarm.kernels.kernel import kernel
from bt_dualarm.pose import Matrix, Vector
from bt_dualarm.world.rendering.edge_kernels import crossing, stretch
from bt_dualarm.world.rendering.hiding_kernels import SURELY, is_ahead, is_hidden, nearest
from bt_dualarm.world.rendering.kernel_arrays import (
    CAPSULE,
    CYLINDER,
    PLANE,
    SPHERE,
    Fan,
    Marks,
    Shapes,
)
from bt_dualarm.world.rendering.screen_kernels import box_of, project

_TINY = 1e-12
_ON_THE_CAP_M = 1e-9


@kernel
def meet_round(shapes: Shapes, index: int, axes: Matrix, fan: Fan, marks: Marks) -> None:
    """Mark a shape that is no hull where it is nearer than what is there; as `meet_hull`."""
    kind, size = shapes.kinds[index], shapes.sizes[index]
    eye, turn = marks.eyes[index], marks.turns[index]
    if contains(kind, size, eye):
        return
    if kind == PLANE:
        face = len(shapes.normals) + index
        for axis in range(3):
            marks.normals[face, axis] = axes[axis, 2]
        _meet_plane(size, index, face, fan, marks)
        return
    corners = _corners_about(kind, size, eye, turn, fan)
    top, bottom, left, right = box_of(fan, corners)
    if is_ahead(corners) and is_hidden(
        (top, bottom, left, right), nearest(corners), marks.distances
    ):
        return
    ray = np.empty(3)
    for row in range(top, bottom):
        for column in range(left, right):
            x, y, z = fan.rays[0, row, column], fan.rays[1, row, column], fan.rays[2, row, column]
            for axis in range(3):
                ray[axis] = turn[axis, 0] * x + turn[axis, 1] * y + turn[axis, 2] * z
            distance = enter(kind, size, eye, ray)
            if distance < marks.distances[row, column]:
                marks.distances[row, column] = distance
                marks.faces[row, column] = -2 - index


@kernel
def _meet_plane(size: Vector, index: int, face: int, fan: Fan, marks: Marks) -> None:
    """Mark z = 0 within half the lengths along x and y, where rays go down."""
    eye, turn = marks.eyes[index], marks.turns[index]
    edge = crossing(fan.spacing, fan.centre, turn[2, 0], turn[2, 1], turn[2, 2])
    near = SURELY * eye[2]
    for row in range(fan.rays.shape[1]):
        begin, _, _, end = stretch(0, fan.rays.shape[2], row, edge, edge, edge)
        for column in range(begin, end):
            if marks.distances[row, column] <= near:
                continue
            x, y, z = fan.rays[0, row, column], fan.rays[1, row, column], fan.rays[2, row, column]
            down = turn[2, 0] * x + turn[2, 1] * y + turn[2, 2] * z
            if down >= -_TINY:
                continue
            distance = -eye[2] / down
            if not distance < marks.distances[row, column]:
                continue
            along = turn[0, 0] * x + turn[0, 1] * y + turn[0, 2] * z
            across = turn[1, 0] * x + turn[1, 1] * y + turn[1, 2] * z
            is_within = abs(eye[0] + distance * along) <= size[0]
            if is_within and abs(eye[1] + distance * across) <= size[1]:
                marks.distances[row, column] = distance
                marks.faces[row, column] = face


@kernel
def _corners_about(kind: int, size: Vector, eye: Vector, turn: Matrix, fan: Fan) -> Matrix:
    """Corners of a box about the shape, as of `project`, which they have been through, (8, 5)."""
    length = size[0] if kind == SPHERE else size[1] + (size[0] if kind == CAPSULE else 0.0)
    corners = np.empty((8, 5))
    for number in range(8):
        x = (size[0] if number & 1 else -size[0]) - eye[0]
        y = (size[0] if number & 2 else -size[0]) - eye[1]
        z = (length if number & 4 else -length) - eye[2]
        for axis in range(3):
            corners[number, axis] = x * turn[0, axis] + y * turn[1, axis] + z * turn[2, axis]
    project(fan, corners)
    return corners


@kernel
def contains(kind: int, size: Vector, eye: Vector) -> bool:
    """Whether the eye is inside; for a plane, whether it is below it."""
    x, y, z = float(eye[0]), float(eye[1]), float(eye[2])
    radius, beyond = float(size[0]), abs(z) - float(size[1])
    if kind == PLANE:
        return z <= 0.0
    if kind == SPHERE:
        return x * x + y * y + z * z <= radius**2
    if kind == CYLINDER:
        return x * x + y * y <= radius**2 and beyond <= 0.0
    return x * x + y * y + max(beyond, 0.0) ** 2 <= radius**2


@kernel
def enter(kind: int, size: Vector, eye: Vector, ray: Vector) -> float:
    """Distance of the entry of a ray into what is no plane, inf for a miss."""
    if kind == SPHERE:
        return _enter_ball(size[0], 0.0, eye, ray)
    if kind == CYLINDER:
        return _enter_cylinder(size, eye, ray)
    return min(
        _enter_cylinder(size, eye, ray),
        min(_enter_ball(size[0], size[1], eye, ray), _enter_ball(size[0], -size[1], eye, ray)),
    )


@kernel
def _enter_ball(radius: float, height: float, eye: Vector, ray: Vector) -> float:
    """Distance to a sphere about (0, 0, height)."""
    z = eye[2] - height
    along: float = eye[0] * ray[0] + eye[1] * ray[1] + z * ray[2]
    squared: float = along**2 - (eye[0] * eye[0] + eye[1] * eye[1] + z * z - radius**2)
    return -along - math.sqrt(squared) if squared >= 0.0 and along < 0.0 else math.inf


@kernel
def _enter_cylinder(size: Vector, eye: Vector, ray: Vector) -> float:
    """Distance to the common part of the inside of the wall and what is between the caps."""
    a = max(ray[0] ** 2 + ray[1] ** 2, _TINY)
    b = eye[0] * ray[0] + eye[1] * ray[1]
    squared: float = b**2 - a * (eye[0] ** 2 + eye[1] ** 2 - size[0] ** 2)
    if squared < 0.0:
        return math.inf
    root = math.sqrt(squared)
    climb = _TINY if abs(ray[2]) < _TINY else ray[2]
    middle, half = -eye[2] / climb, abs(size[1] / climb)
    entry: float = max((-b - root) / a, middle - half)
    leave = min((-b + root) / a, middle + half)
    return entry if entry <= leave and entry > 0.0 else math.inf


@kernel
def outward(
    kind: int, radius: float, half: float, x: float, y: float, z: float
) -> tuple[float, float, float]:
    """The outward unit normal of a shape of a radius and a half length at a place on it."""
    if kind == PLANE:
        return 0.0, 0.0, 1.0
    if kind == CYLINDER:
        if abs(z) >= half - _ON_THE_CAP_M:
            return 0.0, 0.0, math.copysign(1.0, z)
        z = 0.0
    elif kind == CAPSULE:
        z -= min(max(z, -half), half)
    return x / radius, y / radius, z / radius
