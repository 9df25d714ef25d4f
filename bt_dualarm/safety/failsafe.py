"""Fail-safe trajectories: the space that each arm reserves is clear of the others' reservations.

Every arm has a reservation: its set-points until it rests. It takes a new one only if that is
clear, at each time to come, of what the others have reserved for that time. Arms check one after
the other: all reservations are always clear of each other, and so are the motions of the arms.

Where the others are far away, an arm reserves everything within a distance instead of set-points.

- `FailSafeCheck` checks and reserves the trajectories of one arm.
- `Reservations` are those of all arms of a world.
- `ClosestApproach` bounds the distances between trajectories from samples.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from bt_dualarm.collision.distance import HORIZON, ArmDistance, BoundingSpheres, Gap, apart
from bt_dualarm.core.pose import Matrix, Vector
from bt_dualarm.sim.world import World
from bt_dualarm.trajectory.set_points import SetPoint, displacement_bound, limit_rows

SAMPLE_S = 0.032
"""Time between two measured distances, s; halved where the bound in between is not clear.

In that time a point at 10 m/s² deviates from a straight line by about 1 mm (a t²/8).
"""

_BEYOND = 0.07
"""Range beyond the required separation in which distances are measured, m."""

FAR_M = 0.01
"""Margin of the bounding-sphere test beyond which distances are not measured, m."""


class FailSafeCheck:
    """Checks and reserves trajectories of one arm; to be rebuilt after the world is recompiled.

    All bounds are per pair of arms: the required distance, and the deviation of the other arm from
    its reserved positions.

    Args:
        world: World that contains the arm.
        arm: Name of the arm.
        period: Seconds between set-points.
        reservations: Reservations of all arms of the world.

    Attributes:
        others: Names of the arms whose workspace this arm can approach.
        tool_avoids_payloads: Whether the tool avoids what other arms hold, see `ArmDistance`.
    """

    def __init__(self, world: World, arm: str, period: float, reservations: Reservations) -> None:
        self.tool_avoids_payloads = False
        self._world = world
        self._arm = arm
        self._period = period
        self._reservations = reservations
        from bt_dualarm.trajectory.trajectory_kernels import longest_free_time

        self._longest_free_time = longest_free_time
        self._limits = limit_rows(world.robots[arm].limits)
        self._generation = world.generation
        self._stance: _Stance | None = None
        self._hulls = reservations.hulls(world)
        self._approaches: dict[bool, ClosestApproach] = {}
        self.others = tuple(name for name in world.arms if name != arm and self._meets(name))

    @property
    def _approach(self) -> ClosestApproach:
        """Closest approaches to the other arms, created on first use: a lone arm needs none."""
        found = self._approaches.get(self.tool_avoids_payloads)
        if found is None:
            separation = ArmDistance(
                self._world, self._arm, tool_avoids_payloads=self.tool_avoids_payloads
            )
            found = ClosestApproach(self._arm, separation, self._hulls, self._period)
            self._approaches[self.tool_avoids_payloads] = found
        return found

    def in_reach(self, within: float) -> frozenset[str]:
        """Names of the other arms that are, or hold something, where this one can come now.

        Args:
            within: Distance that counts as reached, m.
        """
        ball = self._hulls[self._arm].ball
        spheres = {name: self._hulls[name].spheres() for name in self.others}
        return frozenset(name for name, at in spheres.items() if apart(ball, at) < within)

    def present(self, q: Vector, time: float) -> dict[str, Gap]:
        """Distances by other arm at the current set-points; own position of shape (dof,), rad."""
        if not self.others:
            return {}
        others = {name: other.rows(time, 1)[0] for name, other in self._reserved().items()}
        horizons = dict.fromkeys(self.others, HORIZON)
        return self._approach.separation.gaps({self._arm: q, **others}, horizons)

    def reserve_trajectory(
        self, q: Matrix, time: float, keep: Mapping[str, float]
    ) -> ReservationCheck:
        """Reserve a trajectory if it is clear.

        Args:
            q: Positions from ``time`` on, of shape (n, dof), rad; the arm rests at the last one.
            time: Simulated time, s.
            keep: Required distances by other arm, m.
        """
        away = self._hulls[self._arm].reach(
            self._here(time).levers, np.abs(q - self._world.hardware[self._arm].q).max(axis=0)
        )
        # Only arms that may come near, by their bounding spheres, need exact distances.
        near = {
            name: other
            for name, other in self._reserved().items()
            if away > self._room(other, time) - keep[name]
        }
        if not near:
            self._publish(q, time, 0.0, away)
            return _NONE_NEAR
        # The other arm may be that far from the positions that are measured.
        enough = {name: keep[name] + other.deviation for name, other in near.items()}
        approach = self._approach.measure(self._rows(q, time, near), enough)
        verdicts = [
            ReservationCheck(
                replace(gap, meters=gap.meters - near[name].deviation), gap.meters - least
            )
            for (name, least), gap in zip(enough.items(), approach.gaps.values(), strict=True)
        ]
        verdict = min(verdicts, key=lambda check: check.spare)
        if verdict.clear:
            self._publish(q, time, 0.0, approach.spread)
        return verdict

    def reserve_region(
        self, sent: SetPoint, time: float, keep: Mapping[str, float], waits: Sequence[float]
    ) -> float:
        """Reserve everything that the arm can reach in a time and while braking, if that is clear.

        Args:
            sent: Current set-point.
            time: Simulated time of the next one, s.
            keep: Required distances by other arm, m.
            waits: Candidate times of free motion before braking, the longest first, s.

        Returns:
            The first of these whose reachable region is clear; 0 if there is none.
        """
        if not self.others:
            self._roam(sent, time, waits[0])
            return waits[0]
        reserved = self._reserved()
        room = min(self._room(other, time) - keep[name] for name, other in reserved.items())
        if room <= 0.0:
            return 0.0
        seconds = np.array(waits) + self._period
        now = np.array((sent.v, sent.a))
        span = self._hulls[self._arm].span
        which, away = self._longest_free_time(
            room, seconds, self._here(time).levers, span, self._limits, now, np.empty(len(sent.q))
        )
        if which < 0:
            return 0.0
        self._publish(sent.q[None], time, away, away)
        return waits[which]

    def reserve_rest(self, q: Vector, time: float) -> None:
        """Reserve that the arm rests at ``q``, of shape (dof,), rad."""
        self._publish(q[None], time, 0.0, 0.0)

    def reserve_regardless(self, q: Matrix, time: float) -> None:
        """Reserve a trajectory of shape (n, dof), rad, without a check: the arm has no other."""
        self._publish(q, time, 0.0, float("inf"))

    def _roam(self, sent: SetPoint, time: float, wait: float) -> None:
        """Reserve the region that an arm without neighbors can reach in a time in s.

        No other arm queries it before the world is recompiled, which may bring it nearer.
        """
        hull = self._hulls[self._arm]
        turn = displacement_bound(sent.v, sent.a, self._limits, wait + self._period)
        away = float(hull.spans @ turn)
        self._publish(sent.q[None], time, away, away, hull.ball)

    def _rows(self, q: Matrix, time: float, others: Mapping[str, Reservation]) -> dict[str, Matrix]:
        """Positions of this arm and others until all of them rest, by arm, each (n, dof), rad."""
        count = max(len(q), *(other.left(time) for other in others.values()))
        rows = {name: other.rows(time, count) for name, other in others.items()}
        rest = np.broadcast_to(q[-1], (count - len(q), q.shape[1]))
        rows[self._arm] = np.concatenate((q, rest))
        return rows

    def _here(self, time: float) -> _Stance:
        """Current spheres and levers of this arm, cached per time."""
        if self._stance is None or self._stance.time != time:
            hull = self._hulls[self._arm]
            spheres = hull.spheres()
            self._stance = _Stance(time, spheres, hull.levers(spheres))
        return self._stance

    def _room(self, other: Reservation, time: float) -> float:
        """Lower bound of the distance in m to anywhere another arm's reservation may take it."""
        return apart(self._here(time).spheres, other.spheres) - other.spread - FAR_M

    def _meets(self, name: str) -> bool:
        """Whether another arm can ever come within the horizon, by their workspace spheres."""
        return apart(self._hulls[self._arm].ball, self._hulls[name].ball) < HORIZON + FAR_M

    def _reserved(self) -> dict[str, Reservation]:
        """Reservations of the other arms, valid for the world as it is composed now."""
        return {name: self._reservation_of(name) for name in self.others}

    def _reservation_of(self, name: str) -> Reservation:
        latest = self._reservations.of(name)
        if latest is not None and latest.generation == self._generation:
            return latest
        spheres = self._hulls[name].spheres()
        if latest is None:  # its controller has not sent anything yet
            q = self._world.hardware[name].q[None]
            return Reservation(0.0, self._period, q, 0.0, 0.0, spheres, self._generation)
        # Since the reservation, the arm may have moved by the spread; the reserved motion may lead
        # as far to the other side.
        spread = 2.0 * latest.spread
        return replace(latest, spheres=spheres, spread=spread, generation=self._generation)

    def _publish(
        self, q: Matrix, time: float, deviation: float, spread: float, spheres: Matrix | None = None
    ) -> None:
        if spheres is None:
            spheres = self._here(time).spheres
        own = Reservation(time, self._period, q, deviation, spread, spheres, self._generation)
        self._reservations.publish(self._arm, own)


@dataclass(frozen=True)
class ReservationCheck:
    """Result of a check.

    Attributes:
        gap: Distance to the arm with the smallest spare distance.
        spare: Distance beyond the required one, m; negative if too near.
    """

    gap: Gap
    spare: float

    @property
    def clear(self) -> bool:
        """Whether all required distances are kept."""
        return self.spare >= 0.0


_NONE_NEAR = ReservationCheck(Gap(), float("inf"))


class Reservations:
    """Latest reservation of each arm of one world.

    All controllers of a world share one instance, as the robots of a cell share a safety
    controller.
    """

    def __init__(self) -> None:
        self._of: dict[str, Reservation] = {}
        self._hulls: dict[str, BoundingSpheres] = {}
        self._hulls_of: tuple[World, int] | None = None

    def hulls(self, world: World) -> Mapping[str, BoundingSpheres]:
        """Bounding spheres of all arms of a world as it is composed now, by arm; cached."""
        if self._hulls_of != (world, world.generation):
            self._hulls_of = world, world.generation
            self._hulls = {name: BoundingSpheres(world, name) for name in world.arms}
        return self._hulls

    def of(self, arm: str) -> Reservation | None:
        """Reservation of an arm; None until its controller has published one."""
        return self._of.get(arm)

    def publish(self, arm: str, reservation: Reservation) -> None:
        """Replace the reservation of an arm."""
        self._of[arm] = reservation

    def withdraw(self, arm: str) -> None:
        """Remove the reservation of an arm, if any: its controller restarts, or is removed."""
        self._of.pop(arm, None)


@dataclass(frozen=True, eq=False)
class Reservation:
    """Reserved motion of an arm until it rests. Controllers publish it for each other; trees never.

    Attributes:
        time: Simulated time of the first row, s.
        period: Seconds between rows.
        q: Positions to come, of shape (n, dof), rad; the arm rests at the last one.
        deviation: Largest distance of any point of the arm from its position at ``q``, m.
        spread: Largest distance of any point of the arm from ``spheres``, m.
        spheres: Bounding spheres of the arm at ``time``: centers and radii, of shape (m, 4), m.
        generation: Generation of the world that the spheres belong to.
    """

    time: float
    period: float
    q: Matrix
    deviation: float
    spread: float
    spheres: Matrix
    generation: int

    def rows(self, time: float, count: int) -> Matrix:
        """Positions at ``count`` periods from ``time`` on, of shape (count, dof), rad."""
        index = np.minimum(np.arange(count) + self._first(time), len(self.q) - 1)
        rows: Matrix = self.q[index]
        return rows

    def left(self, time: float) -> int:
        """Number of rows from ``time`` to the last one, at least 1."""
        return max(len(self.q) - self._first(time), 1)

    def _first(self, time: float) -> int:
        return max(round((time - self.time) / self.period), 0)


@dataclass(frozen=True, eq=False)
class _Stance:
    """Bounding spheres and levers of an arm at a simulated time in s, see `BoundingSpheres`."""

    time: float
    spheres: Matrix
    levers: Matrix


class ClosestApproach:
    """Lower bounds of the distance between one arm's trajectory and those of others.

    If two arms have distances d0 and d1 at two samples and their points move by at most m0 and m1
    in between, they are never nearer than ``(d0 + d1 - m0 - m1) / 2``: distance changes no faster
    than the arms move. To be rebuilt after the world is recompiled.

    Args:
        arm: Name of the arm.
        separation: Distance queries of the arm.
        hulls: Bounding spheres of all arms, by name.
        period: Seconds between trajectory rows.

    Attributes:
        separation: The distance queries.
    """

    def __init__(
        self, arm: str, separation: ArmDistance, hulls: Mapping[str, BoundingSpheres], period: float
    ) -> None:
        self._arm = arm
        self.separation = separation
        self._hulls = hulls
        self._stride = max(round(SAMPLE_S / period), 1)

    def measure(self, rows: Mapping[str, Matrix], enough: Mapping[str, float]) -> Approach:
        """Measure until the end, or until some arm is nearer than it has to be.

        Args:
            rows: Configurations from now on by arm, including this one, each (n, dof), rad.
            enough: Required distances by other arm, m; only these arms are measured.
        """
        horizons = {name: max(HORIZON, least + _BEYOND) for name, least in enough.items()}
        first = before = self._sample(rows, 0, horizons)
        smallest = dict(first.gaps)
        spread = 0.0
        i = 0
        stride = self._stride
        last = len(rows[self._arm]) - 1
        while i < last and all(smallest[name].meters >= least for name, least in enough.items()):
            j = min(i + stride, last)
            now = self._sample(rows, j, horizons)
            own = self._moved(self._arm, before, now)
            between = self._bounds_between(before, now, own)
            # Exact distances are known at the samples only; in between, both arms may have moved.
            unclear = any(between[name] < least for name, least in enough.items())
            if unclear and j > i + 1:  # refine before concluding anything
                stride = max((j - i) // 2, 1)
                continue
            for name, least in enough.items():
                nearer = min(before.gaps[name], now.gaps[name], key=_meters)
                if between[name] < least:
                    meters = min(between[name], nearer.meters)
                    smallest[name] = replace(nearer, meters=meters)
                else:
                    smallest[name] = min(smallest[name], nearer, key=_meters)
            # Between two samples a point is at most half of its motion from the nearer one.
            spread = max(spread, self._moved(self._arm, first, now) + 0.5 * own)
            i = j
            before = now
            # Back to the full stride once the narrow part is over.
            stride = min(2 * stride, self._stride)
        return Approach(smallest, spread)

    def _sample(self, rows: Mapping[str, Matrix], i: int, horizons: Mapping[str, float]) -> _Sample:
        q = {name: trajectory[i] for name, trajectory in rows.items()}
        gaps = self.separation.gaps(q, horizons)
        return _Sample(
            gaps,
            {name: min(gap.meters, horizons[name]) for name, gap in gaps.items()},
            q,
            {name: self._hulls[name].centers(self.separation.data) for name in rows},
        )

    def _bounds_between(self, before: _Sample, now: _Sample, own: float) -> dict[str, float]:
        """Lower bounds of the distances in m between two samples, by other arm."""
        return {
            name: 0.5
            * (before.meters[name] + now.meters[name] - own - self._moved(name, before, now))
            for name in before.meters
        }

    def _moved(self, name: str, first: _Sample, second: _Sample) -> float:
        turn = second.q[name] - first.q[name]
        return self._hulls[name].moved(first.centers[name], second.centers[name], turn)


@dataclass(frozen=True, eq=False)
class Approach:
    """Closest approach of an arm to others.

    Attributes:
        gaps: Smallest distances by other arm; infinite beyond the horizon.
        spread: Largest displacement of any point of the arm from its start, m.
    """

    gaps: Mapping[str, Gap]
    spread: float


@dataclass(frozen=True, eq=False)
class _Sample:
    """State of the arms at one time.

    Attributes:
        gaps: Distances by other arm, infinite beyond the horizon.
        meters: The same, capped at the horizon.
        q: Configurations by arm, each of shape (dof,), rad.
        centers: Sphere centers by arm, each of shape (m, 3), m.
    """

    gaps: Mapping[str, Gap]
    meters: Mapping[str, float]
    q: Mapping[str, Vector]
    centers: Mapping[str, Matrix]


def _meters(gap: Gap) -> float:
    return gap.meters


def warm_up_reservations() -> None:
    """Compile the kernel of reservations."""
    from bt_dualarm.trajectory.trajectory_kernels import longest_free_time

    one = np.ones(1)
    table = np.ones((5, 1))
    longest_free_time(1.0, one, table, 1.0, table, table[:2].copy(), one)
