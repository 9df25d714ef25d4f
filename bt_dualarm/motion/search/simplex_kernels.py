"""The point nearest to the origin of a point, a segment, a triangle or a tetrahedron.

After Ericson, Real-Time Collision Detection, 2005, 5.1: by the regions in which the origin can lie.
A simplex is rows of a matrix: up to four corners, and the nearest point in row `POINT`.
"""

from __future__ import annotations

import math
from typing import Final

from bt_dualarm.kernels.kernel import kernel
from bt_dualarm.pose import Matrix

POINT: Final = 4
"""Row of the nearest point."""


@kernel
def nearest(simplex: Matrix, count: int) -> int:
    """Enter the point nearest to the origin, and leave those corners alone that it hangs on.

    Args:
        simplex: Corners, of shape (5 or more, 3); those that are left come first.
        count: Number of corners, 1 to 4.

    Returns:
        How many corners are left; 4 where the origin lies inside.
    """
    if count == 1:
        return _at_corner(simplex, 0)
    if count == 2:
        return _on_segment(simplex, 0, 1)
    if count == 3:
        return _on_triangle(simplex, 0, 1, 2)
    return _on_tetrahedron(simplex)


@kernel
def _product(simplex: Matrix, a: int, b: int, c: int, d: int) -> float:
    """Of the way from row a to row b with that from row c to row d."""
    return float(
        (simplex[b, 0] - simplex[a, 0]) * (simplex[d, 0] - simplex[c, 0])
        + (simplex[b, 1] - simplex[a, 1]) * (simplex[d, 1] - simplex[c, 1])
        + (simplex[b, 2] - simplex[a, 2]) * (simplex[d, 2] - simplex[c, 2])
    )


@kernel
def _dot(simplex: Matrix, a: int, b: int, c: int) -> float:
    """Product of the way from row a to row b with row c."""
    return float(
        (simplex[b, 0] - simplex[a, 0]) * simplex[c, 0]
        + (simplex[b, 1] - simplex[a, 1]) * simplex[c, 1]
        + (simplex[b, 2] - simplex[a, 2]) * simplex[c, 2]
    )


@kernel
def _at_corner(simplex: Matrix, a: int) -> int:
    """As `nearest`, of one corner."""
    for i in range(3):
        simplex[POINT, i] = simplex[0, i] = simplex[a, i]
    return 1


@kernel
def _on_segment(simplex: Matrix, a: int, b: int) -> int:
    """As `nearest`, of two corners."""
    along, square = -_dot(simplex, a, b, a), _product(simplex, a, b, a, b)
    if along <= 0.0 or square == 0.0:
        return _at_corner(simplex, a)
    if along >= square:
        return _at_corner(simplex, b)
    share = along / square
    for i in range(3):
        start, end = simplex[a, i], simplex[b, i]
        simplex[POINT, i] = start + share * (end - start)
        simplex[0, i], simplex[1, i] = start, end
    return 2


@kernel
def _on_triangle(simplex: Matrix, a: int, b: int, c: int) -> int:
    """As `nearest`, of three corners."""
    d1, d2 = -_dot(simplex, a, b, a), -_dot(simplex, a, c, a)
    d3, d4 = -_dot(simplex, a, b, b), -_dot(simplex, a, c, b)
    d5, d6 = -_dot(simplex, a, b, c), -_dot(simplex, a, c, c)
    at_c, at_b, at_a = d1 * d4 - d3 * d2, d5 * d2 - d1 * d6, d3 * d6 - d5 * d4
    if at_a > 0.0 and at_b > 0.0 and at_c > 0.0:
        whole = at_a + at_b + at_c
        for i in range(3):
            p, q, r = simplex[a, i], simplex[b, i], simplex[c, i]
            simplex[POINT, i] = (at_a * p + at_b * q + at_c * r) / whole
            simplex[0, i], simplex[1, i], simplex[2, i] = p, q, r
        return 3
    if d1 <= 0.0 and d2 <= 0.0:
        return _at_corner(simplex, a)
    if d3 >= 0.0 and d4 <= d3:
        return _at_corner(simplex, b)
    if at_c <= 0.0 and d1 >= 0.0 and d3 <= 0.0:
        return _on_segment(simplex, a, b)
    if d6 >= 0.0 and d5 <= d6:
        return _at_corner(simplex, c)
    if at_b <= 0.0 and d2 >= 0.0 and d6 <= 0.0:
        return _on_segment(simplex, a, c)
    return _on_segment(simplex, b, c)


@kernel
def _on_tetrahedron(simplex: Matrix) -> int:
    """As `nearest`, of four corners: by the faces that the origin is outside of."""
    least, face = math.inf, -1
    trial = simplex.copy()
    for across in range(4):
        if not _is_outside(simplex, across):
            continue
        trial[:] = simplex
        _on_triangle(trial, (across + 1) % 4, (across + 2) % 4, (across + 3) % 4)
        square = trial[POINT, 0] ** 2 + trial[POINT, 1] ** 2 + trial[POINT, 2] ** 2
        if square < least:
            least, face = square, across
    if face < 0:
        return 4
    return _on_triangle(simplex, (face + 1) % 4, (face + 2) % 4, (face + 3) % 4)


@kernel
def _is_outside(simplex: Matrix, across: int) -> bool:
    """Whether the origin and a corner are not on one side of the face across."""
    a, b, c = (across + 1) % 4, (across + 2) % 4, (across + 3) % 4
    ux, uy, uz = (
        simplex[b, 0] - simplex[a, 0],
        simplex[b, 1] - simplex[a, 1],
        simplex[b, 2] - simplex[a, 2],
    )
    vx, vy, vz = (
        simplex[c, 0] - simplex[a, 0],
        simplex[c, 1] - simplex[a, 1],
        simplex[c, 2] - simplex[a, 2],
    )
    x, y, z = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
    face = x * simplex[a, 0] + y * simplex[a, 1] + z * simplex[a, 2]
    corner = x * simplex[across, 0] + y * simplex[across, 1] + z * simplex[across, 2]
    return bool(-face * (corner - face) <= 0.0)
