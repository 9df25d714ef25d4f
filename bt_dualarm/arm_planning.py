"""How an arm finds its motions, and what it refuses, on the world as it stands."""

from __future__ import annotations

from collections.abc import Generator, Iterator, Sequence

import numpy as np

from bt_dualarm.arm_motion import HALT_S, ArmMotion
from bt_dualarm.errors import Failure
from bt_dualarm.motion import timing
from bt_dualarm.motion.collision import CollisionChecker
from bt_dualarm.motion.controller import JointController
from bt_dualarm.motion.joint_motion import refuse_contact, straight_motion
from bt_dualarm.motion.joint_range import refuse_beyond
from bt_dualarm.motion.paths import line
from bt_dualarm.motion.planners import DEFAULT_PLANNER, Planner
from bt_dualarm.motion.planning import PlanningProblem, admitted
from bt_dualarm.motion.planning_process import PendingMotion, PlanningProcess
from bt_dualarm.motion.trajectory import Trajectory
from bt_dualarm.motion.vicinity import clearance
from bt_dualarm.pose import Matrix, Pose, Vector
from bt_dualarm.world.camera import Camera
from bt_dualarm.world.world import World

PLANNING_S = 0.1
"""Simulated seconds that planning costs, whatever it costs on the wall."""

PLANNING_MARGIN_M = 0.045
"""Distance in metres that plans keep from other arms: more than the guard asks for."""

REPLANS = 1
"""How often an arm plans anew when something has moved into its way."""


class ArmPlanning(ArmMotion):
    """Paths, plans and refusals; nothing here moves the arm.

    Args:
        world, name, controller, camera, seed: As for `ArmState`.
        planning: Looks for ways around what is in the way.
    """

    def __init__(
        self,
        world: World,
        name: str,
        controller: JointController,
        camera: Camera | None,
        seed: int,
        planning: PlanningProcess,
    ) -> None:
        super().__init__(world, name, controller, camera, seed)
        self._planning = planning

    def think(self) -> Iterator[None]:
        """Let the simulated time of planning pass; plan afterwards, on the world as it is then.

        What an earlier leaf has begun is braked first: plans start where the arm stands.

        Raises:
            Failure: ``BUSY`` when another leaf moves the arm; ``TRACKING_ERROR`` when it does not
                come to rest.
        """
        began = self.time
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
            goals: Each of shape (dof,), rad, the preferred one first.
            speed: Share of the limits.
            ignore: Objects that may be touched.
            planner: Searches where the straight way to the preferred goal is not free.

        Raises:
            Failure: ``IN_COLLISION`` or ``JOINT_LIMIT`` of the start, or of the preferred goal if
                the arm can stand in none; ``NO_PLAN``; ``BUSY`` when another leaf moves the arm;
                ``TRACKING_ERROR`` when it does not come to rest.
        """
        yield from self._come_to_rest()
        for replan in range(REPLANS, -1, -1):
            motion = yield from self._plan_once(goals, speed, ignore, planner)
            try:
                refuse_contact(self.checker(ignore), motion.q)
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
        due = self.time + PLANNING_S
        problem = admitted(self._problem(goals, speed, ignore, planner))
        straight = straight_motion(problem)
        if straight is not None:
            yield from self._pass_until(due)
            return straight
        pending = self._planning.solve(problem)
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
            self.setpoint.q,
            tuple(goals),
            self.limits(speed),
            self.period,
            self._seed,
            planner,
        )

    def _come_to_rest(self) -> Iterator[None]:
        began = self.time
        self._refuse_if_busy()
        while self.controller.motion is not None:
            if self.time - began > HALT_S:
                raise Failure("TRACKING_ERROR", f"{self.name} still moves after {HALT_S:g} s")
            yield
            self._refuse_if_busy()

    def _pass_until(self, time: float) -> Iterator[None]:
        while self.time < time:
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
        refuse_contact(self.checker(ignore), q)

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

    def planned_tool_positions(self, trajectory: Trajectory) -> Matrix:
        """Where each set-point of a motion puts the tool, of shape (n, 3)."""
        return np.array([self.kinematics.matrix(q)[:3, 3] for q in trajectory.q])


def _found(pending: PendingMotion) -> Trajectory:
    """What was looked for; a refusal says what looking for it has cost."""
    try:
        return pending.result()
    except Failure as refusal:
        numbers = {**refusal.numbers, "planning_s": PLANNING_S}
        raise Failure(refusal.code, refusal.reason, **numbers) from refusal
