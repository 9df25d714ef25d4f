"""How far apart two convex shapes are: as near as is needed, and never too far.

Gilbert, Johnson and Keerthi (1988): whatever direction is looked along, the gap between the shapes
in that direction is a lower bound of their distance. It is all that is made use of, so that errors
of the iteration make distances smaller, not larger.
"""

from __future__ import annotations

import math
from typing import Final

from bt_dualarm.kernels.kernel import kernel
from bt_dualarm.motion.search.kernel_arrays import Frames, Numbers
from bt_dualarm.motion.search.simplex_kernels import POINT, nearest
from bt_dualarm.pose import Matrix

SCRATCH: Final = (8, 3)
"""Shape of what `distance` writes in."""

_CORNER: Final = 5
_ROUNDS: Final = 40
_EXACT: Final = 1e-4
"""Share of a distance to which it is found."""

_TINY: Final = 1e-9
"""Metres; shapes that are as near touch."""


@kernel
def distance(
    corners: Matrix,
    heaps: Numbers,
    frames: Frames,
    first: int,
    second: int,
    enough: float,
    least: float,
    hints: Matrix,
    pair: int,
    scratch: Matrix,
) -> float:
    """A lower bound of the distance of the corners of two shapes in m; negative: they touch.

    Args:
        corners: Corners of all shapes, as `Shapes` has them.
        heaps: Which of them are whose, as `Shapes` has them.
        frames: Where what has been moved by so many joints is, from where it was.
        first: Number of a shape.
        second: Number of another.
        enough: Metres above which nothing more is to be known.
        least: Metres below which nothing more is to be known.
        hints: Directions to begin with, from the second to the first, of shape (p, 3); renewed.
        pair: Row of theirs.
        scratch: Room to write in, of shape `SCRATCH`.
    """
    x, y, z = hints[pair, 0], hints[pair, 1], hints[pair, 2]
    lower, count = float(-math.inf), 0
    for _ in range(_ROUNDS):
        length = max(math.sqrt(x * x + y * y + z * z), _TINY)
        hints[pair, 0], hints[pair, 1], hints[pair, 2] = x, y, z
        enter_farthest(corners, heaps, frames, first, -x, -y, -z, scratch, count)
        enter_farthest(corners, heaps, frames, second, x, y, z, scratch, _CORNER)
        for i in range(3):
            scratch[count, i] -= scratch[_CORNER, i]
        gap = (x * scratch[count, 0] + y * scratch[count, 1] + z * scratch[count, 2]) / length
        lower = max(lower, gap)
        if lower >= enough or (count > 0 and length - gap <= _EXACT * length):
            break
        count = nearest(scratch, count + 1)
        x, y, z = scratch[POINT, 0], scratch[POINT, 1], scratch[POINT, 2]
        if count == 4 or math.sqrt(x * x + y * y + z * z) < max(least, _TINY):
            return float(lower - _TINY)
    return float(lower)


@kernel
def enter_farthest(
    corners: Matrix,
    heaps: Numbers,
    frames: Frames,
    shape: int,
    x: float,
    y: float,
    z: float,
    scratch: Matrix,
    row: int,
) -> None:
    """Enter the corner of a shape that lies farthest in the direction (x, y, z) into a row."""
    f = heaps[shape, 2]
    u = x * frames[f, 0, 0] + y * frames[f, 1, 0] + z * frames[f, 2, 0]
    v = x * frames[f, 0, 1] + y * frames[f, 1, 1] + z * frames[f, 2, 1]
    w = x * frames[f, 0, 2] + y * frames[f, 1, 2] + z * frames[f, 2, 2]
    best, found = -math.inf, heaps[shape, 0]
    for k in range(heaps[shape, 0], heaps[shape, 1]):
        reach = u * corners[k, 0] + v * corners[k, 1] + w * corners[k, 2]
        if reach > best:
            best, found = reach, k
    for i in range(3):
        scratch[row, i] = (
            frames[f, i, 0] * corners[found, 0]
            + frames[f, i, 1] * corners[found, 1]
            + frames[f, i, 2] * corners[found, 2]
            + frames[f, i, 3]
        )
