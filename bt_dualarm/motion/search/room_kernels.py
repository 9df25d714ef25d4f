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

_LEAVING: Final = 0.05
"""Near the ends of a way less than what is to spare will do, this share of how far the arm is from
there: so it may stand close to something, and go away from it."""

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
    needs: Vector


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
        np.empty(len(centers)),
    )


@kernel
def go_to(swept: Swept, course: Course, share: float) -> None:
    """Enter where everything is at a place on the way."""
    joints, shapes, _, _ = swept
    enter_frames(joints, course.start, course.end, share, course.frames)
    enter_centers(shapes, course.frames, course.centers)
    enter_ways_here(joints, shapes, course.frames, course.centers, course.ways, course.here)


@kernel
def those_near(swept: Swept, course: Course, active: Numbers) -> int:
    """Enter the pairs that can meet on a way, from where they are in its middle; tells how many."""
    first, second, least, _ = swept.pairs
    bounds, normals, heaps = swept.shapes.bounds, swept.shapes.normals, swept.shapes.heaps
    ways, here, centers = course.ways, course.here, course.centers
    kept = 0
    for p in range(len(first)):
        one, other = first[p], second[p]
        last, before = heaps[one, 2], heaps[other, 2]
        way, turn = ways[one + 1, last] - ways[one + 1, before], ways[0, last] - ways[0, before]
        if turn < 2.0:
            way = min(way, (here[one, last] - here[one, before]) / (1.0 - 0.5 * turn))
        if _gap(centers, bounds, normals, one, other) < least[p] + swept.spare + 0.5 * way:
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

    Of a room of d metres: s with ``s W <= d``, W the most that the whole way moves a shape, or with
    ``s L <= (1 - s T) d``, where the way at the speed of now would move it by L, and turns it by T:
    levers grow by no more than it is moved. ``away`` is the share from here to the nearer end.
    """
    # Fields are looked up here, not in the loop: that would count references each time.
    firsts, seconds, leasts, aparts = swept.pairs
    corners, heaps, radii, _, bounds, turns, halves, normals, _ = swept.shapes
    _, _, ways, here, frames, centers, scratch, needs = course
    best, usual = most, swept.spare
    for index in range(len(active)):
        p = active[index]
        first, second, least = firsts[p], seconds[p], leasts[p]
        if index == 1:  # the nearest one has been looked at
            enter_needs(heaps, ways, here, best, needs)
        gap = _gap(centers, bounds, normals, first, second) - least
        if index and gap >= max(needs[first], usual):
            continue
        last, before = heaps[first, 2], heaps[second, 2]
        way, turn = ways[first + 1, last] - ways[first + 1, before], ways[0, last] - ways[0, before]
        local, spare = here[first, last] - here[first, before], min(usual, _LEAVING * way * away)
        enough, low = max(_need(best, way, local, turn), spare), spare
        by_box = _boxes_gap(frames, heaps, turns, halves, bounds, centers, first, second)
        if by_box >= enough + least:
            continue
        rounding = radii[first] + radii[second] + least
        enough, low = enough + rounding, low + rounding
        if math.isinf(bounds[second]):
            apart = _above(corners, heaps, normals, centers, frames, first, second, scratch)
        else:
            if least < 0.0:  # they may touch, where only this direction tells how deep
                hints[p] = aparts[p]
            apart = distance(corners, heaps, frames, first, second, enough, low, hints, p, scratch)
        if apart >= enough:
            continue
        active[index], active[0] = active[0], p  # the first to be asked at the next look
        if apart < low:
            return -1.0
        room = apart - rounding
        best = max(room / way, room / (local + room * turn))
    return float(best)


@kernel
def _boxes_gap(
    frames: Frames,
    heaps: Numbers,
    turns: Frames,
    halves: Matrix,
    bounds: Vector,
    centers: Matrix,
    first: int,
    second: int,
) -> float:
    """The distance of the box around one shape from the sphere around the other, in m."""
    if math.isinf(bounds[second]):
        return -1.0
    one = _box_gap(frames, heaps, turns, halves, centers, second, first) - bounds[first]
    other = _box_gap(frames, heaps, turns, halves, centers, first, second) - bounds[second]
    return float(max(one, other))


@kernel
def _box_gap(
    frames: Frames,
    heaps: Numbers,
    turns: Frames,
    halves: Matrix,
    centers: Matrix,
    boxed: int,
    other: int,
) -> float:
    """The distance of the centre of a shape from the box around another one, in m."""
    f, square = heaps[boxed, 2], 0.0
    x = centers[other, 0] - centers[boxed, 0]
    y = centers[other, 1] - centers[boxed, 1]
    z = centers[other, 2] - centers[boxed, 2]
    u = frames[f, 0, 0] * x + frames[f, 1, 0] * y + frames[f, 2, 0] * z
    v = frames[f, 0, 1] * x + frames[f, 1, 1] * y + frames[f, 2, 1] * z
    w = frames[f, 0, 2] * x + frames[f, 1, 2] * y + frames[f, 2, 2] * z
    for i in range(3):
        along = turns[boxed, 0, i] * u + turns[boxed, 1, i] * v + turns[boxed, 2, i] * w
        beyond = max(abs(along) - halves[boxed, i], 0.0)
        square += beyond * beyond
    return math.sqrt(square)


@kernel
def _need(share: float, way: float, local: float, turn: float) -> float:
    """Metres of room that are needed for a share of the way, as `room_around` has it."""
    if share * turn < 1.0:
        return min(share * way, share * local / (1.0 - share * turn))
    return share * way


@kernel
def enter_needs(heaps: Numbers, ways: Matrix, here: Matrix, share: float, needs: Vector) -> None:
    """Enter the room that each shape needs for a share of the way, from what stands still, in m."""
    for n in range(len(needs)):
        last = heaps[n, 2]
        needs[n] = _need(share, ways[n + 1, last], here[n, last], ways[0, last])


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
