"""Takes a trajectory from one reservation to the next: slower, to a stop, and on again."""

from __future__ import annotations

import numpy as np

from bt_dualarm.errors import BlockedFailure, Failure
from bt_dualarm.motion.safety.report import GuardReport
from bt_dualarm.motion.safety.separation_rule import NEAR, SeparationRule, reason_of
from bt_dualarm.motion.setpoints.set_point import SetPoint
from bt_dualarm.motion.setpoints.time_scaling import ScaledPiece, sampled_at
from bt_dualarm.motion.setpoints.trajectory_source import TrajectorySource
from bt_dualarm.world.robots.robot import JointLimits

LOOK_S = 0.02
"""Simulated seconds between two looks near another arm."""

PIECE_S = 0.1
"""Likewise where none is near."""

RESUME_S = 0.3
"""Seconds ahead that must be clear before an arm that was stopped goes on."""

RESUME_M = 0.01
"""By how much clearer they must be, in metres."""


class TrajectoryGuard:
    """Guards one motion.

    Args:
        motion: Motion at its beginning, or wherever it is.
        rule: Separation rule of the motion.
        limits: Limits of the arm.
        report: Report in which it notes what it does.
    """

    def __init__(
        self,
        motion: TrajectorySource,
        rule: SeparationRule,
        limits: JointLimits,
        report: GuardReport,
    ) -> None:
        self._motion, self._rule = motion, rule
        self._limits, self._report = limits, report
        self._period = motion.trajectory.dt

    def go_on(
        self, sent: SetPoint, scale: float, reason: str, time: float
    ) -> tuple[float, Failure | None]:
        """Reserve the next piece of the motion; where that is not clear, it comes to rest.

        Args:
            sent: The last set-point.
            scale: Time scale that the arm's posture and surroundings allow.
            reason: Reason for that time scale, if it is less than 1.
            time: Simulated time in s of the next set-point.

        Returns:
            When to call again, in s from now; and why the motion must be given up, if so.
        """
        free = self._rule.leave_alone(sent, time, (PIECE_S, 0.5 * PIECE_S, LOOK_S))
        if free > 0.0 and self._change_to(scale, reason):
            return free, None
        self._rule.see(sent, time)
        wait = PIECE_S if self._rule.time_scale == 1.0 else LOOK_S
        if self._rule.time_scale < scale:
            scale, reason = self._rule.time_scale, NEAR
        refusal = self._take_next_piece(wait, scale, reason, time)
        if refusal is None:
            return wait, None
        return LOOK_S, self._hold(sent, refusal, time)

    def _change_to(self, scale: float, reason: str) -> bool:
        """Go at this time scale without a stop that is reserved; whether that can be."""
        motion = self._motion
        if motion.braking is None and (motion.goal_scale == scale or motion.changing):
            return True
        before = motion.goal_scale
        if not motion.change_scale(scale, self._limits):
            return motion.braking is None
        self._went_on(before, scale, reason)
        return True

    def _take_next_piece(self, wait: float, scale: float, reason: str, time: float) -> str | None:
        """Reserve the next piece of the motion and a stop; or returns why that must not be."""
        motion = self._motion
        held = motion.held_since is not None
        count = round((RESUME_S if held else wait) / self._period)
        ahead = motion.to_rest_after(count, scale, self._limits)
        leaves_path = ahead is None
        if ahead is None:
            ahead = motion.to_brake_after(count, self._limits)
        if ahead is None:  # its time scale is changing, and cannot change back
            return motion.held_up or "it is slowing down"
        gap = self._rule.admits(ahead.motion.to_come, time, RESUME_M if held else 0.0)
        if gap is not None:
            return reason_of(gap)
        before = motion.goal_scale
        motion.take(ahead, leaves_path=leaves_path)
        self._went_on(before, scale, reason)
        return None

    def _hold(self, sent: SetPoint, reason: str, time: float) -> Failure | None:
        """Let the motion come to rest on its path; returns why that cannot be, if so."""
        motion = self._motion
        if motion.leaves_path or (motion.braking is None and not self._stops(sent, time)):
            failure = BlockedFailure("IN_COLLISION", reason, progress=motion.progress)
            return self._report.given_up(failure)
        if motion.held_since is None:
            self._report.stop(reason)
            motion.held_since = time
        motion.goal_scale, motion.held_up = 0.0, reason
        return None

    def _stops(self, sent: SetPoint, time: float) -> bool:
        """Whether a motion that has reserved nothing yet can stop on its path."""
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

    def _went_on(self, before: float, scale: float, reason: str) -> None:
        self._motion.held_since, self._motion.held_up = None, ""
        if scale < before:
            self._report.slow(reason)
