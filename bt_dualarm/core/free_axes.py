"""Targets that leave the tool free to turn about its own axes.

An arm of five joints cannot take every orientation, and many tasks do not ask for one: a suction
cup may turn about its own axis, a pointer may point from anywhere. ``free`` names the axes of the
tool frame about which a target does not count: none of them, one, or all three, which leaves a
position. Two are not allowed: turns about two axes do not commute, so that the set of allowed
orientations would depend on their order.
"""

from __future__ import annotations

import math
from typing import Final, Literal, TypeAlias, get_args

import numpy as np

from bt_dualarm.core.pose import Pose, Vector

Axis: TypeAlias = Literal["rx", "ry", "rz"]
"""Rotation about an axis of the tool frame."""

FreeAxes: TypeAlias = tuple[Axis, ...]
"""Rotations that a target leaves free: none, one or all three."""

AXES: Final[FreeAxes] = get_args(Axis)
"""All rotations, in the order x, y, z."""

REMEDY: Final = "skills with the port `free` can leave an axis of the tool free, as by free: [rz]"
"""Advice to whoever asks an arm with too few joints for a whole pose."""

_OPPOSITE: Final = 1e-9
"""Distance of a cosine from -1 below which two directions count as opposite."""


def pointing(free: FreeAxes) -> Vector | None:
    """Axis of the tool frame whose direction a target fixes, a unit vector of shape (3,).

    None if the target fixes all of the orientation, or nothing of it.
    """
    if len(free) != 1:
        return None
    axis: Vector = np.eye(3)[AXES.index(free[0])]
    return axis


def angle_to(pose: Pose, target: Pose, free: FreeAxes) -> float:
    """Least angle in rad by which a pose has to turn to be one that the target allows."""
    if not free:
        return pose.angle(target)
    axis = pointing(free)
    if axis is None:
        return 0.0
    here = pose.turn(axis)
    there = target.turn(axis)
    # Of sine and cosine, one is exact where the other is not.
    return math.atan2(float(np.linalg.norm(np.cross(here, there))), float(here @ there))


def nearest_allowed(pose: Pose, target: Pose, free: FreeAxes) -> Pose:
    """The pose at the target's position, among those it allows, that turns least from ``pose``."""
    if not free:
        return target
    axis = pointing(free)
    if axis is None:
        return Pose(target.position, pose.quaternion)
    here = pose.turn(axis)
    there = target.turn(axis)
    cosine = float(here @ there)
    if cosine < _OPPOSITE - 1.0:  # half a turn about any axis across: the next one of the tool
        half = np.array((0.0, *pose.turn(np.roll(axis, 1))))
        turn = Pose(np.zeros(3), half)
    else:
        half = np.array((1.0 + cosine, *np.cross(here, there)))
        turn = Pose(np.zeros(3), half / np.linalg.norm(half))
    return Pose(target.position, (turn @ Pose(np.zeros(3), pose.quaternion)).quaternion)
