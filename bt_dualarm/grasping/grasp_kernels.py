"""Kernels of grasping: distances to solids, pad contact, grip force, clearance of a gripper.

A solid is given as in `Form`, by its kind and its numbers, in its own frame.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from bt_dualarm.core.kernel import kernel
from bt_dualarm.core.pose import Matrix, Vector

# Kinds of solids, `Form.kind`.
BOX: Final = 0
CYLINDER: Final = 1
CAPSULE: Final = 2
CONVEX: Final = 3
TRIANGLES: Final = 4


PRESSED: Final = 3e-4
"""Depth by which a pad yields, m; about that of rubber, and of MuJoCo's contacts."""

_SPOT: Final = 1.5e-3
"""Minimum lever of a contact patch, m: a soft pad turns a contact point into a patch. For a ball of
10 mm that is pressed in by 0.3 mm, it is 1.6 mm."""

_ROWS: Final = 7
"""Number of rows and columns of sample points on a pad."""

_STEPS: Final = 20
"""Maximum number of steps of a ray, each as long as the distance to the solid."""

_HIT: Final = 2e-5
"""Distance at which a ray has reached a solid, m."""

_SLOPE: Final = 1e-5
"""Step of the central differences of normals, m."""

APPROACHES: Final = 8
"""Number of directions of approach around a grasp axis, in a whole turn."""

_HIGHER: Final = (0.0, 0.004, 0.008, 0.016)
"""Distances of candidates behind the deepest one, m: fingertips may need clearance below."""


@kernel
def reach(kind: int, numbers: Matrix, direction: Vector) -> float:
    """Support function: largest coordinate of a solid along a unit vector of shape (3,), m."""
    x = direction[0]
    y = direction[1]
    z = direction[2]
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
    """Signed distance of a point from a solid, m; negative inside.

    Outside a convex mesh, the distance of the farthest plane: a lower bound.
    """
    if kind == BOX:
        a = abs(x) - numbers[0, 0]
        b = abs(y) - numbers[0, 1]
        c = abs(z) - numbers[0, 2]
        out = math.sqrt(max(a, 0.0) ** 2 + max(b, 0.0) ** 2 + max(c, 0.0) ** 2)
        return float(out + min(max(a, b, c), 0.0))
    if kind == CYLINDER:
        a = math.hypot(x, y) - numbers[0, 0]
        b = abs(z) - numbers[0, 1]
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
    """Signed distances of points of shape (n, 3) from a solid, of shape (n,), m."""
    away = np.empty(len(points))
    for i in range(len(points)):
        away[i] = distance(kind, numbers, points[i, 0], points[i, 1], points[i, 2])
    return away


@kernel
def _from_triangles(numbers: Matrix, point: Vector) -> float:
    """Signed distance of a point from a closed surface: that of the nearest triangle.

    The sign is that of the winding number, by the solid angles of the triangles: A. Van Oosterom,
    J. Strackee, The solid angle of a plane triangle, IEEE Transactions on Biomedical Engineering
    30(2), 1983.
    """
    nearest = np.inf
    angle = 0.0
    to = np.empty((3, 3))
    for row in numbers:
        for i in range(3):
            for k in range(3):
                to[i, k] = row[3 * i + k] - point[k]
        nearest = min(nearest, _from_triangle(to, row[9:12]))
        a = length(to[0])
        b = length(to[1])
        c = length(to[2])
        volume = dot(to[0], cross(to[1], to[2]))
        level = a * b * c + dot(to[0], to[1]) * c + dot(to[1], to[2]) * a
        angle += 2.0 * math.atan2(volume, level + dot(to[2], to[0]) * b)
    # The solid angles add up to 4 pi inside and to 0 outside: anything in between is rounding.
    return float(-nearest if angle > 2.0 * math.pi else nearest)


@kernel
def _from_triangle(to: Matrix, normal: Vector) -> float:
    """Distance of the origin from a triangle with corners of shape (3, 3), m."""
    height = dot(to[0], normal)
    inside = True
    nearest = np.inf
    for i in range(3):
        start = to[i]
        edge = to[(i + 1) % 3] - to[i]
        share = min(max(-dot(start, edge) / dot(edge, edge), 0.0), 1.0)
        nearest = min(nearest, length(start + share * edge))
        # On the inner side of all three edges, the projection of the origin is in the triangle.
        inside = inside and dot(cross(edge, height * normal - start), normal) >= 0.0
    return abs(height) if inside else nearest


@kernel
def press(
    kind: int, numbers: Matrix, center: Vector, normal: Vector, along: Vector, size: Vector,
    met: Vector,
) -> bool:  # fmt: skip
    """Write the contact patch of i pad that approaches from outside; False if it misses.

    Args:
        kind: Kind of the solid, `Form.kind`.
        numbers: Numbers of the solid, `Form.numbers`.
        center: Any point on the line along which the pad's center approaches, of shape (3,), m.
        normal: Unit vector from the solid to the pad, of shape (3,).
        along: Unit vector along the pad's length, perpendicular to the normal, of shape (3,).
        size: Length and width of the pad, of shape (2,), m.
        met: Output, of shape (6,): center of the patch (m), share of the pad, lever (m) and slope
            (rad), as in `PadContact`.
    """
    # Rays start on the plane that touches the solid from outside, and end on the opposite i.
    outside = reach(kind, numbers, normal)
    back = -normal
    farthest = outside + reach(kind, numbers, back)
    points = _spread(center + (outside - dot(center, normal)) * normal, normal, along, size)
    gone = np.empty(len(points))
    for i in range(len(points)):
        gone[i] = _traced(kind, numbers, points[i], back, farthest)
    first = gone.min()
    if math.isinf(first):
        return False
    _describe(kind, numbers, points, gone, normal, met)
    # The pad stops where it first touches: the center of the patch is on its plane.
    met[:3] += (outside - first - dot(met, normal)) * normal
    return True


@kernel
def _spread(middle: Vector, normal: Vector, along: Vector, size: Vector) -> Matrix:
    """Sample points of a pad with a given center, of shape (n, 3), m; arguments as in `press`."""
    across = cross(normal, along)
    points = np.empty((_ROWS * _ROWS, 3))
    for i in range(len(points)):
        up = size[0] * ((i // _ROWS + 0.5) / _ROWS - 0.5)
        aside = size[1] * ((i % _ROWS + 0.5) / _ROWS - 0.5)
        for axis in range(3):
            points[i, axis] = middle[axis] + up * along[axis] + aside * across[axis]
    return points


@kernel
def _traced(kind: int, numbers: Matrix, point: Vector, direction: Vector, farthest: float) -> float:
    """Distance along a ray to a solid, m; infinite if it misses.

    Sphere tracing: each step is the distance to the solid, which the ray cannot skip (J. C. Hart,
    Sphere tracing, The Visual Computer 12(10), 1996).
    """
    gone = 0.0
    for _ in range(_STEPS):
        x = point[0] + gone * direction[0]
        y = point[1] + gone * direction[1]
        away = distance(kind, numbers, x, y, point[2] + gone * direction[2])
        gone += max(away, 0.0)
        if gone > farthest:
            break
        if away < _HIT:
            return gone
    return math.inf


@kernel
def _describe(
    kind: int, numbers: Matrix, points: Matrix, gone: Vector, normal: Vector, met: Vector
) -> None:
    """Write center, share, lever and slope of the contact patch; arguments as in `press`."""
    # Points within the depth by which the pad yields are in contact.
    least = gone.min() + PRESSED
    count = 0
    met[:] = 0.0
    for i in range(len(points)):
        if gone[i] > least:
            continue
        count += 1
        for axis in range(3):
            points[i, axis] -= gone[i] * normal[axis]
            met[axis] += points[i, axis]
    met[:3] /= count
    lever = 0.0
    cosine = -1.0
    for i in range(len(points)):
        if gone[i] > least:
            continue
        x = points[i, 0]
        y = points[i, 1]
        z = points[i, 2]
        lever += math.sqrt((x - met[0]) ** 2 + (y - met[1]) ** 2 + (z - met[2]) ** 2) / count
        # The best aligned point counts: at an edge, others have normals of the adjacent side.
        cosine = max(cosine, _cosine(kind, numbers, x, y, z, normal))
    met[3] = count / len(points)
    met[4] = max(lever, _SPOT)
    met[5] = math.acos(min(cosine, 1.0))


@kernel
def _cosine(kind: int, numbers: Matrix, x: float, y: float, z: float, normal: Vector) -> float:
    """Cosine of the angle between a solid's normal at a surface point and a unit vector."""
    # The gradient of the signed distance is the normal.
    a = distance(kind, numbers, x + _SLOPE, y, z) - distance(kind, numbers, x - _SLOPE, y, z)
    b = distance(kind, numbers, x, y + _SLOPE, z) - distance(kind, numbers, x, y - _SLOPE, z)
    c = distance(kind, numbers, x, y, z + _SLOPE) - distance(kind, numbers, x, y, z - _SLOPE)
    length = max(math.sqrt(a * a + b * b + c * c), 1e-12)
    return float((a * normal[0] + b * normal[1] + c * normal[2]) / length)


@kernel
def hold(
    kind: int, numbers: Matrix, center: Vector, axis: Vector, along: Vector, size: Vector,
    between: Vector,
) -> bool:  # fmt: skip
    """Write the contact of two pads that close along an axis; False if one of them misses.

    Args:
        kind: Kind of the solid, `Form.kind`.
        numbers: Numbers of the solid, `Form.numbers`.
        center: Point on the line between the pads' centers, of shape (3,), m.
        axis: Unit vector along which they close, of shape (3,).
        along: Unit vector along the pads' length, perpendicular to the axis, of shape (3,).
        size: Length and width of a pad, of shape (2,), m.
        between: Output, of shape (6,): center between both patches (m), distance of the pads (m),
            smaller one of both levers (m), and the largest angle from the axis (rad) of the surface
            on either side and of the line between the patches.
    """
    one = np.empty(6)
    other = np.empty(6)
    if not press(kind, numbers, center, axis, along, size, one):
        return False
    if not press(kind, numbers, center, -axis, along, size, other):
        return False
    line = one[:3] - other[:3]
    width = dot(line, axis)
    if width > 0.0:
        # Force is transmitted along the line between the patches, not along the axis.
        skew = math.acos(min(max(width / length(line), 0.0), 1.0))
        between[:3] = 0.5 * (one[:3] + other[:3])
        between[3] = width
        between[4] = min(one[4], other[4])
        between[5] = max(one[5], other[5], skew)
    return bool(width > 0.0)


@kernel
def pinch(
    forces: Matrix, moments: Matrix, offset: Vector, axis: Vector, width: float, lever: float,
    friction: float,
) -> Vector:  # fmt: skip
    """Minimum force of each of two pads under each of several loads, N: see `pinching_forces`."""
    needed = np.full(len(forces), np.inf)
    if friction <= 0.0 or width <= 0.0:
        return needed
    for i in range(len(forces)):
        force = forces[i]
        moment = moments[i] + cross(offset, force)
        pressing = dot(force, axis)
        turning = dot(moment, axis)
        if lever <= 0.0 and 0.5 * abs(turning) > 1e-9:
            return np.full(len(forces), np.inf)
        # Each pad takes half of the force across the axis, and one of two opposite forces that
        # balance the moment across it. Sliding and twisting share the limit surface, an ellipsoid:
        # their root of squares is the friction that is needed.
        across = length(force - pressing * axis)
        sliding = 0.5 * across + length(moment - turning * axis) / width
        twisting = 0.5 * abs(turning) / max(lever, 1e-9)
        # The pad that the force along the axis relieves must still press enough.
        needed[i] = math.hypot(sliding, twisting) / friction + 0.5 * abs(pressing)
    return needed


@kernel
def close_along(
    kind: int, numbers: Matrix, pairs: Matrix, jaw: Vector, forces: Matrix, center: Vector,
    friction: float, found: Matrix,
) -> int:  # fmt: skip
    """Write the grasps of pads that close along antipodal pairs; returns their number.

    Args:
        kind: Kind of the solid, `Form.kind`.
        numbers: Numbers of the solid, `Form.numbers`.
        pairs: Center, axis, and first direction of approach of each pair, of shape (n, 9).
        jaw: Length and width of a pad, distance from the pads' center to the palm, minimum width,
            distance of an open pad from the center (m), largest force (N), of shape (6,).
        forces: Loads at the center of mass, of shape (m, 3), N.
        center: Center of mass, of shape (3,), m.
        friction: Coefficient of friction between pads and solid.
        found: Output, of shape (n * 32, 11): center of the pads, axis, approach, width and minimum
            force of each grasp; of one approach, deeper grasps come first.
    """
    count = 0
    for row in pairs:
        other = cross(row[3:6], row[6:9])
        for roll in range(APPROACHES):
            angle = roll * 2.0 * math.pi / APPROACHES
            approach = math.cos(angle) * row[6:9] + math.sin(angle) * other
            # Depth of the object behind the pair: the palm stays clear of it.
            behind = reach(kind, numbers, -approach) + dot(row, approach)
            for higher in _HIGHER:
                entry = found[count]
                entry[:3] = row[:3] - (max(0.0, behind - jaw[2]) + higher) * approach
                entry[3:6] = row[3:6]
                entry[6:9] = approach
                # What is not held here is taken not to be held farther back, either.
                if not _is_held(kind, numbers, jaw, forces, center, friction, entry):
                    break
                # An entry that needs too much force is overwritten by the next one.
                count += 1 if entry[10] <= jaw[5] else 0
    return count


@kernel
def _is_held(
    kind: int, numbers: Matrix, jaw: Vector, forces: Matrix, center: Vector, friction: float,
    entry: Vector,
) -> bool:  # fmt: skip
    """Whether open pads fit around the solid and close on it; writes center, width and force.

    Arguments as in `close_along`; ``entry`` is a row of ``found``, of shape (11,).
    """
    between = np.empty(6)
    middle = entry[:3]
    axis = entry[3:6]
    approach = entry[6:9]
    if not hold(kind, numbers, middle, axis, approach, jaw[:2], between):
        return False
    width = between[3]
    if width < jaw[3]:
        return False
    # The open pads must clear the whole solid on both sides, not only the contact patches.
    at = dot(between, axis)
    beyond = max(reach(kind, numbers, axis) - at, reach(kind, numbers, -axis) + at)
    if beyond > jaw[4]:
        return False
    # A tilted surface uses up a part of the friction cone.
    remaining = math.tan(math.atan(friction) - between[5])
    offset = center - between[:3]
    none = np.zeros(forces.shape)  # the tool is shaken, but not turned
    needed = pinch(forces, none, offset, axis, width, between[4], remaining)
    entry[9] = width
    entry[10] = needed.max()
    entry[:3] += dot(between[:3] - middle, axis) * axis
    return True


@kernel
def lower_clearances(
    kind: int, numbers: Matrix, pose: Matrix, tools: Matrix, widths: Matrix, points: Matrix,
    least: float, rooms: Vector,
) -> None:  # fmt: skip
    """Lower the clearances of grippers to their distances from i more solid.

    Args:
        kind: Kind of the solid, `Form.kind`.
        numbers: Numbers of the solid, `Form.numbers`.
        pose: Pose of the solid in the world, of shape (4, 4).
        tools: Position and quaternion wxyz of each tool in the world, of shape (n, 7).
        widths: Openings at which each gripper is checked, of shape (n, k), m.
        points: Points of a closed gripper in the tool frame, m, and the share of half the opening
            by which each moves along y, of shape (m, 4).
        least: Clearance below which the exact value does not matter, m.
        rooms: Clearances of the grippers, of shape (n,), m; updated.
    """
    around = _radius(points, widths.max())
    turn = np.empty((3, 3))
    for i in range(len(tools)):
        if rooms[i] < least:
            continue
        place = _into(pose, tools[i], turn)
        # One distance rules out a solid that is farther than the gripper is large.
        if distance(kind, numbers, place[0], place[1], place[2]) - around < rooms[i]:
            for opening in widths[i]:
                room = _room(kind, numbers, place, turn, opening, points, least)
                rooms[i] = min(rooms[i], room)


@kernel
def _room(
    kind: int, numbers: Matrix, place: Vector, turn: Matrix, opening: float, points: Matrix,
    least: float,
) -> float:  # fmt: skip
    """Distance of a gripper from a solid, in whose frame the tool is given, m."""
    room = np.inf
    for point in points:
        x = point[0]
        y = point[1] + 0.5 * opening * point[3]
        z = point[2]
        a = place[0] + turn[0, 0] * x + turn[0, 1] * y + turn[0, 2] * z
        b = place[1] + turn[1, 0] * x + turn[1, 1] * y + turn[1, 2] * z
        c = place[2] + turn[2, 0] * x + turn[2, 1] * y + turn[2, 2] * z
        room = min(room, distance(kind, numbers, a, b, c))
        if room < least:
            break
    return room


@kernel
def _radius(points: Matrix, widest: float) -> float:
    """Distance from the tool frame to the farthest point of an open gripper, m."""
    farthest = 0.0
    for point in points:
        y = abs(point[1]) + 0.5 * widest * abs(point[3])
        farthest = max(farthest, math.sqrt(point[0] ** 2 + y * y + point[2] ** 2))
    return farthest


@kernel
def _into(pose: Matrix, tool: Vector, turn: Matrix) -> Vector:
    """Position of a tool in a frame, of shape (3,), m; writes its rotation matrix to ``turn``."""
    w = tool[3]
    x = tool[4]
    y = tool[5]
    z = tool[6]
    axes = np.array((
        (1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - z * w), 2.0 * (x * z + y * w)),
        (2.0 * (x * y + z * w), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - x * w)),
        (2.0 * (x * z - y * w), 2.0 * (y * z + x * w), 1.0 - 2.0 * (x * x + y * y)),
    ))  # fmt: skip
    place = np.zeros(3)
    for i in range(3):
        for k in range(3):
            place[i] += pose[k, i] * (tool[k] - pose[k, 3])
            turn[i, k] = 0.0
            for j in range(3):
                turn[i, k] += pose[j, i] * axes[j, k]
    return place


@kernel
def dot(a: Vector, b: Vector) -> float:
    """Scalar product of two vectors of shape (3,)."""
    return float(a[0] * b[0] + a[1] * b[1] + a[2] * b[2])


@kernel
def length(a: Vector) -> float:
    """Length of a vector of shape (3,)."""
    return math.sqrt(dot(a, a))


@kernel
def cross(a: Vector, b: Vector) -> Vector:
    """Cross product of two vectors of shape (3,)."""
    return np.array(
        (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])
    )
