"""Guard of a moving arm: slows it near obstacles and stops it before it meets another arm.

An arm has a braking trajectory at any time, which the fail-safe check has found clear of the
reservations of the other arms. Before it continues for another moment, the braking trajectory that
it would have afterwards is checked. If that one is not clear, the arm takes the one that it has: it
stops, and continues when the path is clear.

Where no other arm can be met within that moment, whatever the arms do, no braking trajectory is
checked: the arm may move freely for that time.

- `ArmGuard` is the guard of one arm, called every control period.
- `TrajectoryGuard` takes one trajectory from reservation to reservation.
- `SeparationRule` converts distances to other arms to time scales.
- `PlanMonitor` checks the rest of a motion when something else has moved.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from bt_dualarm.collision.checker import CollisionChecker, Contact, LinkContacts
from bt_dualarm.collision.distance import (
    HANDS_APART_M,
    BoundingSpheres,
    Clearance,
    Gap,
    apart,
)
from bt_dualarm.core.errors import BlockedFailure, Failure, Number
from bt_dualarm.core.pose import Matrix, Vector
from bt_dualarm.kinematics.solver import Posture
from bt_dualarm.robots.robot import JointLimits
from bt_dualarm.safety.failsafe import FailSafeCheck, Reservations
from bt_dualarm.sim.world import World
from bt_dualarm.trajectory.path_timing import stop
from bt_dualarm.trajectory.set_points import (
    ScaledPiece,
    SetPoint,
    SetPointSource,
    StreamSource,
    TrajectorySource,
    sampled_at,
)
from bt_dualarm.trajectory.trajectory import Trajectory

CLEAR_M = HANDS_APART_M
"""Separation that an arm keeps from others, m; less if its motion began nearer to them."""

FLOOR_M = 0.012
"""Separation below which an arm comes no nearer than by `NOISE_M`, m. A motion that begins between
this and `CLEAR_M` may come nearer by `NEARER_M`."""

NEARER_M = 0.0005
"""Approach that a motion may add where arms are already too near, m: control tolerance."""

NOISE_M = 0.0001
"""Difference of two measurements of the same separation, m: noise of the encoders, and rounding of
the distances."""

SLOW = ((0.05, 1.0), (0.025, 0.6), (0.0, 0.3))
"""Pairs of spare distance beyond the required separation in m, and the time scale from there on."""

NEAR = "another arm is near"
"""Reason for slowing down because of another arm."""

PACED = "another arm must keep up"
"""Reason for slowing down because another arm follows, or moves in step."""

RESCALED = "it is slowing down"
"""Reason for holding a motion whose time scale changes and cannot change back before: it says
nothing about other arms, and does not last."""

LOOK_S = 0.02
"""Time between two checks near another arm, s."""

PIECE_S = 0.1
"""Time between two checks where no other arm is near, s."""

RESUME_S = 0.3
"""Time ahead that must be clear before a stopped arm continues, s: hysteresis against a restart
that ends in the next stop."""

RESUME_M = 0.01
"""Additional separation required for that, m."""

MONITOR_PERIOD_S = 0.2
"""Simulated time between two checks of the motion ahead, s."""

AHEAD_S = 2.0
"""Planned time that a check looks ahead, s."""

_WAITS = (25, 10, 5, 3, 2, 1)
"""Numbers of set-points of a stream that may pass unchecked where no other arm is near, tried in
turn."""

_POSTURE_EVERY = 5
"""Checks of the surroundings per check of the posture, which changes slowly."""

_MOVED = 2e-3
"""Displacement above which something counts as moved, rad or m."""

_RESTING = 0.05
"""Joint speed above which an arm counts as moving, rad/s: it will be elsewhere, and the guard keeps
it away meanwhile."""

_STEP = 0.015
"""Displacement between checked configurations, m: with 5 mm of the arm's own thickness, too little
to miss a wall of 10 mm."""


class ArmGuard:
    """Checks the motions of one arm before they are executed.

    Args:
        world: World that contains the arm.
        name: Name of the arm.
        period: Seconds between set-points.
        reservations: Reservations of all arms of the world.

    Attributes:
        report: Statistics and actions so far.
    """

    def __init__(self, world: World, name: str, period: float, reservations: Reservations) -> None:
        self.report = GuardReport()
        self._world = world
        self._name = name
        self._period = period
        self._reservations = reservations
        self._limits = world.robots[name].limits
        self._waits = [count * period for count in _WAITS]
        self._motion: SetPointSource | None = None
        self._trajectory: TrajectoryGuard | None = None
        self._next_look = -np.inf
        self._next_check = -np.inf
        self._free_until = -np.inf
        self._looks = 0
        self._scale = 1.0
        self._reason = ""
        self._generation = -1

    @property
    def neighbors(self) -> tuple[str, ...]:
        """Names of the arms that this one can ever come near."""
        self._refresh()
        return self._check.others

    def in_reach(self, within: float) -> frozenset[str]:
        """Names of those that are within a distance in m of where this one can come now."""
        self._refresh()
        return self._check.in_reach(within)

    def look(self, motion: SetPointSource, sent: SetPoint, time: float) -> Failure | None:
        """Let the motion continue, slow it down or hold it; return a failure that ends it.

        The times at which posture and surroundings are checked depend on the motion alone, not on
        the distance to other arms.

        Args:
            motion: Motion that is being followed.
            sent: The last set-point.
            time: Simulated time of the next one, s.
        """
        self._refresh()
        if motion is not self._motion:
            self._begin(motion, sent, time)
        if time >= self._next_look:
            contact = self.touch()
            if contact is not None:
                return contact
            self._look_around(motion, time)
        if self._trajectory is None or time < self._next_check:
            return None
        if isinstance(motion, TrajectorySource) and motion.waits:
            return None
        wait, refusal = self._trajectory.advance(sent, self._scale, self._reason, time)
        self._next_check = time + wait - 1e-9  # against rounding of the time
        return refusal

    def touch(self) -> Failure | None:
        """Failure if a link is in contact with something now, else None."""
        self._refresh()
        contact = self._touch.unwanted()
        return None if contact is None else self.report.given_up(contact)

    def is_free(self, time: float) -> bool:
        """Whether set-points of a stream need no check at a simulated time in s."""
        return time < self._free_until

    def permits(self, motion: StreamSource, desired: SetPoint, time: float) -> Failure | None:
        """Check a set-point of a stream; return the failure that ends the stream, if any.

        Args:
            motion: Stream; its braking trajectory from the set-point on is updated.
            desired: Set-point, within the joint limits.
            time: Simulated time of the set-point, s.
        """
        if self.is_free(time):
            return None
        free = self._rule.reserve_free_motion(desired, time, self._waits)
        self._free_until = time + free - 1e-9
        if free > 0.0:
            motion.braking = None
            return None
        braking = stop(desired.q, desired.v, desired.a, self._limits, self._period)
        gap = self._rule.admits(braking.q, time)
        self._rule.see(desired, time)
        if gap is not None:
            return self.report.given_up(Failure("IN_COLLISION", reason_of(gap)))
        motion.braking = braking
        return None

    def stop(
        self, motion: SetPointSource | None, candidates: Sequence[Trajectory], time: float
    ) -> Trajectory:
        """Braking trajectory for an arm that must stop now: the first clear one, and reserve it.

        If none is clear, the one reserved before is taken, or the last candidate.

        Args:
            motion: Motion that is being followed.
            candidates: Trajectories from the last set-point on, the preferred one first; the last
                one brakes all joints as hard as their limits allow.
            time: Simulated time of the next set-point, s.
        """
        self._refresh()
        keep = dict.fromkeys(self._check.others, CLEAR_M)
        if motion is not None and motion is self._motion:
            keep = self._rule.clear
        for braking in candidates:
            if self._check.reserve_trajectory(braking.to_come, time, keep).clear:
                return braking
        # The reserved trajectory was clear when it was checked, and is still reserved.
        reserved = None if motion is None else motion.braking
        braking = candidates[-1] if reserved is None else reserved
        self._check.reserve_regardless(braking.to_come, time)
        return braking

    def rests(self, q: Vector, time: float) -> None:
        """Reserve that the arm rests at ``q``, of shape (dof,), rad."""
        self._refresh()
        self._check.reserve_rest(q, time)

    def _begin(self, motion: SetPointSource, sent: SetPoint, time: float) -> None:
        self._motion = motion
        self._next_look = -np.inf
        self._next_check = -np.inf
        self._free_until = -np.inf
        self._looks = 0
        self._check.tool_avoids_payloads = (
            isinstance(motion, TrajectorySource) and motion.tool_avoids_payloads
        )
        self._rule = SeparationRule(self._check, self.report, sent, time)
        self._surroundings.begin()
        self._trajectory = None
        if isinstance(motion, TrajectorySource):
            self._trajectory = TrajectoryGuard(motion, self._rule, self._limits, self.report)

    def _look_around(self, motion: SetPointSource, time: float) -> None:
        """Check posture and surroundings, and apply the time scale that they allow."""
        # The smaller time scale, with its reason.
        self._scale, self._reason = min(self._posture_scale(motion), self._surroundings_scale())
        self._next_look = time + 2.0 * LOOK_S - 1e-9
        if isinstance(motion, StreamSource):
            self._next_look = time + LOOK_S - 1e-9
            scale = self._scale
            reason = self._reason
            if self._rule.time_scale < scale:
                scale = self._rule.time_scale
                reason = NEAR
            if motion.change_scale(scale) and scale < 1.0:
                self.report.slow(reason)
        elif isinstance(motion, TrajectorySource) and motion.goal_scale != min(
            self._scale, motion.most_scale
        ):
            self._next_check = time

    def _posture_scale(self, motion: SetPointSource) -> tuple[float, str]:
        """Time scale that the posture allows, and the reason if it is less than 1."""
        self._looks += 1
        if self._looks % _POSTURE_EVERY == 1:
            report = self.report
            posture = self._posture
            posture.look()
            report.nearest_limit_rad = min(report.nearest_limit_rad, posture.room)
            report.worst_condition = max(report.worst_condition, posture.condition)
        if isinstance(motion, TrajectorySource) and not motion.along_path:
            return 1.0, ""
        return self._posture.time_scale

    def _surroundings_scale(self) -> tuple[float, str]:
        """Time scale that scene and objects allow, and the reason if it is less than 1."""
        scale = self._surroundings.time_scale
        self.report.nearest_body_m = min(self.report.nearest_body_m, self._surroundings.nearest)
        return scale

    def _refresh(self) -> None:
        """Rebuild everything that refers to the compiled world, if it was recompiled."""
        world = self._world
        if self._generation == world.generation:
            return
        self._generation = world.generation
        self._motion = None
        self._check = FailSafeCheck(world, self._name, self._period, self._reservations)
        self._touch = LinkContacts(world, self._name)
        self._posture = Posture(world, self._name)
        self._surroundings = Clearance(world, self._name)


class TrajectoryGuard:
    """Guards one trajectory: reserves it piece by piece, slows it down, holds and resumes it.

    Args:
        motion: Motion to guard, at any point.
        rule: Separation rule of the motion.
        limits: Joint limits of the arm.
        report: Report that counts slowdowns and stops.
    """

    def __init__(
        self,
        motion: TrajectorySource,
        rule: SeparationRule,
        limits: JointLimits,
        report: GuardReport,
    ) -> None:
        self._motion = motion
        self._rule = rule
        self._limits = limits
        self._report = report
        self._period = motion.trajectory.dt

    def advance(
        self, sent: SetPoint, scale: float, reason: str, time: float
    ) -> tuple[float, Failure | None]:
        """Reserve the next piece of the motion; if that is not clear, bring it to rest.

        Args:
            sent: The last set-point.
            scale: Time scale that the arm's posture and surroundings allow.
            reason: Reason for that time scale, if it is less than 1.
            time: Simulated time of the next set-point, s.

        Returns:
            Time until the next call, s; and the failure that ends the motion, if any.
        """
        # Cheapest first: where no other arm can be met, no braking trajectory is needed.
        free = self._rule.reserve_free_motion(sent, time, (PIECE_S, 0.5 * PIECE_S, LOOK_S))
        if free > 0.0:
            paced = self._motion.paced(scale, time)
            if self._change_to(paced, reason if paced == scale else PACED):
                return free, None
        self._rule.see(sent, time)
        wait = PIECE_S if self._rule.time_scale == 1.0 else LOOK_S
        if self._rule.time_scale < scale:
            scale = self._rule.time_scale
            reason = NEAR
        paced = self._motion.paced(scale, time)
        if paced < scale:
            scale = paced
            reason = PACED
        refusal = self._take_next_piece(wait, scale, reason, time)
        if refusal is None:
            return wait, None
        self._motion.note_share(0.0, time)
        return LOOK_S, self._hold(sent, refusal, time)

    def _change_to(self, scale: float, reason: str) -> bool:
        """Change to a time scale without a reserved stop; return whether that is possible."""
        motion = self._motion
        if motion.braking is None and (motion.goal_scale == scale or motion.changing):
            return True
        before = motion.goal_scale
        if not motion.change_scale(scale, self._limits):
            return motion.braking is None
        self._note_scale(before, scale, reason)
        return True

    def _take_next_piece(self, wait: float, scale: float, reason: str, time: float) -> str | None:
        """Reserve the next piece of the motion and a stop after it; otherwise return the reason."""
        motion = self._motion
        held = motion.held_since is not None
        count = round((RESUME_S if held else wait) / self._period)
        ahead = motion.to_rest_after(count, scale, self._limits)
        leaves_path = ahead is None
        # To rest on the path, so that the motion can be resumed; otherwise each joint as fast as it
        # can.
        if ahead is None:
            ahead = motion.to_brake_after(count, self._limits)
        if ahead is None:  # the time scale is changing, and cannot change back
            return motion.held_up or RESCALED
        gap = self._rule.admits(ahead.motion.to_come, time, RESUME_M if held else 0.0)
        if gap is not None:
            return reason_of(gap)
        before = motion.goal_scale
        motion.take(ahead, leaves_path=leaves_path)
        self._note_scale(before, scale, reason)
        return None

    def _hold(self, sent: SetPoint, reason: str, time: float) -> Failure | None:
        """Bring the motion to rest on its path; return a failure if that is not possible."""
        motion = self._motion
        if motion.leaves_path or (motion.braking is None and not self._stops(sent, time)):
            failure = BlockedFailure("IN_COLLISION", reason, progress=motion.progress)
            return self._report.given_up(failure)
        if motion.held_since is None:
            self._report.stop(reason)
            motion.held_since = time
        motion.goal_scale = 0.0
        motion.held_up = reason
        return None

    def _stops(self, sent: SetPoint, time: float) -> bool:
        """Reserve a stop on the path for a motion without a reservation; return whether it can."""
        motion = self._motion
        if sent.v.any() or sent.a.any():
            ahead = motion.to_rest_after(0, 0.0, self._limits)
        else:
            still = np.array(((motion.parameter.s, 0.0, 0.0),))
            ahead = ScaledPiece(still, sampled_at(motion.trajectory, still), 0.0)
        if ahead is None or self._rule.admits(ahead.motion.to_come, time) is not None:
            return False
        motion.take(ahead)
        return True

    def _note_scale(self, before: float, scale: float, reason: str) -> None:
        self._motion.held_since = None
        self._motion.held_up = ""
        if scale < before:
            self._report.slow(reason)


class SeparationRule:
    """Required separation of one motion from the other arms, and the time scale it allows.

    Args:
        check: Fail-safe check of the arm.
        report: Report of its guard.
        sent: Set-point where the motion begins.
        time: Simulated time of that set-point, s.

    Attributes:
        clear: Separation to keep in m, by other arm.
        time_scale: Time scale that the last reserved trajectory allows.
    """

    def __init__(
        self, check: FailSafeCheck, report: GuardReport, sent: SetPoint, time: float
    ) -> None:
        self._check = check
        self._report = report
        self.time_scale = 1.0
        self.clear = {
            name: clearance(gap.meters, CLEAR_M)
            for name, gap in check.present(sent.q, time).items()
        }

    def reserve_free_motion(self, sent: SetPoint, time: float, waits: Sequence[float]) -> float:
        """Time for which the arm may move freely, then stop, without coming near any other arm.

        That region is reserved. 0 if even the shortest time is too long.

        Args:
            sent: Current set-point.
            time: Simulated time of the next one, s.
            waits: Candidate times in s, the longest first.
        """
        free = self._check.reserve_region(sent, time, self.clear, waits)
        if free > 0.0:
            self.time_scale = 1.0
        return free

    def admits(self, rows: Matrix, time: float, more: float = 0.0) -> Gap | None:
        """Reserve a trajectory if it is clear; otherwise return the gap that is too small.

        Args:
            rows: Positions from ``time`` on, to rest, of shape (n, dof), rad.
            time: Simulated time, s.
            more: Additional separation to keep, m.
        """
        keep = {name: meters + more for name, meters in self.clear.items()}
        if more and min(keep.values(), default=math.inf) < CLEAR_M + more:
            # The motion began too near to another arm: it may continue if it leads away.
            for name, gap in self._check.present(rows[0], time).items():
                if self.clear[name] < CLEAR_M:
                    keep[name] = min(keep[name], max(self.clear[name], gap.meters - NOISE_M))
        verdict = self._check.reserve_trajectory(rows, time, keep)
        if not verdict.clear:
            return verdict.gap
        beyond = verdict.spare + more
        self.time_scale = next(scale for least, scale in SLOW if beyond >= least)
        return None

    def see(self, sent: SetPoint, time: float) -> None:
        """Add the current distances to the report."""
        for gap in self._check.present(sent.q, time).values():
            self._report.nearest_arm_m = min(self._report.nearest_arm_m, gap.true_meters)


def clearance(present: float, desired: float) -> float:
    """Separation to keep in m, for an arm that may already be nearer than desired."""
    # Between the floor and the desired separation, a motion may begin, but hardly come nearer.
    return min(desired, max(present - NEARER_M, min(present - NOISE_M, FLOOR_M)))


def reason_of(gap: Gap) -> str:
    """Reason for which an arm must stop, as a clause."""
    near = f"{1e3 * max(gap.true_meters, 0.0):.0f} mm"
    if not gap.first:
        return f"another arm would come to within {near}"
    return f"{gap.first} would come to within {near} of {gap.second}"


@dataclass
class GuardReport:
    """Statistics and actions of a guard; distances were measured while the arm moved.

    Attributes:
        nearest_arm_m: Smallest distance to another arm, infinite if never within range, m.
        nearest_body_m: Smallest distance from a link to anything else, including what the arm is
            mounted on; infinite if never within range, m.
        nearest_limit_rad: Smallest distance of a joint from its position limit, rad.
        worst_condition: Largest condition number of the Jacobian.
        fastest_share: Largest measured joint speed, as a fraction of the robot's limit.
        saturated: Number of periods in which torques were scaled down to the effort limits.
        slowed: Number of times that the guard slowed the arm.
        stopped: Number of times that the guard stopped the arm.
        last_reason: Reason for the last of these.
    """

    nearest_arm_m: float = float("inf")
    nearest_body_m: float = float("inf")
    nearest_limit_rad: float = float("inf")
    worst_condition: float = 1.0
    fastest_share: float = 0.0
    saturated: int = 0
    slowed: int = 0
    stopped: int = 0
    last_reason: str = ""

    def as_dict(self) -> dict[str, Number]:
        """Values for the summary of a run; infinite ones are left out."""
        return {name: value for name, value in vars(self).items() if value != float("inf")}

    def slow(self, reason: str) -> None:
        """Count a slowdown."""
        self.slowed += 1
        self.last_reason = reason

    def stop(self, reason: str) -> None:
        """Count a stop."""
        self.stopped += 1
        self.last_reason = reason

    def given_up(self, failure: Failure) -> Failure:
        """Count a stop because the motion failed; return the failure."""
        self.stop(failure.reason)
        return failure


class PlanMonitor:
    """Checks the rest of a motion for collisions when something else in the world has moved.

    Everything that has not moved was already checked when the motion was planned.

    Args:
        world: World, still as it was when the motion was planned.
        arm: Name of the arm.
        motion: Motion that has just begun; all of it was checked against this world.
        ignore: Names of objects that may be touched.
        until_s: Time of the motion as planned after which it is not checked, as contact is
            intended, s; None for its end.
        waits_for_arms: Whether the motion waits, held by the guard, for other arms in its path
            also if these are at rest: it has a prescribed path, and they may move on.
    """

    def __init__(
        self,
        world: World,
        arm: str,
        motion: TrajectorySource,
        ignore: frozenset[str],
        until_s: float | None = None,
        *,
        waits_for_arms: bool = False,
    ) -> None:
        self._world = world
        self._arm = arm
        self._motion = motion
        self._waits_for_arms = waits_for_arms
        self._ignore = ignore
        self._bounds = BoundingSpheres(world, arm)
        self._bounded = world.model
        self._next = world.time + MONITOR_PERIOD_S
        self._seen = self._others()
        self._moved: set[str] = set()
        count = len(motion.trajectory)
        self._end = count if until_s is None else min(int(until_s / motion.trajectory.dt), count)
        self._checked = self._end

    def look(self, time: float) -> None:
        """Check the motion ahead, if it is time for that.

        Raises:
            Failure: ``IN_COLLISION`` with the obstacle.
        """
        if time < self._next or self._motion.done:
            return
        self._next = time + MONITOR_PERIOD_S
        if self._has_seen_motion():
            self._checked = self._row()
        if self._checked < self._end:
            self._look_ahead()

    def _has_seen_motion(self) -> bool:
        """Whether something was added or has moved since the last time; remembers what."""
        now = self._others()
        moved = {name for name, position in now.items() if not self._is_at(position, name)}
        self._seen = {name: now[name] if name in moved else self._seen[name] for name in now}
        self._moved |= moved
        return bool(moved)

    def _is_at(self, position: Vector, name: str) -> bool:
        """Whether something is still where it was seen."""
        seen = self._seen.get(name)
        return seen is not None and bool((np.abs(position - seen) < _MOVED).all())

    def _look_ahead(self) -> None:
        """Check the next part of the motion, as far as it has not been checked yet."""
        motion = self._motion.trajectory
        first = max(self._row(), self._checked)
        ahead = min(self._row() + round(AHEAD_S / motion.dt), self._end)
        if first >= ahead:  # held by the guard: no unchecked part has come into range
            return
        near = self._within_reach(first, ahead)
        if not near:
            self._checked = ahead
            return
        if all(self._may_leave(name) for name in near):  # check again later
            return
        checker = CollisionChecker(self._world, self._arm, ignore=self._ignore)
        waiting = False
        for q in self._rows(first, ahead, checker.radii):
            contact = checker.contact(q)
            if contact is None or contact.failure().obstacle not in self._moved:
                continue
            if not self._may_leave(contact.second):
                raise self._failure(contact)
            waiting = True
        if not waiting:  # an arm that moves now may stop there
            self._checked = ahead

    def _within_reach(self, first: int, end: int) -> list[str]:
        """Names of moved arms and objects within reach of a part of the motion."""
        world = self._world
        motion = self._motion.trajectory
        rows = motion.piece(first, end).q
        # From where the arm is now: its spheres, and the largest turn of each joint on that part.
        turns = np.abs(rows - world.hardware[self._arm].q).max(axis=0)
        if self._bounded is not world.model:  # recompiled
            self._bounds = BoundingSpheres(world, self._arm)
            self._bounded = world.model
        own = self._bounds.spheres()
        reach = self._bounds.reach(self._bounds.levers(own), turns) + _STEP
        there = self._moved & (world.arms.keys() | world.objects.keys())
        return [name for name in there if apart(own, self._spheres(name)) < reach]

    def _spheres(self, name: str) -> Matrix:
        """Bounding spheres of an object, or of an arm and its payload, of shape (n, 4), m."""
        world = self._world
        arm = self._world.arms.get(name)
        if arm is None:
            geoms = [*world.object_geoms(name)]
        else:
            held = world.carried_by(name)
            payloads = (geom for one in held for geom in world.object_geoms(one))
            geoms = [*arm.geom_ids, *payloads]
        spheres: Matrix = np.empty((len(geoms), 4))
        spheres[:, :3] = world.sensed.geom_xpos[geoms]
        spheres[:, 3] = world.model.geom_rbound[geoms]
        return spheres

    def _row(self) -> int:
        """Current row of the trajectory."""
        return round(self._motion.parameter.s / self._motion.trajectory.dt)

    def _rows(self, first: int, end: int, radii: Vector) -> Matrix:
        """Configurations of a part of the motion, about `_STEP` apart, of shape (n, dof), rad.

        The last one is always included: the next part may be shorter than a step.
        """
        rows = self._motion.trajectory.piece(first, end).q
        moved = np.concatenate(((0.0,), np.cumsum(np.abs(np.diff(rows, axis=0)) @ radii)))
        _, kept = np.unique((moved / _STEP).astype(int), return_index=True)
        picked: Matrix = rows[[*kept[1:], -1]]
        return picked

    def _may_leave(self, body: str) -> bool:
        """Whether a link of an arm, or an object that an arm holds, is not there for good."""
        world = self._world
        holders = {attached.arm for attached in world.attachments if attached.object == body}
        arms = (world.hardware.get(name) for name in holders or {body.partition("/")[0]})
        return any(
            arm is not None and (self._waits_for_arms or np.abs(arm.v).max() > _RESTING)
            for arm in arms
        )

    def _others(self) -> dict[str, Vector]:
        """Joint positions of the other arms and poses of objects that this arm does not hold.

        A fixed object never moves: its pose stands for its presence.
        """
        world = self._world
        held = world.carried_by(self._arm)
        states = {name: arm.q for name, arm in world.hardware.items() if name != self._arm}
        for name in world.objects.keys() - held:
            obj = world.objects[name]
            if obj.fixed:
                states[name] = np.zeros(7)
            elif obj.joint is not None:
                states[name] = np.append(world.joint_position(name), np.zeros(6))
            else:
                start = world.pose_address(name)
                states[name] = world.sensed.qpos[start : start + 7].copy()
        return states

    def _failure(self, contact: Contact) -> BlockedFailure:
        return BlockedFailure(
            "IN_COLLISION",
            f"{contact.second} now blocks the path of {contact.first}",
            first=contact.first,
            second=contact.second,
            progress=self._motion.progress,
        )
