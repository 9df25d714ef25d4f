"""Where rays enter a convex body: each triangle that looks at the eye, in the cells it covers.

With corners a, b, c as seen from the eye, a ray d passes through the triangle if d·(a x b),
d·(b x c) and d·(c x a) have one sign. Neighbours have the same product of their common edge but for
its sign, to the last bit: no ray slips between them. It enters at the inverse distance (n / h)·d,
with the plane's outward normal n and its distance h along n, negative where it looks at the eye.
"""

from __future__ import annotations

from typing import TypeAlias

import numpy as np
import numpy.typing as npt

from bt_dualarm.kernels.kernel import kernel
from bt_dualarm.pose import Matrix, Vector
from bt_dualarm.world.rendering.edge_kernels import crossing, stretch
from bt_dualarm.world.rendering.hiding_kernels import SURELY, is_ahead, is_hidden, nearest
from bt_dualarm.world.rendering.kernel_arrays import Fan, Marks, Shapes
from bt_dualarm.world.rendering.screen_kernels import box_of, cells, project

_TINY = 1e-12

_Three: TypeAlias = tuple[float, float, float]


@kernel
def meet_hull(shapes: Shapes, index: int, axes: Matrix, fan: Fan, marks: Marks) -> None:
    """Mark a convex body where it is nearer than what is there.

    From inside nothing looks at the eye: a body is invisible then, as in OpenGL.

    Args:
        shapes: The shapes.
        index: Which of them.
        axes: The body's axes as columns in the world, of shape (3, 3).
        fan: The rays.
        marks: What they meet; the eye's place in the body's axes and their turn are entered.
    """
    heap, eye, turn = shapes.heaps[index], marks.eyes[index], marks.turns[index]
    corners = seen(shapes.corners[heap[0] : heap[1]], eye, turn, fan)
    top, bottom, left, right = box_of(fan, corners)
    if top >= bottom or left >= right:
        return
    ahead, rows, columns = is_ahead(corners), fan.rays.shape[1], fan.rays.shape[2]
    if ahead and is_hidden((top, bottom, left, right), nearest(corners), marks.distances):
        return
    for number in range(heap[2], heap[3]):
        normal = shapes.normals[number]
        height = shapes.offsets[number] - (
            normal[0] * eye[0] + normal[1] * eye[1] + normal[2] * eye[2]
        )
        if height > -_TINY:
            continue
        a, b, c = (
            corners[shapes.triangles[number, 0] - heap[0]],
            corners[shapes.triangles[number, 1] - heap[0]],
            corners[shapes.triangles[number, 2] - heap[0]],
        )
        box = _box(a, b, c, rows, columns) if ahead else box_of(fan, _together(a, b, c))
        if box[0] >= box[1] or box[2] >= box[3]:
            continue
        near = -SURELY * max(a[2], b[2], c[2]) if ahead else 0.0
        for axis in range(3):
            marks.normals[number, axis] = (
                axes[axis, 0] * normal[0] + axes[axis, 1] * normal[1] + axes[axis, 2] * normal[2]
            )
        _mark(
            number, box, near, (_cross(a, b), _cross(b, c), _cross(c, a)),
            _inverse(turn, normal, height), fan.rays, fan.spacing, fan.centre,
            marks.faces, marks.distances,
        )  # fmt: skip


@kernel
def _box(a: Vector, b: Vector, c: Vector, rows: int, columns: int) -> tuple[int, int, int, int]:
    """Rows from and to, columns from and to, that can meet a triangle that is ahead."""
    top, bottom = cells(min(a[4], b[4], c[4]), max(a[4], b[4], c[4]), rows)
    left, right = cells(min(a[3], b[3], c[3]), max(a[3], b[3], c[3]), columns)
    return top, bottom, left, right


@kernel
def _together(a: Vector, b: Vector, c: Vector) -> Matrix:
    """Three corners as `box_of` takes them."""
    corners = np.empty((3, 5))
    corners[0], corners[1], corners[2] = a, b, c
    return corners


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
def _mark(
    number: int, box: tuple[int, int, int, int], near: float,
    sides: tuple[_Three, _Three, _Three], plane: _Three,
    rays: npt.NDArray[np.float64], spacing: float, centre: tuple[float, float],
    faces: npt.NDArray[np.int32], distances: Matrix,
) -> None:  # fmt: skip
    """Mark a triangle within a box: rays on the inner side of its three sides.

    None of it is nearer than `near`: what rays have met nearer than that stays.
    """
    (ax, ay, az), (bx, by, bz), (cx, cy, cz) = sides
    ux, uy, uz = plane
    top, bottom, left, right = box
    first = crossing(spacing, centre, ax, ay, az)
    second = crossing(spacing, centre, bx, by, bz)
    third = crossing(spacing, centre, cx, cy, cz)
    for row in range(top, bottom):
        begin, sure, unsure, end = stretch(left, right, row, first, second, third)
        for column in range(begin, end):
            if distances[row, column] <= near:
                continue
            x, y, z = rays[0, row, column], rays[1, row, column], rays[2, row, column]
            if column < sure or column >= unsure:
                if ax * x + ay * y + az * z > 0.0:
                    continue
                if bx * x + by * y + bz * z > 0.0 or cx * x + cy * y + cz * z > 0.0:
                    continue
            inverse = ux * x + uy * y + uz * z
            if inverse > _TINY and 1.0 / inverse < distances[row, column]:
                distances[row, column] = 1.0 / inverse
                faces[row, column] = number


@kernel
def _cross(a: Vector, b: Vector) -> _Three:
    """The product a x b."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@kernel
def _inverse(turn: Matrix, normal: Vector, height: float) -> _Three:
    """The normal in the camera's axes, by the plane's distance."""
    return (
        (turn[0, 0] * normal[0] + turn[1, 0] * normal[1] + turn[2, 0] * normal[2]) / height,
        (turn[0, 1] * normal[0] + turn[1, 1] * normal[1] + turn[2, 1] * normal[2]) / height,
        (turn[0, 2] * normal[0] + turn[1, 2] * normal[1] + turn[2, 2] * normal[2]) / height,
    )
