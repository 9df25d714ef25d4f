"""How an arm gets past others: it waits, gives way, and plans anew when its way is blocked."""

from __future__ import annotations

from collections.abc import Generator, Iterator, Sequence

from bt_dualarm.arm_planning import REPLANS, ArmPlanning
from bt_dualarm.errors import Failure
from bt_dualarm.motion.planners import DEFAULT_PLANNER, Planner
from bt_dualarm.motion.retreat import places_out_of_the_way
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
        something has moved into the way meanwhile, the arm stops and plans anew, from where it
        stands, around what is there then: once at least, and again while its patience lasts.

        Args:
            goals: Configurations of shape (dof,), the preferred one first.
            speed: Share of the limits.
            ignore: Objects that may be touched.
            give_way: Wait out of the way, so that two arms do not wait for each other.
            patience: Seconds after which it does not wait or plan any more.
            planner: Searches where the straight way is not free.

        Raises:
            Failure: As ``plan`` and ``follow``.
        """
        began, replans = self.time, REPLANS
        while True:
            motion = yield from self._plan_when_clear(
                goals, speed, ignore, began + patience, planner, give_way=give_way
            )
            try:
                yield from self.follow(motion, ignore)
            except Failure as failure:
                in_the_way = failure.code in _IN_THE_WAY and "progress" in failure.numbers
                if not in_the_way or (replans <= 0 and self.time > began + patience):
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
        until: float,
        planner: Planner,
        *,
        give_way: bool,
    ) -> Generator[float | None, None, Trajectory]:
        while True:
            try:
                return (yield from self.plan(goals, speed, ignore, planner))
            except Failure as refusal:
                if not self._may_clear(refusal) or self.time > until:
                    raise
            tried = self.time
            patience = self._draw_patience()
            while self.time < tried + patience:
                yield None
            if give_way:
                yield from self._give_way(speed, ignore)

    def _give_way(self, speed: float, ignore: frozenset[str]) -> Iterator[float | None]:
        """Go out of the way of the other arms, as far as that is possible."""
        others = [body.base.position for name, body in self.world.arms.items() if name != self.name]
        places = places_out_of_the_way(
            self.checker(ignore),
            others,
            tuple(self.robot.postures.values()),
            self.robot.limits,
            self._patience_rng,
        )
        if not places:
            return
        try:
            yield from self.follow((yield from self.plan(places, speed, ignore)), ignore)
        except Failure as failure:
            if failure.code not in (*_IN_THE_WAY, "NO_PLAN"):
                raise
            yield from self.halt()

    def _may_clear(self, refusal: Failure) -> bool:
        """Whether another arm is the reason, or may be."""
        others = self.world.arms.keys() - {self.name}
        owner = str(refusal.numbers.get("second", "")).partition("/")[0]
        return owner in others or (refusal.code == "NO_PLAN" and bool(others))
