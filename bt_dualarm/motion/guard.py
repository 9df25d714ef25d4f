"""Watches an arm while it moves: slows it down near other arms, stops it before it meets them.

An arm has a way to rest at any time, which `RightOfWay` has found clear of those of the others.
Before it goes on for another moment, the way to rest that it would have then is looked at. If that
one is not clear, the arm follows the one that it has: it stops. It goes on when the way is clear.

Where the others are too far to be met in that moment, whatever the arms do, the way is not looked
at: the arm may do what it likes for that time.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from bt_dualarm.errors import Failure
from bt_dualarm.motion import timing
from bt_dualarm.motion.driver import LOOK_S, Driver
from bt_dualarm.motion.guard_report import GuardReport
from bt_dualarm.motion.limiter import SetPoint
from bt_dualarm.motion.motions import Motion, StreamMotion, TrajectoryMotion
from bt_dualarm.motion.posture import Posture
from bt_dualarm.motion.right_of_way import RightOfWay
from bt_dualarm.motion.surroundings import Surroundings
from bt_dualarm.motion.touch import Touch
from bt_dualarm.motion.trajectory import Trajectory
from bt_dualarm.motion.vicinity import CLEAR_M, NEAR, Vicinity, reason_of
from bt_dualarm.pose import Vector
from bt_dualarm.world.world import World

_WAITS = (25, 10, 5, 3, 2, 1)  # set-points of a stream that may pass unseen, where there is room
_EVERY = 5  # looks between two at the posture, which changes slowly


class Guard:
    """Judges what one arm is about to do.

    Args:
        world: That the arm is in.
        name: Of the arm.
        period: Seconds between set-points.

    Attributes:
        report: So far.
    """

    def __init__(self, world: World, name: str, period: float) -> None:
        self.report = GuardReport()
        self._world, self._name, self._period = world, name, period
        self._limits = world.robots[name].limits
        self._waits = [count * period for count in _WAITS]
        self._motion: Motion | None = None
        self._driver: Driver | None = None
        self._next = self._drive_at = self._free_until = -np.inf
        self._looks = 0
        self._generation = -1

    def look(self, motion: Motion, sent: SetPoint, time: float) -> Failure | None:
        """Let the motion go on, slow it down or hold it; returns why it must be given up, if so.

        Args:
            motion: What is followed.
            sent: The last set-point.
            time: Of the next one, in simulated seconds.
        """
        if time < self._next and motion is self._motion:
            return None
        self._next = time + LOOK_S - 1e-9
        self._refresh()
        if motion is not self._motion:
            self._begin(motion, sent, time)
        contact = self._touch.unwanted()
        if contact is not None:
            return self.report.given_up(contact)
        pace, reason = min(self._pace_of_posture(motion), self._pace_of_surroundings())
        refusal = None
        if self._driver is not None:
            if time >= self._drive_at:
                wait, refusal = self._driver.go_on(sent, pace, reason, time)
                self._drive_at = time + wait - 1e-9
            self._next = min(time + 2.0 * LOOK_S - 1e-9, self._drive_at)
        elif isinstance(motion, StreamMotion):
            self._pace_stream(motion, pace, reason)
        return refusal

    def permits(self, motion: StreamMotion, wanted: SetPoint, time: float) -> Failure | None:
        """Let a stream's set-point pass; or returns why the stream must be given up.

        Args:
            motion: The stream; gets its way to rest from there.
            wanted: The set-point, within the arm's limits.
            time: Of it, in simulated seconds.
        """
        if time < self._free_until:
            return None
        free = self._vicinity.leave_alone(wanted, time, self._waits)
        self._free_until = time + free - 1e-9
        if free > 0.0:
            motion.way_left = None
            return None
        rest = timing.stop(wanted.q, wanted.v, wanted.a, self._limits, self._period)
        gap = self._vicinity.admits(rest.q, time)
        self._vicinity.see(wanted, time)
        if gap is not None:
            return self.report.given_up(Failure("IN_COLLISION", reason_of(gap)))
        motion.way_left = rest
        return None

    def stop(self, motion: Motion | None, ways: Sequence[Trajectory], time: float) -> Trajectory:
        """Which way to rest an arm takes that must stop now.

        Args:
            motion: That it is in.
            ways: From the last set-point on, the preferred one first; the last one is that of
                joints which brake as hard as they can.
            time: Of the next set-point, in simulated seconds.
        """
        self._refresh()
        if self._way.alone:
            return ways[0]
        left = None if motion is None else motion.way_left
        keep = CLEAR_M if motion is not self._motion else self._vicinity.clear
        for way in ways:
            if self._way.take_way(way.to_come, time, keep).metres >= keep:
                return way
        way = ways[-1] if left is None else left
        self._way.insist(way.to_come, time)
        return way

    def rests(self, q: Vector, time: float) -> None:
        """Say that the arm stays at ``q``, of shape (dof,)."""
        self._refresh()
        if not self._way.alone:
            self._way.stand(q, time)

    def _begin(self, motion: Motion, sent: SetPoint, time: float) -> None:
        self._motion, self._drive_at, self._free_until = motion, -np.inf, -np.inf
        self._vicinity = Vicinity(self._way, self.report, sent, time)
        self._surroundings.begin()
        self._driver = None
        if isinstance(motion, TrajectoryMotion):
            self._driver = Driver(motion, self._vicinity, self._limits, self.report)

    def _pace_stream(self, motion: StreamMotion, pace: float, reason: str) -> None:
        if self._vicinity.pace < pace:
            pace, reason = self._vicinity.pace, NEAR
        if motion.go_at(pace) and pace < 1.0:
            self.report.slow(reason)

    def _pace_of_posture(self, motion: Motion) -> tuple[float, str]:
        self._looks += 1
        if self._looks % _EVERY == 0:
            report, posture = self.report, self._posture
            posture.look()
            report.nearest_limit_rad = min(report.nearest_limit_rad, posture.room)
            report.worst_condition = max(report.worst_condition, posture.condition)
        if isinstance(motion, TrajectoryMotion) and not motion.along_path:
            return 1.0, ""
        return self._posture.pace

    def _pace_of_surroundings(self) -> tuple[float, str]:
        pace = self._surroundings.pace
        self.report.nearest_body_m = min(self.report.nearest_body_m, self._surroundings.nearest)
        return pace

    def _refresh(self) -> None:
        """Look up what a recompilation of the world has moved."""
        world = self._world
        if self._generation == world.generation:
            return
        self._generation = world.generation
        self._motion = None
        self._way = RightOfWay(world, self._name, self._period)
        self._touch = Touch(world, self._name)
        self._posture = Posture(world, self._name)
        self._surroundings = Surroundings(world, self._name)
