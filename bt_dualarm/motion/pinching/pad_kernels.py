"""What flat pads meet when they shut on a solid, and the force that bears loads: compiled."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from bt_dualarm.kernels.kernel import kernel
from bt_dualarm.motion.pinching.solid_kernels import cross, distance, dot, length, reach
from bt_dualarm.pose import Matrix, Vector

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
    outside, back = reach(kind, numbers, normal), -normal
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
    """After how many metres a ray meets a solid; infinite where it passes by."""
    gone = 0.0
    for _ in range(_STEPS):
        x, y = point[0] + gone * direction[0], point[1] + gone * direction[1]
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
    least, count = gone.min() + PRESSED, 0
    met[:] = 0.0
    for one in range(len(points)):
        if gone[one] > least:
            continue
        count += 1
        for axis in range(3):
            points[one, axis] -= gone[one] * normal[axis]
            met[axis] += points[one, axis]
    met[:3] /= count
    lever, cosine = 0.0, -1.0
    for one in range(len(points)):
        if gone[one] > least:
            continue
        x, y, z = points[one, 0], points[one, 1], points[one, 2]
        lever += math.sqrt((x - met[0]) ** 2 + (y - met[1]) ** 2 + (z - met[2]) ** 2) / count
        cosine = max(cosine, _cosine(kind, numbers, x, y, z, normal))
    met[3], met[4] = count / len(points), max(lever, _SPOT)
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
    one, other = np.empty(6), np.empty(6)
    if not press(kind, numbers, center, axis, along, size, one):
        return False
    if not press(kind, numbers, center, -axis, along, size, other):
        return False
    line = one[:3] - other[:3]
    width = dot(line, axis)
    if width > 0.0:
        skew = math.acos(min(max(width / length(line), 0.0), 1.0))
        between[:3], between[3] = 0.5 * (one[:3] + other[:3]), width
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
        pressing, turning = dot(force, axis), dot(moment, axis)
        if lever <= 0.0 and 0.5 * abs(turning) > 1e-9:
            return np.full(len(forces), np.inf)
        across = length(force - pressing * axis)
        sliding = 0.5 * across + length(moment - turning * axis) / width
        twisting = 0.5 * abs(turning) / max(lever, 1e-9)
        needed[i] = math.hypot(sliding, twisting) / friction + 0.5 * abs(pressing)
    return needed
