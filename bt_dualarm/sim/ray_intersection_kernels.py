"""Compiled kernels that intersect rays with convex meshes, planes, spheres, cylinders, capsules.

Everything is conservative: a test may keep a cell that no ray needs, but never drops one that it
does.
"""

from __future__ import annotations

import math
from typing import TypeAlias

import numpy as np

from bt_dualarm.core.kernel import kernel
from bt_dualarm.core.pose import Matrix, Vector
from bt_dualarm.sim.kernel_arrays import CAPSULE, CYLINDER, PLANE, SPHERE, Fan, Marks, Shapes

# Planes through the eye
#
# A ray through column c and row r of the grid has the direction ((c - c0) s, -(r - r0) s, -1), with
# the camera's axis at (c0, r0) and the spacing s. It is on the inner side of a plane with the
# normal e if A c + B r + C <= 0, with A = e_x, B = -e_y, C = -e_x c0 + e_y r0 - e_z / s. Each ray
# passes through some point of its cell: a cell may be inside if one of its corners is, and is
# certainly inside if all are.


Crossing: TypeAlias = tuple[float, float, float]
"""Column at which a plane crosses the start of row 0; slope in columns per row; and a number that
is positive if cells to the left are inside, negative if those to the right are, 0 if columns do not
decide."""

_STEEP = 1e-9
"""Fraction of the other terms that A must exceed: planes along the rows do not bound columns."""

_EDGE_SPARE = 0.01
"""Margin in cells for rounding errors."""


@kernel
def crossing(spacing: float, center: tuple[float, float], x: float, y: float, z: float) -> Crossing:
    """Intersect a plane through the eye with the rows of a grid.

    Args:
        spacing: Spacing of a fan.
        center: Center of a fan.
        x: First component of the plane's outward normal in the camera's axes, of any length.
        y: Second component.
        z: Third component.
    """
    rest = -x * center[0] + y * center[1] - z / spacing
    if abs(x) <= _STEEP * (abs(y) + abs(rest)):
        return 0.0, 0.0, 0.0
    by_column = 1.0 / x
    return -rest * by_column, y * by_column, x


@kernel
def stretch(
    left: int, right: int, row: int, first: Crossing, second: Crossing, third: Crossing
) -> tuple[int, int, int, int]:
    """Cells of a row that may be inside three planes, and those that certainly are.

    Args:
        left: First column to test.
        right: End of the columns.
        row: The row.
        first: Intersection of a plane with the rows, by `crossing`.
        second: Likewise.
        third: Likewise.

    Returns:
        First column that may be inside, first that certainly is, end of the certain ones, and end
        of the possible ones. If none is certain, the two in the middle are arbitrary.
    """
    begin = float(left)
    end = float(right)
    begin, sure, unsure, end = _narrowed(begin, begin, end, end, row, first)
    begin, sure, unsure, end = _narrowed(begin, sure, unsure, end, row, second)
    begin, sure, unsure, end = _narrowed(begin, sure, unsure, end, row, third)
    # int() truncates, which rounds down as all values are 0 or more.
    return int(begin), int(sure), int(max(unsure, 0.0)), int(max(end, 0.0))


@kernel
def _narrowed(
    begin: float, sure: float, unsure: float, end: float, row: int, plane: Crossing
) -> tuple[float, float, float, float]:
    """Intersect the result of `stretch` with the inner side of one more plane."""
    from_column, slope, side = plane
    at = from_column + slope * row
    least = at + min(slope, 0.0) - _EDGE_SPARE
    most = at + max(slope, 0.0) + _EDGE_SPARE
    if side > 0.0:
        return begin, sure, min(unsure, least), min(end, most + 1.0)
    if side < 0.0:
        return max(begin, least), max(sure, most + 1.0), unsure, end
    return begin, sure, begin, end


# Projection to the grid

NEAR_M = 1e-3
"""Depth below which points are not projected."""

_SPARE = 0.01
"""Margin in cells for rounding errors."""


@kernel
def sphere_is_seen(fan: Fan, center: Vector, radius: float) -> bool:
    """Whether a sphere reaches into the pyramid of the fan.

    Args:
        fan: The rays.
        center: Center in the camera, of shape (3,), m.
        radius: Radius in m; with inf the result is always true.
    """
    rows = fan.rays.shape[1]
    columns = fan.rays.shape[2]
    depth = -center[2]
    x = center[0] / fan.spacing
    y = -center[1] / fan.spacing
    if depth < -radius:
        return False
    reach = radius / fan.spacing
    return _reaches(x, depth, fan.center[0], columns, reach, fan.spacing) and _reaches(
        y, depth, fan.center[1], rows, reach, fan.spacing
    )


@kernel
def _reaches(
    offset: float, depth: float, center: float, count: int, reach: float, spacing: float
) -> bool:
    """Whether a sphere reaches between the planes through the first and the last cell border."""
    low = -_SPARE - center
    high = count + _SPARE - center
    # The plane is offset = border · depth; the excess over the normal's length is the distance.
    under = (low * depth - offset) / math.sqrt(1.0 + (low * spacing) ** 2)
    over = (offset - high * depth) / math.sqrt(1.0 + (high * spacing) ** 2)
    return under <= reach and over <= reach


@kernel
def project(fan: Fan, points: Matrix) -> None:
    """Enter column and row of the points in front of the camera.

    Args:
        fan: The rays.
        points: Positions in the camera, then column and row, of shape (n, 5); changed.
    """
    for i in range(len(points)):
        depth = -points[i, 2]
        if depth >= NEAR_M:
            scale = 1.0 / (fan.spacing * depth)
            points[i, 3] = points[i, 0] * scale + fan.center[0]
            points[i, 4] = -points[i, 1] * scale + fan.center[1]


@kernel
def cells(least: float, most: float, count: int) -> tuple[int, int]:
    """First cell between two coordinates, and the end of the cells."""
    first = min(max(least - _SPARE, 0.0), float(count))
    last = min(max(most + _SPARE, -1.0), float(count))
    # int() truncates, which rounds down as all values are 0 or more.
    return int(first), min(int(last + 1.0), count)


@kernel
def box_of(fan: Fan, points: Matrix) -> tuple[int, int, int, int]:
    """Bounding box of projected points: first and end row, first and end column; may be empty.

    Args:
        fan: The rays.
        points: Points after `project`. If some of them are behind the camera, the result is the
            whole grid, or empty if all are beside it.
    """
    rows = fan.rays.shape[1]
    columns = fan.rays.shape[2]
    left = math.inf
    right = -math.inf
    top = math.inf
    bottom = -math.inf
    ahead = 0
    behind = 0
    for i in range(len(points)):
        if points[i, 2] >= 0.0:
            behind += 1
        if -points[i, 2] >= NEAR_M:
            ahead += 1
            left = min(left, points[i, 3])
            right = max(right, points[i, 3])
            top = min(top, points[i, 4])
            bottom = max(bottom, points[i, 4])
    if ahead == len(points):
        first, last = cells(top, bottom, rows)
        start, stop = cells(left, right, columns)
        return first, last, start, stop
    beside = (
        behind == len(points)
        or _beside(points, 0, fan.center[0], columns, fan.spacing)
        or _beside(points, 1, fan.center[1], rows, -fan.spacing)
    )
    return (0, 0, 0, 0) if beside else (0, rows, 0, columns)


@kernel
def _beside(points: Matrix, axis: int, center: float, count: int, spacing: float) -> bool:
    """Whether all points, some of them behind the camera, are outside of one border."""
    under = True
    over = True
    for i in range(len(points)):
        offset = points[i, axis] / spacing
        depth = -points[i, 2]
        under = under and offset + (center + _SPARE) * depth < 0.0
        over = over and offset + (center - count - _SPARE) * depth > 0.0
    return under or over


# Occlusion

SURELY = 0.999
"""Factor of a shape's smallest depth that, despite rounding, is a lower bound of its distance."""


@kernel
def is_ahead(corners: Matrix) -> bool:
    """Whether all corners are in front of the camera and were projected."""
    ahead = True
    for corner in range(len(corners)):
        ahead = ahead and -corners[corner, 2] >= NEAR_M
    return ahead


@kernel
def nearest(corners: Matrix) -> float:
    """Lower bound of the distance of a convex hull of corners: their smallest depth, m."""
    least = math.inf
    for corner in range(len(corners)):
        least = min(least, -corners[corner, 2])
    return SURELY * least


@kernel
def is_hidden(box: tuple[int, int, int, int], near: float, distances: Matrix) -> bool:
    """Whether all rays of a box hit something nearer than ``near``."""
    top, bottom, left, right = box
    for row in range(top, bottom):
        for column in range(left, right):
            if not distances[row, column] <= near:
                return False
    return True


# Convex polyhedra
#
# Each triangle that faces the camera is intersected with the rays of the cells that it covers. With
# corners a, b, c relative to the eye, a ray d passes through the triangle if d·(a x b), d·(b x c)
# and d·(c x a) have one sign. Neighboring triangles have the same product for their common edge up
# to its sign, to the last bit: no ray slips between them. The inverse distance of the intersection
# is (n / h)·d, with the plane's outward normal n and its offset h along n, which is negative if the
# triangle faces the camera.


_HULL_TINY = 1e-12

_Three: TypeAlias = tuple[float, float, float]


@kernel
def meet_hull(shapes: Shapes, index: int, axes: Matrix, fan: Fan, marks: Marks) -> None:
    """Mark a convex polyhedron where it is nearer than the current marks.

    From inside no triangle faces the camera: the body is invisible then, as in OpenGL.

    Args:
        shapes: The shapes.
        index: Index of the polyhedron.
        axes: Its axes as columns in the world, of shape (3, 3).
        fan: The rays.
        marks: Intersections so far, with eye and turn for this shape; changed.
    """
    mesh_range = shapes.mesh_ranges[index]
    eye = marks.eyes[index]
    turn = marks.turns[index]
    corners = in_camera(shapes.corners[mesh_range[0] : mesh_range[1]], eye, turn, fan)
    top, bottom, left, right = box_of(fan, corners)
    if top >= bottom or left >= right:
        return
    ahead = is_ahead(corners)
    rows = fan.rays.shape[1]
    columns = fan.rays.shape[2]
    if ahead and is_hidden((top, bottom, left, right), nearest(corners), marks.distances):
        return
    # In the loop, numbers instead of rows, and no call with an array that remains one: numba counts
    # references to arrays by atomic operations, which would take a third of the time of an image.
    first = mesh_range[0]
    normals = shapes.normals
    rays = fan.rays
    faces = marks.faces
    distances = marks.distances
    for number in range(mesh_range[2], mesh_range[3]):
        normal = normals[number, 0], normals[number, 1], normals[number, 2]
        height = shapes.offsets[number] - (
            normal[0] * eye[0] + normal[1] * eye[1] + normal[2] * eye[2]
        )
        if height > -_HULL_TINY:
            continue
        a = shapes.triangles[number, 0] - first
        b = shapes.triangles[number, 1] - first
        c = shapes.triangles[number, 2] - first
        if ahead:
            box = _box(corners, a, b, c, rows, columns)
        else:
            box = box_of(fan, _stacked(corners, a, b, c))
        if box[0] >= box[1] or box[2] >= box[3]:
            continue
        near = -SURELY * max(corners[a, 2], corners[b, 2], corners[c, 2]) if ahead else 0.0
        for axis in range(3):
            marks.normals[number, axis] = (
                axes[axis, 0] * normal[0] + axes[axis, 1] * normal[1] + axes[axis, 2] * normal[2]
            )
        ax, ay, az = _cross(corners, a, b)
        bx, by, bz = _cross(corners, b, c)
        cx, cy, cz = _cross(corners, c, a)
        ux, uy, uz = _inverse(turn, normal, height)
        one = crossing(fan.spacing, fan.center, ax, ay, az)
        two = crossing(fan.spacing, fan.center, bx, by, bz)
        three = crossing(fan.spacing, fan.center, cx, cy, cz)
        # Rays on the inner side of all three edges, unless they hit something nearer.
        for row in range(box[0], box[1]):
            begin, sure, unsure, end = stretch(box[2], box[3], row, one, two, three)
            for column in range(begin, end):
                if distances[row, column] <= near:
                    continue
                x = rays[0, row, column]
                y = rays[1, row, column]
                z = rays[2, row, column]
                if column < sure or column >= unsure:
                    if ax * x + ay * y + az * z > 0.0:
                        continue
                    if bx * x + by * y + bz * z > 0.0 or cx * x + cy * y + cz * z > 0.0:
                        continue
                inverse = ux * x + uy * y + uz * z
                if inverse > _HULL_TINY and 1.0 / inverse < distances[row, column]:
                    distances[row, column] = 1.0 / inverse
                    faces[row, column] = number


@kernel
def _box(
    corners: Matrix, a: int, b: int, c: int, rows: int, columns: int
) -> tuple[int, int, int, int]:
    """Bounding box of the triangle of three projected corners: as the result of `box_of`."""
    top, bottom = cells(
        min(corners[a, 4], corners[b, 4], corners[c, 4]),
        max(corners[a, 4], corners[b, 4], corners[c, 4]),
        rows,
    )
    left, right = cells(
        min(corners[a, 3], corners[b, 3], corners[c, 3]),
        max(corners[a, 3], corners[b, 3], corners[c, 3]),
        columns,
    )
    return top, bottom, left, right


@kernel
def _stacked(corners: Matrix, a: int, b: int, c: int) -> Matrix:
    """Three of the corners as an array."""
    three = np.empty((3, 5))
    three[0] = corners[a]
    three[1] = corners[b]
    three[2] = corners[c]
    return three


@kernel
def in_camera(corners: Matrix, eye: Vector, turn: Matrix, fan: Fan) -> Matrix:
    """Transform corners to the camera and project them, of shape (n, 5); see `project`."""
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
def _cross(corners: Matrix, a: int, b: int) -> _Three:
    """Cross product a x b of two corners."""
    return (
        corners[a, 1] * corners[b, 2] - corners[a, 2] * corners[b, 1],
        corners[a, 2] * corners[b, 0] - corners[a, 0] * corners[b, 2],
        corners[a, 0] * corners[b, 1] - corners[a, 1] * corners[b, 0],
    )


@kernel
def _inverse(turn: Matrix, normal: _Three, height: float) -> _Three:
    """Normal in the camera over the plane's offset, n / h."""
    return (
        (turn[0, 0] * normal[0] + turn[1, 0] * normal[1] + turn[2, 0] * normal[2]) / height,
        (turn[0, 1] * normal[0] + turn[1, 1] * normal[1] + turn[2, 1] * normal[2]) / height,
        (turn[0, 2] * normal[0] + turn[1, 2] * normal[1] + turn[2, 2] * normal[2]) / height,
    )


# Planes and curved shapes
#
# In the shape's own frame planes are z = 0, seen from above, and the others lie about the origin
# along z. ``eye`` and ``ray`` are of shape (3,), rays of unit length. From inside a shape is
# invisible, as in OpenGL.


_TINY = 1e-12
_ON_THE_CAP_M = 1e-9


@kernel
def meet_round(shapes: Shapes, index: int, axes: Matrix, fan: Fan, marks: Marks) -> None:
    """Mark a shape that is not a polyhedron; as `meet_hull`."""
    kind = shapes.kinds[index]
    size = shapes.sizes[index]
    eye = marks.eyes[index]
    turn = marks.turns[index]
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
            x = fan.rays[0, row, column]
            y = fan.rays[1, row, column]
            z = fan.rays[2, row, column]
            for axis in range(3):
                ray[axis] = turn[axis, 0] * x + turn[axis, 1] * y + turn[axis, 2] * z
            distance = enter(kind, size, eye, ray)
            if distance < marks.distances[row, column]:
                marks.distances[row, column] = distance
                marks.faces[row, column] = -2 - index


@kernel
def _meet_plane(size: Vector, index: int, face: int, fan: Fan, marks: Marks) -> None:
    """Mark a plane, z = 0 within its half lengths along x and y, where rays point down."""
    eye = marks.eyes[index]
    turn = marks.turns[index]
    edge = crossing(fan.spacing, fan.center, turn[2, 0], turn[2, 1], turn[2, 2])
    near = SURELY * eye[2]
    for row in range(fan.rays.shape[1]):
        begin, _, _, end = stretch(0, fan.rays.shape[2], row, edge, edge, edge)
        for column in range(begin, end):
            if marks.distances[row, column] <= near:
                continue
            x = fan.rays[0, row, column]
            y = fan.rays[1, row, column]
            z = fan.rays[2, row, column]
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
    """Projected corners of the bounding box of a shape, of shape (8, 5); see `project`."""
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
    """Whether the eye is inside a shape, or below a plane."""
    x = float(eye[0])
    y = float(eye[1])
    z = float(eye[2])
    radius = float(size[0])
    beyond = abs(z) - float(size[1])
    if kind == PLANE:
        return z <= 0.0
    if kind == SPHERE:
        return x * x + y * y + z * z <= radius**2
    if kind == CYLINDER:
        return x * x + y * y <= radius**2 and beyond <= 0.0
    return x * x + y * y + max(beyond, 0.0) ** 2 <= radius**2


@kernel
def enter(kind: int, size: Vector, eye: Vector, ray: Vector) -> float:
    """Distance at which a ray enters a sphere, cylinder or capsule; inf if it misses."""
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
    """Distance at which a ray enters a sphere about (0, 0, height)."""
    z = eye[2] - height
    along: float = eye[0] * ray[0] + eye[1] * ray[1] + z * ray[2]
    squared: float = along**2 - (eye[0] * eye[0] + eye[1] * eye[1] + z * z - radius**2)
    return -along - math.sqrt(squared) if squared >= 0.0 and along < 0.0 else math.inf


@kernel
def _enter_cylinder(size: Vector, eye: Vector, ray: Vector) -> float:
    """Distance at which a ray enters a cylinder.

    The ray is inside where its section of the infinite cylinder and its section of the slab between
    the caps overlap.
    """
    a = max(ray[0] ** 2 + ray[1] ** 2, _TINY)
    b = eye[0] * ray[0] + eye[1] * ray[1]
    squared: float = b**2 - a * (eye[0] ** 2 + eye[1] ** 2 - size[0] ** 2)
    if squared < 0.0:
        return math.inf
    root = math.sqrt(squared)
    climb = _TINY if abs(ray[2]) < _TINY else ray[2]
    middle = -eye[2] / climb
    half = abs(size[1] / climb)
    entry: float = max((-b - root) / a, middle - half)
    leave = min((-b + root) / a, middle + half)
    return entry if entry <= leave and entry > 0.0 else math.inf


@kernel
def outward(
    kind: int, radius: float, half: float, x: float, y: float, z: float
) -> tuple[float, float, float]:
    """Outward unit normal at a point on a shape with a radius and a half length."""
    if kind == PLANE:
        return 0.0, 0.0, 1.0
    if kind == CYLINDER:
        if abs(z) >= half - _ON_THE_CAP_M:
            return 0.0, 0.0, math.copysign(1.0, z)
        z = 0.0
    elif kind == CAPSULE:
        z -= min(max(z, -half), half)
    return x / radius, y / radius, z / radius
