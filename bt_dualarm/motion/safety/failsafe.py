"""The fail-safe check: keeps what one arm reserves clear of what the other arms have reserved.

Every arm has a reservation: its set-points until it rests. It takes a new one only if that is
clear, at each time to come, of what the others have reserved then. Arms check one after the other;
thus what all have reserved is clear at any time, and so is what they do.

Where the others are far away, an arm reserves no set-points but all that lies within a distance.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from bt_dualarm.motion.collision.arm_distance import HORIZON, ArmDistance, Gap
from bt_dualarm.motion.collision.bounding_spheres import apart
from bt_dualarm.motion.safety.closest_approach import ClosestApproach
from bt_dualarm.motion.safety.reservation import Reservation, Reservations
from bt_dualarm.motion.setpoints.set_point import SetPoint
from bt_dualarm.motion.setpoints.stopping_distance import displacement_bound, limit_rows
from bt_dualarm.pose import Matrix, Vector
from bt_dualarm.world.world import World

FAR_M = 0.01
"""By how much more arms must be apart, in metres, that are not looked at any nearer."""


@dataclass(frozen=True)
class Verdict:
    """What a check has found.

    Attributes:
        gap: Distance to the arm that is too near by most, or has least to spare.
        spare: Metres by which that is more than what is to be kept; negative if it is less.
    """

    gap: Gap
    spare: float

    @property
    def clear(self) -> bool:
        """Whether the arm may go on so."""
        return self.spare >= 0.0


_NOBODY_NEAR = Verdict(Gap(), float("inf"))


@dataclass(frozen=True, eq=False)
class _Stance:
    """An arm at a simulated time in s: spheres and levers as `BoundingSpheres` has them."""

    time: float
    spheres: Matrix
    levers: Matrix


class FailSafeCheck:
    """Checks and reserves trajectories of one arm; to be made anew after a recompilation.

    All bounds belong to pairs of arms: what an arm must keep from one other, and how far that one
    may be from where it is expected, say nothing of a third.

    Args:
        world: World that the arm is in.
        arm: Name of the arm.
        period: Seconds between set-points.
        reservations: Reservations of all arms of the world.

    Attributes:
        others: Names of the arms that this one can ever come near.
    """

    def __init__(self, world: World, arm: str, period: float, reservations: Reservations) -> None:
        self._world, self._arm, self._period = world, arm, period
        self._reservations = reservations
        from bt_dualarm.motion.safety.region_kernels import first_within

        self._first_within = first_within
        self._limits = limit_rows(world.robots[arm].limits)
        self._generation = world.generation
        self._stance: _Stance | None = None
        self._hulls = reservations.hulls(world)
        self.others = tuple(name for name in world.arms if name != arm and self._meets(name))

    @cached_property
    def _separation(self) -> ArmDistance:
        """Distances to the other arms; an arm that can meet none needs none."""
        return ArmDistance(self._world, self._arm)

    @cached_property
    def _approach(self) -> ClosestApproach:
        return ClosestApproach(self._arm, self._separation, self._hulls, self._period)

    def present(self, q: Vector, time: float) -> dict[str, Gap]:
        """Distances by other arm, where all are to be now; own set-point of shape (dof,), rad."""
        if not self.others:
            return {}
        others = {name: one.rows(time, 1)[0] for name, one in self._reserved().items()}
        horizons = dict.fromkeys(self.others, HORIZON)
        return self._separation.gaps({self._arm: q, **others}, horizons)

    def reserve_trajectory(self, q: Matrix, time: float, keep: Mapping[str, float]) -> Verdict:
        """Reserve a trajectory if it is clear.

        Args:
            q: Set-points from ``time`` on, of shape (n, dof), rad; the arm rests at the last one.
            time: Simulated time in s.
            keep: Distances to keep in metres, by other arm.
        """
        away = self._hulls[self._arm].reach(
            self._here(time).levers, np.abs(q - self._world.hardware[self._arm].q).max(axis=0)
        )
        near = {
            name: one
            for name, one in self._reserved().items()
            if away > self._room(one, time) - keep[name]
        }
        if not near:
            self._publish(q, time, 0.0, away)
            return _NOBODY_NEAR
        enough = {name: keep[name] + one.deviation for name, one in near.items()}
        approach = self._approach.measure(self._rows(q, time, near), enough)
        verdicts = [
            Verdict(replace(gap, metres=gap.metres - near[name].deviation), gap.metres - least)
            for (name, least), gap in zip(enough.items(), approach.gaps.values(), strict=True)
        ]
        verdict = min(verdicts, key=lambda one: one.spare)
        if verdict.clear:
            self._publish(q, time, 0.0, approach.spread)
        return verdict

    def reserve_region(
        self, sent: SetPoint, time: float, keep: Mapping[str, float], waits: Sequence[float]
    ) -> float:
        """Reserve all that the arm can reach for a time and while it brakes then, if that is clear.

        Args:
            sent: Set-point where the arm is.
            time: Simulated time in s of the next one.
            keep: Distances to keep in metres, by other arm.
            waits: Seconds for which it may do what it likes within its limits before it brakes.

        Returns:
            The first of these for which there is room enough; 0 if there is none.
        """
        if not self.others:
            self._roam(sent, time, waits[0])
            return waits[0]
        room = min(self._room(one, time) - keep[name] for name, one in self._reserved().items())
        if room <= 0.0:
            return 0.0
        seconds = np.array(waits) + self._period
        now, span = np.array((sent.v, sent.a)), self._hulls[self._arm].span
        which, away = self._first_within(
            room, seconds, self._here(time).levers, span, self._limits, now, np.empty(len(sent.q))
        )
        if which < 0:
            return 0.0
        self._publish(sent.q[None], time, away, away)
        return waits[which]

    def reserve_rest(self, q: Vector, time: float) -> None:
        """Reserve the place of the arm at ``q``, of shape (dof,), rad: there it stays, or stops."""
        self._publish(q[None], time, 0.0, 0.0)

    def reserve_regardless(self, q: Matrix, time: float) -> None:
        """Reserve a trajectory that the arm must take, clear or not, of shape (n, dof), rad."""
        self._publish(q, time, 0.0, float("inf"))

    def _roam(self, sent: SetPoint, time: float, wait: float) -> None:
        """Reserve, for an arm that can meet no other one, wherever it can get in a time in s.

        Nobody asks before the world is recompiled.
        """
        hull = self._hulls[self._arm]
        turn = displacement_bound(sent.v, sent.a, self._limits, wait + self._period)
        away = float(hull.spans @ turn)
        self._publish(sent.q[None], time, away, away, hull.ball)

    def _rows(self, q: Matrix, time: float, others: Mapping[str, Reservation]) -> dict[str, Matrix]:
        """Where this arm and others will be until all of them rest, by arm, of shape (n, dof)."""
        count = max(len(q), *(one.left(time) for one in others.values()))
        rows = {name: one.rows(time, count) for name, one in others.items()}
        rest = np.broadcast_to(q[-1], (count - len(q), q.shape[1]))
        rows[self._arm] = np.concatenate((q, rest))
        return rows

    def _here(self, time: float) -> _Stance:
        """This arm as it is, worked out once for a time."""
        if self._stance is None or self._stance.time != time:
            hull = self._hulls[self._arm]
            spheres = hull.spheres()
            self._stance = _Stance(time, spheres, hull.levers(spheres))
        return self._stance

    def _room(self, other: Reservation, time: float) -> float:
        """How far from here another arm cannot come, in metres, less what is not looked at."""
        return apart(self._here(time).spheres, other.spheres) - other.spread - FAR_M

    def _meets(self, name: str) -> bool:
        """Whether another arm can ever come near this one: decided once, not at every look."""
        return apart(self._hulls[self._arm].ball, self._hulls[name].ball) < HORIZON + FAR_M

    def _reserved(self) -> dict[str, Reservation]:
        """What the other arms have reserved, as it holds for the world as it is now."""
        return {name: self._reservation_of(name) for name in self.others}

    def _reservation_of(self, name: str) -> Reservation:
        one = self._reservations.of(name)
        if one is not None and one.generation == self._generation:
            return one
        spheres = self._hulls[name].spheres()
        if one is None:  # its controller has not sent anything yet
            q = self._world.hardware[name].q[None]
            return Reservation(0.0, self._period, q, 0.0, 0.0, spheres, self._generation)
        return replace(one, spheres=spheres, spread=2.0 * one.spread, generation=self._generation)

    def _publish(
        self, q: Matrix, time: float, deviation: float, spread: float, spheres: Matrix | None = None
    ) -> None:
        if spheres is None:
            spheres = self._here(time).spheres
        own = Reservation(time, self._period, q, deviation, spread, spheres, self._generation)
        self._reservations.publish(self._arm, own)


def reserve_something() -> None:
    """Have all kernels of reservations compiled."""
    from bt_dualarm.motion.safety.region_kernels import first_within

    one, table = np.ones(1), np.ones((5, 1))
    first_within(1.0, one, table, 1.0, table, table[:2].copy(), one)
