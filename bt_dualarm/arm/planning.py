"""How an arm finds its motions, and what it refuses, on the world as it stands."""

from __future__ import annotations

import itertools
from collections.abc import Generator, Iterator, Sequence

import numpy as np

from bt_dualarm.arm.carrying import Carrying
from bt_dualarm.arm.execution import HALT_S
from bt_dualarm.arm.lease import Leaseholder
from bt_dualarm.arm.state import ArmState
from bt_dualarm.errors import Failure
from bt_dualarm.motion.collision.checker import CollisionChecker
from bt_dualarm.motion.kinematics.joint_limits import refuse_beyond
from bt_dualarm.motion.paths.cartesian_path import line
from bt_dualarm.motion.planning.joint_motion import refuse_contact, straight_motion
from bt_dualarm.motion.planning.planners import DEFAULT_PLANNER, Planner
from bt_dualarm.motion.planning.problem import PlanningProblem, admitted
from bt_dualarm.motion.planning.process import PendingMotion, PlanningProcess
from bt_dualarm.motion.safety.separation_rule import clearance
from bt_dualarm.motion.timing.point_to_point import point_to_point, time_path
from bt_dualarm.motion.timing.trajectory import Trajectory
from bt_dualarm.pose import Matrix, Pose, Vector

PLANNING_S = 0.1
"""Simulated seconds that planning costs, whatever it costs on the wall."""

PLANNING_MARGIN_M = 0.045
"""Distance in metres that plans keep from other arms: more than the guard asks for."""

REPLANS = 1
"""How often an arm plans anew when something has moved into its way."""


class ArmPlanner:
    """Paths, plans and refusals of one leaf; nothing here moves the arm.

    Args:
        arm: State of the arm.
        lease: Lease of the arm, as the leaf holds it: who may not move does not plan.
        process: Process that looks for ways around what is in the way.
        carrying: What the arm can carry.
        seed: Seed of everything random in a plan.
    """

    def __init__(
        self,
        arm: ArmState,
        lease: Leaseholder,
        process: PlanningProcess,
        carrying: Carrying,
        seed: int,
    ) -> None:
        self._arm = arm
        self._lease = lease
        self._process = process
        self._seed = seed
        self._carrying = carrying

    def think(self) -> Iterator[None]:
        """Let the simulated time of planning pass; plan afterwards, on the world as it is then.

        What an earlier leaf has begun is braked first: plans start where the arm stands.

        Raises:
            Failure: ``BUSY`` when another leaf moves the arm; ``TRACKING_ERROR`` when it does not
                come to rest.
        """
        began = self._arm.time
        yield from self._come_to_rest()
        yield from self._pass_until(began + PLANNING_S)

    def plan(
        self,
        goals: Sequence[Vector],
        speed: float,
        ignore: frozenset[str] = frozenset(),
        planner: Planner = DEFAULT_PLANNER,
    ) -> Generator[None, None, Trajectory]:
        """A motion free of collisions to one of several configurations, straight where possible.

        Yields once a tick. It plans on the world as it is at the start, which takes
        ``PLANNING_S``, and checks the plan against the world as it is then; where that has changed
        too much it plans once more.

        Args:
            goals: Configurations, each of shape (dof,), rad, the preferred one first.
            speed: Share of the limits, above 0 to 1.
            ignore: Names of the objects that may be touched.
            planner: Planner that searches where the straight way to the preferred goal is not free.

        Raises:
            Failure: ``IN_COLLISION`` or ``JOINT_LIMIT`` of the start, or of the preferred goal if
                the arm can stand in none; ``NO_PLAN``; ``OVERLOADED``; ``BUSY`` when another leaf
                moves the arm; ``TRACKING_ERROR`` when it does not come to rest.
        """
        yield from self._come_to_rest()
        for replan in range(REPLANS, -1, -1):
            found = yield from self._plan_once(goals, speed, ignore, planner)
            motion = self._carrying.within_efforts(found)
            try:
                refuse_contact(self.checker(ignore), motion)
            except Failure:
                if not replan:
                    raise
            else:
                break
        return motion

    def _plan_once(
        self,
        goals: Sequence[Vector],
        speed: float,
        ignore: frozenset[str],
        planner: Planner,
    ) -> Generator[None, None, Trajectory]:
        due = self._arm.time + PLANNING_S
        problem = admitted(self._problem(goals, speed, ignore, planner))
        straight = straight_motion(problem)
        if straight is not None:
            yield from self._pass_until(due)
            return straight
        pending = self._process.solve(problem)
        try:
            yield from self._pass_until(due)
            return _found(pending)
        finally:
            pending.abandon()

    def _problem(
        self, goals: Sequence[Vector], speed: float, ignore: frozenset[str], planner: Planner
    ) -> PlanningProblem:
        return PlanningProblem(
            self.checker(ignore),
            self._arm.setpoint.q,
            tuple(goals),
            self._arm.limits(speed),
            self._arm.period,
            self._seed,
            planner,
        )

    def _come_to_rest(self) -> Iterator[None]:
        began = self._arm.time
        self._lease.refuse_if_busy()
        while self._arm.controller.motion is not None:
            if self._arm.time - began > HALT_S:
                raise Failure("TRACKING_ERROR", f"{self._arm.name} still moves after {HALT_S:g} s")
            yield
            self._lease.refuse_if_busy()

    def _pass_until(self, time: float) -> Iterator[None]:
        while self._arm.time < time:
            self._lease.refuse_if_busy()
            yield

    def checker(self, ignore: frozenset[str] = frozenset()) -> CollisionChecker:
        """A test of configurations against the world as it stands now.

        Args:
            ignore: Names of the objects that may be touched.

        Returns:
            A checker that keeps `PLANNING_MARGIN_M` from other arms, or from one that is nearer
            already what there is.
        """
        keeps = dict.fromkeys(self._arm.world.arms, PLANNING_MARGIN_M)
        while True:
            checker = CollisionChecker(self._arm.world, self._arm.name, keeps, ignore)
            contact = checker.contact(self._arm.setpoint.q)
            if contact is None or contact.depth >= 0.0:
                return checker
            near = contact.second.partition("/")[0]
            if keeps.get(near, 0.0) <= 0.0:
                return checker
            keeps[near] = max(min(clearance(-contact.depth, keeps[near]), keeps[near] - 1e-4), 0.0)

    def refuse_collision(self, q: Vector, ignore: frozenset[str] = frozenset()) -> None:
        """Check a configuration before anything moves.

        Raises:
            Failure: ``IN_COLLISION`` with the two bodies and how deep they are in each other.
        """
        contact = self.checker(ignore).contact(q)
        if contact is not None:
            raise contact.failure()

    def refuse_collision_along(
        self, way: Matrix | Trajectory, ignore: frozenset[str] = frozenset()
    ) -> None:
        """Check a motion, or configurations of shape (n, dof), rad, before anything moves.

        Raises:
            Failure: ``IN_COLLISION`` at the first one that touches something.
        """
        refuse_contact(self.checker(ignore), way)

    def line(self, start: Pose, end: Pose) -> Matrix:
        """Configurations, of shape (n, dof), rad, along a straight line of the tool.

        Its branch is chosen for the line, see `Kinematics.follow`: the arm has to go to the first
        configuration before. From where the arm is now leads `line_on`.

        Raises:
            Failure: ``UNREACHABLE``, ``PATH_BROKEN`` or ``SINGULAR``.
        """
        return self._arm.kinematics.follow(line(start, end).poses, self._arm.setpoint.q)

    def lines(self, *corners: Pose) -> Iterator[list[Matrix]]:
        """Straight lines of the tool from corner to corner, in each branch that allows all of them.

        Args:
            corners: Poses of the tool in the world, at least two.

        Yields:
            For each line its configurations, of shape (n, dof), rad; each begins where the one
            before ends. The preferred branch comes first, see `Kinematics.branches_along`.

        Raises:
            Failure: ``UNREACHABLE``, ``PATH_BROKEN`` or ``SINGULAR``, if there is none.
        """
        poses, ends = [corners[0]], [0]
        for start, end in itertools.pairwise(corners):
            poses += line(start, end).poses[1:]
            ends.append(len(poses) - 1)
        for rows in self._arm.kinematics.branches_along(poses, self._arm.setpoint.q):
            yield [rows[first : last + 1] for first, last in itertools.pairwise(ends)]

    def line_on(self, end: Pose) -> Matrix:
        """Configurations, of shape (n, dof), rad, straight on from the last set-point to a pose.

        The first one is that set-point, and the arm stays in its branch.

        Raises:
            Failure: ``PATH_BROKEN`` or ``SINGULAR``.
        """
        return self.line_after(self._arm.setpoint.q, end)

    def line_after(self, q: Vector, end: Pose) -> Matrix:
        """As `line_on`, from another configuration ``q``, of shape (dof,), rad."""
        start = self._arm.kinematics.forward(q)
        return self._arm.kinematics.follow_on(line(start, end).poses, q)

    def time_path(self, q: Matrix, speed: float) -> Trajectory:
        """The motion through configurations, of shape (n, dof), at a share of the limits.

        Raises:
            Failure: ``OVERLOADED``.
        """
        return self._carrying.within_efforts(
            time_path(q, self._arm.limits(speed), self._arm.period)
        )

    def straight_to(self, goal: Vector, speed: float) -> Trajectory:
        """The motion to the configuration ``goal`` in which all joints turn evenly.

        Raises:
            Failure: ``INVALID_TARGET``, ``JOINT_LIMIT``, ``OVERLOADED`` or ``IN_COLLISION``.
        """
        refuse_beyond(self._arm.robot.joints, goal, self._arm.robot.limits)
        motion = point_to_point(
            self._arm.setpoint.q, goal, self._arm.limits(speed), self._arm.period
        )
        self.refuse_collision_along(motion)
        return self._carrying.within_efforts(motion)

    def planned_tool_positions(self, trajectory: Trajectory) -> Matrix:
        """Positions of the tool in the world at a motion's set-points, of shape (n, 3), m."""
        return np.array([self._arm.kinematics.matrix(q)[:3, 3] for q in trajectory.q])


def _found(pending: PendingMotion) -> Trajectory:
    """What was looked for; a refusal says what looking for it has cost."""
    try:
        return pending.result()
    except Failure as refusal:
        refusal.noting(planning_s=PLANNING_S)
        raise
