"""Kernels of distances: between two convex shapes (GJK), and between bounding spheres.

`distance` is the algorithm of E. G. Gilbert, D. W. Johnson, S. S. Keerthi, A fast procedure for
computing the distance between complex objects in three-dimensional space, IEEE J. Robotics and
Automation 4(2), 1988. The nearest point of a simplex follows C. Ericson, Real-Time Collision
Detection, 2005, section 5.1: by the Voronoi region that contains the origin. A simplex is stored as
rows of a matrix: up to four corners, and the nearest point in row `POINT`.

The bounding spheres of an arm give bounds of its distances and its motion at little cost.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from bt_dualarm.collision.kernel_arrays import Frames, Numbers
from bt_dualarm.core.kernel import kernel
from bt_dualarm.core.pose import Matrix, Vector

SCRATCH: Final = (8, 3)
"""Shape of the scratch array of `distance`: simplex, nearest point, and a support point."""

POINT: Final = 4
"""Row of the nearest point."""

_CORNER: Final = 5
"""Row of the second shape's support point."""

_ROUNDS: Final = 40
_EXACT: Final = 1e-4
"""Relative accuracy of a distance."""

_TINY: Final = 1e-9
"""Distance up to which shapes count as in contact, m."""


@kernel
def distance(
    corners: Matrix,
    ranges: Numbers,
    frames: Frames,
    first: int,
    second: int,
    enough: float,
    least: float,
    hints: Matrix,
    pair: int,
    scratch: Matrix,
) -> float:
    """Lower bound of the distance between the hulls of two shapes, m; negative: in contact.

    Args:
        corners: Corners of all shapes, as in `ConvexShapes`.
        ranges: Corners of each shape, as in `ConvexShapes`.
        frames: Motion of everything that the first 0, 1, ... joints move, from the reference.
        first: Index of a shape.
        second: Index of the other shape.
        enough: Distance above which the exact value does not matter, m.
        least: Distance below which the exact value does not matter, m.
        hints: Initial directions from the second to the first, of shape (p, 3); updated.
        pair: Row of `hints` for this pair.
        scratch: Scratch array of shape `SCRATCH`.
    """
    # For any direction, the gap between the supporting planes is a lower bound of the distance.
    # Only these bounds are returned: errors of the iteration make distances smaller, never larger.
    x = hints[pair, 0]
    y = hints[pair, 1]
    z = hints[pair, 2]
    lower = float(-math.inf)
    count = 0
    for _ in range(_ROUNDS):
        length = max(math.sqrt(x * x + y * y + z * z), _TINY)
        # A pair moves little between two configurations: its last direction separates it at once.
        hints[pair, 0] = x
        hints[pair, 1] = y
        hints[pair, 2] = z
        # Support point of the Minkowski difference, opposite to the direction of the nearest point.
        write_support_point(corners, ranges, frames, first, -x, -y, -z, scratch, count)
        write_support_point(corners, ranges, frames, second, x, y, z, scratch, _CORNER)
        for i in range(3):
            scratch[count, i] -= scratch[_CORNER, i]
        gap = (x * scratch[count, 0] + y * scratch[count, 1] + z * scratch[count, 2]) / length
        lower = max(lower, gap)
        # In the first round the length is that of the hint, not an upper bound of the distance.
        if lower >= enough or (count > 0 and length - gap <= _EXACT * length):
            break
        count = nearest(scratch, count + 1)
        x = scratch[POINT, 0]
        y = scratch[POINT, 1]
        z = scratch[POINT, 2]
        # Nearest point of the simplex: an upper bound, so that a value below `least` is final.
        if count == 4 or math.sqrt(x * x + y * y + z * z) < max(least, _TINY):
            return float(lower - _TINY)
    return float(lower)


@kernel
def write_support_point(
    corners: Matrix,
    ranges: Numbers,
    frames: Frames,
    shape: int,
    x: float,
    y: float,
    z: float,
    scratch: Matrix,
    row: int,
) -> None:
    """Write the corner of a shape that is farthest in the direction (x, y, z) into a row."""
    f = ranges[shape, 2]
    # The direction is rotated back into the reference configuration once, instead of each corner
    # into the current one.
    u = x * frames[f, 0, 0] + y * frames[f, 1, 0] + z * frames[f, 2, 0]
    v = x * frames[f, 0, 1] + y * frames[f, 1, 1] + z * frames[f, 2, 1]
    w = x * frames[f, 0, 2] + y * frames[f, 1, 2] + z * frames[f, 2, 2]
    best = -math.inf
    found = ranges[shape, 0]
    for k in range(ranges[shape, 0], ranges[shape, 1]):
        reach = u * corners[k, 0] + v * corners[k, 1] + w * corners[k, 2]
        if reach > best:
            best = reach
            found = k
    for i in range(3):
        scratch[row, i] = (
            frames[f, i, 0] * corners[found, 0]
            + frames[f, i, 1] * corners[found, 1]
            + frames[f, i, 2] * corners[found, 2]
            + frames[f, i, 3]
        )


@kernel
def nearest(simplex: Matrix, count: int) -> int:
    """Write the point nearest to the origin, and keep only the corners that span it.

    Args:
        simplex: Corners, of shape (5 or more, 3); the remaining ones are moved to the front.
        count: Number of corners, 1 to 4.

    Returns:
        Number of corners that remain; 4 if the origin is inside.
    """
    if count == 1:
        return _at_corner(simplex, 0)
    if count == 2:
        return _on_segment(simplex, 0, 1)
    if count == 3:
        return _on_triangle(simplex, 0, 1, 2)
    return _on_tetrahedron(simplex)


@kernel
def _at_corner(simplex: Matrix, a: int) -> int:
    """`nearest` for one corner."""
    for i in range(3):
        simplex[POINT, i] = simplex[0, i] = simplex[a, i]
    return 1


@kernel
def _on_segment(simplex: Matrix, a: int, b: int) -> int:
    """`nearest` for two corners."""
    along = -_dot(simplex, a, b, a)
    square = _product(simplex, a, b, a, b)
    if along <= 0.0 or square == 0.0:
        return _at_corner(simplex, a)
    if along >= square:
        return _at_corner(simplex, b)
    share = along / square
    # Both rows are read before either is written: b may be row 0 on a face of a tetrahedron.
    for i in range(3):
        start = simplex[a, i]
        end = simplex[b, i]
        simplex[POINT, i] = start + share * (end - start)
        simplex[0, i] = start
        simplex[1, i] = end
    return 2


@kernel
def _on_triangle(simplex: Matrix, a: int, b: int, c: int) -> int:
    """`nearest` for three corners."""
    # d1 ... d6 as in Ericson 5.1.5, with the origin as the query point.
    d1 = -_dot(simplex, a, b, a)
    d2 = -_dot(simplex, a, c, a)
    d3 = -_dot(simplex, a, b, b)
    d4 = -_dot(simplex, a, c, b)
    d5 = -_dot(simplex, a, b, c)
    d6 = -_dot(simplex, a, c, c)
    # Barycentric coordinates of the origin's projection, times the square of |ab x ac|.
    at_c = d1 * d4 - d3 * d2
    at_b = d5 * d2 - d1 * d6
    at_a = d3 * d6 - d5 * d4
    if at_a > 0.0 and at_b > 0.0 and at_c > 0.0:
        whole = at_a + at_b + at_c
        for i in range(3):
            p = simplex[a, i]
            q = simplex[b, i]
            r = simplex[c, i]
            simplex[POINT, i] = (at_a * p + at_b * q + at_c * r) / whole
            simplex[0, i] = p
            simplex[1, i] = q
            simplex[2, i] = r
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
    """`nearest` for four corners: the nearest of the faces that the origin is outside of."""
    least = math.inf
    face = -1
    trial = simplex.copy()
    for across in range(4):
        if not _is_outside(simplex, across):
            continue
        trial[:] = simplex  # the triangle's solution overwrites its corners
        _on_triangle(trial, (across + 1) % 4, (across + 2) % 4, (across + 3) % 4)
        square = trial[POINT, 0] ** 2 + trial[POINT, 1] ** 2 + trial[POINT, 2] ** 2
        if square < least:
            least = square
            face = across
    if face < 0:
        return 4
    return _on_triangle(simplex, (face + 1) % 4, (face + 2) % 4, (face + 3) % 4)


@kernel
def _is_outside(simplex: Matrix, across: int) -> bool:
    """Whether the origin is not on the same side of a face as the opposite corner."""
    a = (across + 1) % 4
    b = (across + 2) % 4
    c = (across + 3) % 4
    ux = simplex[b, 0] - simplex[a, 0]
    uy = simplex[b, 1] - simplex[a, 1]
    uz = simplex[b, 2] - simplex[a, 2]
    vx = simplex[c, 0] - simplex[a, 0]
    vy = simplex[c, 1] - simplex[a, 1]
    vz = simplex[c, 2] - simplex[a, 2]
    x = uy * vz - uz * vy
    y = uz * vx - ux * vz
    z = ux * vy - uy * vx
    # Heights along the normal; the sign of the normal cancels in the product. A flat tetrahedron
    # has product zero, and counts as outside of all its faces.
    face = x * simplex[a, 0] + y * simplex[a, 1] + z * simplex[a, 2]
    corner = x * simplex[across, 0] + y * simplex[across, 1] + z * simplex[across, 2]
    return bool(-face * (corner - face) <= 0.0)


@kernel
def _product(simplex: Matrix, a: int, b: int, c: int, d: int) -> float:
    """Dot product of the vectors from row a to row b and from row c to row d."""
    return float(
        (simplex[b, 0] - simplex[a, 0]) * (simplex[d, 0] - simplex[c, 0])
        + (simplex[b, 1] - simplex[a, 1]) * (simplex[d, 1] - simplex[c, 1])
        + (simplex[b, 2] - simplex[a, 2]) * (simplex[d, 2] - simplex[c, 2])
    )


@kernel
def _dot(simplex: Matrix, a: int, b: int, c: int) -> float:
    """Dot product of the vector from row a to row b with row c."""
    return float(
        (simplex[b, 0] - simplex[a, 0]) * simplex[c, 0]
        + (simplex[b, 1] - simplex[a, 1]) * simplex[c, 1]
        + (simplex[b, 2] - simplex[a, 2]) * simplex[c, 2]
    )


_GROUP: Final = 8
"""Number of consecutive spheres with a common bounding ball in `sphere_distance`."""

_ROUNDING: Final = 1e-9
"""Added to the radius of a bounding ball, m: rounding errors never make it too small."""


@kernel
def place(
    local: Matrix, geoms: Numbers, positions: Matrix, frames: Matrix, spheres: Matrix
) -> None:
    """Write the spheres in world coordinates.

    Args:
        local: Centers in the frames of their geoms, and radii, of shape (n, 4), m.
        geoms: Index of each sphere's geom, of shape (n,).
        positions: Positions of all geoms, of shape (ngeom, 3), m.
        frames: Rotation matrices of all geoms, row by row, of shape (ngeom, 9).
        spheres: Output: centers and radii in the world, of shape (n, 4), m.
    """
    for i in range(len(local)):
        geom = geoms[i]
        for row in range(3):
            total = positions[geom, row]
            for column in range(3):
                total += frames[geom, 3 * row + column] * local[i, column]
            spheres[i, row] = total
        spheres[i, 3] = local[i, 3]


@kernel
def lever(
    spheres: Matrix, joints: Numbers, anchors: Matrix, axes: Matrix, moved: Matrix, levers: Matrix
) -> None:
    """Write the largest distance of any point of each sphere from each joint's axis.

    Args:
        spheres: Centers and radii, of shape (n, 4), m.
        joints: Index of each joint, of shape (dof,).
        anchors: Points on the axes of all joints, of shape (njnt, 3), m.
        axes: Directions of the axes of all joints, of shape (njnt, 3).
        moved: Whether a joint moves a sphere, 1 or 0, of shape (n, dof).
        levers: Output: the distances, of shape (n, dof), m; zero if the joint does not move it.
    """
    for i in range(len(spheres)):
        for j in range(len(joints)):
            square = 0.0
            along = 0.0
            for k in range(3):
                arm = spheres[i, k] - anchors[joints[j], k]
                square += arm * arm
                along += arm * axes[joints[j], k]
            # Pythagoras; rounding may make the difference negative for a center on the axis.
            away = math.sqrt(max(square - along * along, 0.0)) + spheres[i, 3]
            levers[i, j] = away * moved[i, j]


@kernel
def reach(levers: Matrix, turns: Vector, span: float) -> float:
    """Upper bound of any point's displacement while each joint turns by no more than ``turns``, m.

    Args:
        levers: Current distances from the joints' axes, of shape (n, dof), m.
        turns: Largest turn of each joint, of shape (dof,), rad.
        span: Largest distance of any point from the first joint in any configuration, m.
    """
    # Turn the joints in the order tip to base. Before joint j turns, a point has moved by at most
    # the bound R, and the axis not at all: their distance is at most lever_j + R. Hence
    # R <= sum(lever_j turn_j) + R sum(turn_j), which is solved for R below.
    total = 0.0
    for i in range(len(turns)):
        total += turns[i]
    most: float = span * total
    if total >= 1.0:
        return most
    return min(farthest(levers, turns) / (1.0 - total), most)


@kernel
def farthest(levers: Matrix, turns: Vector) -> float:
    """Largest sum of a sphere's levers times the turns of the joints, of shape (dof,), rad."""
    most = 0.0
    for i in range(len(levers)):
        total = 0.0
        for j in range(len(turns)):
            total += levers[i, j] * turns[j]
        most = max(most, total)
    return most


@kernel
def sphere_distance(first: Matrix, second: Matrix) -> float:
    """Smallest distance between two sets of spheres, of shape (n, 4) and (m, 4), m."""
    # Consecutive spheres belong to the same link: a ball around them rules out most pairs at once.
    count = len(second)
    least = math.inf
    balls = np.empty(((count + _GROUP - 1) // _GROUP, 4))
    for k in range(len(balls)):
        _wrap(second, k * _GROUP, min((k + 1) * _GROUP, count), balls[k])
    for i in range(len(first)):
        for k in range(len(balls)):
            if _between(first, i, balls, k) < least:
                for j in range(k * _GROUP, min((k + 1) * _GROUP, count)):
                    least = min(least, _between(first, i, second, j))
    return least


@kernel
def _between(first: Matrix, i: int, second: Matrix, j: int) -> float:
    """Distance between two spheres, m; negative if they overlap."""
    square = 0.0
    for k in range(3):
        square += (first[i, k] - second[j, k]) ** 2
    distance: float = math.sqrt(square) - first[i, 3] - second[j, 3]
    return distance


@kernel
def _wrap(spheres: Matrix, begin: int, end: int, ball: Vector) -> None:
    """Write center and radius of a ball around the spheres ``begin`` to ``end - 1``."""
    for k in range(3):
        ball[k] = 0.0
        for i in range(begin, end):
            ball[k] += spheres[i, k] / (end - begin)
    ball[3] = 0.0
    for i in range(begin, end):
        square = 0.0
        for k in range(3):
            square += (spheres[i, k] - ball[k]) ** 2
        ball[3] = max(ball[3], math.sqrt(square) + spheres[i, 3] + _ROUNDING)


@kernel
def moved(first: Matrix, second: Matrix, bounds: Vector, turned: Matrix, turn: Vector) -> float:
    """Upper bound of the displacement of any point of some shapes between two states, m.

    Args:
        first: Centers of the shapes in the first state, of shape (n, 3), m.
        second: Centers in the second state, of shape (n, 3), m.
        bounds: Radii of the shapes' bounding spheres, of shape (n,), m.
        turned: Whether a joint moves a shape, 1 or 0, of shape (n, dof).
        turn: Turn of each joint, of shape (dof,), rad.
    """
    most = 0.0
    for i in range(len(bounds)):
        square = 0.0
        angle = 0.0
        for k in range(3):
            square += (second[i, k] - first[i, k]) ** 2
        # A shape rotates about its center by no more than all its joints turn together.
        for j in range(len(turn)):
            angle += turned[i, j] * abs(turn[j])
        most = max(most, math.sqrt(square) + bounds[i] * angle)
    return most
