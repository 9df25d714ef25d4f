"""Slow ticks: they are reported with their times, and the slowest are kept."""

from __future__ import annotations

import logging

import pytest

from bt_dualarm.behaviors.report import LeafReport
from bt_dualarm.runtime.outcome import MOST, SLOW_S, SlowTicks


def test_a_slow_tick_names_the_leaves_that_ran_in_it(caplog: pytest.LogCaptureFixture) -> None:
    leaves = [
        LeafReport("sequence/first", "wait", "SUCCESS", 0.0, 1.0),
        LeafReport("sequence/second", "wait", "FAILURE", 1.0, 2.0),
        LeafReport("sequence/third", "wait", "RUNNING", 2.0),
    ]
    slow = SlowTicks("arm1")
    with caplog.at_level(logging.WARNING):
        slow.check(1.0, SLOW_S - 0.01, leaves)
        slow.check(2.0, SLOW_S + 0.5, leaves)
    (tick,) = slow.slowest
    assert (tick.time_s, tick.wall_s) == (2.0, SLOW_S + 0.5)
    assert tick.leaves == ("sequence/second", "sequence/third")
    assert caplog.messages == [
        "arm1: the tick at 2.000 s took 2.5 s (sequence/second, sequence/third)"
    ]


def test_the_slowest_are_kept_in_the_order_of_time() -> None:
    slow = SlowTicks("arm1")
    for number in range(2 * MOST):
        slow.check(float(number), SLOW_S + (number * 7) % (2 * MOST), [])
    kept = slow.slowest
    assert len(kept) == MOST
    assert [tick.time_s for tick in kept] == sorted(tick.time_s for tick in kept)
    assert min(tick.wall_s for tick in kept) == SLOW_S + MOST
