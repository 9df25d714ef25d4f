"""Whether newest sightings of a target are elsewhere than its first ones; see `Stillness`."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from bt_dualarm.kernels.kernel import kernel
from bt_dualarm.pose import Matrix, Vector

COLUMNS: Final = 5
"""Numbers of a sighting: place of the camera along the plane (2), slope (2), variance."""

VARIANCE: Final = 4

FIRST: Final = 24
"""First sightings that make a mean."""

FEWEST: Final = 3
"""Newest sightings all of which have to be elsewhere."""

_SIGMAS: Final = 6.0  # of a mean: exceeded at rest once in 10⁷ frames, and by 2.5 mm hardly ever
_DOUBLINGS: Final = 5  # of the count of newest sightings whose mean is compared


@kernel
def scatter(newest: Matrix, depth: float) -> float:
    """Standard deviation of a sighting along an axis: as expected, or as seen if that is more.

    Seen in third differences, which smooth movement does not enter (with first ones: Rice,
    Annals of Statistics 12, 1984).
    """
    count, expected, bends = len(newest), 0.0, 0.0
    for number in range(count):
        expected += newest[number, VARIANCE]
    for number in range(count - 3):
        for axis in range(2):
            bend = 0.0
            for after, share in enumerate((-1.0, 3.0, -3.0, 1.0)):
                row = newest[number + after]
                bend += share * (row[axis] + depth * row[2 + axis])
            bends += bend * bend
    measured = bends / (2.0 * (count - 3)) / 20.0 if count > 3 else 0.0
    return math.sqrt(max(expected / count, measured))


@kernel
def has_moved(
    rows: Matrix, leaving: int, firsts: Matrix, depth: float, doubt: float, far: float
) -> bool:
    """Whether the newest sightings, of however many, are farther from the first ones than `far`.

    Args:
        rows: Sightings of late, oldest first, of shape (n, `COLUMNS`).
        leaving: Number of those that are no more among the newest.
        firsts: Means of the first ones, by slope, of shape (m, `COLUMNS`).
        depth: Distance at which the target is believed to be, in m.
        doubt: Factor by which it may be larger or smaller.
        far: Distance in m.
    """
    newest = rows[leaving:]
    now, then = np.zeros(COLUMNS), np.empty(COLUMNS)
    sigma, taken, count = scatter(newest, depth), 0, FEWEST
    for _ in range(_DOUBLINGS):
        if count > len(newest) or (len(firsts) == 0 and count >= len(rows)):
            break
        for number in range(taken, count):
            now += newest[len(newest) - 1 - number]
        taken = count
        of = FIRST if len(firsts) else min(len(rows) - count, FIRST)
        allowed = _SIGMAS * sigma * math.sqrt(1.0 / count + 1.0 / of)
        for number in range(max(len(firsts), 1)):
            if len(firsts):
                then[:] = firsts[number]
            else:
                then[:] = 0.0
                for early in range(of):
                    then += rows[early]
                then /= of
            if _excess(now / count, then, allowed, depth, doubt) > far and _is_apart(
                newest, then, depth, doubt, far
            ):
                return True
        count *= 2
    return False


@kernel
def _is_apart(newest: Matrix, then: Vector, depth: float, doubt: float, far: float) -> bool:
    """Whether all of the last are: one or two sightings far off move a mean, too."""
    apart = True
    for number in range(len(newest) - FEWEST, len(newest)):
        apart = apart and _excess(newest[number], then, 0.0, depth, doubt) > far
    return apart


@kernel
def _excess(now: Vector, then: Vector, allowed: float, depth: float, doubt: float) -> float:
    """How far it moved at least, in m, less what the scatter explains, whatever the depth.

    The least of |e + z s| - z a over z, the depth as a share of the believed one: of a convex
    function, in closed form.
    """
    x, y = now[0] - then[0], now[1] - then[1]
    u, v = depth * (now[2] - then[2]), depth * (now[3] - then[3])
    length = max(math.sqrt(u * u + v * v), 1e-9)
    along = (x * u + y * v) / length
    across = math.sqrt(max(x * x + y * y - along * along, 0.0))
    share = doubt
    if allowed < length:
        steep = math.sqrt(max(length * length - allowed * allowed, 1e-18))
        share = min(max((allowed * across / steep - along) / length, 1.0 / doubt), doubt)
    return math.hypot(along + share * length, across) - share * allowed
