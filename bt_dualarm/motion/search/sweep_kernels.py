"""How far an arm gets on a straight way in joint space before it comes too near to something.

Conservative advancement: where everything keeps its distance, the arm may go on as far as none of
its points moves by more than that, whatever lies between.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from bt_dualarm.kernels.kernel import kernel
from bt_dualarm.motion.search.kernel_arrays import Numbers, Swept
from bt_dualarm.motion.search.placing_kernels import enter_centers, enter_frames, enter_ways
from bt_dualarm.motion.search.room_kernels import (
    Course,
    course_of,
    go_to,
    room_around,
    those_near,
)
from bt_dualarm.pose import Matrix, Vector

WHOLE: Final = 1.0
"""Share of a way that it is worth to know of whoever needs all of it, or nothing."""

_SHORT: Final = 1e-4
"""Metres that are not looked at any closer."""

_SHORT_END: Final = 4e-4
"""Likewise at the ends of a way, where the arm can stand, and may touch what it touches there."""

_DEEPEST: Final = 64
"""Parts of a way that can be left to look at; each is less than half of the one before it."""

_FARTHEST: Final = 0.1
"""Metres of room that are of use from one configuration of many to the next."""


@kernel
def free_share(
    swept: Swept, start: Vector, end: Vector, worth: float, hints: Matrix, spent: Numbers
) -> float:
    """The share of a straight way, from its start, on which everything keeps its distance.

    Args:
        swept: The arm in its world.
        start: Configuration of shape (dof,), rad, in which the arm can stand.
        end: Configuration of shape (dof,), rad.
        worth: Least share by which it is worth to know better how far it is free.
        hints: Directions in which each pair was apart when it was looked at last, of shape (p, 3);
            they are renewed.
        spent: Number of configurations that were looked at, of shape (1,); it grows.

    Returns:
        From 0 to 1; less than 1 where not all of it is free.
    """
    course = course_of(swept, start, end)
    enter_ways(swept.shapes, start, end, course.ways)
    go_to(swept, course, 0.5)
    active = np.empty(len(swept.pairs.least), np.int64)
    active = active[: those_near(swept, course, active)]
    spent[0] += 1
    return _explored(swept, course, active, worth, hints, spent) if len(active) else 1.0


@kernel
def _explored(
    swept: Swept, course: Course, active: Numbers, worth: float, hints: Matrix, spent: Numbers
) -> float:
    """As `free_share`, once it is known which pairs can meet: from the middle, then left to right.

    A look covers the way on both sides of it; what is left of it is looked at before what is right.
    """
    lows, highs = np.zeros(_DEEPEST), np.ones(_DEEPEST)
    left, farthest, most = 1, 1.0, course.ways[1:].max()
    while left:
        left -= 1
        low, high = lows[left], highs[left]
        if (high - low) * most < (_SHORT if low > 0.0 and high < 1.0 else _SHORT_END):
            continue
        middle = 0.5 * (low + high)
        go_to(swept, course, middle)
        spent[0] += 1
        away = min(middle, 1.0 - middle)
        around = room_around(swept, course, active, away, 1.0, hints)
        if around < 0.0:
            if middle - low < worth:
                return float(low)
            farthest, lows[0], highs[0], left = middle, low, middle, 1
            continue
        if middle + around < high:
            lows[left], highs[left], left = middle + around, high, left + 1
        if middle - around > low:
            lows[left], highs[left], left = low, middle - around, left + 1
    return farthest


@kernel
def first_too_near(swept: Swept, rows: Matrix, radii: Vector, hints: Matrix, spent: Numbers) -> int:
    """The first of many configurations on the way to which something comes too near.

    Args:
        swept: The arm in its world.
        rows: Configurations, of shape (n, dof), rad; the arm can stand in the first and the last.
        radii: Metres that the arm moves at most per radian of each joint, of shape (dof,).
        hints: As of `free_share`.
        spent: As of `free_share`.

    Returns:
        Number of the configuration; n where there is none.
    """
    count, shapes = len(rows), swept.shapes
    course = course_of(swept, rows[0], rows[0])
    heaps = shapes.heaps
    for n in range(len(heaps)):  # so that a share of the way is a metre
        course.ways[n + 1, heaps[n, 2]] = course.here[n, heaps[n, 2]] = 1.0
    moved = np.zeros(count)
    for i in range(1, count):
        moved[i] = moved[i - 1] + np.sum(np.abs(rows[i] - rows[i - 1]) * radii)
    active, until = np.arange(len(swept.pairs.least)), 0.0
    for i in range(1, count):
        if moved[i] <= until:
            continue
        room = 0.0
        if _SHORT_END < moved[i] < moved[-1] - _SHORT_END:
            enter_frames(swept.joints, rows[i], rows[i], 0.0, course.frames)
            enter_centers(shapes, course.frames, course.centers)
            spent[0] += 1
            room = room_around(swept, course, active, 0.0, _FARTHEST, hints)
            if room < 0.0:
                return i
        gap = moved[i] - room - until
        if gap > _SHORT and free_share(swept, rows[i - 1], rows[i], WHOLE, hints, spent) < 1.0:
            return i
        until = moved[i] + room
    return count
