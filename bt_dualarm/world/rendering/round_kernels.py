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
from bt_dualarm.world.rendering.kernel_arrays import (
    CAPSULE,
    CYLINDER,
    PLANE,
    SPHERE,
    Fan,
    Hits,
    Shapes,
)
from bt_dualarm.world.rendering.screen_kernels import box_of, project

_TINY = 1e-12
_ON_THE_CAP_M = 1e-9


@kernel
def meet_round(
    shapes: Shapes, index: int, eye: Vector, turn: Matrix, axes: Matrix, fan: Fan, hits: Hits
) -> None:
    """Enter a shape into the hits where it is nearer than what is there; as `meet_hull`."""
    kind, size = shapes.kinds[index], shapes.sizes[index]
    top, bottom, left, right = _covered(kind, size, eye, turn, fan)
    if contains(kind, size, eye):
        return
    ray, normal = np.empty(3), np.empty(3)
    for row in range(top, bottom):
        for column in range(left, right):
            x, y, z = fan.rays[0, row, column], fan.rays[1, row, column], fan.rays[2, row, column]
            for axis in range(3):
                ray[axis] = turn[axis, 0] * x + turn[axis, 1] * y + turn[axis, 2] * z
            distance = enter(kind, size, eye, ray)
            if distance < hits.distances[row, column]:
                hits.distances[row, column] = distance
                hits.geoms[row, column] = shapes.geoms[index]
                outward(kind, size, eye, ray, distance, normal)
                x, y, z = normal[0], normal[1], normal[2]
                for axis in range(3):
                    hits.normals[axis, row, column] = (
                        axes[axis, 0] * x + axes[axis, 1] * y + axes[axis, 2] * z
                    )


@kernel
def _covered(
    kind: int, size: Vector, eye: Vector, turn: Matrix, fan: Fan
) -> tuple[int, int, int, int]:
    """Rows from and to, columns from and to, in which the shape can be seen."""
    if kind == PLANE:
        return 0, fan.rays.shape[1], 0, fan.rays.shape[2]
    length = size[0] if kind == SPHERE else size[1] + (size[0] if kind == CAPSULE else 0.0)
    corners = np.empty((8, 5))
    for number in range(8):
        x = (size[0] if number & 1 else -size[0]) - eye[0]
        y = (size[0] if number & 2 else -size[0]) - eye[1]
        z = (length if number & 4 else -length) - eye[2]
        for axis in range(3):
            corners[number, axis] = x * turn[0, axis] + y * turn[1, axis] + z * turn[2, axis]
    project(fan, corners)
    return box_of(fan, corners)


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
    """Distance of the entry of a ray, inf for a miss."""
    if kind == PLANE:
        return _enter_plane(size, eye, ray)
    if kind == SPHERE:
        return _enter_ball(size[0], 0.0, eye, ray)
    if kind == CYLINDER:
        return _enter_cylinder(size, eye, ray)
    return min(
        _enter_cylinder(size, eye, ray),
        min(_enter_ball(size[0], size[1], eye, ray), _enter_ball(size[0], -size[1], eye, ray)),
    )


@kernel
def _enter_plane(size: Vector, eye: Vector, ray: Vector) -> float:
    """Distance to z = 0 within half the lengths along x and y."""
    if ray[2] >= -_TINY:
        return math.inf
    distance: float = -eye[2] / ray[2]
    inside = (
        abs(eye[0] + distance * ray[0]) <= size[0] and abs(eye[1] + distance * ray[1]) <= size[1]
    )
    return distance if inside else math.inf


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
    kind: int, size: Vector, eye: Vector, ray: Vector, distance: float, normal: Vector
) -> None:
    """The outward unit normal where a ray enters, into ``normal`` of shape (3,)."""
    if kind == PLANE:
        normal[0], normal[1], normal[2] = 0.0, 0.0, 1.0
        return
    x, y, z = eye[0] + distance * ray[0], eye[1] + distance * ray[1], eye[2] + distance * ray[2]
    if kind == CYLINDER:
        if abs(z) >= size[1] - _ON_THE_CAP_M:
            normal[0], normal[1], normal[2] = 0.0, 0.0, math.copysign(1.0, z)
            return
        z = 0.0
    elif kind == CAPSULE:
        z -= min(max(z, -size[1]), size[1])
    normal[0], normal[1], normal[2] = x / size[0], y / size[0], z / size[0]
