"""Continuous collision checks of straight segments in joint space by conservative advancement.

While two shapes are a distance d apart, the arm may move until one has moved by d relative to the
other, whatever lies in between (B. Mirtich, Impulse-based Dynamic Simulation of Rigid Body Systems,
PhD thesis, UC Berkeley, 1996). `free_share` covers a segment with such intervals: no obstacle is
too thin to be found. `first_too_near` does the same for many configurations of one path.

Bounds of motion are in meters for the whole segment, so that a share of it in [0, 1] times a bound
is the motion on that share.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np

from bt_dualarm.collision.distance_kernels import SCRATCH, distance, write_support_point
from bt_dualarm.collision.kernel_arrays import ConvexShapes, Frames, Joints, Numbers, SweptArm
from bt_dualarm.core.kernel import kernel
from bt_dualarm.core.pose import Matrix, Vector

WHOLE: Final = 1.0
"""Resolution for callers that need to know only whether all of a segment is free."""

_SHORT: Final = 1e-4
"""Motion of the arm that needs no closer look, m."""

_SHORT_END: Final = 4e-4
"""Likewise at the ends of a segment, m, where the arm is known to be free or in allowed contact."""

_DEEPEST: Final = 64
"""Capacity of the stack of open intervals; each is less than half as long as the one below it."""

_FARTHEST: Final = 0.1
"""Largest useful room around one of many configurations, m."""

_LEAVING: Final = 0.05
"""Clearance per distance from the nearer end of a segment, up to the full clearance: the arm may
begin close to an obstacle and depart from it."""

_CORNER: Final = 0
"""Row of the scratch array for a support point."""


class Segment(NamedTuple):
    """A straight segment in joint space, with the state of the arm at one configuration on it.

    Attributes:
        start: First configuration, of shape (dof,), rad.
        end: Last configuration, of shape (dof,), rad.
        travel: As in `write_travel`.
        local: As in `write_local_travel`.
        frames: As in `write_frames`.
        centers: As in `write_centers`.
        scratch: Scratch array of `distance`.
        needs: As in `write_needs`.
    """

    start: Vector
    end: Vector
    travel: Matrix
    local: Matrix
    frames: Frames
    centers: Matrix
    scratch: Matrix
    needs: Vector


@kernel
def free_share(
    swept: SweptArm, start: Vector, end: Vector, resolution: float, hints: Matrix, checks: Numbers
) -> float:
    """Fraction of a segment, from its start, on which all pairs keep their smallest distances.

    Args:
        swept: The arm in its world.
        start: Configuration of shape (dof,), rad, known to be free.
        end: Configuration of shape (dof,), rad.
        resolution: Accuracy of the result if the segment is not free, as a fraction of it.
        hints: Separating direction of each pair when last computed, of shape (p, 3); updated.
        checks: Number of configurations checked, of shape (1,); incremented.

    Returns:
        Share in [0, 1]; less than 1 if not all of the segment is free.
    """
    segment = segment_of(swept, start, end)
    write_travel(swept.shapes, start, end, segment.travel)
    move_to(swept, segment, 0.5)
    active = np.empty(len(swept.pairs.least), np.int64)
    active = active[: select_active_pairs(swept, segment, active)]
    checks[0] += 1
    return _explore(swept, segment, active, resolution, hints, checks) if len(active) else 1.0


@kernel
def _explore(
    swept: SweptArm,
    segment: Segment,
    active: Numbers,
    resolution: float,
    hints: Matrix,
    checks: Numbers,
) -> float:
    """`free_share` for the pairs that can collide: by bisection, the left half first.

    Each check covers an interval on both sides of its configuration.
    """
    lows = np.zeros(_DEEPEST)
    highs = np.ones(_DEEPEST)
    left = 1
    farthest = 1.0
    most = segment.travel[1:].max()
    # Depth first: the left part is pushed last, so that the result is the first blocked interval.
    while left:
        left -= 1
        low = lows[left]
        high = highs[left]
        if (high - low) * most < (_SHORT if low > 0.0 and high < 1.0 else _SHORT_END):
            continue
        middle = 0.5 * (low + high)
        move_to(swept, segment, middle)
        checks[0] += 1
        away = min(middle, 1.0 - middle)
        around = share_around(swept, segment, active, away, 1.0, hints)
        if around < 0.0:
            if middle - low < resolution:
                return float(low)
            # Blocked in the middle: only what lies before it still matters.
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
    swept: SweptArm, rows: Matrix, radii: Vector, hints: Matrix, checks: Numbers
) -> int:
    """First of many configurations on the segment to which a pair comes too close.

    Args:
        swept: The arm in its world.
        rows: Configurations, of shape (n, dof), rad; the first and the last are known to be free.
        radii: Largest motion of the arm per radian of each joint, of shape (dof,), m/rad.
        hints: As in `free_share`.
        checks: As in `free_share`.

    Returns:
        Index of the configuration; n if the whole path is free.
    """
    count = len(rows)
    shapes = swept.shapes
    segment = segment_of(swept, rows[0], rows[0])
    ranges = shapes.ranges
    # With bounds of 1 m, the "share" from `share_around` is the room in meters of motion.
    for n in range(len(ranges)):
        segment.travel[n + 1, ranges[n, 2]] = segment.local[n, ranges[n, 2]] = 1.0
    moved = np.zeros(count)
    for i in range(1, count):
        moved[i] = moved[i - 1] + np.sum(np.abs(rows[i] - rows[i - 1]) * radii)
    active = np.arange(len(swept.pairs.least))
    until = 0.0
    for i in range(1, count):
        if moved[i] <= until:  # within the room around an earlier configuration
            continue
        room = 0.0
        if _SHORT_END < moved[i] < moved[-1] - _SHORT_END:
            write_frames(swept.joints, rows[i], rows[i], 0.0, segment.frames)
            write_centers(shapes, segment.frames, segment.centers)
            checks[0] += 1
            # Without the extra clearance (distance 0 from the end): the segments between the
            # rows are checked with it where the room does not cover them.
            room = share_around(swept, segment, active, 0.0, _FARTHEST, hints)
            if room < 0.0:
                return i
        gap = moved[i] - room - until
        if gap > _SHORT and free_share(swept, rows[i - 1], rows[i], WHOLE, hints, checks) < 1.0:
            return i
        until = moved[i] + room
    return count


@kernel
def segment_of(swept: SweptArm, start: Vector, end: Vector) -> Segment:
    """Segment with arrays allocated for its state."""
    centers = swept.shapes.centers
    dof = len(start)
    return Segment(
        start,
        end,
        np.zeros((len(centers) + 1, dof + 1)),
        np.zeros((len(centers), dof + 1)),
        np.empty((dof + 1, 3, 4)),
        centers.copy(),  # those of fixed shapes are never written again
        np.empty(SCRATCH),
        np.empty(len(centers)),
    )


@kernel
def move_to(swept: SweptArm, segment: Segment, share: float) -> None:
    """Write the state of the arm at a fraction of the segment."""
    joints, shapes, _, _ = swept
    write_frames(joints, segment.start, segment.end, share, segment.frames)
    write_centers(shapes, segment.frames, segment.centers)
    write_local_travel(
        joints, shapes, segment.frames, segment.centers, segment.travel, segment.local
    )


@kernel
def write_frames(joints: Joints, start: Vector, end: Vector, share: float, frames: Frames) -> None:
    """Write the motion of everything that the first 0, 1, ... joints move, from the reference.

    Product of exponentials (K. M. Lynch, F. C. Park, Modern Robotics, 2017, section 4.1).

    Args:
        joints: Joints of the arm.
        start: First configuration of a segment, of shape (dof,), rad.
        end: Last configuration of the segment, of shape (dof,), rad.
        share: Fraction of the segment at which the arm is.
        frames: Output: transforms, of shape (dof + 1, 3, 4).
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
        # Rodrigues' formula I + sin [w] + (1 - cos) [w]^2, with [w]^2 = w w^T - I.
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
            # A rotation R about an anchor a maps x to R x + (I - R) a.
            frames[k + 1, i, 3] = (
                frames[k, i, 3]
                + (a - u) * anchors[k, 0]
                + (b - v) * anchors[k, 1]
                + (c - w) * anchors[k, 2]
            )


@kernel
def write_centers(shapes: ConvexShapes, frames: Frames, centers: Matrix) -> None:
    """Write the centers of the moving shapes in the world, of shape (n, 3), m."""
    ranges = shapes.ranges
    references = shapes.centers
    for n in range(len(centers)):
        f = ranges[n, 2]
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
def write_travel(shapes: ConvexShapes, start: Vector, end: Vector, travel: Matrix) -> None:
    """Write upper bounds of the shapes' motion on a segment, valid in any configuration.

    Args:
        shapes: The shapes.
        start: First configuration, of shape (dof,), rad.
        end: Last configuration, of shape (dof,), rad.
        travel: Output, of shape (1 + n, dof + 1), zero before: column k holds the sum over the
            first k joints, row 0 their turns in rad, and row n + 1 the motion of shape n in m. The
            difference of two columns bounds the motion relative to a shape on an earlier link.
    """
    ranges = shapes.ranges
    reaches = shapes.reaches
    for k in range(len(start)):
        travel[0, k + 1] = travel[0, k] + abs(end[k] - start[k])
    for n in range(len(reaches)):
        for k in range(ranges[n, 2]):
            travel[n + 1, k + 1] = travel[n + 1, k] + abs(end[k] - start[k]) * reaches[n, k]


@kernel
def write_local_travel(
    joints: Joints,
    shapes: ConvexShapes,
    frames: Frames,
    centers: Matrix,
    travel: Matrix,
    local: Matrix,
) -> None:
    """Write bounds of the shapes' motion as if their current levers held on all of a segment.

    Args:
        joints: Joints of the arm.
        shapes: The shapes.
        frames: As in `write_frames`.
        centers: As in `write_centers`.
        travel: As in `write_travel`.
        local: Output, of shape (n, dof + 1), m: column k holds the sum over the first k joints.
    """
    _, anchors, axes = joints
    ranges = shapes.ranges
    bounds = shapes.bounds
    for k in range(len(axes)):
        turn = travel[0, k + 1] - travel[0, k]
        ax = _turned(frames, k, 0, axes)
        ay = _turned(frames, k, 1, axes)
        az = _turned(frames, k, 2, axes)
        px = _turned(frames, k, 0, anchors) + frames[k, 0, 3]
        py = _turned(frames, k, 1, anchors) + frames[k, 1, 3]
        pz = _turned(frames, k, 2, anchors) + frames[k, 2, 3]
        for n in range(len(bounds)):
            if ranges[n, 2] > k:
                x = centers[n, 0] - px
                y = centers[n, 1] - py
                z = centers[n, 2] - pz
                u = y * az - z * ay
                v = z * ax - x * az
                w = x * ay - y * ax
                lever = math.sqrt(u * u + v * v + w * w) + bounds[n]
                local[n, k + 1] = local[n, k] + turn * lever


@kernel
def _turned(frames: Frames, k: int, i: int, vectors: Matrix) -> float:
    """Coordinate i of vector k, rotated by the joints before it."""
    return float(
        frames[k, i, 0] * vectors[k, 0]
        + frames[k, i, 1] * vectors[k, 1]
        + frames[k, i, 2] * vectors[k, 2]
    )


@kernel
def select_active_pairs(swept: SweptArm, segment: Segment, active: Numbers) -> int:
    """Write the pairs that can collide on a segment, by its middle; returns their number."""
    first, second, least, _ = swept.pairs
    bounds = swept.shapes.bounds
    normals = swept.shapes.normals
    ranges = swept.shapes.ranges
    travel = segment.travel
    local = segment.local
    centers = segment.centers
    kept = 0
    for p in range(len(first)):
        one = first[p]
        other = second[p]
        last = ranges[one, 2]
        before = ranges[other, 2]
        bound = travel[one + 1, last] - travel[one + 1, before]
        turn = travel[0, last] - travel[0, before]
        # Both halves start in the middle: `share_around` with a share of 0.5, solved for the room.
        if turn < 2.0:
            bound = min(bound, (local[one, last] - local[one, before]) / (1.0 - 0.5 * turn))
        if _gap(centers, bounds, normals, one, other) < least[p] + swept.clearance + 0.5 * bound:
            active[kept] = p
            kept += 1
    return kept


@kernel
def _gap(centers: Matrix, bounds: Vector, normals: Matrix, first: int, second: int) -> float:
    """Distance between the bounding spheres of two shapes, or of the first to a plane, m."""
    x = centers[first, 0] - centers[second, 0]
    y = centers[first, 1] - centers[second, 1]
    z = centers[first, 2] - centers[second, 2]
    if math.isinf(bounds[second]):
        height = x * normals[second, 0] + y * normals[second, 1] + z * normals[second, 2]
        return float(height - bounds[first])
    return float(math.sqrt(x * x + y * y + z * z) - bounds[first] - bounds[second])


@kernel
def share_around(
    swept: SweptArm, segment: Segment, active: Numbers, away: float, most: float, hints: Matrix
) -> float:
    """Fraction of the segment that is free on both sides of the current configuration.

    Args:
        swept: The arm in its world.
        segment: Segment with the state at the configuration.
        active: Pairs to check; the one that limits the result is moved to the front.
        away: Fraction of the segment from here to its nearer end.
        most: Largest share of interest.
        hints: As in `free_share`.

    Returns:
        Share, up to ``most``; -1 if a pair is closer than its minimum distance and clearance.
    """
    # A pair with room d may move on a share s with s W <= d, where W bounds its relative motion on
    # the whole segment; or with s L <= (1 - s T) d, where L is that motion at the current levers
    # and T its turn: levers grow by no more than the pair moves. Solved for s, the larger one wins.
    #
    # Fields are read here: inside the loop, compiled code would count references each time.
    firsts, seconds, leasts, directions = swept.pairs
    corners, ranges, radii, _, bounds, rotations, half_extents, normals, _ = swept.shapes
    _, _, travel, local, frames, centers, scratch, needs = segment
    best = most
    full = swept.clearance
    for index in range(len(active)):
        p = active[index]
        first = firsts[p]
        second = seconds[p]
        least = leasts[p]
        # The pair that limited the previous check lowers `best` first, so that the spheres rule
        # out most others.
        if index == 1:
            write_needs(ranges, travel, local, best, needs)
        gap = _gap(centers, bounds, normals, first, second) - least
        if index and gap >= max(needs[first], full):
            continue
        last = ranges[first, 2]
        before = ranges[second, 2]
        bound = travel[first + 1, last] - travel[first + 1, before]
        turn = travel[0, last] - travel[0, before]
        fast = local[first, last] - local[first, before]
        clearance = min(full, _LEAVING * bound * away)
        enough = max(_need(best, bound, fast, turn), clearance)
        low = clearance
        by_box = _boxes_gap(frames, ranges, rotations, half_extents, bounds, centers, first, second)
        if by_box >= enough + least:
            continue
        rounding = radii[first] + radii[second] + least
        enough = enough + rounding
        low = low + rounding
        if math.isinf(bounds[second]):
            apart = _height_above(corners, ranges, normals, centers, frames, first, second, scratch)
        else:
            # Once two hulls overlap, GJK finds no separating direction: the depth of a tolerated
            # contact is measured along its normal.
            if least < 0.0:
                hints[p] = directions[p]
            apart = distance(corners, ranges, frames, first, second, enough, low, hints, p, scratch)
        if apart >= enough:
            continue
        # Checked first in the next configuration.
        active[index] = active[0]
        active[0] = p
        if apart < low:
            return -1.0
        room = apart - rounding
        best = max(room / bound, room / (fast + room * turn))
    return float(best)


@kernel
def _need(share: float, bound: float, fast: float, turn: float) -> float:
    """Room that a fraction of the segment requires, m; derived in `share_around`."""
    if share * turn < 1.0:
        return min(share * bound, share * fast / (1.0 - share * turn))
    return share * bound


@kernel
def write_needs(
    ranges: Numbers, travel: Matrix, local: Matrix, share: float, needs: Vector
) -> None:
    """Write the room that each shape requires around it for a fraction of the segment, m.

    Relative to fixed shapes, and therefore enough relative to moving ones, too.
    """
    for n in range(len(needs)):
        last = ranges[n, 2]
        needs[n] = _need(share, travel[n + 1, last], local[n, last], travel[0, last])


@kernel
def _boxes_gap(
    frames: Frames,
    ranges: Numbers,
    rotations: Frames,
    half_extents: Matrix,
    bounds: Vector,
    centers: Matrix,
    first: int,
    second: int,
) -> float:
    """Distance between the bounding box of one shape and the bounding sphere of the other, m."""
    if math.isinf(bounds[second]):
        return -1.0
    one = _box_gap(frames, ranges, rotations, half_extents, centers, second, first) - bounds[first]
    other = (
        _box_gap(frames, ranges, rotations, half_extents, centers, first, second) - bounds[second]
    )
    return float(max(one, other))


@kernel
def _box_gap(
    frames: Frames,
    ranges: Numbers,
    rotations: Frames,
    half_extents: Matrix,
    centers: Matrix,
    boxed: int,
    other: int,
) -> float:
    """Distance of the center of a shape from the bounding box of another one, m."""
    f = ranges[boxed, 2]
    square = 0.0
    x = centers[other, 0] - centers[boxed, 0]
    y = centers[other, 1] - centers[boxed, 1]
    z = centers[other, 2] - centers[boxed, 2]
    u = frames[f, 0, 0] * x + frames[f, 1, 0] * y + frames[f, 2, 0] * z
    v = frames[f, 0, 1] * x + frames[f, 1, 1] * y + frames[f, 2, 1] * z
    w = frames[f, 0, 2] * x + frames[f, 1, 2] * y + frames[f, 2, 2] * z
    for i in range(3):
        along = rotations[boxed, 0, i] * u + rotations[boxed, 1, i] * v + rotations[boxed, 2, i] * w
        beyond = max(abs(along) - half_extents[boxed, i], 0.0)
        square += beyond * beyond
    return math.sqrt(square)


@kernel
def _height_above(
    corners: Matrix,
    ranges: Numbers,
    normals: Matrix,
    places: Matrix,
    frames: Frames,
    first: int,
    plane: int,
    scratch: Matrix,
) -> float:
    """Height of the lowest corner of a shape above a fixed plane, m."""
    x = normals[plane, 0]
    y = normals[plane, 1]
    z = normals[plane, 2]
    write_support_point(corners, ranges, frames, first, -x, -y, -z, scratch, _CORNER)
    return float(
        x * (scratch[_CORNER, 0] - places[plane, 0])
        + y * (scratch[_CORNER, 1] - places[plane, 1])
        + z * (scratch[_CORNER, 2] - places[plane, 2])
    )
