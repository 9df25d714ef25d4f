"""What each ray of a fan meets first."""

from __future__ import annotations

import math

import numpy as np

from bt_dualarm.kernels.kernel import kernel
from bt_dualarm.pose import Matrix, Vector
from bt_dualarm.world.rendering.hull_kernels import meet_hull
from bt_dualarm.world.rendering.kernel_arrays import HULL, Fan, Hits, Numbers, Shapes
from bt_dualarm.world.rendering.round_kernels import meet_round
from bt_dualarm.world.rendering.screen_kernels import sphere_is_seen


@kernel
def trace(shapes: Shapes, places: Matrix, axes: Matrix, fan: Fan, hits: Hits) -> None:
    """Enter the nearest surfaces into the hits.

    Args:
        shapes: The shapes of n geoms.
        places: Places of all geoms of the model, of shape (ngeom, 3), in m.
        axes: Axes of all geoms of the model, row by row, of shape (ngeom, 9).
        fan: The rays.
        hits: What they meet.
    """
    eye, turn = np.empty(3), np.empty((3, 3))
    for index in _ahead(shapes, places, fan):
        geom = shapes.geoms[index]
        own = axes[geom].reshape(3, 3)
        for one in range(3):
            eye[one] = 0.0
            for other in range(3):
                eye[one] += (fan.eye[other] - places[geom, other]) * own[other, one]
                turn[one, other] = 0.0
                for between in range(3):
                    turn[one, other] += own[between, one] * fan.axes[between, other]
        if shapes.kinds[index] == HULL:
            meet_hull(shapes, index, eye, turn, own, fan, hits)
        else:
            meet_round(shapes, index, eye, turn, own, fan, hits)


@kernel
def _ahead(shapes: Shapes, places: Matrix, fan: Fan) -> Numbers:
    """Numbers of the shapes whose bounding sphere reaches into the fan, planes last.

    In the order of distance; of shapes that lie in one surface, the first is seen.
    """
    count = len(shapes.geoms)
    closest, center = np.empty(count), np.empty(3)
    for index in range(count):
        closest[index] = math.nan
        for axis in range(3):
            center[axis] = 0.0
            for along in range(3):
                offset = places[shapes.geoms[index], along] - fan.eye[along]
                center[axis] += offset * fan.axes[along, axis]
        radius = shapes.radii[index]
        if sphere_is_seen(fan, center, radius):
            away = math.sqrt(center[0] ** 2 + center[1] ** 2 + center[2] ** 2)
            closest[index] = math.inf if math.isinf(radius) else max(away - radius, 0.0)
    return _by_distance(closest)


@kernel
def _by_distance(closest: Vector) -> Numbers:
    """Numbers of those that are not NaN, nearest first, equal ones as they come."""
    order = np.empty(len(closest), np.int64)
    filled = 0
    for index in range(len(closest)):
        if math.isnan(closest[index]):
            continue
        place = filled
        while place > 0 and closest[order[place - 1]] > closest[index]:
            order[place] = order[place - 1]
            place -= 1
        order[place] = index
        filled += 1
    return order[:filled]
