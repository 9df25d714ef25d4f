"""How an arm finds its motions, and what it refuses, on the world as it stands."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from bt_dualarm.arm_motion import ArmMotion
from bt_dualarm.errors import Failure
from bt_dualarm.motion import timing
from bt_dualarm.motion.collision import CollisionChecker
from bt_dualarm.motion.guard import clearance
from bt_dualarm.motion.joint_motion import free_motion, refuse_contact
from bt_dualarm.motion.joint_range import refuse_beyond
from bt_dualarm.motion.paths import line
from bt_dualarm.motion.sweep import sweep_radii
from bt_dualarm.motion.trajectory import Trajectory
from bt_dualarm.pose import Matrix, Pose, Vector

PLANNING_S = 0.1
"""Simulated seconds that planning costs, whatever it costs on the wall."""

PLANNING_MARGIN_M = 0.045
"""Distance in metres that plans keep from other arms: more than the guard asks for."""


class ArmPlanning(ArmMotion):
    """Paths, plans and refusals; nothing here moves the arm."""

    def think(self) -> Iterator[None]:
        """Let the simulated time of planning pass; plan afterwards, on the world as it is then.

        What an earlier leaf has begun is braked meanwhile: plans start where the arm stands.

        Raises:
            Failure: ``BUSY`` when another leaf moves the arm.
        """
        until = self.time + PLANNING_S
        while self.time < until or self.controller.motion is not None:
            self._refuse_if_busy()
            yield

    def checker(self, ignore: frozenset[str] = frozenset()) -> CollisionChecker:
        """A test of configurations against the world as it stands now.

        Args:
            ignore: Objects that may be touched.

        Returns:
            One that keeps `PLANNING_MARGIN_M` from other arms.
        """
        clear = PLANNING_MARGIN_M
        while True:  # nearer to another arm already: keep what there is
            checker = CollisionChecker(self.world, self.name, max(clear, 0.0), ignore)
            contact = checker.contact(self.setpoint.q) if clear > 0.0 else None
            if contact is None or contact.second.partition("/")[0] not in self.world.arms:
                return checker
            if -contact.depth <= 0.0:
                return checker
            clear = min(clearance(-contact.depth, clear), clear - 1e-4)

    def refuse_collision(self, q: Vector, ignore: frozenset[str] = frozenset()) -> None:
        """Check a configuration before anything moves.

        Raises:
            Failure: ``IN_COLLISION`` with the two bodies and how deep they are in each other.
        """
        contact = self.checker(ignore).contact(q)
        if contact is not None:
            raise contact.failure()

    def refuse_collision_along(self, q: Matrix, ignore: frozenset[str] = frozenset()) -> None:
        """Check configurations, of shape (n, dof), before anything moves.

        Raises:
            Failure: ``IN_COLLISION`` at the first one that touches something.
        """
        checker = self.checker(ignore)
        refuse_contact(checker, q, sweep_radii(checker))

    def line(self, start: Pose, end: Pose) -> Matrix:
        """Configurations, of shape (n, dof), along a straight line of the tool.

        Raises:
            Failure: ``UNREACHABLE`` or ``PATH_BROKEN``.
        """
        return self.kinematics.follow(line(start, end).poses, self.setpoint.q)

    def time_path(self, q: Matrix, speed: float) -> Trajectory:
        """The motion through configurations, of shape (n, dof), at a share of the limits."""
        return timing.time_path(q, self.limits(speed), self.period)

    def straight_to(self, goal: Vector, speed: float) -> Trajectory:
        """The motion to the configuration ``goal`` in which all joints turn evenly.

        Raises:
            Failure: ``INVALID_TARGET``, ``JOINT_LIMIT`` or ``IN_COLLISION``.
        """
        refuse_beyond(self.robot.joints, goal, self.robot.limits)
        motion = timing.point_to_point(self.setpoint.q, goal, self.limits(speed), self.period)
        self.refuse_collision_along(motion.q)
        return motion

    def plan_to(
        self, goal: Vector, speed: float, ignore: frozenset[str] = frozenset()
    ) -> Trajectory:
        """A motion free of collisions to the configuration ``goal``, straight where possible.

        Raises:
            Failure: ``IN_COLLISION`` or ``NO_PLAN``.
        """
        return free_motion(
            self.checker(ignore),
            self.setpoint.q,
            goal,
            self.limits(speed),
            self.period,
            self._seed,
        )

    def plan_to_any(
        self, goals: Sequence[Vector], speed: float, ignore: frozenset[str] = frozenset()
    ) -> Trajectory:
        """As ``plan_to``, to the first of several goals that has a way.

        Raises:
            Failure: Why the first goal has none, if no goal has one; ``NO_PLAN`` if one of them
                at least is free, and only the way to it is not.
        """
        refusals = []
        for goal in goals:
            try:
                return self.plan_to(goal, speed, ignore)
            except Failure as refusal:
                refusals.append(refusal)
        raise next((one for one in refusals if one.code == "NO_PLAN"), refusals[0])

    def planned_tool_positions(self, trajectory: Trajectory) -> Matrix:
        """Where each set-point of a motion puts the tool, of shape (n, 3)."""
        return np.array([self.kinematics.matrix(q)[:3, 3] for q in trajectory.q])
