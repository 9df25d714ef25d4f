"""What need not be asked of rays, as they have met something nearer."""

from __future__ import annotations

import math

from bt_dualarm.kernels.kernel import kernel
from bt_dualarm.pose import Matrix
from bt_dualarm.world.rendering.screen_kernels import NEAR_M

SURELY = 0.999
"""Share of the least depth of a shape that the distance of its places surely has, but rounded."""


@kernel
def is_ahead(corners: Matrix) -> bool:
    """Whether all corners were projected."""
    ahead = True
    for corner in range(len(corners)):
        ahead = ahead and -corners[corner, 2] >= NEAR_M
    return ahead


@kernel
def nearest(corners: Matrix) -> float:
    """Distance that no place of what corners span falls short of: that of a plane ahead, m."""
    least = math.inf
    for corner in range(len(corners)):
        least = min(least, -corners[corner, 2])
    return SURELY * least


@kernel
def is_hidden(box: tuple[int, int, int, int], near: float, distances: Matrix) -> bool:
    """Whether all rays of a box meet something nearer than that."""
    top, bottom, left, right = box
    for row in range(top, bottom):
        for column in range(left, right):
            if not distances[row, column] <= near:
                return False
    return True
