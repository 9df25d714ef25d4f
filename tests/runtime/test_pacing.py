"""Real-time pacing: simulated time is never ahead of the clock, and does not race to catch up."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from bt_dualarm.runtime.clock import RealTime


class Clock:
    def __init__(self) -> None:
        self.now = 100.0

    def __call__(self) -> float:
        return self.now

    def sleep(self, seconds: float) -> None:
        self.now += seconds


def test_simulated_time_waits_for_the_clock() -> None:
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


def test_a_long_delay_is_not_caught_up() -> None:
    clock = Clock()
    pacer = RealTime(clock, clock.sleep)
    pacer.pace(0.0)
    clock.now += 3.0
    for step in range(1, 501):
        pacer.pace(step * 0.002)
    assert abs(clock.now - 104.0) < 0.004


@given(st.lists(st.floats(0.0, 1.0), min_size=1, max_size=100))
def test_simulated_time_is_never_ahead_of_the_clock(delays: list[float]) -> None:
    """Whatever time the steps take; it may be ahead by 1 ms, for which a sleep is not worth it."""
    clock = Clock()
    pacer = RealTime(clock, clock.sleep)
    pacer.pace(0.0)
    began = clock.now
    for step, delay in enumerate(delays, start=1):
        clock.now += delay
        pacer.pace(step * 0.01)
        assert step * 0.01 <= clock.now - began + 0.001 + 1e-9
