"""Curves through points that somebody drew in a plane."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from bt_dualarm.errors import Failure
from bt_dualarm.motion.paths.cartesian_path import Axes, CartesianPath, Mode, through
from bt_dualarm.pose import Pose


def drawn(
    tool: Pose,
    axes: Axes,
    points: Sequence[tuple[float, float]],
    *,
    mode: Mode = "around",
    closed: bool = True,
    repeats: int = 1,
) -> CartesianPath:
    """A smooth curve in a plane through points, in their order; the orientation is kept.

    Args:
        tool: Origin of the points, or with mode ``"from"`` the place of the first one.
        axes: Axes of the plane, along which the points are given.
        points: Points in metres; no two in a row at the same place.
        mode: See ``tool``.
        closed: Whether it goes on from the last to the first, as smoothly as everywhere.
        repeats: Number of passes, more than one only of a closed curve.

    Raises:
        Failure: ``INVALID_TARGET`` for what draws no curve.
    """
    if repeats > 1 and not closed:
        raise Failure("INVALID_TARGET", "only a closed curve can be drawn again and again")
    frame, offsets = np.array(axes), np.array(points, dtype=float)
    origin = tool.position - (offsets[0] @ frame if mode == "from" else 0.0)
    places = origin + offsets @ frame
    path = through([Pose(place, tool.quaternion) for place in places], closed=closed)
    return replace(path, repeats=repeats, center=Pose(origin, tool.quaternion))
