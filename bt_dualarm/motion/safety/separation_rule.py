"""What the distance to other arms asks of one motion: how fast, and whether at all."""

from __future__ import annotations

from collections.abc import Sequence

from bt_dualarm.motion.collision.arm_distance import Gap
from bt_dualarm.motion.safety.failsafe import FailSafeCheck
from bt_dualarm.motion.safety.report import GuardReport
from bt_dualarm.motion.setpoints.set_point import SetPoint
from bt_dualarm.pose import Matrix

CLEAR_M = 0.03
"""Distance in metres that an arm keeps from others; less where it began nearer to them."""

FLOOR_M = 0.012
"""An arm that is nearer than that comes no nearer at all; before, by `NEARER_M` a motion."""

NEARER_M = 0.0005
"""See `FLOOR_M`."""

SLOW = ((0.05, 1.0), (0.025, 0.6), (0.0, 0.3))
"""Metres beyond that distance, and the time scale from there on."""

NEAR = "another arm is near"
"""Why an arm goes slower."""


class SeparationRule:
    """The other arms, as one motion meets them.

    Args:
        check: Fail-safe check of the arm.
        report: Report of its guard.
        sent: Set-point where the motion begins.
        time: Simulated time in s of that.

    Attributes:
        clear: Distances to keep in metres, by other arm.
        time_scale: Time scale that the trajectory reserved last allows.
    """

    def __init__(
        self, check: FailSafeCheck, report: GuardReport, sent: SetPoint, time: float
    ) -> None:
        self._check, self._report = check, report
        self.time_scale = 1.0
        self.clear = {
            name: clearance(gap.metres, CLEAR_M)
            for name, gap in check.present(sent.q, time).items()
        }

    def leave_alone(self, sent: SetPoint, time: float, waits: Sequence[float]) -> float:
        """Seconds for which the arm may do what it likes and stop then, and nobody will be near.

        The arm has reserved no more than that; 0 if there are none.

        Args:
            sent: Set-point where the arm is.
            time: Simulated time in s of the next one.
            waits: Seconds that are worth while, the longest first.
        """
        free = self._check.reserve_region(sent, time, self.clear, waits)
        if free > 0.0:
            self.time_scale = 1.0
        return free

    def admits(self, rows: Matrix, time: float, more: float = 0.0) -> Gap | None:
        """Reserve a trajectory, of shape (n, dof), if it is clear; else what is too near.

        Args:
            rows: Set-points from ``time`` on, to rest.
            time: Simulated time in s.
            more: Metres by which it must be clearer.
        """
        keep = {name: metres + more for name, metres in self.clear.items()}
        verdict = self._check.reserve_trajectory(rows, time, keep)
        if not verdict.clear:
            return verdict.gap
        beyond = verdict.spare + more
        self.time_scale = next(scale for least, scale in SLOW if beyond >= least)
        return None

    def see(self, sent: SetPoint, time: float) -> None:
        """Measure how near the others are now."""
        for gap in self._check.present(sent.q, time).values():
            self._report.nearest_arm_m = min(self._report.nearest_arm_m, gap.metres)


def reason_of(gap: Gap) -> str:
    """Why an arm must stop, in a sentence."""
    near = f"{1e3 * max(gap.metres, 0.0):.0f} mm"
    if not gap.first:
        return f"another arm would come to within {near}"
    return f"{gap.first} would come to within {near} of {gap.second}"


def clearance(present: float, wanted: float) -> float:
    """Distance to keep, in metres, by an arm that may already be nearer than is wanted."""
    return min(wanted, max(present - NEARER_M, min(present, FLOOR_M)))
