"""The friction on a robot's page, checked against its joints."""

from __future__ import annotations

import numpy as np

from bt_dualarm.pose import Vector
from bt_dualarm.spec.problems import Problem
from bt_dualarm.world.robots.friction import JointFriction
from bt_dualarm.world.robots.page import RobotFile

_OPTIONAL = ("viscous", "static", "rise", "offset")


def friction_of(file: RobotFile, effort: Vector, problems: list[Problem]) -> JointFriction:
    """The friction that the page gives, else what is typical of the efforts.

    Args:
        file: Page of the robot.
        effort: Effort limits of its joints, of shape (dof,), N m.
        problems: List that takes what is wrong.
    """
    entry = file.entry.friction
    if entry is None:
        return JointFriction.typical(effort)
    given = {name: getattr(entry, name) for name in ("coulomb", *_OPTIONAL)}
    found: dict[str, Vector] = {}
    for name, values in given.items():
        found[name] = np.zeros_like(effort)
        if values is None:
            continue
        if len(values) != len(effort):
            message = f"has {len(values)} values, the arm {len(effort)} joints"
            problems.append(file.problem(("friction", name), message))
            return JointFriction.typical(effort)
        found[name] = np.array(values)
    if entry.static is None:
        found["static"] = found["coulomb"]
    if (found["static"] < found["coulomb"]).any():
        message = "a joint that stands rubs less than one that moves"
        problems.append(file.problem(("friction", "static"), message, "at least coulomb"))
    speed = np.full_like(effort, entry.stribeck_velocity)
    return JointFriction(stribeck_velocity=speed, **found)  # type: ignore[arg-type]  # no uncertainty among them
