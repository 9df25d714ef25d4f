"""Limits of an arm's joints, of its URDF and its page together."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

import numpy as np

from bt_dualarm.pose import Vector
from bt_dualarm.spec.problems import Problem
from bt_dualarm.world.robots.page import LimitEntry, RobotFile
from bt_dualarm.world.robots.robot import JointLimits
from bt_dualarm.world.urdf.attributes import Range
from bt_dualarm.world.urdf.joint import Stops

RANGES: Final[Mapping[str, Range]] = {
    "velocity": Range(1e-3, 1e3, "rad/s"),
    "acceleration": Range(1e-3, 1e5, "rad/s²"),
    "jerk": Range(1e-2, 1e7, "rad/s³"),
    "effort": Range(1e-4, 1e6, "N m"),
}
"""What a limit may be: beyond lies no arm, and no motion that ends in a time worth computing."""


def limits_of(file: RobotFile, stops: Mapping[str, Stops], problems: list[Problem]) -> JointLimits:
    """The URDF's limits; the page may tighten velocity and effort, never widen them.

    Where the URDF gives none, or zero, the page's are taken.

    Args:
        file: Page of the robot.
        stops: Limits of its joints in the URDF.
        problems: List that takes what is wrong.
    """
    unknown = Stops(0.0, 0.0, 1.0, 1.0)  # of a joint that is refused already
    own = [stops.get(joint, unknown) for joint in file.entry.joints]
    given = file.entry.limits
    velocity = np.array([stop.velocity for stop in own])
    effort = np.array([stop.effort for stop in own])
    return JointLimits(
        lower=np.array([stop.lower for stop in own]),
        upper=np.array([stop.upper for stop in own]),
        velocity=_tightened(file, "velocity", given.velocity, velocity, problems),
        acceleration=_per_joint(file, "acceleration", given.acceleration, problems),
        jerk=_per_joint(file, "jerk", given.jerk, problems),
        effort=_tightened(file, "effort", given.effort, effort, problems),
    )


def _tightened(
    file: RobotFile, what: str, entry: LimitEntry | None, urdf: Vector, problems: list[Problem]
) -> Vector:
    """The smaller of the URDF's limit and the page's where there are two, of shape (dof,)."""
    if entry is not None:
        given = _per_joint(file, what, entry, problems)
        return np.where(urdf > 0, np.minimum(urdf, given), given)
    for joint, limit in zip(file.entry.joints, urdf, strict=True):
        if not limit > 0:
            message = f"{file.entry.urdf} gives no {what} for joint '{joint}'"
            problems.append(file.problem(("limits",), message, f"add {what}"))
        elif not RANGES[what].holds(limit):
            message = f"{file.entry.urdf} gives {what} {limit:g} for joint '{joint}'"
            hint = f"add {what}: a limit is {RANGES[what]}"
            problems.append(file.problem(("limits",), message, hint))
    return urdf


def _per_joint(file: RobotFile, what: str, limit: LimitEntry, problems: list[Problem]) -> Vector:
    """The page's limit for each joint, of shape (dof,)."""
    dof, place = len(file.entry.joints), ("limits", what, "value")
    values = limit.value if isinstance(limit.value, tuple) else (limit.value,) * dof
    if len(values) != dof:
        message = f"has {len(values)} values, the arm {dof} joints"
        problems.append(file.problem(place, message))
        return np.ones(dof)
    for number, value in enumerate(values):
        if not RANGES[what].holds(value):
            message = f"{what}: must be {RANGES[what]}, not {value:g}"
            problems.append(file.problem((*place, number), message))
    return np.array(values)
