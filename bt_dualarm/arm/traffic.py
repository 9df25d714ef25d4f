"""Right of way: which arm waits for which because it is in its path, and who moves aside.

Arms plan and move independently; the guard stops them before they touch. An arm whose goal or path
is blocked by another one waits and plans again. If the other one waits as well, one of the two has
to move aside: the one that has begun to wait later. Whoever waits longest therefore is never asked
to move aside, until it is through; then another one waits longest, and no arm starves.

These waits are part of the wait-for graph of the cell, in addition to those for signals, rendezvous
and claims. If an arm waits forever because the one in its way waits for it or has ended, the run
ends its wait.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, replace

from bt_dualarm.arm.in_step import MotionPair, WaitingMotion
from bt_dualarm.core.errors import Failure
from bt_dualarm.core.pose import Vector
from bt_dualarm.trajectory.set_points import TrajectorySource
from bt_dualarm.trajectory.trajectory import Trajectory


@dataclass(frozen=True)
class BlockedArm:
    """An arm that other arms keep from its goal.

    Attributes:
        arm: Name of the arm.
        path: Path of its leaf in its tree.
        since: Simulated time in seconds at which it was first blocked on its way to this goal.
        blockers: Names of the arms that are in its way now; none while it moves on.
        tries: How often it has found others in its way.
        may_yield: Whether it can move aside: not in the middle of a straight line, for example.
        has_other_path: Whether it takes another path, or moves aside, if the blockers stay.
        wanted: Configurations, of shape (dof,), rad, that it was to take and the blockers prevent.
        why: What its last try to go on met, as a clause.
    """

    arm: str
    path: str
    since: float
    blockers: frozenset[str]
    may_yield: bool
    has_other_path: bool = True
    tries: int = 1
    wanted: tuple[Vector, ...] = ()
    why: str = ""

    @property
    def rank(self) -> tuple[bool, float, str]:
        """Sorts arms by their right of way, first the one that need not move aside."""
        return self.may_yield, self.since, self.arm


class Traffic:
    """The blocked arms of one run.

    All trees that are due are ticked in one physics step. What they change here becomes visible to
    the others in the next step, so that the order of the arms in the file does not matter.

    Args:
        clock: Simulated time in seconds.
    """

    def __init__(self, clock: Callable[[], float]) -> None:
        self._clock = clock
        self._blocked: dict[str, BlockedArm] = {}
        self._before: dict[str, BlockedArm] = {}
        self._refused: dict[str, Failure | None] = {}
        self._changed_at = -1.0
        self._pairs: dict[str, tuple[object, MotionPair]] = {}
        self._leaders: dict[str, tuple[str, Callable[[Trajectory], float]]] = {}

    @property
    def blocked(self) -> tuple[BlockedArm, ...]:
        """Arms that others are in the way of now."""
        return tuple(one for one in self._blocked.values() if one.blockers)

    def block(
        self,
        arm: str,
        path: str,
        blockers: Collection[str],
        *,
        may_yield: bool = True,
        has_other_path: bool = True,
        wanted: Sequence[Vector] = (),
        why: str = "",
    ) -> None:
        """Record that other arms are in the way of an arm; repeated calls of a leaf keep its rank.

        Args:
            arm: Name of the arm.
            path: Path of its leaf in its tree.
            blockers: Names of the arms in its way.
            may_yield: Whether it can move aside.
            has_other_path: As of `BlockedArm`.
            wanted: As of `BlockedArm`.
            why: As of `BlockedArm`.
        """
        known = self._blocked.get(arm)
        if known is not None and known.path != path:
            known = None
        since = self._clock() if known is None else known.since
        self._changing()
        self._blocked[arm] = BlockedArm(
            arm,
            path,
            since,
            frozenset(blockers) - {arm},
            may_yield,
            has_other_path,
            1 if known is None else known.tries + 1,
            tuple(wanted),
            why,
        )

    def advance(self, arm: str) -> None:
        """Record that nothing is in the way of an arm at present; it keeps its rank."""
        if arm in self._blocked:
            self._changing()
            self._blocked[arm] = replace(self._blocked[arm], blockers=frozenset())

    def arrive(self, arm: str, path: str) -> None:
        """Record that a leaf has reached its goal, has given up, or was halted.

        Args:
            arm: Name of its arm; what another leaf of this arm waits for stays recorded.
            path: Path of the leaf in its tree.
        """
        known = self._blocked.get(arm)
        if known is not None and known.path != path:
            return
        self._refused.pop(arm, None)
        if known is not None:
            self._changing()
            del self._blocked[arm]

    def refuse(self, arm: str, failure: Failure) -> None:
        """End an arm's wait, as the arms in its way are going to stay there."""
        self._refused[arm] = failure

    def look_again(self, arm: str) -> None:
        """Let an arm find out at once whether the others are still in its way."""
        self._refused.setdefault(arm)

    def is_called(self, arm: str) -> bool:
        """Whether an arm is to look again at once, or is to wait no longer."""
        return arm in self._refused

    def take_refusal(self, arm: str) -> Failure | None:
        """Reason why an arm need not wait any longer, once; None if it may wait."""
        return self._refused.pop(arm, None)

    def is_in_the_way(self, arm: str) -> bool:
        """Whether another arm waits for this one to leave its path."""
        return any(arm in other.blockers for other in self._visible().values())

    def wanted_by(self, arm: str) -> tuple[Vector, ...]:
        """Configurations that a blocked arm was to take; none if it is not known which."""
        return self._blocked[arm].wanted if arm in self._blocked else ()

    def must_yield(self, arm: str) -> bool:
        """Whether a blocked arm has to move aside for one with the right of way."""
        own = self._blocked.get(arm)
        return (
            own is not None
            and own.may_yield
            and any(
                arm in other.blockers and other.rank < own.rank
                for other in self._visible().values()
            )
        )

    def enter_step(self, arm: str, other: str, action: object) -> None:
        """Let the motions of an arm go in step with those of another one, until `leave_step`.

        Args:
            arm: Name of the arm.
            other: Name of the other arm.
            action: What both arms take part in; motions of one action go in step.
        """
        known = next((pair for one, pair in self._pairs.values() if one is action), None)
        self._pairs[arm] = action, known or MotionPair(arm, other)

    def leave_step(self, arm: str) -> None:
        """Record that the motions of an arm no longer go in step with others."""
        if arm in self._pairs:
            self._pairs.pop(arm)[1].leave(arm)

    def alone_in_step(self, arm: str) -> None:
        """Record that the other arm begins no further motion in step."""
        if arm in self._pairs:
            self._pairs[arm][1].be_alone(arm)

    def begin_motion(self, arm: str, path: str, motion: TrajectorySource) -> None:
        """Let a motion that has just begun wait, if it is to go in step with another one."""
        if arm in self._pairs:
            self._pairs[arm][1].begin(arm, path, self._clock(), motion)

    def abandon_motion(self, arm: str) -> None:
        """Record that the motion of an arm was stopped."""
        if arm in self._pairs:
            self._pairs[arm][1].abandon(arm)

    def give_up_motion(self, arm: str) -> None:
        """Record that the leaf has ended that moved an arm, whether its motion has or not."""
        if arm in self._pairs:
            self._pairs[arm][1].give_up(arm)

    @property
    def waiting_motions(self) -> tuple[WaitingMotion, ...]:
        """Motions that wait for the next motion of another arm."""
        if not self._pairs:
            return ()
        return tuple(
            one for arm, (_, pair) in self._pairs.items() for one in pair.waiting if one.arm == arm
        )

    def start_motions(self) -> None:
        """Start the motions in step that need not wait any longer; after all ticks of a step."""
        for _, pair in {id(pair): (arm, pair) for arm, (_, pair) in self._pairs.items()}.values():
            pair.start()

    def lead(self, arm: str, leader: str, scale_of: Callable[[Trajectory], float]) -> None:
        """Record that an arm follows another one's tool, until `stop_leading`.

        Args:
            arm: Name of the follower.
            leader: Name of the arm that it follows.
            scale_of: Time scale, above 0 to 1, at which it can keep up with a motion of that arm.
        """
        self._leaders[arm] = leader, scale_of

    def stop_leading(self, arm: str) -> None:
        """Record that an arm follows no other one any more."""
        self._leaders.pop(arm, None)

    def leader(self, arm: str) -> str | None:
        """Name of the arm whose tool an arm follows, None if it follows none."""
        return self._leaders[arm][0] if arm in self._leaders else None

    def followers(self, arm: str) -> frozenset[str]:
        """Names of the arms that follow an arm's tool, also those that do so through others."""
        found: frozenset[str] = frozenset()
        while True:
            more = frozenset(
                name for name, (leader, _) in self._leaders.items() if leader in found | {arm}
            )
            if more <= found:
                return found - {arm}
            found |= more

    def time_scale_of(self, arm: str, motion: Trajectory) -> float:
        """Time scale, above 0 to 1, at which all direct followers of an arm can keep up."""
        scales = (scale_of(motion) for leader, scale_of in self._leaders.values() if leader == arm)
        return min(scales, default=1.0)

    def _visible(self) -> dict[str, BlockedArm]:
        return self._before if self._changed_at == self._clock() else self._blocked

    def _changing(self) -> None:
        now = self._clock()
        if self._changed_at != now:
            self._changed_at = now
            self._before = dict(self._blocked)
