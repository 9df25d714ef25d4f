"""Paths of the tool in the world: lines, and splines through waypoints."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np
import scipy

from bt_dualarm.errors import Failure
from bt_dualarm.pose import Matrix, Pose, Vector

Axes: TypeAlias = tuple[Vector, Vector]
"""Two orthogonal unit vectors of a plane in the world, each of shape (3,)."""

Mode: TypeAlias = Literal["around", "from"]
"""Whether a curve has the tool pose at its centre, or at its start."""

_SAMPLES = 12
"""Samples between two waypoints: close enough that inverse kinematics never jumps."""


@dataclass(frozen=True, eq=False)
class CartesianPath:
    """A path of the tool, and how often it is gone along.

    Attributes:
        positions: One pass in small steps, of shape (n, 3), in the world.
        quaternions: Orientations wxyz at the positions, of shape (n, 4).
        waypoints: What the path was drawn through, of shape (m, 3).
        closed: It ends where it starts, and smoothly.
        repeats: Number of passes; more than one only of a closed path.
        center: Pose in the middle of a curve, which its points are measured from; None of others.
    """

    positions: Matrix
    quaternions: Matrix
    waypoints: Matrix
    closed: bool = False
    repeats: int = 1
    center: Pose | None = None

    @property
    def poses(self) -> list[Pose]:
        """One pass as poses."""
        return [Pose(p, q) for p, q in zip(self.positions, self.quaternions, strict=True)]

    @property
    def start(self) -> Pose:
        """Where it begins: if the tool is elsewhere, a ``line`` leads there."""
        return Pose(self.positions[0].copy(), self.quaternions[0].copy())

    @property
    def end(self) -> Pose:
        """Where it ends."""
        return Pose(self.positions[-1].copy(), self.quaternions[-1].copy())

    @property
    def length(self) -> float:
        """Way of the tool in metres, over all passes."""
        return self.repeats * float(np.linalg.norm(np.diff(self.positions, axis=0), axis=1).sum())


def line(
    start: Pose, end: Pose, spacing: float = 0.005, spacing_rad: float = 0.03
) -> CartesianPath:
    """Straight from pose to pose, turning evenly about one axis.

    Args:
        start: First pose.
        end: Last pose.
        spacing: Most between two samples, in metres.
        spacing_rad: Most between two samples, in radians.
    """
    pieces = max(start.distance(end) / spacing, start.angle(end) / spacing_rad)
    share = np.linspace(0.0, 1.0, max(math.ceil(pieces), 8) + 1)
    positions = start.position + share[:, None] * (end.position - start.position)
    turn = _slerp((0.0, 1.0), (start, end), share)
    waypoints = np.array((start.position, end.position))
    return CartesianPath(positions, turn, waypoints)


def through(poses: Sequence[Pose], *, closed: bool = False) -> CartesianPath:
    """A smooth curve through poses; orientations turn evenly from one to the next.

    Args:
        poses: Two or more, no two in a row at the same place.
        closed: Go on from the last to the first.

    Raises:
        Failure: ``INVALID_TARGET`` for fewer poses, or for two in a row at one place.
    """
    stops = [*poses, poses[0]] if closed and len(poses) else list(poses)
    require(len(stops) >= 2, "a path needs two poses or more", poses=len(poses))
    points = np.array([pose.position for pose in stops])
    steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
    require(bool(np.all(steps > 1e-6)), "two poses in a row are at the same place")
    # Centripetal (Lee 1989): no loops where waypoints are unevenly far apart.
    knots = np.concatenate(((0.0,), np.cumsum(np.sqrt(steps))))
    places = refined(knots)
    turn = _slerp(knots, stops, places)
    positions = spline(knots, points, closed)(places)
    return CartesianPath(positions, turn, points, closed)


def _slerp(knots: Sequence[float] | Vector, poses: Sequence[Pose], places: Vector) -> Matrix:
    """Quaternions wxyz, of shape (n, 4), that turn evenly from each pose to the next."""
    turns = scipy.spatial.transform.Rotation.concatenate([pose.rotation for pose in poses])
    quaternions: Matrix = scipy.spatial.transform.Slerp(knots, turns)(places).as_quat(
        scalar_first=True
    )
    return quaternions


def spline(knots: Vector, points: Matrix, closed: bool) -> scipy.interpolate.CubicSpline:
    """Through points of shape (n, k) at knots of shape (n,); smooth at its ends if it closes."""
    return scipy.interpolate.CubicSpline(
        knots, points, bc_type="periodic" if closed else "not-a-knot"
    )


def refined(knots: Vector) -> Vector:
    """The knots and even steps between them."""
    index = np.linspace(0.0, len(knots) - 1.0, _SAMPLES * (len(knots) - 1) + 1)
    return np.interp(index, np.arange(len(knots)), knots)


def require(holds: bool, reason: str, **numbers: float) -> None:
    """Refuse what draws no path.

    Raises:
        Failure: ``INVALID_TARGET`` with the reason and the numbers.
    """
    if not holds:
        raise Failure("INVALID_TARGET", reason, **numbers)
