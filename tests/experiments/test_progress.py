"""The forecast of the remaining time is exact if runs take as long as what they simulate."""

from __future__ import annotations

import io
import re
from collections.abc import Sequence

import pytest
from hypothesis import given
from hypothesis import strategies as st
from rich.console import Console

from bt_dualarm.experiments.report import Forecast, shown_progress
from bt_dualarm.experiments.trials import CASES, Cell

CELLS = [Cell(case, speed) for case, speed in CASES]


ROUNDING_S = {"s": 0.5, "min": 30.0, "h": 180.0}
"""Rounding error by unit, s: whole seconds and minutes, tenths of an hour."""


def seconds(text: str) -> tuple[float, float]:
    """The time in a forecast and its rounding error, s."""
    found = re.search(r"about ([\d.]+) (s|min|h) left", text)
    assert found is not None, text
    unit = {"s": 1, "min": 60, "h": 3600}[found[2]]
    return float(found[1]) * unit, ROUNDING_S[found[2]]


@given(
    runs=st.lists(st.sampled_from(CELLS), min_size=2, max_size=30),
    over=st.integers(1, 29),
    pace=st.floats(0.05, 50.0),
)
def test_time_left_is_that_of_the_remaining_runs(
    runs: Sequence[Cell], over: int, pace: float
) -> None:
    """At a constant pace the forecast is exact except for rounding."""
    over = min(over, len(runs) - 1)
    costs = [pace * (1.0 + 1.0 / cell.speed) for cell in runs]
    now = [0.0]
    forecast = Forecast(runs, lambda: now[0])
    for cell, cost in zip(runs[:over], costs, strict=False):
        now[0] += cost
        forecast.count(cell)
    time_left, rounding = seconds(str(forecast))
    assert time_left == pytest.approx(sum(costs[over:]), abs=rounding + 1e-6)


def test_forecast_is_empty_before_the_first_run_and_after_the_last() -> None:
    forecast = Forecast(CELLS[:1])
    assert "after the first run" in str(forecast)
    forecast.count(CELLS[0])
    assert str(forecast) == ""


def test_progress_without_a_terminal_is_one_line_per_experiment() -> None:
    console = Console(file=io.StringIO(), width=60)
    runs = [CELLS[0]] * 3 + [CELLS[4]] * 3
    with shown_progress(runs, console) as is_over:
        for cell in runs:
            is_over(cell)
    assert isinstance(console.file, io.StringIO)
    lines = console.file.getvalue().splitlines()
    assert lines[0] == "6 runs"
    assert re.fullmatch(r"circle 0.5 predictive ray: 3 of 6 runs, about \d+ s left", lines[1])
    assert lines[2:] == ["lissajous 1 predictive ray: 6 of 6 runs"]


@pytest.mark.parametrize("width", [40, 80, 200])
def test_progress_bar_fits_the_terminal(width: int) -> None:
    console = Console(file=io.StringIO(), width=width, force_terminal=True, color_system=None)
    runs = [Cell("circle", 1.0, label="circle elsewhere", controller="proportional")] * 2
    with shown_progress(runs, console) as is_over:
        for cell in runs:
            is_over(cell)
    assert isinstance(console.file, io.StringIO)
    drawn = re.sub(r"\x1b\[[0-9;?]*[A-Za-z]", "", console.file.getvalue())
    assert "2/2" in drawn
    assert all(len(line) <= width for line in re.split(r"[\r\n]", drawn))
