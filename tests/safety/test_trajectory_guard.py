"""Trajectory guard: a motion is slowed on request, and goes on as planned afterward."""

from __future__ import annotations

from itertools import product

import pytest

from bt_dualarm.safety.failsafe import FailSafeCheck, Reservations
from bt_dualarm.safety.guard import GuardReport, SeparationRule, TrajectoryGuard
from bt_dualarm.trajectory.set_points import SetPoint, TrajectorySource
from tests.families import some
from tests.sim.worlds import PAGES, WIDE, world_with
from tests.trajectory.test_time_scaling import circular

SLOW_S = 0.7
"""Long enough for the slower speed to be reached and kept for a while."""

AGAIN_S = 0.5
"""Seconds within which the planned speed is reached again: a change takes 0.1 to 0.4 s."""


@pytest.mark.parametrize(("begin", "robot"), some(product((0.2, 0.4), (*WIDE, *PAGES)), 6))
def test_a_motion_soon_regains_its_planned_speed(robot: str, begin: float) -> None:
    """However long it was slowed, and wherever it is on its path."""
    world = world_with(robot)
    whole = circular(world.robots["arm1"], 0.6)
    motion = TrajectorySource(whole)
    report = GuardReport()
    check = FailSafeCheck(world, "arm1", whole.dt, Reservations())
    sent = motion.next(0.0)
    rule = SeparationRule(check, report, sent, 0.0)
    guard = TrajectoryGuard(motion, rule, world.robots["arm1"].limits, report)
    began = begin * whole.duration

    def go(seconds: float, scale: float, sent: SetPoint) -> SetPoint:
        """Advance with a requested time scale; the guard checks when it is due."""
        due = 0.0
        for step in range(round(seconds / whole.dt)):
            if step * whole.dt >= due:
                wait, refusal = guard.advance(sent, scale, "a test", step * whole.dt)
                assert refusal is None
                due = step * whole.dt + wait
            sent = motion.next(0.0)
        return sent

    sent = go(began, 1.0, sent)
    sent = go(SLOW_S, 0.5, sent)
    assert motion.parameter.scale == 0.5
    go(AGAIN_S, 1.0, sent)
    assert motion.parameter.scale == 1.0
    assert report.slowed == 1
