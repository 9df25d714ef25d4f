"""How an arm goes somewhere while others move: it waits, gives way, and plans anew."""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterator, Sequence
from dataclasses import dataclass
from typing import TypeAlias, TypeVar

import numpy as np

from bt_dualarm.arm.execution import Executor
from bt_dualarm.arm.patience import Patience
from bt_dualarm.arm.planning import REPLANS, ArmPlanner
from bt_dualarm.arm.state import ArmState
from bt_dualarm.errors import BlockedFailure, CollisionFailure, Failure
from bt_dualarm.motion.planning.give_way import places_out_of_the_way
from bt_dualarm.motion.planning.planners import DEFAULT_PLANNER, Planner
from bt_dualarm.motion.timing.trajectory import Trajectory
from bt_dualarm.pose import Matrix, Pose, Vector

Planning: TypeAlias = Callable[[], Generator[None, None, Trajectory]]
"""Makes a motion from where the arm stands, in the world as it is then; yields once a tick."""

_Found = TypeVar("_Found")

WAIT_S = 5.0
"""Simulated seconds that an arm waits for another one to leave its goal, unless said otherwise."""

_HARMLESS = ("IN_COLLISION", "TIMED_OUT", "NO_PLAN")
"""Codes with which giving way may fail: the arm then waits where it is."""


@dataclass(frozen=True, eq=False)
class MoveTo:
    """Ways of one leaf in a world in which others move.

    Attributes:
        arm: State of the arm.
        executor: Executor of the leaf that goes there.
        planner: Planner of the same leaf.
        patience: Time that the arm waits before it tries again.
        speed: Share of the limits, above 0 to 1.
        ignore: Names of the objects that may be touched.
        search: Planner that searches where the straight way is not free.
        give_way: Whether it waits out of the way, so that two arms do not wait for each other.
        wait_s: Simulated seconds after which it does not wait or plan any more.
    """

    arm: ArmState
    executor: Executor
    planner: ArmPlanner
    patience: Patience
    speed: float
    ignore: frozenset[str] = frozenset()
    search: Planner = DEFAULT_PLANNER
    give_way: bool = False
    wait_s: float = WAIT_S

    def go(self, goals: Sequence[Vector]) -> Iterator[float | None]:
        """Plan and follow the plan, until the arm stands at one of the goals; yields once a tick.

        Args:
            goals: Configurations, each of shape (dof,), rad, the preferred one first.

        Raises:
            Failure: As `ArmPlanner.plan` and `Executor.follow`.
        """
        return self.along(lambda: self._plan(goals, self.search))

    def straight(self, end: Pose, *, known_free: bool = False) -> Iterator[float | None]:
        """Go straight to a pose of the tool in the world, as `along`; yields once a tick.

        Args:
            end: The pose.
            known_free: Whether nothing but another arm can be in the way of the whole line.

        Raises:
            Failure: As `ArmPlanner.line_on`, `ArmPlanner.time_path` and `Executor.follow`;
                ``IN_COLLISION``.
        """
        start = self.arm.setpoint.q

        def planned() -> Generator[None, None, Trajectory]:
            rows = self.planner.line_on(end)
            stands = bool(np.array_equal(self.arm.setpoint.q, start))
            yield from self._checked(rows, known_free and stands)
            return self.planner.time_path(rows, self.speed)

        return self.along(planned)

    def until_free(self, rows: Matrix, *, known_free: bool = False) -> Iterator[float | None]:
        """Wait until no other arm is in the way; yields once a tick.

        Args:
            rows: Configurations along the way, of shape (n, dof), rad.
            known_free: Whether nothing but another arm can be in the way.

        Raises:
            Failure: ``IN_COLLISION`` with what else is in the way, or with an arm that stays.
        """
        until = self.arm.time + self.wait_s
        return self._when_clear(lambda: self._checked(rows, known_free), until)

    def along(self, planning: Planning) -> Iterator[float | None]:
        """Plan and follow the plan to its end; yields once a tick.

        Where another arm stands at the goal or in the way, it waits for that to change. When
        something has moved into the way meanwhile, the arm stops and plans anew, from where it
        stands, around what is there then: once at least, and again while its patience lasts.

        Args:
            planning: Makes the plan, each time.

        Raises:
            Failure: As ``planning`` and `Executor.follow`.
        """
        until, replans = self.arm.time + self.wait_s, REPLANS
        while True:
            motion = yield from self._when_clear(planning, until)
            try:
                yield from self.executor.follow(motion, self.ignore)
            except BlockedFailure:
                if replans <= 0 and self.arm.time > until:
                    raise
            else:
                return
            replans -= 1
            yield from self.executor.halt()

    def _when_clear(
        self, attempt: Callable[[], Generator[None, None, _Found]], until: float
    ) -> Generator[float | None, None, _Found]:
        while True:
            try:
                return (yield from attempt())
            except Failure as refusal:
                if not self._may_clear(refusal) or self.arm.time > until:
                    raise
            again = self.arm.time + self.patience.renew()
            while self.arm.time < again:
                yield None
            if self.give_way:
                yield from self._go_out_of_the_way()

    def _go_out_of_the_way(self) -> Iterator[float | None]:
        """Go out of the way of the other arms, as far as that is possible."""
        arm = self.arm
        others = [arm.world.arms[name].base.position for name in arm.controller.neighbours]
        places = places_out_of_the_way(
            self.planner.checker(self.ignore),
            others,
            tuple(arm.robot.postures.values()),
            arm.robot.limits,
            self.patience.rng,
        )
        if not places:
            return
        try:
            motion = yield from self._plan(places, DEFAULT_PLANNER)
            yield from self.executor.follow(motion, self.ignore)
        except Failure as failure:
            if failure.code not in _HARMLESS:
                raise
            yield from self.executor.halt()

    def _plan(self, goals: Sequence[Vector], search: Planner) -> Generator[None, None, Trajectory]:
        return self.planner.plan(goals, self.speed, self.ignore, search)

    def _checked(self, rows: Matrix, known_free: bool) -> Generator[None, None, None]:
        """Refuse what is in the way now; only another arm where all else is known to be free."""
        yield from ()
        if known_free and not self.arm.controller.neighbours:
            return
        try:
            self.planner.refuse_collision_along(rows, self.ignore)
        except CollisionFailure as refusal:
            if not known_free or self._may_clear(refusal):
                raise

    def _may_clear(self, refusal: Failure) -> bool:
        """Whether another arm, or what it holds, is the reason, or may be."""
        ways, neighbours = refusal.__cause__, self.arm.controller.neighbours
        if isinstance(ways, ExceptionGroup):
            return any(isinstance(one, Failure) and self._may_clear(one) for one in ways.exceptions)
        if not isinstance(refusal, CollisionFailure):
            return refusal.code == "NO_PLAN" and bool(neighbours)
        held = self.arm.world.attachments
        return refusal.obstacle in neighbours or any(
            held.find(name, refusal.obstacle) is not None for name in neighbours
        )
