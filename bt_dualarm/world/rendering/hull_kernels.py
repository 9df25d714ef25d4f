"""Where rays enter a convex body: each triangle that looks at the eye, in the cells it covers.

With corners a, b, c as seen from the eye, a ray d passes through the triangle if d·(a x b),
d·(b x c) and d·(c x a) have one sign. Neighbours have the same product of their common edge but for
its sign, to the last bit: no ray slips between them. It enters at the inverse distance (n / h)·d,
with the plane's outward normal n and its distance h along n, negative where it looks at the eye.
"""

from __future__ import annotations

import numpy as np

from bt_dualarm.kernels.kernel import kernel
from bt_dualarm.pose import Matrix, Vector
from bt_dualarm.world.rendering.kernel_arrays import Fan, Hits, Shapes
from bt_dualarm.world.rendering.screen_kernels import box_of, project

_TINY = 1e-12


@kernel
def meet_hull(
    shapes: Shapes, index: int, eye: Vector, turn: Matrix, axes: Matrix, fan: Fan, hits: Hits
) -> None:
    """Enter a convex body into the hits where it is nearer than what is there.

    From inside nothing looks at the eye: a body is invisible then, as in OpenGL.

    Args:
        shapes: The shapes.
        index: Which of them.
        eye: Place of the eye in the body's axes, of shape (3,), in m.
        turn: The camera's axes as columns in the body's axes, of shape (3, 3).
        axes: The body's axes as columns in the world, of shape (3, 3).
        fan: The rays.
        hits: What they meet.
    """
    heap = shapes.heaps[index]
    corners = seen(shapes.corners[heap[0] : heap[1]], eye, turn, fan)
    top, bottom, left, right = box_of(fan, corners)
    if top >= bottom or left >= right:
        return
    triangle = np.empty((3, 5))
    for number in range(heap[2], heap[3]):
        normal = shapes.normals[number]
        height = shapes.offsets[number] - (
            normal[0] * eye[0] + normal[1] * eye[1] + normal[2] * eye[2]
        )
        if height > -_TINY:
            continue
        for corner in range(3):
            for value in range(5):
                triangle[corner, value] = corners[shapes.triangles[number, corner] - heap[0], value]
        _meet_triangle(triangle, normal, height, turn, axes, shapes.geoms[index], fan, hits)


@kernel
def seen(corners: Matrix, eye: Vector, turn: Matrix, fan: Fan) -> Matrix:
    """Corners in the camera's axes from the eye, with column and row, of shape (n, 5)."""
    points = np.empty((len(corners), 5))
    for number in range(len(corners)):
        for axis in range(3):
            place = 0.0
            for own in range(3):
                place += (corners[number, own] - eye[own]) * turn[own, axis]
            points[number, axis] = place
    project(fan, points)
    return points


@kernel
def _meet_triangle(
    corners: Matrix, normal: Vector, height: float, turn: Matrix, axes: Matrix,
    geom: int, fan: Fan, hits: Hits,
) -> None:  # fmt: skip
    """Enter a triangle that looks at the eye into the hits."""
    top, bottom, left, right = box_of(fan, corners)
    if top >= bottom or left >= right:
        return
    ax, ay, az = _cross(corners[0], corners[1])
    bx, by, bz = _cross(corners[1], corners[2])
    cx, cy, cz = _cross(corners[2], corners[0])
    ux, uy, uz = _inverse(turn, normal, height)
    for row in range(top, bottom):
        for column in range(left, right):
            x, y, z = fan.rays[0, row, column], fan.rays[1, row, column], fan.rays[2, row, column]
            if ax * x + ay * y + az * z > 0.0:
                continue
            if bx * x + by * y + bz * z > 0.0 or cx * x + cy * y + cz * z > 0.0:
                continue
            inverse = ux * x + uy * y + uz * z
            if inverse > _TINY and 1.0 / inverse < hits.distances[row, column]:
                hits.distances[row, column] = 1.0 / inverse
                hits.geoms[row, column] = geom
                for axis in range(3):
                    hits.normals[axis, row, column] = (
                        axes[axis, 0] * normal[0]
                        + axes[axis, 1] * normal[1]
                        + axes[axis, 2] * normal[2]
                    )


@kernel
def _cross(a: Vector, b: Vector) -> tuple[float, float, float]:
    """The product a x b."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@kernel
def _inverse(turn: Matrix, normal: Vector, height: float) -> tuple[float, float, float]:
    """The normal in the camera's axes, by the plane's distance."""
    return (
        (turn[0, 0] * normal[0] + turn[1, 0] * normal[1] + turn[2, 0] * normal[2]) / height,
        (turn[0, 1] * normal[0] + turn[1, 1] * normal[1] + turn[2, 1] * normal[2]) / height,
        (turn[0, 2] * normal[0] + turn[1, 2] * normal[1] + turn[2, 2] * normal[2]) / height,
    )
