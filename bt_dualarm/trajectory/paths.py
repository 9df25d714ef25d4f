"""Geometric paths of the tool, without timing: lines, splines, blends, curves, rotations.

Each function returns a `CartesianPath`: samples of the tool's pose, dense enough that inverse
kinematics stays on one branch between them.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal, TypeAlias

import numpy as np

from bt_dualarm.core import rotations
from bt_dualarm.core.errors import Failure
from bt_dualarm.core.free_axes import FreeAxes
from bt_dualarm.core.pose import Matrix, Pose, Vector
from bt_dualarm.trajectory.cubic_spline import cubic_spline

Axes: TypeAlias = tuple[Vector, Vector]
"""Two orthogonal unit vectors of a plane in the world, each of shape (3,)."""

Mode: TypeAlias = Literal["around", "from"]
"""Whether the given tool pose is the center of a curve, or its start."""

_SHARE = np.linspace(0.0, 1.0, 33)[:, None]
"""Parameters of the points of a blend."""

_SAMPLES = 12
"""Samples between two waypoints: dense enough that inverse kinematics stays on one branch."""

_ARM = 0.2
"""Length that a rotation by 1 rad counts as, m: for segments that only rotate."""

_SPACING = 0.005
"""Largest distance between two samples of a blended path, m."""

_TURN_SPACING = 0.03
"""Largest angle between two samples of a rotation, rad."""

_WAYPOINT = math.radians(15.0)
"""Angle between two waypoints of a rotation, rad."""


@dataclass(frozen=True, eq=False)
class CartesianPath:
    """Path of the tool in the world, with a number of passes.

    Attributes:
        positions: Samples of one pass, of shape (n, 3), m.
        quaternions: Orientations wxyz at the positions, of shape (n, 4).
        waypoints: Waypoints that the path passes through, of shape (m, 3), m.
        closed: Whether it ends where it starts, smoothly.
        repeats: Number of passes; more than one only for a closed path.
        center: Center of a plane curve, in which its points are given; None for other paths.
        free: Rotations about the tool's axes that do not count anywhere on the path.
    """

    positions: Matrix
    quaternions: Matrix
    waypoints: Matrix
    closed: bool = False
    repeats: int = 1
    center: Pose | None = None
    free: FreeAxes = ()

    @property
    def poses(self) -> list[Pose]:
        """One pass as poses."""
        return [Pose(p, q) for p, q in zip(self.positions, self.quaternions, strict=True)]

    @property
    def start(self) -> Pose:
        """First pose. If the tool is elsewhere, approach it with a ``line``."""
        return Pose(self.positions[0].copy(), self.quaternions[0].copy())

    @property
    def end(self) -> Pose:
        """Last pose."""
        return Pose(self.positions[-1].copy(), self.quaternions[-1].copy())

    @property
    def lengths(self) -> Vector:
        """Path length up to each sample of all passes, m, of shape (repeats (n - 1) + 1,)."""
        steps = np.linalg.norm(np.diff(self.positions, axis=0), axis=1)
        return np.concatenate(((0.0,), np.cumsum(np.tile(steps, self.repeats))))

    @property
    def length(self) -> float:
        """Path length over all passes, m."""
        return self.repeats * float(np.linalg.norm(np.diff(self.positions, axis=0), axis=1).sum())


def line(
    start: Pose, end: Pose, spacing: float = 0.005, spacing_rad: float = 0.03
) -> CartesianPath:
    """Straight line between two poses, with rotation about a fixed axis at a constant rate.

    Args:
        start: First pose.
        end: Last pose.
        spacing: Maximum distance between two samples, m.
        spacing_rad: Maximum rotation between two samples, rad.
    """
    pieces = max(start.distance(end) / spacing, start.angle(end) / spacing_rad)
    share = np.linspace(0.0, 1.0, max(math.ceil(pieces), 8) + 1)
    positions = start.position + share[:, None] * (end.position - start.position)
    turn = rotations.slerp(np.array((0.0, 1.0)), _quaternions((start, end)), share)
    waypoints = np.array((start.position, end.position))
    return CartesianPath(positions, turn, waypoints)


def through(poses: Sequence[Pose], *, closed: bool = False) -> CartesianPath:
    """Smooth curve through poses; orientations are interpolated from one to the next (slerp).

    Args:
        poses: Two or more poses, no two in a row at the same position.
        closed: Whether the curve continues from the last to the first.

    Raises:
        Failure: ``INVALID_TARGET`` for fewer poses, or two in a row at the same position.
    """
    stops = [*poses, poses[0]] if closed and len(poses) else list(poses)
    require(len(stops) >= 2, "a path needs two poses or more", poses=len(poses))
    points = np.array([pose.position for pose in stops])
    steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
    require(bool(np.all(steps > 1e-6)), "two poses in a row are at the same place")
    # Centripetal parameterization (Lee 1989): no loops between unevenly spaced waypoints.
    knots = np.concatenate(((0.0,), np.cumsum(np.sqrt(steps))))
    samples = refined(knots)
    turn = rotations.slerp(knots, _quaternions(stops), samples)
    positions = cubic_spline(knots, points, closed=closed)(samples)
    return CartesianPath(positions, turn, points, closed)


def blended(poses: Sequence[Pose], radius: float) -> CartesianPath:
    """Straight lines through poses with blended corners, so that the tool need not stop.

    Orientations change at a constant rate along a line, and are blended like positions. The path
    passes through the first and the last pose, and within ``radius`` of the others, or half the
    length of a shorter line.

    Args:
        poses: Poses of the tool in the world, two or more, no two in a row equal.
        radius: Blend radius, m; a rotation by 1 rad counts as 0.2 m.

    Raises:
        Failure: ``INVALID_TARGET`` for fewer poses, two in a row that are equal, or a radius below
            0.
    """
    if len(poses) < 2:
        raise Failure("INVALID_TARGET", "a path needs two poses or more", poses=len(poses))
    if not radius >= 0.0:
        raise Failure("INVALID_TARGET", "the blend radius must be 0 m or more", radius=radius)
    lines = [_step(there, here) for here, there in itertools.pairwise(poses)]
    lengths = [_length(line) for line in lines]
    if min(lengths) < 1e-6:
        raise Failure("INVALID_TARGET", f"pose {lengths.index(min(lengths)) + 2} repeats the last")
    # Blends of both ends of a line may meet in its middle, but not overlap.
    cuts = [min(radius / length, 0.5) for length in lengths]
    pieces: list[tuple[Pose, Matrix]] = []
    for i, line in enumerate(lines):
        # Measured from its end, a line leads from 1 to 0; the parts cut by blends are left out.
        first = 1.0 - cuts[i] if i > 0 else 1.0
        last = cuts[i] if i < len(lines) - 1 else 0.0
        corner = poses[i + 1]
        pieces.append((corner, _straight(first * line, last * line)))
        if i < len(lines) - 1:
            leave = cuts[i + 1] * _step(corner, poses[i + 2])
            pieces.append((corner, corner_curve(last * line, np.zeros(6), leave)))
    return _joined(pieces, poses)


def circle(
    tool: Pose,
    axes: Axes,
    radius: float,
    *,
    mode: Mode = "around",
    waypoints: int = 20,
    turns: float = 1.0,
    begin: float = 0.0,
    direction: int = 1,
    tilt: float = 0.0,
) -> CartesianPath:
    """Circle, or an arc if ``turns`` is not an integer.

    Args:
        tool: Center of the circle, or with mode ``"from"`` its first point.
        axes: Axes of the plane; angles are measured from the first one toward the second.
        radius: Radius, m.
        mode: See ``tool``.
        waypoints: Number of waypoints per turn.
        turns: Number of turns.
        begin: Angle of the first point, rad.
        direction: 1, or -1 to turn away from the second axis.
        tilt: Inclination of the tool's z axis toward the center, rad; 0 keeps the orientation.

    Raises:
        Failure: ``INVALID_TARGET`` for invalid parameters.
    """
    require(radius > 0.0 and math.isfinite(radius), "the radius must be above 0 m", radius=radius)
    require(turns > 0.0, "the turns must be above 0", turns=turns)
    require(direction in (1, -1), "the direction must be 1 or -1", direction=direction)
    whole = float(turns).is_integer()
    angle = 2.0 * math.pi * (1.0 if whole else turns)
    count = waypoints if whole else max(math.ceil(waypoints * turns), 4)
    phase = begin + np.linspace(0.0, direction * angle, count + 1)
    offsets = radius * np.column_stack((np.cos(phase), np.sin(phase)))
    return _curve(tool, axes, offsets, mode, waypoints, int(turns) if whole else 0, tilt)


def lissajous(
    tool: Pose,
    axes: Axes,
    amplitudes: tuple[float, float],
    frequencies: tuple[int, int],
    *,
    phase: float = 0.0,
    mode: Mode = "around",
    waypoints: int = 40,
    repeats: float = 1.0,
    tilt: float = 0.0,
) -> CartesianPath:
    """Lissajous curve: A sin(a t + phase) along the first axis, B sin(b t) along the second.

    Args:
        tool: Center of the curve, or with mode ``"from"`` its first point.
        axes: Axes of the plane.
        amplitudes: A and B, half the width and height of the curve, m.
        frequencies: Integers a and b; only their ratio matters.
        phase: Phase of the first axis, rad.
        mode: See ``tool``.
        waypoints: Number of waypoints per pass.
        repeats: Number of passes; a fraction draws a part of the curve.
        tilt: Inclination of the tool's z axis toward the center at the farthest point, rad;
            proportional to the distance elsewhere. 0 keeps the orientation.

    Raises:
        Failure: ``INVALID_TARGET`` for invalid parameters.
    """
    require(min(amplitudes) >= 0.0 < max(amplitudes), "an amplitude must be above 0 m")
    require(min(frequencies) >= 1, "the frequencies must be whole numbers of 1 or more")
    require(repeats > 0.0, "the repeats must be above 0", repeats=repeats)
    divisor = math.gcd(*frequencies)
    first, second = (frequency // divisor for frequency in frequencies)
    whole = float(repeats).is_integer()
    count = waypoints if whole else max(math.ceil(waypoints * repeats), 4)
    t = np.linspace(0.0, 2.0 * math.pi * (1.0 if whole else repeats), count + 1)
    offsets = np.column_stack(
        (amplitudes[0] * np.sin(first * t + phase), amplitudes[1] * np.sin(second * t))
    )
    return _curve(tool, axes, offsets, mode, waypoints, int(repeats) if whole else 0, tilt)


def drawn(
    tool: Pose,
    axes: Axes,
    points: Sequence[tuple[float, float]],
    *,
    mode: Mode = "around",
    closed: bool = True,
    repeats: int = 1,
) -> CartesianPath:
    """Smooth plane curve through points in their order, with constant orientation.

    Args:
        tool: Origin of the points, or with mode ``"from"`` the position of the first one.
        axes: Axes of the plane, along which the points are given.
        points: Points, m; no two in a row at the same position.
        mode: See ``tool``.
        closed: Whether the curve continues smoothly from the last to the first point.
        repeats: Number of passes; more than one only for a closed curve.

    Raises:
        Failure: ``INVALID_TARGET`` for invalid parameters.
    """
    if repeats > 1 and not closed:
        raise Failure("INVALID_TARGET", "only a closed curve can be drawn again and again")
    frame = np.array(axes)
    offsets = np.array(points, dtype=float)
    origin = tool.position - (offsets[0] @ frame if mode == "from" else 0.0)
    positions = origin + offsets @ frame
    path = through([Pose(position, tool.quaternion) for position in positions], closed=closed)
    return replace(path, repeats=repeats, center=Pose(origin, tool.quaternion))


def turned_about(tool: Pose, point: Vector, axis: Vector, angle: float) -> CartesianPath:
    """Rotation of the tool about a line in space, as a rigid body.

    Args:
        tool: First pose.
        point: Point on the line, in the world, of shape (3,), m.
        axis: Direction of the line in the world, of shape (3,), with a length other than 0.
        angle: Angle about the axis, right-handed, rad; may exceed a full turn.

    Raises:
        Failure: ``INVALID_TARGET`` for an axis or an angle of 0.
    """
    length = float(np.linalg.norm(axis))
    if not (length > 1e-9 and abs(angle) > 1e-9):
        raise Failure("INVALID_TARGET", "a turn needs an axis and an angle other than 0")
    count = max(math.ceil(abs(angle) / _TURN_SPACING), 8)
    turns = rotations.from_rotation_vectors(
        np.linspace(0.0, angle, count + 1)[:, None] * np.asarray(axis) / length
    )
    offset = np.einsum("ijk,k->ij", rotations.matrices(turns), tool.position - point)
    positions = point + offset
    quaternions = rotations.product(turns, _quaternions((tool,)))
    every = max(round(count * _WAYPOINT / abs(angle)), 1)
    return CartesianPath(positions, quaternions, positions[::every])


def corner_curve(start: Vector, corner: Vector, end: Vector) -> Matrix:
    """Blend of a corner between two lines: a quintic Bézier curve with zero curvature at both ends.

    Args:
        start: Point where it leaves the line to the corner, of shape (k,).
        corner: Intersection of the two lines, of shape (k,).
        end: Point where it joins the line from the corner, of shape (k,).

    Returns:
        33 points from start to end, of shape (33, k).
    """
    # Control points at equal distances on both lines, three of them in a row on each: the second
    # derivative vanishes at both ends, so that the curvature is continuous where the lines
    # continue.
    t = _SHARE
    u = 1.0 - _SHARE
    toward = (start + corner) / 2.0
    away = (corner + end) / 2.0
    curve: Matrix = (
        u**5 * start
        + 5 * u**4 * t * toward
        + 10 * (u**3 * t**2 + u**2 * t**3) * corner
        + 5 * u * t**4 * away
        + t**5 * end
    )
    return curve


def _curve(
    tool: Pose,
    axes: Axes,
    offsets: Matrix,
    mode: Mode,
    waypoints: int,
    repeats: int,
    tilt: float,
) -> CartesianPath:
    """Plane curve through waypoints that are evenly spaced in its parameter.

    It passes exactly through them. In between it is a cubic spline, periodic if closed and
    not-a-knot otherwise: with 20 waypoints it is within 0.02 mm of a circle of 0.1 m, where natural
    end conditions would deviate by 0.5 mm.

    Args:
        tool: Center or start of the curve, and orientation of the tool.
        axes: Axes of the plane.
        offsets: Waypoints relative to the center, along the axes, of shape (n, 2), m.
        mode: See ``tool``.
        waypoints: Number of waypoints that was requested.
        repeats: Number of passes; 0 for a curve that is not closed.
        tilt: Inclination toward the center at the farthest waypoint, rad.
    """
    require(waypoints >= 4, "a curve needs 4 waypoints or more", waypoints=waypoints)
    require(bool(np.isfinite(offsets).all()), "a number of the curve is not finite")
    frame = np.array(axes)
    require(
        bool(np.allclose(frame @ frame.T, np.eye(2), atol=1e-6)),
        "the axes of the plane must be orthogonal unit vectors",
    )
    middle = tool.position - (offsets[0] @ frame if mode == "from" else 0.0)
    if repeats:
        offsets[-1] = offsets[0]  # sin and cos leave a rounding error
    points = middle + offsets @ frame
    knots = np.arange(len(points), dtype=float)
    positions = cubic_spline(knots, points, closed=bool(repeats))(refined(knots))
    scale = float(np.linalg.norm(offsets, axis=1).max())
    quaternions = _leaning(tool, (positions - middle) * (tilt / scale))
    center = Pose(middle, tool.quaternion)
    return CartesianPath(positions, quaternions, points, bool(repeats), max(repeats, 1), center)


def _leaning(tool: Pose, lean: Matrix) -> Matrix:
    """Orientations, of shape (n, 4), with the tool's z axis tilted against each row of ``lean``.

    The angle in rad is the length of the row's component perpendicular to that axis.
    """
    if not lean.any():
        return np.tile(tool.quaternion, (len(lean), 1))
    # A small rotation w tilts the axis z by w x z; with w = lean x z that is against the lean.
    tilts = np.asarray(np.cross(lean, tool.rotation_matrix[:, 2]), dtype=float)
    turns = rotations.from_rotation_vectors(tilts)
    return rotations.product(turns, _quaternions((tool,)))


def _quaternions(poses: Sequence[Pose]) -> Matrix:
    """Orientations, of shape (n, 4), as unit quaternions."""
    return rotations.normalized(np.array([pose.quaternion for pose in poses]))


def _step(origin: Pose, other: Pose) -> Vector:
    """Offset of another pose, of shape (6,): translation in world axes, rotation in origin's."""
    # Relative rotation vectors can be scaled and blended like positions.
    begin, end = _quaternions((origin, other))[:, None]
    turn = rotations.rotation_vectors(rotations.product(rotations.inverse(begin), end))[0]
    return np.concatenate((other.position - origin.position, turn))


def _length(step: Vector) -> float:
    return math.hypot(*step[:3], *(_ARM * step[3:]))


def _straight(start: Vector, end: Vector) -> Matrix:
    pieces = max(math.ceil(_length(end - start) / _SPACING), 8)
    share = np.linspace(0.0, 1.0, pieces + 1)[:, None]
    rows: Matrix = start + share * (end - start)
    return rows


def _joined(pieces: Sequence[tuple[Pose, Matrix]], poses: Sequence[Pose]) -> CartesianPath:
    """One path from offsets relative to corner poses, without repeated samples."""
    positions: list[Matrix] = []
    turns: list[Matrix] = []
    for i, (origin, steps) in enumerate(pieces):
        rows = steps if i == 0 else steps[1:]
        turned = rotations.from_rotation_vectors(rows[:, 3:])
        positions.append(origin.position + rows[:, :3])
        turns.append(rotations.product(_quaternions((origin,)), turned))
    waypoints = np.array([pose.position for pose in poses])
    return CartesianPath(np.vstack(positions), np.vstack(turns), waypoints)


def refined(knots: Vector) -> Vector:
    """The knots, and `_SAMPLES` - 1 evenly spaced parameters between two of them."""
    index = np.linspace(0.0, len(knots) - 1.0, _SAMPLES * (len(knots) - 1) + 1)
    return np.interp(index, np.arange(len(knots)), knots)


def require(holds: bool, reason: str, **numbers: float) -> None:
    """Check a condition on the parameters of a path.

    Raises:
        Failure: ``INVALID_TARGET`` with the reason and the numbers.
    """
    if not holds:
        raise Failure("INVALID_TARGET", reason, **numbers)
