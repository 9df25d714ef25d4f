"""Guards an arm while it moves: slows it down near other arms, stops it before it meets them.

An arm has a braking trajectory at any time, which the fail-safe check has found clear of those of
the others. Before it goes on for another moment, the braking trajectory that it would have then is
checked. If that one is not clear, the arm follows the one that it has: it stops. It goes on when
the way is clear.

Where the others are too far to be met in that moment, whatever the arms do, no braking trajectory
is checked: the arm may do what it likes for that time.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from bt_dualarm.errors import Failure
from bt_dualarm.motion.collision.clearance import Clearance
from bt_dualarm.motion.collision.contacts import LinkContacts
from bt_dualarm.motion.kinematics.conditioning import Posture
from bt_dualarm.motion.safety.failsafe import FailSafeCheck
from bt_dualarm.motion.safety.report import GuardReport
from bt_dualarm.motion.safety.reservation import Reservations
from bt_dualarm.motion.safety.separation_rule import CLEAR_M, NEAR, SeparationRule, reason_of
from bt_dualarm.motion.safety.trajectory_guard import LOOK_S, TrajectoryGuard
from bt_dualarm.motion.setpoints.set_point import SetPoint, SetPointSource
from bt_dualarm.motion.setpoints.stream_source import StreamSource
from bt_dualarm.motion.setpoints.trajectory_source import TrajectorySource
from bt_dualarm.motion.timing.point_to_point import stop
from bt_dualarm.motion.timing.trajectory import Trajectory
from bt_dualarm.pose import Vector
from bt_dualarm.world.world import World

_WAITS = (25, 10, 5, 3, 2, 1)  # set-points of a stream that may pass unseen, where there is room
_EVERY = 5  # looks from one at the posture to the next: it changes slowly


class ArmGuard:
    """Judges what one arm is about to do.

    Args:
        world: World that the arm is in.
        name: Name of the arm.
        period: Seconds between set-points.
        reservations: Reservations of all arms of the world.

    Attributes:
        report: Report of what it has seen and done so far.
    """

    def __init__(self, world: World, name: str, period: float, reservations: Reservations) -> None:
        self.report = GuardReport()
        self._world, self._name, self._period = world, name, period
        self._reservations = reservations
        self._limits = world.robots[name].limits
        self._waits = [count * period for count in _WAITS]
        self._motion: SetPointSource | None = None
        self._trajectory: TrajectoryGuard | None = None
        self._next_look = self._next_check = self._free_until = -np.inf
        self._looks = 0
        self._scale, self._reason = 1.0, ""
        self._generation = -1

    @property
    def neighbours(self) -> tuple[str, ...]:
        """Names of the arms that this one can ever come near."""
        self._refresh()
        return self._check.others

    def look(self, motion: SetPointSource, sent: SetPoint, time: float) -> Failure | None:
        """Let the motion go on, slow it down or hold it; returns why it must be given up, if so.

        When it looks at the arm's posture and surroundings hangs on the motion alone: how near
        other arms are has no part in that.

        Args:
            motion: Source of the set-points that are followed.
            sent: The last set-point.
            time: Simulated time in s of the next one.
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
        wait, refusal = self._trajectory.go_on(sent, self._scale, self._reason, time)
        self._next_check = time + wait - 1e-9
        return refusal

    def touch(self) -> Failure | None:
        """Why the motion must be given up if a link touches something now."""
        self._refresh()
        contact = self._touch.unwanted()
        return None if contact is None else self.report.given_up(contact)

    def is_free(self, time: float) -> bool:
        """Whether a stream may do what it likes at a simulated time in s: nobody need ask."""
        return time < self._free_until

    def permits(self, motion: StreamSource, wanted: SetPoint, time: float) -> Failure | None:
        """Let a stream's set-point pass; or returns why the stream must be given up.

        Args:
            motion: The stream; gets its braking trajectory from there.
            wanted: Set-point, within the arm's limits.
            time: Simulated time in s of it.
        """
        if self.is_free(time):
            return None
        free = self._rule.leave_alone(wanted, time, self._waits)
        self._free_until = time + free - 1e-9
        if free > 0.0:
            motion.braking = None
            return None
        braking = stop(wanted.q, wanted.v, wanted.a, self._limits, self._period)
        gap = self._rule.admits(braking.q, time)
        self._rule.see(wanted, time)
        if gap is not None:
            return self.report.given_up(Failure("IN_COLLISION", reason_of(gap)))
        motion.braking = braking
        return None

    def stop(
        self, motion: SetPointSource | None, candidates: Sequence[Trajectory], time: float
    ) -> Trajectory:
        """Which braking trajectory an arm takes that must stop now.

        Args:
            motion: Source of set-points that it follows.
            candidates: Trajectories from the last set-point on, the preferred one first; the last
                one is that of joints which brake as hard as they can.
            time: Simulated time in s of the next set-point.
        """
        self._refresh()
        keep = dict.fromkeys(self._check.others, CLEAR_M)
        if motion is not None and motion is self._motion:
            keep = self._rule.clear
        for braking in candidates:
            if self._check.reserve_trajectory(braking.to_come, time, keep).clear:
                return braking
        reserved = None if motion is None else motion.braking
        braking = candidates[-1] if reserved is None else reserved
        self._check.reserve_regardless(braking.to_come, time)
        return braking

    def rests(self, q: Vector, time: float) -> None:
        """Say that the arm stays at ``q``, of shape (dof,), rad."""
        self._refresh()
        self._check.reserve_rest(q, time)

    def _begin(self, motion: SetPointSource, sent: SetPoint, time: float) -> None:
        self._motion = motion
        self._next_look = self._next_check = self._free_until = -np.inf
        self._looks = 0
        self._rule = SeparationRule(self._check, self.report, sent, time)
        self._surroundings.begin()
        self._trajectory = None
        if isinstance(motion, TrajectorySource):
            self._trajectory = TrajectoryGuard(motion, self._rule, self._limits, self.report)

    def _look_around(self, motion: SetPointSource, time: float) -> None:
        """Look at posture and surroundings; what they ask for is seen to at once."""
        self._scale, self._reason = min(self._posture_scale(motion), self._surroundings_scale())
        self._next_look = time + 2.0 * LOOK_S - 1e-9
        if isinstance(motion, StreamSource):
            self._next_look = time + LOOK_S - 1e-9
            self._scale_stream(motion, self._scale, self._reason)
        elif isinstance(motion, TrajectorySource) and motion.goal_scale != self._scale:
            self._next_check = time

    def _scale_stream(self, motion: StreamSource, scale: float, reason: str) -> None:
        if self._rule.time_scale < scale:
            scale, reason = self._rule.time_scale, NEAR
        if motion.change_scale(scale) and scale < 1.0:
            self.report.slow(reason)

    def _posture_scale(self, motion: SetPointSource) -> tuple[float, str]:
        """Time scale that the posture allows, and why, if that is less than 1."""
        self._looks += 1
        if self._looks % _EVERY == 1:
            report, posture = self.report, self._posture
            posture.look()
            report.nearest_limit_rad = min(report.nearest_limit_rad, posture.room)
            report.worst_condition = max(report.worst_condition, posture.condition)
        if isinstance(motion, TrajectorySource) and not motion.along_path:
            return 1.0, ""
        return self._posture.time_scale

    def _surroundings_scale(self) -> tuple[float, str]:
        """Time scale that scene and objects allow, and why, if that is less than 1."""
        scale = self._surroundings.time_scale
        self.report.nearest_body_m = min(self.report.nearest_body_m, self._surroundings.nearest)
        return scale

    def _refresh(self) -> None:
        """Look up what a recompilation of the world has moved."""
        world = self._world
        if self._generation == world.generation:
            return
        self._generation = world.generation
        self._motion = None
        self._check = FailSafeCheck(world, self._name, self._period, self._reservations)
        self._touch = LinkContacts(world, self._name)
        self._posture = Posture(world, self._name)
        self._surroundings = Clearance(world, self._name)
