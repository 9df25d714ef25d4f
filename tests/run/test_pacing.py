"""Real time: simulated time never runs ahead of the clock, and does not race to catch up."""

from __future__ import annotations

from bt_dualarm.run.pacing import RealTime, Unpaced


class Clock:
    def __init__(self) -> None:
        self.now = 100.0

    def __call__(self) -> float:
        return self.now

    def sleep(self, seconds: float) -> None:
        self.now += seconds


def test_it_waits_for_the_clock() -> None:
    clock = Clock()
    pacer = RealTime(clock, clock.sleep)
    for step in range(501):
        pacer.pace(step * 0.002)
    assert abs(clock.now - 101.0) < 0.002


def test_a_small_delay_is_caught_up() -> None:
    clock = Clock()
    pacer = RealTime(clock, clock.sleep)
    pacer.pace(0.0)
    clock.now += 0.3
    for step in range(1, 501):
        pacer.pace(step * 0.002)
    assert abs(clock.now - 101.0) < 0.002


def test_a_long_delay_is_not() -> None:
    clock = Clock()
    pacer = RealTime(clock, clock.sleep)
    pacer.pace(0.0)
    clock.now += 3.0
    for step in range(1, 501):
        pacer.pace(step * 0.002)
    assert abs(clock.now - 104.0) < 0.004


def test_unpaced_is_at_once() -> None:
    Unpaced().pace(1e9)
