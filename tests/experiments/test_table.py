"""The table of results is complete on a terminal of 80 columns or more."""

from __future__ import annotations

import io
from collections.abc import Sequence
from dataclasses import replace
from typing import get_args

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rich.console import Console

from bt_dualarm.experiments.report import Result, row, table_of
from bt_dualarm.experiments.trials import CASES, UNTUNED, Cell, ControllerName
from tests.experiments.test_results import synthetic_trial

CELLS = (*(Cell(case, speed) for case, speed in CASES), *UNTUNED)


def shown(results: Sequence[Result], width: int) -> list[str]:
    console = Console(file=io.StringIO(), width=width)
    console.print(table_of(results))
    assert isinstance(console.file, io.StringIO)
    return console.file.getvalue().splitlines()


@given(
    cell=st.sampled_from(CELLS),
    controller=st.sampled_from(get_args(ControllerName)),
    late=st.floats(0.0, 0.9),
    lost=st.integers(0, 999),
    width=st.integers(80, 200),
)
@settings(max_examples=40)
def test_every_number_is_complete_and_in_one_line(
    cell: Cell, controller: ControllerName, late: float, lost: int, width: int
) -> None:
    """The family: all experiments, with errors up to the diameter of the curve."""
    trial = replace(synthetic_trial(late), lost_count=lost)
    result = Result(replace(cell, controller=controller), [trial])
    lines = shown([result], width)
    assert max(map(len, lines)) <= width
    assert "…" not in "".join(lines)
    assert lines[-1].split() == " ".join(row(result)[:9]).split()


@pytest.mark.parametrize("width", [20, 50, 79])
def test_narrow_table_is_folded_and_complete(width: int) -> None:
    lines = shown([Result(UNTUNED[1], [synthetic_trial()])], width)
    assert max(map(len, lines)) <= width
    assert "…" not in "".join(lines)
