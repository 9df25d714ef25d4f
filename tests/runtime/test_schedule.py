"""Periods: kept exactly for any timestep."""

from __future__ import annotations

from fractions import Fraction
from math import ceil

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bt_dualarm.runtime.clock import Periodic, exact


def due_steps(period: Fraction, timestep: Fraction, steps: int, first: int = 0) -> list[int]:
    periodic = Periodic(period, timestep, first)
    return [step for step in range(steps) if periodic.due(step)]


def test_a_multiple_of_the_step_is_evenly_spaced() -> None:
    assert due_steps(Fraction(1, 50), exact(0.002), 31) == [0, 10, 20, 30]


def test_sixty_hertz_at_two_milliseconds_alternates_and_does_not_drift() -> None:
    steps = due_steps(Fraction(1, 60), exact(0.002), 500 * 60 + 1)
    assert steps[:5] == [0, 9, 17, 25, 34]
    assert steps[-1] == 500 * 60
    assert len(steps) == 60 * 60 + 1


def test_a_period_below_the_step_is_due_at_every_step() -> None:
    assert due_steps(Fraction(1, 10000), exact(0.002), 4) == [0, 1, 2, 3]


def test_a_period_counts_from_its_first_step() -> None:
    assert due_steps(Fraction(3, 100), exact(0.01), 10, first=2) == [2, 5, 8]


def test_a_decimal_number_is_read_as_written() -> None:
    assert exact(0.002) == Fraction(1, 500)
    assert exact(0.1) == Fraction(1, 10)


def test_a_period_of_zero_is_refused() -> None:
    with pytest.raises(ValueError, match="positive"):
        Periodic(Fraction(0), Fraction(1, 500))


@given(
    period=st.fractions(Fraction(1, 500), Fraction(1, 2)),
    timestep=st.sampled_from([Fraction(1, 1000), Fraction(1, 500)]),
)
def test_each_multiple_falls_on_the_first_step_at_or_after_it(
    period: Fraction, timestep: Fraction
) -> None:
    for k, step in enumerate(due_steps(period, timestep, 300)):
        assert step == ceil(k * period / timestep)
