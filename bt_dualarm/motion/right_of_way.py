"""Keeps what one arm commits itself to clear of what the other arms have committed themselves to.

Every arm has a commitment: its set-points until it rests (`Commitment`). It takes a new one only
if that is clear, at each time to come, of those that the others have then. Arms look one after the
other; thus what all have committed themselves to is clear at any time, and so is what they do.

Where the others are far away, an arm commits itself to no more than to stay within some distance.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from bt_dualarm.motion.braking import ways_at_will
from bt_dualarm.motion.hull import Hull, apart
from bt_dualarm.motion.limiter import SetPoint
from bt_dualarm.motion.separation import HORIZON, Gap, Separation
from bt_dualarm.pose import Matrix, Vector
from bt_dualarm.world.commitment import Commitment
from bt_dualarm.world.world import World

FAR_M = 0.01
"""By how much more arms must be apart, in metres, that are not looked at any nearer."""

SAMPLE_S = 0.032
"""Seconds of a way between two measured distances; less where they do not clear what is between.

In that time a point leaves the straight line by about a millimetre at 10 m/s².
"""


_BEYOND = 0.07  # metres beyond what is asked for in which things are measured


@dataclass(frozen=True, eq=False)
class Sample:
    """The arms at one time to come.

    Attributes:
        gap: Between them.
        metres: Likewise, or as far as was measured.
        q: Configurations by arm, each of shape (dof,).
        centers: Of the arms' shapes, each of shape (m, 3).
    """

    gap: Gap
    metres: float
    q: dict[str, Vector]
    centers: dict[str, Matrix]


@dataclass(frozen=True, eq=False)
class Shape:
    """An arm as it is at a simulated time in s: as `Hull.spheres` and `Hull.levers`."""

    time: float
    spheres: Matrix
    levers: Matrix


class RightOfWay:
    """Judges the ways of one arm; to be made anew after a recompilation.

    Args:
        world: Its ``commitments`` are those of all arms.
        arm: Name of the arm.
        period: Seconds between set-points.

    Attributes:
        alone: There is no other arm.
    """

    def __init__(self, world: World, arm: str, period: float) -> None:
        self._world, self._arm, self._period = world, arm, period
        self._limits = world.robots[arm].limits
        self._generation = world.generation
        self._shape: Shape | None = None
        self._stride = max(round(SAMPLE_S / period), 1)
        self.alone = len(world.arms) < 2
        self._others: list[str] = []
        if not self.alone:
            self._separation = Separation(world, arm)
            self._hulls = {name: Hull(world, name) for name in world.arms}
            self._others = [name for name in world.arms if name != arm and self._meets(name)]

    def present(self, q: Vector, time: float) -> Gap:
        """The distance to the others where all are to be now; own set-point of shape (dof,)."""
        if not self._others:
            return Gap()
        others = {name: one.rows(time, 1)[0] for name, one in self._commitments().items()}
        return self._separation.gap({self._arm: q, **others})

    def take_way(self, q: Matrix, time: float, keep: float) -> Gap:
        """Commit the arm to a way if that is clear.

        Args:
            q: Set-points from ``time`` on, of shape (n, dof); the arm rests at the last one.
            time: Simulated, in seconds.
            keep: Distance to keep in metres.

        Returns:
            The smallest distance measured; the arm is committed if that is at least ``keep``.
        """
        others = self._commitments()
        if self._takes_far_way(q, time, keep, others):
            return Gap()
        most = max(one.reach for one in others.values())
        count = max(len(q), *(one.left(time) for one in others.values()))
        ways = {name: one.rows(time, count) for name, one in others.items()}
        rest = np.broadcast_to(q[-1], (count - len(q), q.shape[1]))
        ways[self._arm] = np.concatenate((q, rest))
        smallest, spread = self._nearest(ways, keep + most)
        if smallest.metres >= keep + most:
            self._publish(q, time, 0.0, spread)
        return Gap(smallest.metres - most, smallest.first, smallest.second)

    def _takes_far_way(
        self, q: Matrix, time: float, keep: float, others: dict[str, Commitment]
    ) -> bool:
        """Commit the arm to a way that cannot lead near others, whenever they are where."""
        here = self._here(time)
        room = self._room(here, others) - keep
        if room <= 0.0:
            return False
        away = self._hulls[self._arm].reach(
            here.levers, np.abs(q - self._world.arms[self._arm].q).max(axis=0)
        )
        if away > room:
            return False
        self._publish(q, time, 0.0, away)
        return True

    def take_room(self, sent: SetPoint, time: float, keep: float, waits: Sequence[float]) -> float:
        """Commit the arm to nothing but to stay where it cannot meet any other arm.

        Args:
            sent: Where it is.
            time: Of the next set-point, in s.
            keep: Distance to keep in metres.
            waits: Seconds for which it may do what it likes within its limits before it brakes.

        Returns:
            The first of these for which there is room enough; 0 if there is none.
        """
        if not self._others:
            return self._roam(sent, time, waits[0])
        here = self._here(time)
        room = self._room(here, self._commitments()) - keep
        if room <= 0.0:
            return 0.0
        for seconds, way in zip(waits, self._ways(sent, waits), strict=True):
            away = self._hulls[self._arm].reach(here.levers, way)
            if away <= room:
                self._publish(sent.q[None], time, away, away)
                return seconds
        return 0.0

    def _roam(self, sent: SetPoint, time: float, seconds: float) -> float:
        """Commit an arm that can meet no other one to no more than where it can get.

        Nobody asks before the world is recompiled.
        """
        hull = self._hulls[self._arm]
        away = float(hull.spans @ self._ways(sent, (seconds,))[0])
        self._publish(sent.q[None], time, away, away, hull.ball)
        return seconds

    def stand(self, q: Vector, time: float) -> None:
        """Commit the arm to stay at ``q``, of shape (dof,), or to come to rest there."""
        self._publish(q[None], time, 0.0, 0.0)

    def insist(self, q: Matrix, time: float) -> None:
        """Commit the arm to a way that it must take, clear or not, of shape (n, dof)."""
        self._publish(q, time, 0.0, float("inf"))

    def _nearest(self, ways: dict[str, Matrix], keep: float) -> tuple[Gap, float]:
        """The smallest distance, and how far the arm gets; less than ``keep`` ends the search."""
        last, horizon = len(ways[self._arm]) - 1, max(HORIZON, keep + _BEYOND)
        first = before = self._sample(ways, 0, horizon)
        i, stride, smallest, spread = 0, self._stride, first.gap, 0.0
        while i < last and smallest.metres >= keep:
            j = min(i + stride, last)
            now = self._sample(ways, j, horizon)
            own = self._moved(self._arm, before, now)
            least = self._least_between(before, now, own)
            if least < keep and j > i + 1:
                stride = max((j - i) // 2, 1)
                continue
            nearer = min(before.gap, now.gap, key=lambda gap: gap.metres)
            if least < keep:
                smallest = Gap(min(least, nearer.metres), nearer.first, nearer.second)
            elif nearer.metres < smallest.metres:
                smallest = nearer
            spread = max(spread, self._moved(self._arm, first, now) + 0.5 * own)
            i, before, stride = j, now, min(2 * stride, self._stride)
        return smallest, spread

    def _sample(self, ways: dict[str, Matrix], i: int, horizon: float) -> Sample:
        q = {name: rows[i] for name, rows in ways.items()}
        gap = self._separation.gap(q, horizon)
        metres = min(gap.metres, horizon)
        state = self._separation.data
        return Sample(
            gap, metres, q, {name: hull.centers(state) for name, hull in self._hulls.items()}
        )

    def _least_between(self, before: Sample, now: Sample, own: float) -> float:
        """The least distance that two arms can have had between two times."""
        others = max(self._moved(name, before, now) for name in self._others)
        ends = before.metres + now.metres
        return 0.5 * (ends - own - others)

    def _moved(self, name: str, first: Sample, second: Sample) -> float:
        turn = second.q[name] - first.q[name]
        return self._hulls[name].moved(first.centers[name], second.centers[name], turn)

    def _ways(self, sent: SetPoint, waits: Sequence[float]) -> Matrix:
        seconds = np.array(waits)[:, None] + self._period
        return ways_at_will(sent.v, sent.a, self._limits, seconds)

    def _here(self, time: float) -> Shape:
        """This arm as it is, worked out once for a time."""
        if self._shape is None or self._shape.time != time:
            hull = self._hulls[self._arm]
            spheres = hull.spheres()
            self._shape = Shape(time, spheres, hull.levers(spheres))
        return self._shape

    def _room(self, here: Shape, others: dict[str, Commitment]) -> float:
        """How far from here no other arm can come, in metres, less what is not looked at."""
        rooms = [apart(here.spheres, one.spheres) - one.spread for one in others.values()]
        return min(rooms, default=float("inf")) - FAR_M

    def _meets(self, name: str) -> bool:
        """Whether another arm can ever come near this one: decided once, not at every look."""
        return apart(self._hulls[self._arm].ball, self._hulls[name].ball) < HORIZON + FAR_M

    def _commitments(self) -> dict[str, Commitment]:
        """What the other arms have published, as it holds for the world as it is now."""
        return {name: self._commitment_of(name) for name in self._others}

    def _commitment_of(self, name: str) -> Commitment:
        one = self._world.commitments.get(name)
        if one is not None and one.generation == self._generation:
            return one
        spheres = self._hulls[name].spheres()
        if one is None:  # its controller has not sent anything yet
            q = self._world.arms[name].q[None]
            return Commitment(0.0, self._period, q, 0.0, 0.0, spheres, self._generation)
        return replace(one, spheres=spheres, spread=2.0 * one.spread, generation=self._generation)

    def _publish(
        self, q: Matrix, time: float, away: float, spread: float, spheres: Matrix | None = None
    ) -> None:
        if spheres is None:
            spheres = self._here(time).spheres
        self._world.commitments[self._arm] = Commitment(
            time, self._period, q, away, spread, spheres, self._generation
        )
