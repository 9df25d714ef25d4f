"""Paths of the tool in the world: lines, circles, Lissajous curves, splines through waypoints.

A curve goes exactly through its waypoints; between them it is a cubic spline, periodic where the
curve closes and not-a-knot where it does not. On 20 waypoints such a spline stays within 0.02 mm of
a circle of 0.1 m; natural ends would be off by 0.5 mm.
"""

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
    """

    positions: Matrix
    quaternions: Matrix
    waypoints: Matrix
    closed: bool = False
    repeats: int = 1

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


def circle(
    tool: Pose,
    axes: Axes,
    radius: float,
    *,
    mode: Mode = "around",
    waypoints: int = 20,
    turns: float = 1.0,
    direction: int = 1,
    tilt: float = 0.0,
) -> CartesianPath:
    """A circle, or an arc where ``turns`` is not a whole number.

    Args:
        tool: Centre of the circle, or with mode ``"from"`` its first point.
        axes: The circle starts at the end of the first and turns to the second.
        radius: In metres.
        mode: See ``tool``.
        waypoints: Points on a turn that the path goes through.
        turns: How often around.
        direction: 1 or -1, which turns away from the second axis.
        tilt: How far the tool's z axis leans towards the centre, in radians; 0 keeps the
            orientation.

    Raises:
        Failure: ``INVALID_TARGET`` for what draws no circle.
    """
    _require(radius > 0.0 and math.isfinite(radius), "the radius must be above 0 m", radius=radius)
    _require(turns > 0.0, "the turns must be above 0", turns=turns)
    _require(direction in (1, -1), "the direction must be 1 or -1", direction=direction)
    whole = float(turns).is_integer()
    angle = 2.0 * math.pi * (1.0 if whole else turns)
    count = waypoints if whole else max(math.ceil(waypoints * turns), 4)
    phase = np.linspace(0.0, direction * angle, count + 1)
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
    repeats: int = 1,
    tilt: float = 0.0,
) -> CartesianPath:
    """The curve A sin(a t + phase) along the first axis, B sin(b t) along the second.

    Args:
        tool: Centre of the curve, or with mode ``"from"`` its first point.
        axes: Of the curve's plane.
        amplitudes: A and B in metres, half the curve's width and height.
        frequencies: a and b, whole numbers; only their ratio matters.
        phase: In radians.
        mode: See ``tool``.
        waypoints: Points on the curve that the path goes through.
        repeats: How often the whole curve is drawn.
        tilt: How far the tool's z axis leans towards the centre where the curve is farthest from
            it, in radians; in between as far as it is away. 0 keeps the orientation.

    Raises:
        Failure: ``INVALID_TARGET`` for what draws no curve.
    """
    _require(min(amplitudes) >= 0.0 < max(amplitudes), "an amplitude must be above 0 m")
    _require(min(frequencies) >= 1, "the frequencies must be whole numbers of 1 or more")
    _require(repeats >= 1, "the repeats must be 1 or more", repeats=repeats)
    divisor = math.gcd(*frequencies)
    first, second = (frequency // divisor for frequency in frequencies)
    t = np.linspace(0.0, 2.0 * math.pi, waypoints + 1)
    offsets = np.column_stack(
        (amplitudes[0] * np.sin(first * t + phase), amplitudes[1] * np.sin(second * t))
    )
    return _curve(tool, axes, offsets, mode, waypoints, repeats, tilt)


def through(poses: Sequence[Pose], *, closed: bool = False) -> CartesianPath:
    """A smooth curve through poses; orientations turn evenly from one to the next.

    Args:
        poses: Two or more, no two in a row at the same place.
        closed: Go on from the last to the first.

    Raises:
        Failure: ``INVALID_TARGET`` for fewer poses, or for two in a row at one place.
    """
    stops = [*poses, poses[0]] if closed and len(poses) else list(poses)
    _require(len(stops) >= 2, "a path needs two poses or more", poses=len(poses))
    points = np.array([pose.position for pose in stops])
    steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
    _require(bool(np.all(steps > 1e-6)), "two poses in a row are at the same place")
    # Centripetal (Lee 1989): no loops where waypoints are unevenly far apart.
    knots = np.concatenate(((0.0,), np.cumsum(np.sqrt(steps))))
    places = _refined(knots)
    turn = _slerp(knots, stops, places)
    positions = _spline(knots, points, closed)(places)
    return CartesianPath(positions, turn, points, closed)


def _curve(
    tool: Pose,
    axes: Axes,
    offsets: Matrix,
    mode: Mode,
    waypoints: int,
    repeats: int,
    tilt: float,
) -> CartesianPath:
    """A plane curve through even waypoints; ``repeats`` is zero for one that does not close.

    Args:
        tool: Its centre or start, and its orientation.
        axes: Of its plane.
        offsets: Waypoints from the centre along the axes, of shape (n, 2), m.
        mode: What ``tool`` is.
        waypoints: As asked for.
        repeats: Number of passes.
        tilt: Towards the centre at the farthest waypoint, rad.
    """
    _require(waypoints >= 4, "a curve needs 4 waypoints or more", waypoints=waypoints)
    _require(bool(np.isfinite(offsets).all()), "a number of the curve is not finite")
    frame = np.array(axes)
    _require(
        bool(np.allclose(frame @ frame.T, np.eye(2), atol=1e-6)),
        "the axes of the plane must be orthogonal unit vectors",
    )
    centre = tool.position - (offsets[0] @ frame if mode == "from" else 0.0)
    if repeats:
        offsets[-1] = offsets[0]  # sin and cos leave a rounding error
    points = centre + offsets @ frame
    knots = np.arange(len(points), dtype=float)
    positions = _spline(knots, points, bool(repeats))(_refined(knots))
    scale = float(np.linalg.norm(offsets, axis=1).max())
    quaternions = _leaning(tool, (positions - centre) * (tilt / scale))
    return CartesianPath(positions, quaternions, points, bool(repeats), max(repeats, 1))


def _leaning(tool: Pose, lean: Matrix) -> Matrix:
    """Orientations, of shape (n, 4), with the tool's z axis turned against each row of ``lean``.

    By the row's length in rad, as far as the row is perpendicular to that axis.
    """
    if not lean.any():
        return np.tile(tool.quaternion, (len(lean), 1))
    turns = scipy.spatial.transform.Rotation.from_rotvec(np.cross(lean, tool.rotation_matrix[:, 2]))
    quaternions: Matrix = (turns * tool.rotation).as_quat(scalar_first=True)
    return quaternions


def _slerp(knots: Sequence[float] | Vector, poses: Sequence[Pose], places: Vector) -> Matrix:
    """Quaternions wxyz, of shape (n, 4), that turn evenly from each pose to the next."""
    turns = scipy.spatial.transform.Rotation.concatenate([pose.rotation for pose in poses])
    quaternions: Matrix = scipy.spatial.transform.Slerp(knots, turns)(places).as_quat(
        scalar_first=True
    )
    return quaternions


def _spline(knots: Vector, points: Matrix, closed: bool) -> scipy.interpolate.CubicSpline:
    return scipy.interpolate.CubicSpline(
        knots, points, bc_type="periodic" if closed else "not-a-knot"
    )


def _refined(knots: Vector) -> Vector:
    """The knots and even steps between them."""
    index = np.linspace(0.0, len(knots) - 1.0, _SAMPLES * (len(knots) - 1) + 1)
    return np.interp(index, np.arange(len(knots)), knots)


def _require(holds: bool, reason: str, **numbers: float) -> None:
    if not holds:
        raise Failure("INVALID_TARGET", reason, **numbers)
