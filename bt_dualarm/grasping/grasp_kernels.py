"""Distances to solids, pad contact, and where two pads can close: compiled."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from bt_dualarm.core.kernel import kernel
from bt_dualarm.core.pose import Matrix, Vector
from bt_dualarm.grasping.kernel_forms import BOX, CAPSULE, CONVEX, CYLINDER

# How far a point is from a solid, and how far a solid reaches: compiled.


@kernel
def reach(kind: int, numbers: Matrix, direction: Vector) -> float:
    """Largest coordinate in m of a solid along a unit direction of shape (3,)."""
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
    """Signed distance in m of a point from a solid, negative inside.

    From outside a convex mesh it is that of the farthest plane, which is never more.
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
    return float(-nearest if angle > 2.0 * math.pi else nearest)


@kernel
def _from_triangle(to: Matrix, normal: Vector) -> float:
    """Distance in m of the origin from a triangle with corners of shape (3, 3)."""
    height = dot(to[0], normal)
    inside = True
    nearest = np.inf
    for i in range(3):
        start = to[i]
        edge = to[(i + 1) % 3] - to[i]
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


# What flat pads meet when they shut on a solid, and the force that bears loads: compiled.


PRESSED: Final = 3e-4
"""Depth in m to which a pad gives way; rubber and MuJoCo's contacts do about as much."""

_SPOT: Final = 1.5e-3  # m: lever of what touches at a spot, which a soft pad makes a patch; of a
# ball of 10 mm that is pressed in by 0.3 mm it is 1.6 mm
_ROWS: Final = 7
_STEPS: Final = 20  # of a trace: each is as long as the distance to the solid
_HIT: Final = 2e-5  # m
_SLOPE: Final = 1e-5  # m, over which normals are measured


@kernel
def press(
    kind: int, numbers: Matrix, center: Vector, normal: Vector, along: Vector, size: Vector,
    met: Vector,
) -> bool:  # fmt: skip
    """Enter what one pad meets that comes from outside; whether that is anything.

    Args:
        kind: Kind of the solid, as `Form.kind`.
        numbers: Its numbers, as `Form.numbers`.
        center: Any place on the line along which the pad's middle comes, of shape (3,), m.
        normal: Direction from the solid to the pad, of unit length, of shape (3,).
        along: Direction of the pad's length, of unit length, square to the normal.
        size: Length and width of the pad, of shape (2,), m.
        met: Middle of what touches, the share of the pad, its mean distance from its middle (m),
            the angle between both normals (rad), of shape (6,), to be filled.
    """
    outside = reach(kind, numbers, normal)
    back = -normal
    farthest = outside + reach(kind, numbers, back)
    points = _spread(center + (outside - dot(center, normal)) * normal, normal, along, size)
    gone = np.empty(len(points))
    for one in range(len(points)):
        gone[one] = _traced(kind, numbers, points[one], back, farthest)
    first = gone.min()
    if math.isinf(first):
        return False
    _describe(kind, numbers, points, gone, normal, met)
    met[:3] += (outside - first - dot(met, normal)) * normal
    return True


@kernel
def _spread(middle: Vector, normal: Vector, along: Vector, size: Vector) -> Matrix:
    """Points all over a pad with its middle there, of shape (n, 3), m; arguments as of `press`."""
    across = cross(normal, along)
    points = np.empty((_ROWS * _ROWS, 3))
    for one in range(len(points)):
        up = size[0] * ((one // _ROWS + 0.5) / _ROWS - 0.5)
        aside = size[1] * ((one % _ROWS + 0.5) / _ROWS - 0.5)
        for axis in range(3):
            points[one, axis] = middle[axis] + up * along[axis] + aside * across[axis]
    return points


@kernel
def _traced(kind: int, numbers: Matrix, point: Vector, direction: Vector, farthest: float) -> float:
    """After how many meters a ray meets a solid; infinite where it passes by."""
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
    """Enter the mean of what touches, its share, its lever and its slope; as of `press`."""
    least = gone.min() + PRESSED
    count = 0
    met[:] = 0.0
    for one in range(len(points)):
        if gone[one] > least:
            continue
        count += 1
        for axis in range(3):
            points[one, axis] -= gone[one] * normal[axis]
            met[axis] += points[one, axis]
    met[:3] /= count
    lever = 0.0
    cosine = -1.0
    for one in range(len(points)):
        if gone[one] > least:
            continue
        x = points[one, 0]
        y = points[one, 1]
        z = points[one, 2]
        lever += math.sqrt((x - met[0]) ** 2 + (y - met[1]) ** 2 + (z - met[2]) ** 2) / count
        cosine = max(cosine, _cosine(kind, numbers, x, y, z, normal))
    met[3] = count / len(points)
    met[4] = max(lever, _SPOT)
    met[5] = math.acos(min(cosine, 1.0))


@kernel
def _cosine(kind: int, numbers: Matrix, x: float, y: float, z: float, normal: Vector) -> float:
    """Of the angle between a solid's normal at a point of its surface and another, shape (3,)."""
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
    """Enter what two pads hold that shut along an axis; whether both meet something.

    Arguments as of `press`, which this calls for each pad. Into ``between``, of shape (6,), go the
    place in the middle between what touches, the distance of the pads (m), the smaller one of both
    levers (m) and the largest angle from the pads' normal (rad).
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
        skew = math.acos(min(max(width / length(line), 0.0), 1.0))
        between[:3] = 0.5 * (one[:3] + other[:3])
        between[3] = width
        between[4], between[5] = min(one[4], other[4]), max(one[5], other[5], skew)
    return bool(width > 0.0)


@kernel
def pinch(
    forces: Matrix, offset: Vector, axis: Vector, width: float, lever: float, friction: float
) -> Vector:
    """Least force in N of each of two pads under each of several loads: `pinching_forces`."""
    needed = np.full(len(forces), np.inf)
    if friction <= 0.0 or width <= 0.0:
        return needed
    for i in range(len(forces)):
        force = forces[i]
        moment = cross(offset, force)
        pressing = dot(force, axis)
        turning = dot(moment, axis)
        if lever <= 0.0 and 0.5 * abs(turning) > 1e-9:
            return np.full(len(forces), np.inf)
        across = length(force - pressing * axis)
        sliding = 0.5 * across + length(moment - turning * axis) / width
        twisting = 0.5 * abs(turning) / max(lever, 1e-9)
        needed[i] = math.hypot(sliding, twisting) / friction + 0.5 * abs(pressing)
    return needed


# Places where two pads can shut on a solid, and the room that a gripper has there: compiled.


_ROLLS: Final = 8  # approaches around the line of a pinch, of a whole turn
_HIGHER: Final = (0.0, 0.004, 0.008, 0.016)
"""Meters by which a candidate stays behind the deepest one: where tips need room below."""


@kernel
def shut_along(
    kind: int, numbers: Matrix, pinches: Matrix, jaw: Vector, forces: Matrix, center: Vector,
    friction: float, found: Matrix,
) -> int:  # fmt: skip
    """Enter where pads that shut along pinches hold a solid; how many such places there are.

    Args:
        kind: Kind of the solid, as `Form.kind`.
        numbers: Its numbers, as `Form.numbers`.
        pinches: Center, axis, and direction of the first approach of each, of shape (n, 9).
        jaw: Length and width of a pad, room from the pads' middle to the palm, least width that is
            held, room of an open pad from the middle (m), most force (N), of shape (6,).
        forces: Loads at the center of mass, of shape (m, 3), N.
        center: The center of mass, of shape (3,), m.
        friction: Coefficient of friction between pads and solid.
        found: Middle of the pads, their axis, the approach, width and least force of each, of
            shape (n * 32, 11), to be filled; less deep ones after deeper ones.
    """
    count = 0
    for row in pinches:
        other = cross(row[3:6], row[6:9])
        for roll in range(_ROLLS):
            angle = roll * 2.0 * math.pi / _ROLLS
            approach = math.cos(angle) * row[6:9] + math.sin(angle) * other
            behind = reach(kind, numbers, -approach) + dot(row, approach)
            for higher in _HIGHER:
                entry = found[count]
                entry[:3] = row[:3] - (max(0.0, behind - jaw[2]) + higher) * approach
                entry[3:6] = row[3:6]
                entry[6:9] = approach
                if not _held(kind, numbers, jaw, forces, center, friction, entry):
                    break
                count += 1 if entry[10] <= jaw[5] else 0
    return count


@kernel
def _held(
    kind: int, numbers: Matrix, jaw: Vector, forces: Matrix, center: Vector, friction: float,
    entry: Vector,
) -> bool:  # fmt: skip
    """Whether pads come around the solid and shut on it; enter their middle, width and force.

    Arguments as of `shut_along`; ``entry`` is a row of ``found``, of shape (11,).
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
    at = dot(between, axis)
    beyond = max(reach(kind, numbers, axis) - at, reach(kind, numbers, -axis) + at)
    if beyond > jaw[4]:
        return False
    left = math.tan(math.atan(friction) - between[5])
    needed = pinch(forces, center - between[:3], axis, width, between[4], left)
    entry[9] = width
    entry[10] = needed.max()
    entry[:3] += dot(between[:3] - middle, axis) * axis
    return True


@kernel
def narrow(
    kind: int, numbers: Matrix, pose: Matrix, tools: Matrix, widths: Matrix, points: Matrix,
    least: float, rooms: Vector,
) -> None:  # fmt: skip
    """Lessen the room of grippers, of shape (n,), to their least distance in m from one solid.

    Args:
        kind: Kind of the solid, as `Form.kind`.
        numbers: Its numbers, as `Form.numbers`.
        pose: Pose of it in the world, of shape (4, 4).
        tools: Position and quaternion wxyz of each tool in the world, of shape (n, 7).
        widths: Openings at which each gripper is looked at, of shape (n, k), m.
        points: Points of a closed gripper in the tool frame, and by which share of half the
            opening each moves along y, of shape (m, 4), m.
        least: Room in m below which nobody asks how much less it is.
        rooms: Room of each gripper, changed.
    """
    around = _radius(points, widths.max())
    turn = np.empty((3, 3))
    for one in range(len(tools)):
        if rooms[one] < least:
            continue
        place = _into(pose, tools[one], turn)
        if distance(kind, numbers, place[0], place[1], place[2]) - around < rooms[one]:
            for opening in widths[one]:
                room = _room(kind, numbers, place, turn, opening, points, least)
                rooms[one] = min(rooms[one], room)


@kernel
def _room(
    kind: int, numbers: Matrix, place: Vector, turn: Matrix, opening: float, points: Matrix,
    least: float,
) -> float:  # fmt: skip
    """Least distance in m of a gripper from a solid, in whose frame it is; as of `narrow`."""
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
    """Distance in m from the tool frame to the farthest point of an open gripper."""
    farthest = 0.0
    for point in points:
        y = abs(point[1]) + 0.5 * widest * abs(point[3])
        farthest = max(farthest, math.sqrt(point[0] ** 2 + y * y + point[2] ** 2))
    return farthest


@kernel
def _into(pose: Matrix, tool: Vector, turn: Matrix) -> Vector:
    """Place of a tool in a frame, of shape (3,), m; enters its axes there, of shape (3, 3)."""
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
