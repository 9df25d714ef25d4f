"""Curves of the tool in a plane: circles, arcs, Lissajous curves.

A curve goes exactly through its waypoints; between them it is a cubic spline, periodic where the
curve closes and not-a-knot where it does not. On 20 waypoints such a spline stays within 0.02 mm of
a circle of 0.1 m; natural ends would be off by 0.5 mm.
"""

from __future__ import annotations

import math

import numpy as np
import scipy

from bt_dualarm.motion.paths.cartesian_path import (
    Axes,
    CartesianPath,
    Mode,
    refined,
    require,
    spline,
)
from bt_dualarm.pose import Matrix, Pose


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
    """A circle, or an arc where ``turns`` is not a whole number.

    Args:
        tool: Centre of the circle, or with mode ``"from"`` its first point.
        axes: Angles count from the first one towards the second.
        radius: Radius in metres.
        mode: See ``tool``.
        waypoints: Points on a turn that the path goes through.
        turns: Number of turns.
        begin: Angle of the first point, in radians.
        direction: 1 or -1, which turns away from the second axis.
        tilt: Angle by which the tool's z axis leans towards the centre, in radians; 0 keeps the
            orientation.

    Raises:
        Failure: ``INVALID_TARGET`` for what draws no circle.
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
    """The curve A sin(a t + phase) along the first axis, B sin(b t) along the second.

    Args:
        tool: Centre of the curve, or with mode ``"from"`` its first point.
        axes: Axes of the curve's plane.
        amplitudes: A and B in metres, half the curve's width and height.
        frequencies: A and b, whole numbers; only their ratio matters.
        phase: Phase of the first axis in radians.
        mode: See ``tool``.
        waypoints: Points on the curve that the path goes through.
        repeats: Number of times that the whole curve is drawn, or of a part of it where that is
            no whole number.
        tilt: Angle by which the tool's z axis leans towards the centre where the curve is farthest
            from it, in radians; in between as far as it is away. 0 keeps the orientation.

    Raises:
        Failure: ``INVALID_TARGET`` for what draws no curve.
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
        tool: Centre or start of the curve, and orientation of the tool.
        axes: Axes of its plane.
        offsets: Waypoints from the centre along the axes, of shape (n, 2), m.
        mode: What ``tool`` is.
        waypoints: Number that was asked for.
        repeats: Number of passes.
        tilt: Towards the centre at the farthest waypoint, rad.
    """
    require(waypoints >= 4, "a curve needs 4 waypoints or more", waypoints=waypoints)
    require(bool(np.isfinite(offsets).all()), "a number of the curve is not finite")
    frame = np.array(axes)
    require(
        bool(np.allclose(frame @ frame.T, np.eye(2), atol=1e-6)),
        "the axes of the plane must be orthogonal unit vectors",
    )
    centre = tool.position - (offsets[0] @ frame if mode == "from" else 0.0)
    if repeats:
        offsets[-1] = offsets[0]  # sin and cos leave a rounding error
    points = centre + offsets @ frame
    knots = np.arange(len(points), dtype=float)
    positions = spline(knots, points, bool(repeats))(refined(knots))
    scale = float(np.linalg.norm(offsets, axis=1).max())
    quaternions = _leaning(tool, (positions - centre) * (tilt / scale))
    center = Pose(centre, tool.quaternion)
    return CartesianPath(positions, quaternions, points, bool(repeats), max(repeats, 1), center)


def _leaning(tool: Pose, lean: Matrix) -> Matrix:
    """Orientations, of shape (n, 4), with the tool's z axis turned against each row of ``lean``.

    By the row's length in rad, as far as the row is perpendicular to that axis.
    """
    if not lean.any():
        return np.tile(tool.quaternion, (len(lean), 1))
    turns = scipy.spatial.transform.Rotation.from_rotvec(np.cross(lean, tool.rotation_matrix[:, 2]))
    quaternions: Matrix = (turns * tool.rotation).as_quat(scalar_first=True)
    return quaternions
