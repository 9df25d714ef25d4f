"""How much room an arm has in one configuration on its way: how far it may go on to both sides."""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np

from bt_dualarm.kernels.kernel import kernel
from bt_dualarm.motion.search.distance_kernels import SCRATCH, distance, enter_farthest
from bt_dualarm.motion.search.kernel_arrays import Frames, Numbers, Swept
from bt_dualarm.motion.search.placing_kernels import (
    enter_centers,
    enter_frames,
    enter_ways_here,
)
from bt_dualarm.pose import Matrix, Vector

SPARE: Final = 2.5e-3
"""Metres that shapes keep between them besides what they are to keep: to squeeze along something
closer would take many looks."""

_LEAVING: Final = 0.05
"""Near the ends of a way less than `SPARE` will do, this share of how far the arm is from there: so
it may stand close to something, and go away from it."""

_CORNER: Final = 0


class Course(NamedTuple):
    """A straight way, how far it moves the shapes, and where everything is at one place on it."""

    start: Vector
    end: Vector
    ways: Matrix
    here: Matrix
    frames: Frames
    centers: Matrix
    scratch: Matrix


@kernel
def course_of(swept: Swept, start: Vector, end: Vector) -> Course:
    """The straight way, with room for all that is to be known of it."""
    centers, dof = swept.shapes.centers, len(start)
    return Course(
        start,
        end,
        np.zeros((len(centers) + 1, dof + 1)),
        np.zeros((len(centers), dof + 1)),
        np.empty((dof + 1, 3, 4)),
        centers.copy(),
        np.empty(SCRATCH),
    )


@kernel
def go_to(swept: Swept, course: Course, share: float) -> None:
    """Enter where everything is at a place on the way."""
    joints, shapes, _ = swept
    enter_frames(joints, course.start, course.end, share, course.frames)
    enter_centers(shapes, course.frames, course.centers)
    enter_ways_here(joints, shapes, course.frames, course.centers, course.ways, course.here)


@kernel
def those_near(swept: Swept, course: Course, active: Numbers) -> int:
    """Enter the pairs that can meet on a way, from where they are in its middle; tells how many."""
    first, second, least = swept.pairs
    bounds, normals, heaps = swept.shapes.bounds, swept.shapes.normals, swept.shapes.heaps
    ways, here, centers = course.ways, course.here, course.centers
    kept = 0
    for p in range(len(first)):
        one, other = first[p], second[p]
        last, before = heaps[one, 2], heaps[other, 2]
        way, turn = ways[one + 1, last] - ways[one + 1, before], ways[0, last] - ways[0, before]
        if turn < 2.0:
            way = min(way, (here[one, last] - here[one, before]) / (1.0 - 0.5 * turn))
        if _gap(centers, bounds, normals, one, other) < least[p] + SPARE + 0.5 * way:
            active[kept] = p
            kept += 1
    return kept


@kernel
def _gap(centers: Matrix, bounds: Vector, normals: Matrix, first: int, second: int) -> float:
    """The distance of the spheres around two shapes, or of the one from a plane, in m."""
    x = centers[first, 0] - centers[second, 0]
    y = centers[first, 1] - centers[second, 1]
    z = centers[first, 2] - centers[second, 2]
    if math.isinf(bounds[second]):
        height = x * normals[second, 0] + y * normals[second, 1] + z * normals[second, 2]
        return float(height - bounds[first])
    return float(math.sqrt(x * x + y * y + z * z) - bounds[first] - bounds[second])


@kernel
def room_around(
    swept: Swept, course: Course, active: Numbers, away: float, most: float, hints: Matrix
) -> float:
    """The share of the way that the arm may go to both sides, up to ``most``; -1: it is too near.

    ``away`` is the share from here to the nearer end.

    Of a room of d metres: s with ``s W <= d``, W the most that the whole way moves a shape, or with
    ``s L <= (1 - s T) d``, where the way at the speed of now would move it by L, and turns it by T:
    levers grow by no more than it is moved.
    """
    # Fields are looked up here, not in the loop: that would count references each time.
    firsts, seconds, leasts = swept.pairs
    corners, heaps, radii, _, bounds, normals, _ = swept.shapes
    _, _, ways, here, frames, centers, scratch = course
    best = most
    for index in range(len(active)):
        p = active[index]
        first, second, least = firsts[p], seconds[p], leasts[p]
        last, before = heaps[first, 2], heaps[second, 2]
        way, turn = ways[first + 1, last] - ways[first + 1, before], ways[0, last] - ways[0, before]
        local = here[first, last] - here[first, before]
        spare = min(SPARE, _LEAVING * way * away)
        need = best * way
        if best * turn < 1.0:
            need = min(need, best * local / (1.0 - best * turn))
        enough, low = least + max(need, spare), least + spare
        if _gap(centers, bounds, normals, first, second) >= enough:
            continue
        rounding = radii[first] + radii[second]
        enough, low = enough + rounding, low + rounding
        if math.isinf(bounds[second]):
            apart = _above(corners, heaps, normals, centers, frames, first, second, scratch)
        else:
            apart = distance(corners, heaps, frames, first, second, enough, low, hints, p, scratch)
        if apart >= enough:
            continue
        active[index], active[0] = active[0], p  # the first to be asked at the next look
        if apart < low:
            return -1.0
        room = apart - rounding - least
        best = max(room / way, room / (local + room * turn))
    return best


@kernel
def _above(
    corners: Matrix,
    heaps: Numbers,
    normals: Matrix,
    places: Matrix,
    frames: Frames,
    first: int,
    plane: int,
    scratch: Matrix,
) -> float:
    """How far above a plane that stands still the lowest corner of a shape is, in m."""
    x, y, z = normals[plane, 0], normals[plane, 1], normals[plane, 2]
    enter_farthest(corners, heaps, frames, first, -x, -y, -z, scratch, _CORNER)
    return float(
        x * (scratch[_CORNER, 0] - places[plane, 0])
        + y * (scratch[_CORNER, 1] - places[plane, 1])
        + z * (scratch[_CORNER, 2] - places[plane, 2])
    )
