"""Straight lines of the tool from pose to pose, their corners rounded so that it need not stop."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence

import numpy as np
import scipy

from bt_dualarm.errors import Failure
from bt_dualarm.motion.paths.bezier import corner_curve
from bt_dualarm.motion.paths.cartesian_path import CartesianPath
from bt_dualarm.pose import Matrix, Pose, Vector

_ARM = 0.2  # metres that a turn by one radian counts: lengths of pieces that only turn
_SPACING = 0.005  # metres between two samples of a line


def blended(poses: Sequence[Pose], radius: float) -> CartesianPath:
    """Lines through poses; nearer than ``radius`` to one, the tool may cut the corner.

    Turns are even along a line, and blended at corners like positions. The path meets the first
    and the last pose; of the others it stays within ``radius``, or half of a shorter line.

    Args:
        poses: Poses of the tool in the world, two or more, no two in a row alike.
        radius: Radius in metres; a turn by one radian counts as 0.2 m.

    Raises:
        Failure: ``INVALID_TARGET`` for fewer poses, or for two in a row that are alike.
    """
    if len(poses) < 2:
        raise Failure("INVALID_TARGET", "a path needs two poses or more", poses=len(poses))
    lines = [_step(there, here) for here, there in itertools.pairwise(poses)]
    lengths = [_length(line) for line in lines]
    if min(lengths) < 1e-6:
        raise Failure("INVALID_TARGET", f"pose {lengths.index(min(lengths)) + 2} repeats the last")
    cuts = [min(radius / length, 0.5) for length in lengths]
    pieces: list[tuple[Pose, Matrix]] = []
    for i, line in enumerate(lines):
        # Seen from its end, a line leads from 1 to 0; what corners cut is left out.
        first = 1.0 - cuts[i] if i > 0 else 1.0
        last = cuts[i] if i < len(lines) - 1 else 0.0
        corner = poses[i + 1]
        pieces.append((corner, _straight(first * line, last * line)))
        if i < len(lines) - 1:
            leave = cuts[i + 1] * _step(corner, poses[i + 2])
            pieces.append((corner, corner_curve(last * line, np.zeros(6), leave)))
    return _joined(pieces, poses)


def _step(origin: Pose, other: Pose) -> Vector:
    """Another pose seen from a corner, of shape (6,): offset in the world, turn in the origin."""
    turn = (origin.rotation.inv() * other.rotation).as_rotvec()
    return np.concatenate((other.position - origin.position, turn))


def _length(step: Vector) -> float:
    return math.hypot(*step[:3], *(_ARM * step[3:]))


def _straight(start: Vector, end: Vector) -> Matrix:
    pieces = max(math.ceil(_length(end - start) / _SPACING), 8)
    share = np.linspace(0.0, 1.0, pieces + 1)[:, None]
    rows: Matrix = start + share * (end - start)
    return rows


def _joined(pieces: Sequence[tuple[Pose, Matrix]], poses: Sequence[Pose]) -> CartesianPath:
    """The pieces' steps as one path, without the samples that repeat the one before."""
    positions: list[Matrix] = []
    turns: list[Matrix] = []
    for i, (origin, steps) in enumerate(pieces):
        rows = steps if i == 0 else steps[1:]
        turned = origin.rotation * scipy.spatial.transform.Rotation.from_rotvec(rows[:, 3:])
        positions.append(origin.position + rows[:, :3])
        turns.append(turned.as_quat(scalar_first=True))
    waypoints = np.array([pose.position for pose in poses])
    return CartesianPath(np.vstack(positions), np.vstack(turns), waypoints)
