"""Takes a trajectory from one commitment to the next: at a pace, to a stop, and on again."""

from __future__ import annotations

import numpy as np

from bt_dualarm.errors import Failure
from bt_dualarm.motion.guard_report import GuardReport
from bt_dualarm.motion.limiter import SetPoint
from bt_dualarm.motion.motions import TrajectoryMotion
from bt_dualarm.motion.pace import Stretch, at_places
from bt_dualarm.motion.vicinity import NEAR, Vicinity, reason_of
from bt_dualarm.world.catalogue import JointLimits

LOOK_S = 0.02
"""Simulated seconds between two looks near another arm."""

PIECE_S = 0.1
"""Likewise where none is near."""

RESUME_S = 0.3
"""Seconds ahead that must be clear before an arm that was stopped goes on."""

RESUME_M = 0.01
"""By how much clearer they must be, in metres."""


class Driver:
    """Drives one motion.

    Args:
        motion: From its beginning, or from wherever it is.
        vicinity: Of the arm.
        limits: The arm's.
        report: What it does is noted here.
    """

    def __init__(
        self,
        motion: TrajectoryMotion,
        vicinity: Vicinity,
        limits: JointLimits,
        report: GuardReport,
    ) -> None:
        self._motion, self._vicinity = motion, vicinity
        self._limits, self._report = limits, report
        self._period = motion.trajectory.dt

    def go_on(
        self, sent: SetPoint, pace: float, reason: str, time: float
    ) -> tuple[float, Failure | None]:
        """Commit the motion to its next piece; where that is not clear, it comes to rest.

        Args:
            sent: The last set-point.
            pace: That the arm's posture and surroundings allow.
            reason: For that pace, if it is less than 1.
            time: Of the next set-point, in simulated seconds.

        Returns:
            When to call again, in s from now; and why the motion must be given up, if so.
        """
        free = self._vicinity.leave_alone(sent, time, (PIECE_S, 0.5 * PIECE_S, LOOK_S))
        if free > 0.0 and self._change_to(pace, reason):
            return free, None
        self._vicinity.see(sent, time)
        wait = PIECE_S if self._vicinity.pace == 1.0 else LOOK_S
        if self._vicinity.pace < pace:
            pace, reason = self._vicinity.pace, NEAR
        refusal = self._take_next_piece(wait, pace, reason, time)
        if refusal is None:
            return wait, None
        return LOOK_S, self._hold(sent, refusal, time)

    def _change_to(self, pace: float, reason: str) -> bool:
        """Go at this pace without being committed to a stop; whether that can be."""
        motion = self._motion
        if motion.way_left is None and (motion.goal_pace == pace or motion.changing):
            return True
        before = motion.goal_pace
        if not motion.go_at(pace, self._limits):
            return motion.way_left is None
        self._went_on(before, pace, reason)
        return True

    def _take_next_piece(self, wait: float, pace: float, reason: str, time: float) -> str | None:
        """Commit the motion to its next piece and a stop; or returns why that must not be."""
        motion = self._motion
        held = motion.held_since is not None
        count = round((RESUME_S if held else wait) / self._period)
        ahead = motion.to_rest_after(count, pace, self._limits)
        leaves_path = ahead is None
        if ahead is None:
            ahead = motion.to_brake_after(count, self._limits)
        if ahead is None:  # its pace is changing, and cannot change back
            return motion.held_up or "it is slowing down"
        gap = self._vicinity.admits(ahead.motion.to_come, time, RESUME_M if held else 0.0)
        if gap is not None:
            return reason_of(gap)
        before = motion.goal_pace
        motion.commit(ahead, pace, leaves_path=leaves_path)
        self._went_on(before, pace, reason)
        return None

    def _hold(self, sent: SetPoint, reason: str, time: float) -> Failure | None:
        """Let the motion come to rest on its path; returns why that cannot be, if so."""
        motion = self._motion
        if motion.leaves_path or (motion.way_left is None and not self._stops(sent, time)):
            failure = Failure("IN_COLLISION", reason, progress=motion.progress)
            return self._report.given_up(failure)
        if motion.held_since is None:
            self._report.stop(reason)
            motion.held_since = time
        motion.goal_pace, motion.held_up = 0.0, reason
        return None

    def _stops(self, sent: SetPoint, time: float) -> bool:
        """Whether a motion that is not committed to anything yet can stop on its path."""
        motion = self._motion
        if sent.v.any() or sent.a.any():
            ahead = motion.to_rest_after(0, 0.0, self._limits)
        else:
            still = np.array(((motion.place.s, 0.0, 0.0),))
            ahead = Stretch(still, at_places(motion.trajectory, still))
        if ahead is None or self._vicinity.admits(ahead.motion.to_come, time) is not None:
            return False
        motion.commit(ahead, 0.0)
        return True

    def _went_on(self, before: float, pace: float, reason: str) -> None:
        self._motion.held_since, self._motion.held_up = None, ""
        if pace < before:
            self._report.slow(reason)
