"""Where on the grid of a fan something is seen: cells that its rays have to be asked in."""

from __future__ import annotations

import math

from bt_dualarm.kernels.kernel import kernel
from bt_dualarm.pose import Matrix, Vector
from bt_dualarm.world.rendering.kernel_arrays import Fan

NEAR_M = 1e-3
"""What is not at least so far ahead is not projected."""

_SPARE = 0.01
"""Share of a cell that covers errors of rounding."""


@kernel
def sphere_is_seen(fan: Fan, center: Vector, radius: float) -> bool:
    """Whether a sphere reaches into the pyramid of the fan.

    Args:
        fan: The rays.
        center: Place of its centre in the camera's axes from the eye, of shape (3,), in m.
        radius: Radius in m; inf is always seen.
    """
    rows, columns = fan.rays.shape[1], fan.rays.shape[2]
    depth, x, y = -center[2], center[0] / fan.spacing, -center[1] / fan.spacing
    if depth < -radius:
        return False
    reach = radius / fan.spacing
    return _reaches(x, depth, fan.centre[0], columns, reach, fan.spacing) and _reaches(
        y, depth, fan.centre[1], rows, reach, fan.spacing
    )


@kernel
def _reaches(
    offset: float, depth: float, centre: float, count: int, reach: float, spacing: float
) -> bool:
    """Whether a sphere reaches between the planes through the first and the last border."""
    low, high = -_SPARE - centre, count + _SPARE - centre
    # A border lies at offset = border · depth; its distance is the excess by the normal's length.
    under = (low * depth - offset) / math.sqrt(1.0 + (low * spacing) ** 2)
    over = (offset - high * depth) / math.sqrt(1.0 + (high * spacing) ** 2)
    return under <= reach and over <= reach


@kernel
def project(fan: Fan, points: Matrix) -> None:
    """Enter column and row of points that lie ahead.

    Args:
        fan: The rays.
        points: Places in the camera's axes from the eye, then column and row, of shape (n, 5).
    """
    for point in points:
        depth = -point[2]
        if depth >= NEAR_M:
            scale = 1.0 / (fan.spacing * depth)
            point[3] = point[0] * scale + fan.centre[0]
            point[4] = -point[1] * scale + fan.centre[1]


@kernel
def cells(least: float, most: float, count: int) -> tuple[int, int]:
    """The first of the cells that lie between two places, and the first one after them."""
    first = min(max(least - _SPARE, 0.0), float(count))
    last = min(max(most + _SPARE, -1.0), float(count))
    # What is cut off after the point is not below 0: it is rounded down.
    return int(first), min(int(last + 1.0), count)


@kernel
def box_of(fan: Fan, points: Matrix) -> tuple[int, int, int, int]:
    """Rows from and to, columns from and to, that can meet what points span; empty: none can.

    Args:
        fan: The rays.
        points: As of `project`, which they have been through.
    """
    rows, columns = fan.rays.shape[1], fan.rays.shape[2]
    left, right, top, bottom = math.inf, -math.inf, math.inf, -math.inf
    ahead, behind = 0, 0
    for point in points:
        if point[2] >= 0.0:
            behind += 1
        if -point[2] >= NEAR_M:
            ahead += 1
            left, right = min(left, point[3]), max(right, point[3])
            top, bottom = min(top, point[4]), max(bottom, point[4])
    if ahead == len(points):
        first, last = cells(top, bottom, rows)
        start, stop = cells(left, right, columns)
        return first, last, start, stop
    beside = (
        behind == len(points)
        or _beside(points, 0, fan.centre[0], columns, fan.spacing)
        or _beside(points, 1, fan.centre[1], rows, -fan.spacing)
    )
    return (0, 0, 0, 0) if beside else (0, rows, 0, columns)


@kernel
def _beside(points: Matrix, axis: int, centre: float, count: int, spacing: float) -> bool:
    """Whether all points, some of them behind the eye, lie on the outer side of one border."""
    under, over = True, True
    for point in points:
        offset, depth = point[axis] / spacing, -point[2]
        under = under and offset + (centre + _SPARE) * depth < 0.0
        over = over and offset + (centre - count - _SPARE) * depth > 0.0
    return under or over
