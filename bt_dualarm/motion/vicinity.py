"""What the distance to other arms asks of one motion: how fast, and whether at all."""

from __future__ import annotations

from collections.abc import Sequence

from bt_dualarm.motion.guard_report import GuardReport
from bt_dualarm.motion.limiter import SetPoint
from bt_dualarm.motion.right_of_way import RightOfWay
from bt_dualarm.motion.separation import Gap
from bt_dualarm.pose import Matrix

CLEAR_M = 0.03
"""Distance in metres that an arm keeps from others; less where it began nearer to them."""

FLOOR_M = 0.012
"""An arm that is nearer than that comes no nearer at all; before, by `NEARER_M` a motion."""

NEARER_M = 0.0005
"""See `FLOOR_M`."""

SLOW = ((0.05, 1.0), (0.025, 0.6), (0.0, 0.3))
"""From how many metres beyond that distance on an arm goes at which pace."""


NEAR = "another arm is near"
"""Why an arm goes slower."""


class Vicinity:
    """The other arms, as one motion meets them.

    Args:
        way: Of the arm.
        report: Of its guard.
        sent: Where the motion begins.
        time: Likewise, in simulated seconds.

    Attributes:
        clear: Distance to keep in metres.
        pace: That the way taken last allows.
    """

    def __init__(self, way: RightOfWay, report: GuardReport, sent: SetPoint, time: float) -> None:
        self._way, self._report = way, report
        self.alone = way.alone
        self.pace = 1.0
        self.clear = CLEAR_M
        if not way.alone:
            self.clear = clearance(way.present(sent.q, time).metres, CLEAR_M)

    def leave_alone(self, sent: SetPoint, time: float, waits: Sequence[float]) -> float:
        """Seconds for which the arm may do what it likes and stop then, and nobody will be near.

        The arm is committed to no more than that; 0 if there are none.

        Args:
            sent: Where it is.
            time: Of the next set-point, in simulated seconds.
            waits: What is worth while, the longest first.
        """
        if self.alone:
            return waits[0]
        free = self._way.take_room(sent, time, self.clear, waits)
        if free > 0.0:
            self.pace = 1.0
        return free

    def admits(self, rows: Matrix, time: float, more: float = 0.0) -> Gap | None:
        """Commit the arm to a way, of shape (n, dof), if it is clear; else what is too near.

        Args:
            rows: Set-points from ``time`` on, to rest.
            time: Simulated, in seconds.
            more: Distance in metres by which it must be clearer.
        """
        keep = self.clear + more
        gap = self._way.take_way(rows, time, keep)
        if gap.metres < keep:
            return gap
        beyond = gap.metres - self.clear
        self.pace = next(pace for least, pace in SLOW if beyond >= least)
        return None

    def see(self, sent: SetPoint, time: float) -> None:
        """Measure how near the others are now."""
        gap = self._way.present(sent.q, time)
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
