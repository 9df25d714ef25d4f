"""Where an arm's shapes are in a configuration, and how far they get on a straight way."""

from __future__ import annotations

import math

from bt_dualarm.kernels.kernel import kernel
from bt_dualarm.motion.search.kernel_arrays import Frames, Joints, Shapes
from bt_dualarm.pose import Matrix, Vector


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
        sine, rest = math.sin(angle), 1.0 - math.cos(angle)
        x, y, z = axes[k, 0], axes[k, 1], axes[k, 2]
        # Rodrigues: the identity, the axis' cross product, and its square.
        xx, xy, xz = 1.0 - rest * (y * y + z * z), rest * x * y - sine * z, rest * x * z + sine * y
        yx, yy, yz = rest * x * y + sine * z, 1.0 - rest * (x * x + z * z), rest * y * z - sine * x
        zx, zy, zz = rest * x * z - sine * y, rest * y * z + sine * x, 1.0 - rest * (x * x + y * y)
        for i in range(3):
            a, b, c = frames[k, i, 0], frames[k, i, 1], frames[k, i, 2]
            u, v, w = a * xx + b * yx + c * zx, a * xy + b * yy + c * zy, a * xz + b * yz + c * zz
            frames[k + 1, i, 0], frames[k + 1, i, 1], frames[k + 1, i, 2] = u, v, w
            frames[k + 1, i, 3] = (
                frames[k, i, 3]
                + (a - u) * anchors[k, 0]
                + (b - v) * anchors[k, 1]
                + (c - w) * anchors[k, 2]
            )


@kernel
def enter_centers(shapes: Shapes, frames: Frames, centers: Matrix) -> None:
    """Enter where the centres of those shapes are that move, of shape (n, 3), m."""
    heaps, references = shapes.heaps, shapes.centers
    for n in range(len(centers)):
        f = heaps[n, 2]
        if f == 0:
            continue
        x, y, z = references[n, 0], references[n, 1], references[n, 2]
        for i in range(3):
            centers[n, i] = (
                frames[f, i, 0] * x + frames[f, i, 1] * y + frames[f, i, 2] * z + frames[f, i, 3]
            )


@kernel
def enter_ways(shapes: Shapes, start: Vector, end: Vector, ways: Matrix) -> None:
    """Enter how far the shapes move at most on the way, by joints 0 to k, wherever the arm is.

    Args:
        shapes: The shapes.
        start: Configuration of shape (dof,), rad.
        end: Another, likewise.
        ways: Sums over joints, those of all shapes in the first row: radians; then of each shape,
            metres: of shape (1 + n, dof + 1), to be entered.
    """
    heaps, reaches = shapes.heaps, shapes.reaches
    for k in range(len(start)):
        ways[0, k + 1] = ways[0, k] + abs(end[k] - start[k])
    for n in range(len(reaches)):
        for k in range(heaps[n, 2]):
            ways[n + 1, k + 1] = ways[n + 1, k] + abs(end[k] - start[k]) * reaches[n, k]


@kernel
def enter_ways_here(
    joints: Joints, shapes: Shapes, frames: Frames, centers: Matrix, ways: Matrix, here: Matrix
) -> None:
    """Enter how fast the shapes move at most on the way where they are now, as `enter_ways`.

    Args:
        joints: Joints of the arm.
        shapes: The shapes.
        frames: As of `enter_frames`.
        centers: As of `enter_centers`.
        ways: As of `enter_ways`.
        here: Metres for the whole of the way at the speed of now, of shape (n, dof + 1), to be
            entered.
    """
    _, anchors, axes = joints
    heaps, bounds = shapes.heaps, shapes.bounds
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
                x, y, z = centers[n, 0] - px, centers[n, 1] - py, centers[n, 2] - pz
                u, v, w = y * az - z * ay, z * ax - x * az, x * ay - y * ax
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
