"""A UR5 and a thin wall that its straight path to the other side would cross."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from bt_dualarm.collision.checker import CollisionChecker
from bt_dualarm.core.pose import Vector
from bt_dualarm.planning.problem import PlanningProblem
from bt_dualarm.sim.world import World
from bt_dualarm.spec.document import ObjectSpec
from bt_dualarm.spec.values import PoseSpec
from tests.sim.worlds import arm, file_of

DT = 0.002

RIGHT = np.deg2rad((-50.0, -60.0, 90.0, -120.0, -90.0, 0.0))
LEFT = np.deg2rad((50.0, -60.0, 90.0, -120.0, -90.0, 0.0))
ABOVE = np.deg2rad((-50.0, -120.0, 60.0, -30.0, -90.0, 0.0))


def wall(thickness: float = 0.01, height: float = 0.9, **fields: Any) -> ObjectSpec:
    """A wall between `RIGHT` and `LEFT`."""
    return ObjectSpec(
        shape="box",
        size=(1.0, thickness, height),
        mass=1.0,
        fixed=True,
        pose=PoseSpec(xyz=(0.8, 0.0, height / 2)),
        **fields,
    )


def walled_world(thickness: float = 0.01, height: float = 0.9) -> World:
    """The arm and the wall."""
    return World(file_of({"arm1": arm("ur5")}, {"wall": wall(thickness, height)}))


def locked_world() -> World:
    """Walls on both sides of the arm and one above it: it cannot get to the other side."""
    behind = ObjectSpec(
        shape="box", size=(1.0, 0.01, 3.0), mass=1.0, fixed=True, pose=PoseSpec(xyz=(-0.7, 0, 1.5))
    )
    above = ObjectSpec(
        shape="box", size=(1.0, 0.01, 2.0), mass=1.0, fixed=True, pose=PoseSpec(xyz=(0, 0, 1.9))
    )
    walls = {"wall": wall(height=3.0), "behind": behind, "above": above}
    return World(file_of({"arm1": arm("ur5")}, walls))


def problem_in(world: World, start: Vector, *goals: Vector, **fields: Any) -> PlanningProblem:
    """A planning problem of ``arm1``, by default with its own limits."""
    limits = world.arms["arm1"].robot.limits
    problem = PlanningProblem(CollisionChecker(world, "arm1"), start, goals, limits, DT)
    return replace(problem, **fields)
