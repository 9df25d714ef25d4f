"""How an arm gets past others: it waits, gives way, and plans anew when its way is blocked."""

from __future__ import annotations

from collections.abc import Generator, Iterator, Sequence

from bt_dualarm.arm_planning import REPLANS, ArmPlanning
from bt_dualarm.errors import Failure
from bt_dualarm.motion.planners import DEFAULT_PLANNER, Planner
from bt_dualarm.motion.trajectory import Trajectory
from bt_dualarm.pose import Vector

WAIT_S = 5.0
"""Simulated seconds that an arm waits for another one to leave its goal, unless said otherwise."""

_IN_THE_WAY = ("IN_COLLISION", "TIMED_OUT")


class ArmTravel(ArmPlanning):
    """Going to a configuration in a world in which others move."""

    def travel(
        self,
        goals: Sequence[Vector],
        speed: float,
        ignore: frozenset[str] = frozenset(),
        *,
        give_way: bool = False,
        patience: float = WAIT_S,
        planner: Planner = DEFAULT_PLANNER,
    ) -> Iterator[float | None]:
        """Plan to one of several goals, and follow the plan.

        Where another arm stands at the goal or in the way, it waits for that to change. When
        something has moved into the way meanwhile, the arm stops and plans once more, from where
        it stands, around what is there then.

        Args:
            goals: Configurations of shape (dof,), the preferred one first.
            speed: Share of the limits.
            ignore: Objects that may be touched.
            give_way: Wait at home, so that two arms do not wait for each other.
            patience: Seconds that it waits at most.
            planner: Searches where the straight way is not free.

        Raises:
            Failure: As ``plan`` and ``follow``.
        """
        replans = REPLANS
        while True:
            motion = yield from self._plan_when_clear(
                goals, speed, ignore, patience, planner, give_way=give_way
            )
            try:
                yield from self.follow(motion, ignore)
            except Failure as failure:
                in_the_way = failure.code in _IN_THE_WAY and "progress" in failure.numbers
                if not in_the_way or replans == 0:
                    raise
            else:
                return
            replans -= 1
            yield from self.halt()

    def _plan_when_clear(
        self,
        goals: Sequence[Vector],
        speed: float,
        ignore: frozenset[str],
        patience: float,
        planner: Planner,
        *,
        give_way: bool,
    ) -> Generator[float | None, None, Trajectory]:
        began = self.time
        while True:
            try:
                return (yield from self.plan(goals, speed, ignore, planner))
            except Failure as refusal:
                if not self._may_clear(refusal) or self.time - began > patience:
                    raise
            until = self.time + self._draw_patience()
            while self.time < until:
                yield None
            if give_way:
                yield from self._give_way(speed, ignore)

    def _give_way(self, speed: float, ignore: frozenset[str]) -> Iterator[float | None]:
        """Go home, as far as that is possible."""
        try:
            home = yield from self.plan([self.posture("home")], speed, ignore)
            yield from self.follow(home, ignore)
        except Failure as failure:
            if failure.code not in (*_IN_THE_WAY, "NO_PLAN"):
                raise
            yield from self.halt()

    def _may_clear(self, refusal: Failure) -> bool:
        """Whether another arm is the reason, or may be."""
        others = self.world.arms.keys() - {self.name}
        owner = str(refusal.numbers.get("second", "")).partition("/")[0]
        return owner in others or (refusal.code == "NO_PLAN" and bool(others))
