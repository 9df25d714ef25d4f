"""Warnings of poses that an arm cannot reach, taken at their face value."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np
from pydantic import ValidationError

from bt_dualarm.errors import Failure
from bt_dualarm.motion.kinematics.arm_kinematics import Kinematics
from bt_dualarm.motion.kinematics.workspace import Workspace
from bt_dualarm.pose import Vector
from bt_dualarm.spec.annotations import metadata_of
from bt_dualarm.spec.document import TreeFile
from bt_dualarm.spec.goals import Goal
from bt_dualarm.spec.kind import Kind
from bt_dualarm.spec.ports import reference_of
from bt_dualarm.spec.problems import Problem
from bt_dualarm.spec.source import Data, with_tuples
from bt_dualarm.spec.values import PoseSpec
from bt_dualarm.world.robots.robot import Robot

MOST_POSES: Final = 100
"""Different poses of one arm that are tried; the check is to stay quick."""

MOST_WARNINGS: Final = 10
"""Of one arm; those that are out of reach take longest to try."""


def out_of_reach(
    file: TreeFile, robots: Mapping[str, Robot], kinds: Mapping[str, Kind]
) -> Iterator[Problem]:
    """Warn of every pose that an arm is sent to and has no configuration for.

    Args:
        file: Without errors.
        robots: Robots by the arm's name.
        kinds: Kinds of all nodes, by name.
    """
    # An object may be held at any of its corners.
    longest = max((math.hypot(*thing.size) for thing in file.objects.values()), default=0.0)
    for name, arm in file.arms.items():
        trial = _Trial(name, robots[name], arm.base, longest)
        found = 0
        for node in arm.tree.walk():
            fields = kinds[node.kind].ports.model_fields if node.kind in kinds else {}
            for port, declared in fields.items():
                goal = metadata_of(declared, Goal)
                complaint = trial.complaint(node.ports.get(port), goal) if goal else None
                if complaint and found < MOST_WARNINGS:
                    found += 1
                    message = f"{node.kind}: {port}: {complaint[0]}"
                    problem = node.port_problem((port,), message, complaint[1])
                    yield replace(problem, severity="warning")


@dataclass
class _Trial:
    """One arm that is sent to poses; each different one is tried once."""

    arm: str
    robot: Robot
    base: PoseSpec
    longest: float
    _known: dict[tuple[PoseSpec, Goal], tuple[str, str] | None] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self._workspace: Workspace | None = None
        self._kinematics: Kinematics | None = None

    def complaint(self, value: Data, goal: Goal) -> tuple[str, str] | None:
        """What is wrong with a pose in YAML's notation, and a hint; None if it can be reached."""
        if value is None or reference_of(value) is not None:
            return None
        try:
            pose = PoseSpec.model_validate(with_tuples(value))
        except ValidationError:
            return None  # a part of it is a key of the blackboard
        asked = (pose, goal)
        if asked not in self._known:
            if len(self._known) >= MOST_POSES:
                return None
            self._known[asked] = self._tried(pose, goal)
        return self._known[asked]

    def _tried(self, pose: PoseSpec, goal: Goal) -> tuple[str, str] | None:
        point = np.array(pose.xyz)
        away = float(np.linalg.norm(point - self.base.pose.position))
        hint = f"it is {away:.2f} m from the arm's base"
        gap = self._position_gap(point)
        if gap > (self.longest if goal.carried else 0.0):
            nearest = f"{gap:.2f} m" if gap >= 0.01 else f"{1000 * gap:.1f} mm"
            message = f"out of reach of {self.arm}: its tool gets no nearer than {nearest}"
            return message, hint
        turned = pose.rpy or pose.quat or pose.look_at
        if goal.carried or turned is None or self._has_configuration(pose):
            return None
        return f"{self.arm} reaches this point, but not turned like this", hint

    def _position_gap(self, point: Vector) -> float:
        if self._workspace is None:
            self._workspace = Workspace(self.robot, self.base.pose)
        return self._workspace.gap(point)

    def _has_configuration(self, pose: PoseSpec) -> bool:
        if self._kinematics is None:
            self._kinematics = Kinematics(self.robot, self.base.pose)
        try:
            self._kinematics.solve(pose.pose, self.robot.postures["home"])
        except Failure:
            return False
        return True
