"""How far a point is from a solid, and how far a solid reaches: compiled."""

from __future__ import annotations

import math

import numpy as np

from bt_dualarm.kernels.kernel import kernel
from bt_dualarm.motion.pinching.kernel_forms import BOX, CAPSULE, CONVEX, CYLINDER
from bt_dualarm.pose import Matrix, Vector


@kernel
def reach(kind: int, numbers: Matrix, direction: Vector) -> float:
    """Largest coordinate in m of a solid along a unit direction of shape (3,)."""
    x, y, z = direction[0], direction[1], direction[2]
    if kind == BOX:
        return float(numbers[0, 0] * abs(x) + numbers[0, 1] * abs(y) + numbers[0, 2] * abs(z))
    if kind == CYLINDER:
        return float(numbers[0, 0] * math.hypot(x, y) + numbers[0, 1] * abs(z))
    if kind == CAPSULE:
        return float(numbers[0, 0] + numbers[0, 1] * abs(z))
    farthest = -np.inf
    for row in numbers:
        for i in range(0, 9, 3):
            farthest = max(farthest, row[i] * x + row[i + 1] * y + row[i + 2] * z)
    return float(farthest)


@kernel
def distance(kind: int, numbers: Matrix, x: float, y: float, z: float) -> float:
    """Signed distance in m of a point from a solid, negative inside.

    From outside a convex mesh it is that of the farthest plane, which is never more.
    """
    if kind == BOX:
        a, b, c = abs(x) - numbers[0, 0], abs(y) - numbers[0, 1], abs(z) - numbers[0, 2]
        out = math.sqrt(max(a, 0.0) ** 2 + max(b, 0.0) ** 2 + max(c, 0.0) ** 2)
        return float(out + min(max(a, b, c), 0.0))
    if kind == CYLINDER:
        a, b = math.hypot(x, y) - numbers[0, 0], abs(z) - numbers[0, 1]
        return float(math.sqrt(max(a, 0.0) ** 2 + max(b, 0.0) ** 2) + min(max(a, b), 0.0))
    if kind == CAPSULE:
        along = max(abs(z) - numbers[0, 1], 0.0)
        return math.sqrt(x * x + y * y + along * along) - float(numbers[0, 0])
    if kind == CONVEX:
        beyond = -np.inf
        for row in numbers:
            beyond = max(beyond, row[9] * x + row[10] * y + row[11] * z - row[12])
        return float(beyond)
    return _from_triangles(numbers, np.array((x, y, z)))


@kernel
def distances(kind: int, numbers: Matrix, points: Matrix) -> Vector:
    """Signed distances in m of points of shape (n, 3) from a solid, of shape (n,)."""
    away = np.empty(len(points))
    for i in range(len(points)):
        away[i] = distance(kind, numbers, points[i, 0], points[i, 1], points[i, 2])
    return away


@kernel
def _from_triangles(numbers: Matrix, point: Vector) -> float:
    """Distance to the nearest triangle, negative where the surface winds around the point.

    Winding number by solid angles: Van Oosterom and Strackee, IEEE Trans. Biomed. Eng. 1983.
    """
    nearest, angle = np.inf, 0.0
    to = np.empty((3, 3))
    for row in numbers:
        for i in range(3):
            for k in range(3):
                to[i, k] = row[3 * i + k] - point[k]
        nearest = min(nearest, _from_triangle(to, row[9:12]))
        a, b, c = length(to[0]), length(to[1]), length(to[2])
        volume = dot(to[0], cross(to[1], to[2]))
        level = a * b * c + dot(to[0], to[1]) * c + dot(to[1], to[2]) * a
        angle += 2.0 * math.atan2(volume, level + dot(to[2], to[0]) * b)
    return float(-nearest if angle > 2.0 * math.pi else nearest)


@kernel
def _from_triangle(to: Matrix, normal: Vector) -> float:
    """Distance in m of the origin from a triangle with corners of shape (3, 3)."""
    height = dot(to[0], normal)
    inside, nearest = True, np.inf
    for i in range(3):
        start, edge = to[i], to[(i + 1) % 3] - to[i]
        share = min(max(-dot(start, edge) / dot(edge, edge), 0.0), 1.0)
        nearest = min(nearest, length(start + share * edge))
        inside = inside and dot(cross(edge, height * normal - start), normal) >= 0.0
    return abs(height) if inside else nearest


@kernel
def dot(a: Vector, b: Vector) -> float:
    """Of two vectors of shape (3,)."""
    return float(a[0] * b[0] + a[1] * b[1] + a[2] * b[2])


@kernel
def length(a: Vector) -> float:
    """Of a vector of shape (3,)."""
    return math.sqrt(dot(a, a))


@kernel
def cross(a: Vector, b: Vector) -> Vector:
    """The cross product of two vectors of shape (3,)."""
    return np.array(
        (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])
    )
