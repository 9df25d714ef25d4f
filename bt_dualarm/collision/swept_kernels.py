"""How far an arm may move in joint space before it comes too near to something: compiled."""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np

from bt_dualarm.collision.convex_distance_kernels import SCRATCH, distance, enter_farthest
from bt_dualarm.collision.kernel_arrays import ConvexShapes, Frames, Joints, Numbers, SweptArm
from bt_dualarm.core.kernel import kernel
from bt_dualarm.core.pose import Matrix, Vector

# Where an arm's shapes are in a configuration, and how far they get on a straight way.


@kernel
def enter_frames(joints: Joints, start: Vector, end: Vector, share: float, frames: Frames) -> None:
    """Enter where what is moved by 0, 1, ... joints goes from where it is in the reference.

    Products of exponentials (Lynch and Park, Modern Robotics, 2017, 4.1).

    Args:
        joints: Joints of the arm.
        start: Configuration of shape (dof,), rad.
        end: Another, likewise.
        share: Share of the straight way from the one to the other.
        frames: Transforms, of shape (dof + 1, 3, 4), to be entered.
    """
    reference, anchors, axes = joints
    for i in range(3):
        for j in range(4):
            frames[0, i, j] = 1.0 if i == j else 0.0
    for k in range(len(start)):
        angle = start[k] + share * (end[k] - start[k]) - reference[k]
        sine = math.sin(angle)
        rest = 1.0 - math.cos(angle)
        x = axes[k, 0]
        y = axes[k, 1]
        z = axes[k, 2]
        # Rodrigues: the identity, the axis' cross product, and its square.
        xx = 1.0 - rest * (y * y + z * z)
        xy = rest * x * y - sine * z
        xz = rest * x * z + sine * y
        yx = rest * x * y + sine * z
        yy = 1.0 - rest * (x * x + z * z)
        yz = rest * y * z - sine * x
        zx = rest * x * z - sine * y
        zy = rest * y * z + sine * x
        zz = 1.0 - rest * (x * x + y * y)
        for i in range(3):
            a = frames[k, i, 0]
            b = frames[k, i, 1]
            c = frames[k, i, 2]
            u = a * xx + b * yx + c * zx
            v = a * xy + b * yy + c * zy
            w = a * xz + b * yz + c * zz
            frames[k + 1, i, 0] = u
            frames[k + 1, i, 1] = v
            frames[k + 1, i, 2] = w
            frames[k + 1, i, 3] = (
                frames[k, i, 3]
                + (a - u) * anchors[k, 0]
                + (b - v) * anchors[k, 1]
                + (c - w) * anchors[k, 2]
            )


@kernel
def enter_centers(shapes: ConvexShapes, frames: Frames, centers: Matrix) -> None:
    """Enter where the centers of those shapes are that move, of shape (n, 3), m."""
    heaps = shapes.heaps
    references = shapes.centers
    for n in range(len(centers)):
        f = heaps[n, 2]
        if f == 0:
            continue
        x = references[n, 0]
        y = references[n, 1]
        z = references[n, 2]
        for i in range(3):
            centers[n, i] = (
                frames[f, i, 0] * x + frames[f, i, 1] * y + frames[f, i, 2] * z + frames[f, i, 3]
            )


@kernel
def enter_ways(shapes: ConvexShapes, start: Vector, end: Vector, ways: Matrix) -> None:
    """Enter how far the shapes move at most on the way, by joints 0 to k, wherever the arm is.

    Args:
        shapes: The shapes.
        start: Configuration of shape (dof,), rad.
        end: Another, likewise.
        ways: Sums over joints, those of all shapes in the first row: radians; then of each shape,
            meters: of shape (1 + n, dof + 1), to be entered.
    """
    heaps = shapes.heaps
    reaches = shapes.reaches
    for k in range(len(start)):
        ways[0, k + 1] = ways[0, k] + abs(end[k] - start[k])
    for n in range(len(reaches)):
        for k in range(heaps[n, 2]):
            ways[n + 1, k + 1] = ways[n + 1, k] + abs(end[k] - start[k]) * reaches[n, k]


@kernel
def enter_ways_here(
    joints: Joints,
    shapes: ConvexShapes,
    frames: Frames,
    centers: Matrix,
    ways: Matrix,
    here: Matrix,
) -> None:
    """Enter how fast the shapes move at most on the way where they are now, as `enter_ways`.

    Args:
        joints: Joints of the arm.
        shapes: The shapes.
        frames: As of `enter_frames`.
        centers: As of `enter_centers`.
        ways: As of `enter_ways`.
        here: Meters for the whole of the way at the speed of now, of shape (n, dof + 1), to be
            entered.
    """
    _, anchors, axes = joints
    heaps = shapes.heaps
    bounds = shapes.bounds
    for k in range(len(axes)):
        turn = ways[0, k + 1] - ways[0, k]
        ax = _turned(frames, k, 0, axes)
        ay = _turned(frames, k, 1, axes)
        az = _turned(frames, k, 2, axes)
        px = _turned(frames, k, 0, anchors) + frames[k, 0, 3]
        py = _turned(frames, k, 1, anchors) + frames[k, 1, 3]
        pz = _turned(frames, k, 2, anchors) + frames[k, 2, 3]
        for n in range(len(bounds)):
            if heaps[n, 2] > k:
                x = centers[n, 0] - px
                y = centers[n, 1] - py
                z = centers[n, 2] - pz
                u = y * az - z * ay
                v = z * ax - x * az
                w = x * ay - y * ax
                lever = math.sqrt(u * u + v * v + w * w) + bounds[n]
                here[n, k + 1] = here[n, k] + turn * lever


@kernel
def _turned(frames: Frames, k: int, i: int, vectors: Matrix) -> float:
    """Coordinate i of vector k, which the joints before it have turned."""
    return float(
        frames[k, i, 0] * vectors[k, 0]
        + frames[k, i, 1] * vectors[k, 1]
        + frames[k, i, 2] * vectors[k, 2]
    )


# How much room an arm has in one configuration on its way: how far it may go on to both sides.


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
def course_of(swept: SweptArm, start: Vector, end: Vector) -> Course:
    """The straight way, with room for all that is to be known of it."""
    centers = swept.shapes.centers
    dof = len(start)
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
def go_to(swept: SweptArm, course: Course, share: float) -> None:
    """Enter where everything is at a place on the way."""
    joints, shapes, _, _ = swept
    enter_frames(joints, course.start, course.end, share, course.frames)
    enter_centers(shapes, course.frames, course.centers)
    enter_ways_here(joints, shapes, course.frames, course.centers, course.ways, course.here)


@kernel
def those_near(swept: SweptArm, course: Course, active: Numbers) -> int:
    """Enter the pairs that can meet on a way, from where they are in its middle; tells how many."""
    first, second, least, _ = swept.pairs
    bounds = swept.shapes.bounds
    normals = swept.shapes.normals
    heaps = swept.shapes.heaps
    ways = course.ways
    here = course.here
    centers = course.centers
    kept = 0
    for p in range(len(first)):
        one = first[p]
        other = second[p]
        last = heaps[one, 2]
        before = heaps[other, 2]
        way = ways[one + 1, last] - ways[one + 1, before]
        turn = ways[0, last] - ways[0, before]
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
    swept: SweptArm, course: Course, active: Numbers, away: float, most: float, hints: Matrix
) -> float:
    """The share of the way that the arm may go to both sides, up to ``most``; -1: it is too near.

    Of a room of d meters: s with ``s W <= d``, W the most that the whole way moves a shape, or with
    ``s L <= (1 - s T) d``, where the way at the speed of now would move it by L, and turns it by T:
    levers grow by no more than it is moved. ``away`` is the share from here to the nearer end.
    """
    # Fields are looked up here, not in the loop: that would count references each time.
    firsts, seconds, leasts, aparts = swept.pairs
    corners, heaps, radii, _, bounds, turns, halves, normals, _ = swept.shapes
    _, _, ways, here, frames, centers, scratch, needs = course
    best = most
    usual = swept.spare
    for index in range(len(active)):
        p = active[index]
        first = firsts[p]
        second = seconds[p]
        least = leasts[p]
        if index == 1:  # the nearest one has been looked at
            enter_needs(heaps, ways, here, best, needs)
        gap = _gap(centers, bounds, normals, first, second) - least
        if index and gap >= max(needs[first], usual):
            continue
        last = heaps[first, 2]
        before = heaps[second, 2]
        way = ways[first + 1, last] - ways[first + 1, before]
        turn = ways[0, last] - ways[0, before]
        local = here[first, last] - here[first, before]
        spare = min(usual, _LEAVING * way * away)
        enough = max(_need(best, way, local, turn), spare)
        low = spare
        by_box = _boxes_gap(frames, heaps, turns, halves, bounds, centers, first, second)
        if by_box >= enough + least:
            continue
        rounding = radii[first] + radii[second] + least
        enough = enough + rounding
        low = low + rounding
        if math.isinf(bounds[second]):
            apart = _above(corners, heaps, normals, centers, frames, first, second, scratch)
        else:
            if least < 0.0:  # they may touch, where only this direction tells how deep
                hints[p] = aparts[p]
            apart = distance(corners, heaps, frames, first, second, enough, low, hints, p, scratch)
        if apart >= enough:
            continue
        # the first to be asked at the next look
        active[index] = active[0]
        active[0] = p
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
    """The distance of the center of a shape from the box around another one, in m."""
    f = heaps[boxed, 2]
    square = 0.0
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
    """Meters of room that are needed for a share of the way, as `room_around` has it."""
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
    x = normals[plane, 0]
    y = normals[plane, 1]
    z = normals[plane, 2]
    enter_farthest(corners, heaps, frames, first, -x, -y, -z, scratch, _CORNER)
    return float(
        x * (scratch[_CORNER, 0] - places[plane, 0])
        + y * (scratch[_CORNER, 1] - places[plane, 1])
        + z * (scratch[_CORNER, 2] - places[plane, 2])
    )


# How far an arm gets on a straight way in joint space before it comes too near to something.
#
# Conservative advancement: where everything keeps its distance, the arm may go on as far as none of
# its points moves by more than that, whatever lies between.


WHOLE: Final = 1.0
"""Share of a way that it is worth to know of whoever needs all of it, or nothing."""

_SHORT: Final = 1e-4
"""Meters that are not looked at any closer."""

_SHORT_END: Final = 4e-4
"""Likewise at the ends of a way, where the arm can stand, and may touch what it touches there."""

_DEEPEST: Final = 64
"""Parts of a way that can be left to look at; each is less than half of the one before it."""

_FARTHEST: Final = 0.1
"""Meters of room that are of use from one configuration of many to the next."""


@kernel
def free_share(
    swept: SweptArm, start: Vector, end: Vector, worth: float, hints: Matrix, spent: Numbers
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
    swept: SweptArm, course: Course, active: Numbers, worth: float, hints: Matrix, spent: Numbers
) -> float:
    """As `free_share`, once it is known which pairs can meet: from the middle, then left to right.

    A look covers the way on both sides of it; what is left of it is looked at before what is right.
    """
    lows = np.zeros(_DEEPEST)
    highs = np.ones(_DEEPEST)
    left = 1
    farthest = 1.0
    most = course.ways[1:].max()
    while left:
        left -= 1
        low = lows[left]
        high = highs[left]
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
            farthest = middle
            lows[0] = low
            highs[0] = middle
            left = 1
            continue
        if middle + around < high:
            lows[left] = middle + around
            highs[left] = high
            left = left + 1
        if middle - around > low:
            lows[left] = low
            highs[left] = middle - around
            left = left + 1
    return farthest


@kernel
def first_too_near(
    swept: SweptArm, rows: Matrix, radii: Vector, hints: Matrix, spent: Numbers
) -> int:
    """The first of many configurations on the way to which something comes too near.

    Args:
        swept: The arm in its world.
        rows: Configurations, of shape (n, dof), rad; the arm can stand in the first and the last.
        radii: Meters that the arm moves at most per radian of each joint, of shape (dof,).
        hints: As of `free_share`.
        spent: As of `free_share`.

    Returns:
        Number of the configuration; n where there is none.
    """
    count = len(rows)
    shapes = swept.shapes
    course = course_of(swept, rows[0], rows[0])
    heaps = shapes.heaps
    for n in range(len(heaps)):  # so that a share of the way is a meter
        course.ways[n + 1, heaps[n, 2]] = course.here[n, heaps[n, 2]] = 1.0
    moved = np.zeros(count)
    for i in range(1, count):
        moved[i] = moved[i - 1] + np.sum(np.abs(rows[i] - rows[i - 1]) * radii)
    active = np.arange(len(swept.pairs.least))
    until = 0.0
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
